"""A plain soil to hold the engine against: every pair looked at, dense histories, one particle after another.

Written from docs/contact_laws.md and shares no code with subsoil_ros.dem: no neighbour list, no sorting, no
slabs. Compiled only because all pairs of a few hundred particles over a thousand steps are 1e8 distances.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

EVENTS = (
    "zone_1", "zone_2", "zone_3", "sticking", "sliding", "rolling_yield", "separation", "wall_contact",
    "wall_sliding",
)  # fmt: skip
"""What `ReferenceSoil.seen` counts, in this order. Zones, slip and yield are those of particle pairs."""

TOTAL, REPULSIVE, ABSOLUTE = 0, 1, 2
LINEAR, SOFTENING, TOTAL_SPRING, INCREMENTAL = 0, 1, 2, 3
"""Springs: linear, or Hertzian, stiffness growing with the root of the overlap. The tangential force of a
Hertzian contact that softens shrinks with the stiffness, while one that stiffens keeps it (SOFTENING, as
docs/contact_laws.md says; its rolling torque likewise), or is stiffness times displacement (TOTAL_SPRING), or
is kept (INCREMENTAL)."""


class Law(NamedTuple):
    """One row of numbers, of a pair. SI, as in the scene."""

    stiffness: float
    tangential_stiffness: float
    damping: float
    tangential_damping: float
    static_friction: float
    sliding_friction: float
    rolling_friction: float
    adhesion: float = 0.0
    rest_overlap: float = 0.0
    reach: float = 0.0  # 0 without adhesion: a contact ends where the spheres part
    friction_normal: int = TOTAL
    damp_all: bool = False
    springs: int = LINEAR


def linear_law(row: dict) -> Law:
    """A row of a `linear` law: pair values as they stand."""
    return Law(*(row[key] for key in _LINEAR))


def wet_laws(particle: dict, boundary: dict, friction_normal: int = TOTAL, damp_all: bool = False):
    """Pair laws of particle with particle and with boundary: springs in series (eq. 15, 16, 18)."""

    def series(key, row):
        a, b = particle[key], row[key]
        return a * b / (a + b) if a + b > 0.0 else 0.0

    def law(row):
        adhesion = series("cohesive_stiffness_newton_per_m", row)
        return Law(
            *(series(key, row) for key in _LINEAR[:4]), *(row[key] for key in _LINEAR[4:]), adhesion,
            row["equilibrium_overlap_m"], row["cohesion_range_m"] if adhesion > 0.0 else 0.0, friction_normal,
            damp_all,
        )  # fmt: skip

    return law(particle), law(boundary)


def hertz_law(first, second, restitution, friction, radius, mass, springs=SOFTENING) -> Law:
    """Hertz and Mindlin; bodies (Young's modulus, nu), effective radius and mass.

    Stiffness per root of overlap, dashpots per fourth root, 2 sqrt(5/6) beta sqrt(S m) with S_n = 1.5 k_n.
    """
    moduli = [
        (young / (1.0 - nu**2), young / (2.0 * (1.0 + nu) * (2.0 - nu))) for young, nu in (first, second)
    ]
    normal, shear = (1.0 / (1.0 / a + 1.0 / b) for a, b in zip(*moduli, strict=True))
    k_n, k_t = 4.0 / 3.0 * normal * np.sqrt(radius), 8.0 * shear * np.sqrt(radius)
    damping = -2.0 * np.sqrt(5.0 / 6.0) * np.log(restitution) / np.hypot(np.log(restitution), np.pi)
    c_n, c_t = damping * np.sqrt(1.5 * k_n * mass), damping * np.sqrt(k_t * mass)
    return Law(k_n, k_t, c_n, c_t, friction, friction, 0.0, springs=springs)


_LINEAR = (
    "stiffness_newton_per_m", "tangential_stiffness_newton_per_m", "damping_newton_s_per_m",
    "tangential_damping_newton_s_per_m", "static_friction", "sliding_friction", "rolling_friction",
)  # fmt: skip


class ReferenceSoil:
    """Spheres in a box of planes; arrays (n, 3), world axes, SI.

    planes (walls, 4): normal towards the wall, and its distance from the origin. With `backwards` pairs are
    summed in the opposite order: what that changes is the size of round-off.
    """

    def __init__(self, position, velocity, spin, *, radius, density, gravity, planes, laws, backwards=False):
        self.position, self.velocity, self.spin = (np.array(a, float) for a in (position, velocity, spin))
        self.radius, self.planes, self.laws, self.gravity = radius, np.asarray(planes, float), laws, gravity
        self.mass = density * 4.0 / 3.0 * np.pi * radius**3
        self.inertia = 0.4 * self.mass * radius**2
        self.backwards = backwards
        n, walls = len(self.position), len(self.planes)
        self.pair_springs = np.zeros((n, n, 2, 3))  # [i, j], i < j: shear [m] and roll [rad] of i against j
        self.wall_springs = np.zeros((n, walls, 2, 3))
        self.touching = np.zeros((n, n), np.bool_)
        self.force, self.torque = np.zeros((n, 3)), np.zeros((n, 3))
        self.counts = np.zeros(len(EVENTS), np.int64)
        self._sum_forces(0.0)

    @property
    def seen(self) -> dict[str, int]:
        """How often each of EVENTS happened."""
        return dict(zip(EVENTS, self.counts.tolist(), strict=True))

    def _sum_forces(self, step):
        self.force[:] = (0.0, 0.0, -self.mass * self.gravity)
        self.torque[:] = 0.0
        _add_forces(
            self.position, self.velocity, self.spin, self.force, self.torque, self.pair_springs,
            self.wall_springs, self.touching, self.planes, self.radius, step, *self.laws, self.backwards,
            self.counts,
        )  # fmt: skip

    def advance(self, step: float) -> None:
        """Velocity Verlet: half kick, drift, forces at the half-step velocity, half kick."""
        self._kick(0.5 * step)
        self.position += step * self.velocity
        self._sum_forces(step)
        self._kick(0.5 * step)

    def _kick(self, time):
        self.velocity += time / self.mass * self.force
        self.spin += time / self.inertia * self.torque


@njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def _cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(cache=True)
def _plus(a, factor, b):
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


@njit(cache=True)
def _row(array, i):
    return (array[i, 0], array[i, 1], array[i, 2])


@njit(cache=True)
def _elastic(overlap, law):
    """Normal force without damping and the number of its zone."""
    if law.springs != LINEAR:
        return law.stiffness * np.sqrt(max(overlap, 0.0)) * overlap, 1
    if overlap > law.rest_overlap:
        return law.stiffness * (overlap - law.rest_overlap), 1
    if law.adhesion == 0.0:
        return 0.0, 2
    if overlap >= 0.0:
        slope = law.adhesion * law.reach / law.rest_overlap
        return -slope * (law.rest_overlap - overlap), 2
    return -law.adhesion * (law.reach + overlap), 3


@njit(cache=True)
def _contact(overlap, n, velocity, spin, springs, effective_radius, step, law):
    """Force and torque on the first body; `springs` (2, 3), shear and roll, are carried on in place.

    Returns force, torque, zone, whether it slides, whether the rolling spring yields.
    """
    approach = _dot(velocity, n)
    normal, zone = _elastic(overlap, law)
    stiffer, before = 1.0, 1.0
    if law.springs != LINEAR:
        stiffer, before = np.sqrt(overlap), np.sqrt(max(overlap - step * approach, 0.0))
    if zone == 1 or law.damp_all:
        normal += law.damping * np.sqrt(stiffer) * approach
    if law.friction_normal == REPULSIVE:
        pressing = max(normal, 0.0)
    elif law.friction_normal == ABSOLUTE:
        pressing = abs(normal)
    else:
        pressing = max(normal + law.adhesion * law.reach, 0.0)

    # spring and damper in parallel, in series with a slider: the force if the slider held
    tangent = _plus(velocity, -approach, n)
    shear = _row(springs, 0)
    shear = _plus(shear, -_dot(shear, n), n)
    if law.springs == INCREMENTAL or (law.springs == SOFTENING and before < stiffer):
        shear = (before / stiffer * shear[0], before / stiffer * shear[1], before / stiffer * shear[2])
    k, c = law.tangential_stiffness * stiffer, law.tangential_damping * np.sqrt(stiffer)
    held = _plus(shear, step, tangent)
    held = (k * held[0] + c * tangent[0], k * held[1] + c * tangent[1], k * held[2] + c * tangent[2])
    size = np.sqrt(_dot(held, held))
    sliding = size > law.static_friction * pressing
    drag = held
    if sliding:
        part = min(law.sliding_friction * pressing / size, 1.0)
        drag = (part * held[0], part * held[1], part * held[2])
    # the spring must carry the drag less its damper: drag = k shear' + c (shear' - shear) / step
    if k * step + c > 0.0:
        rate = _plus(drag, -k, shear)
        shear = _plus(shear, step / (k * step + c), rate)

    turn = _plus(spin, -_dot(spin, n), n)
    roll = _row(springs, 1)
    if law.springs == SOFTENING and before < stiffer:
        roll = (before / stiffer * roll[0], before / stiffer * roll[1], before / stiffer * roll[2])
    roll = _plus(_plus(roll, -_dot(roll, n), n), step, turn)
    stiffness = k * effective_radius**2
    limit = law.rolling_friction * effective_radius * pressing
    angle = np.sqrt(_dot(roll, roll))
    yields = stiffness * angle > limit
    if yields:
        part = limit / (stiffness * angle)
        roll = (part * roll[0], part * roll[1], part * roll[2])
    for a in range(3):
        springs[0, a] = shear[a]
        springs[1, a] = roll[a]
    force = (-normal * n[0] - drag[0], -normal * n[1] - drag[1], -normal * n[2] - drag[2])
    torque = (-stiffness * roll[0], -stiffness * roll[1], -stiffness * roll[2])
    return force, torque, zone, sliding, yields


@njit(cache=True)
def _add_forces(
    position, velocity, spin, force, torque, pair_springs, wall_springs, touching, planes, radius, step,
    law, boundary, backwards, counts,
):  # fmt: skip
    count = position.shape[0]
    pairs = count * count
    for number in range(pairs):
        flat = pairs - 1 - number if backwards else number
        i, j = flat // count, flat % count
        if i >= j:
            continue
        between = _plus(_row(position, j), -1.0, _row(position, i))
        distance = np.sqrt(_dot(between, between))
        if distance >= 2.0 * radius + law.reach:
            if touching[i, j]:
                counts[6] += 1
            touching[i, j] = False
            pair_springs[i, j] = 0.0
            continue
        touching[i, j] = True
        n = (between[0] / distance, between[1] / distance, between[2] / distance)
        arm = 0.5 * distance
        slip = _plus(_row(velocity, i), -1.0, _row(velocity, j))
        slip = _plus(slip, arm, _cross(_plus(_row(spin, i), 1.0, _row(spin, j)), n))
        f, m, zone, sliding, yields = _contact(
            2.0 * radius - distance, n, slip, _plus(_row(spin, i), -1.0, _row(spin, j)), pair_springs[i, j],
            0.5 * radius, step, law,
        )  # fmt: skip
        twist = _cross(n, f)
        for a in range(3):
            force[i, a] += f[a]
            force[j, a] -= f[a]
            torque[i, a] += arm * twist[a] + m[a]
            torque[j, a] += arm * twist[a] - m[a]
        counts[zone - 1] += 1
        counts[4 if sliding else 3] += 1
        counts[5] += yields
    for i in range(count):
        for w in range(planes.shape[0]):
            n = _row(planes, w)
            distance = planes[w, 3] - _dot(n, _row(position, i))
            if distance >= radius + boundary.reach:
                wall_springs[i, w] = 0.0
                continue
            arm = 0.5 * (radius + distance)
            slip = _plus(_row(velocity, i), arm, _cross(_row(spin, i), n))
            f, m, _, sliding, _ = _contact(
                radius - distance, n, slip, _row(spin, i), wall_springs[i, w], radius, step, boundary
            )
            twist = _cross(n, f)
            for a in range(3):
                force[i, a] += f[a]
                torque[i, a] += arm * twist[a] + m[a]
            counts[7] += 1
            counts[8] += sliding
