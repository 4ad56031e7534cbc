"""Checks of a running soil every so many steps; they stop a run whose numbers are no longer physics.

A step that is too large does not blow up: friction caps the instability, the bed fluidises, and the draft
falls unnoticed. It shows in velocities that reverse sign from one step to the next. Velocity Verlet gives the
velocities half a step before and after a state, v -+ h a / 2. Over all particles

    indicator = sum (h a / 2)^2 / (sum v^2 + sum (h a / 2)^2)

is 0 if they are equal and 1 if they are opposite (v of the state is then 0: the motion is not visible at
whole steps). It is computed from angular velocities too; the larger value counts. Forces change over many
stable steps, so a healthy bed shows less than 0.02, whatever the speed of its tools, and one above its limit
0.25 to 1 (validation/soil_engine.md).
"""

import logging
from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit, prange

from ..errors import PhysicsError
from ..messages import LostParticle
from ..scene.soil import Soil
from .domain import Domain
from .energy import EnergyBook
from .particles import Particles
from .per_particle import PARTS, added_up, of_particle

CONFIRMING_STEPS = 10
"""Steps in a row, after the first one above the bound, that must exceed it too before the run stops: a few
particles that reverse together in a collision alternate for a step or two."""

CALM_M_PER_S = 1e-6
"""Rms speed below which alternating motion counts as rounding: 3.6 mm in an hour."""

ONE_IN = 1000
"""One lost particle in so many, and at least one, is allowed if the scene gives no number: without them the
draft changes by less than a tenth of what another seed of the bed changes."""

NAMED = 3
"""Number of lost particles, the first ones, that messages name."""

_logger = logging.getLogger(__name__)


class MotionSums(NamedTuple):
    """Sums over particles; `half` is what the forces of one state add in half a step."""

    speed2: float  # v.v [m2/s2]
    half_speed2: float
    spin2: float  # w.w [rad2/s2]
    half_spin2: float
    place: float  # sum of coordinates [m]: not finite if a place is not

    @property
    def velocity_reversal(self) -> float:
        """Velocity reversal indicator, 0 to 1: the larger one of linear and angular velocities."""
        return max(_part(self.half_speed2, self.speed2), _part(self.half_spin2, self.spin2))


def _part(half2: float, whole2: float) -> float:
    return half2 / (half2 + whole2) if half2 > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _part_sums(first, last, kinematics, loads, masses, step):
    position, velocity, angular_velocity = kinematics
    force, torque = loads
    mass, inertia = masses
    v2, a2, w2, t2, place = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(first, last):
        by_force, by_torque = 0.5 * step / of_particle(mass, i), 0.5 * step / of_particle(inertia, i)
        for a in range(3):
            v2 += velocity[i, a] * velocity[i, a]
            a2 += (by_force * force[i, a]) ** 2
            w2 += angular_velocity[i, a] * angular_velocity[i, a]
            t2 += (by_torque * torque[i, a]) ** 2
            place += position[i, a]
    return v2, a2, w2, t2, place


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def half_step_sums(kinematics, loads, masses, step):
    """MotionSums, in an order that the threads do not change."""
    n = kinematics.position.shape[0]
    v2, a2, w2, t2 = np.zeros(PARTS), np.zeros(PARTS), np.zeros(PARTS), np.zeros(PARTS)
    place = np.zeros(PARTS)
    for part in prange(PARTS):
        v2[part], a2[part], w2[part], t2[part], place[part] = _part_sums(
            part * n // PARTS, (part + 1) * n // PARTS, kinematics, loads, masses, step
        )
    return added_up(v2), added_up(a2), added_up(w2), added_up(t2), added_up(place)


class Observable(Protocol):
    """A soil that is checked; each method computes its value when called."""

    @property
    def particle_count(self) -> int: ...
    def particles(self) -> Particles: ...
    def motion_sums(self) -> MotionSums: ...
    def max_overlap_m(self) -> float: ...
    def any_outside(self) -> bool: ...
    def energy(self) -> EnergyBook: ...


class SoilMonitor:
    """Checks one soil and records which particles were lost."""

    def __init__(self, soil: Soil, domain: Domain, count: int) -> None:
        assert soil.monitors is not None
        self._bounds, self._domain, self._radius = soil.monitors, domain, soil.particles.bounds_m[0]
        self._allowed, self.count = soil.max_lost_particles, count  # particles there were so far
        self._gone = np.empty(0, np.int64)  # identities
        self.first_lost: list[LostParticle] = []
        # no tool may cross a particle undetected between two checks; a rebuild means a motion by half a skin
        self._hurry_steps = soil.monitors.every_steps * soil.skin_m / (4.0 * self._radius)
        self._steps, self._suspicious, self._rebuild_step, self._hurried = 0, 0, 0, 0
        self._start_joule: float | None = None
        self._largest_kinetic = 0.0

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint; not copied."""
        start = np.nan if self._start_joule is None else self._start_joule
        return {
            "gone": self._gone,
            "first_lost": np.array([(lost.identity, lost.tick) for lost in self.first_lost], np.int64),
            "first_lost_m": np.array(
                [(lost.x_m, lost.y_m, lost.z_m) for lost in self.first_lost], np.float64
            ),
            "counts": np.array([self._steps, self._suspicious, self._rebuild_step, self._hurried]),
            "joules": np.array([start, self._largest_kinetic]),
        }

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Continue from arrays of `state_arrays`."""
        self._gone = arrays["gone"]
        self.first_lost = [
            LostParticle(identity, x, y, z, tick)
            for (identity, tick), (x, y, z) in zip(
                arrays["first_lost"].tolist(), arrays["first_lost_m"].tolist(), strict=True
            )
        ]
        self._steps, self._suspicious, self._rebuild_step, self._hurried = arrays["counts"].tolist()
        start, self._largest_kinetic = arrays["joules"].tolist()
        self._start_joule = None if np.isnan(start) else start

    @property
    def lost_count(self) -> int:
        """Particles that have left the domain since the start, up to the last check."""
        return len(self._gone)

    @property
    def _alarm(self) -> int:
        return max(1, self.count // ONE_IN) if self._allowed is None else self._allowed

    @property
    def balances(self) -> bool:
        """Whether the energy is checked."""
        return self._bounds.max_energy_defect is not None

    def begin(self, book: EnergyBook) -> None:
        """Balance the energy from this state on."""
        self._start_joule, self._largest_kinetic = book.total_joule, book.kinetic_joule

    def note_rebuild(self) -> None:
        """Note a rebuild of lists in the step counted next; if soon after the last one, it is checked."""
        self._hurried = int(self._steps - self._rebuild_step < self._hurry_steps)
        self._rebuild_step = self._steps

    def due(self, *, last: bool) -> bool:
        """Count one more step, and return whether it is to be checked."""
        self._steps += 1
        hurried, self._hurried = self._hurried, 0
        return last or hurried > 0 or self._suspicious > 0 or self._steps % self._bounds.every_steps == 0

    def steps_until_due(self) -> int:
        """Steps from now on until the next check, if no list is rebuilt and the run does not end before."""
        if self._hurried > 0 or self._suspicious > 0:
            return 1
        return self._bounds.every_steps - self._steps % self._bounds.every_steps

    def check(self, where: str, tick: int, soil: Observable) -> None:
        """Check the state at the end of a step; `where` names the step in messages.

        Raises:
            PhysicsError: a bound is exceeded, or a value is not finite.
        """
        sums = soil.motion_sums()
        if not np.isfinite(sums).all():
            refuse_lost_numbers(where, soil.particles())
        self._check_velocity_reversal(where, sums, soil.particle_count)
        if self._suspicious > 1:
            return  # the rest was checked when the suspicion arose
        self._check_overlap(where, soil.max_overlap_m)
        if soil.any_outside():
            self._check_lost(where, tick, soil.particles())
        if self.balances:
            self._check_balance(where, soil.energy())

    def _check_velocity_reversal(self, where: str, sums: MotionSums, count: int) -> None:
        bound = self._bounds.max_velocity_reversal
        surface_m2 = sums.half_speed2 + self._radius**2 * sums.half_spin2
        if bound is None or sums.velocity_reversal <= bound or surface_m2 <= count * CALM_M_PER_S**2:
            self._suspicious = 0
            return
        self._suspicious += 1
        if self._suspicious > CONFIRMING_STEPS:
            spin = np.sqrt((sums.spin2 + sums.half_spin2) / count)
            raise PhysicsError(
                f"{where}: velocities reverse sign from one step to the next: velocity reversal indicator "
                f"{sums.velocity_reversal:.3g} (rms angular velocity {spin:.3g} rad/s), allowed is "
                f"soil.monitors.max_velocity_reversal {bound:g}; the step is too large for this bed "
                "and lowers the draft: use a smaller soil.time_step_s"
            )

    def _check_overlap(self, where: str, max_overlap_m: Callable[[], float]) -> None:
        bound = self._bounds.max_pair_overlap_radii
        if bound is None:
            return
        overlap = max_overlap_m() / self._radius
        if overlap > bound:
            raise PhysicsError(
                f"{where}: two particles overlap by {overlap:.3g} radii, allowed is "
                f"soil.monitors.max_pair_overlap_radii {bound:g}; they may pass through each other: use "
                "a stiffer soil.law, or move the tools slower"
            )

    def _check_lost(self, where: str, tick: int, particles: Particles) -> None:
        outside = self._domain.outside(particles)
        new = np.flatnonzero(outside)
        new = new[~np.isin(particles.identity[new], self._gone)]
        if len(new) == 0:
            return
        new = new[np.argsort(particles.identity[new])]
        first = self.lost_count == 0
        self._gone = np.append(self._gone, particles.identity[new])
        for k in new[: NAMED - len(self.first_lost)]:
            x, y, z = particles.position[k].tolist()
            self.first_lost.append(LostParticle(int(particles.identity[k]), x, y, z, tick))
        found = f"{where}: {self.lost_count} of {self.count} particles have left the domain, {self._names()}"
        if self.lost_count > self._alarm:
            raise PhysicsError(
                f"{found}; allowed is soil.max_lost_particles {self._alarm}; use a smaller "
                "soil.time_step_s, a stiffer soil.law.boundary, or a path that presses no soil through a wall"
            )
        if first:
            _logger.warning("warning: %s", found)

    def _names(self) -> str:
        return ", ".join(
            f"particle {lost.identity} at ({lost.x_m:.3f}, {lost.y_m:.3f}, {lost.z_m:.3f}) m in tick "
            f"{lost.tick}"
            for lost in self.first_lost
        )

    def _check_balance(self, where: str, now: EnergyBook) -> None:
        bound = self._bounds.max_energy_defect
        self._largest_kinetic = max(self._largest_kinetic, now.kinetic_joule)
        if bound is None or self._start_joule is None:
            return
        defect = now.total_joule - self._start_joule
        exchanged = now.turned_over_joule + self._largest_kinetic
        if abs(defect) > bound * exchanged:
            raise PhysicsError(
                f"{where}: the energy book is off by {defect:.3g} J, {abs(defect) / exchanged:.2g} of the "
                f"{exchanged:.3g} J exchanged, allowed is soil.monitors.max_energy_defect {bound:g}; use "
                "a smaller soil.time_step_s"
            )


@njit(cache=True, nogil=True)
def _all_finite(kinematics):
    position, velocity, angular_velocity = kinematics
    rest = 0.0
    for i in range(position.shape[0]):
        for a in range(3):
            rest += 0.0 * position[i, a] + 0.0 * velocity[i, a] + 0.0 * angular_velocity[i, a]
    return rest == 0.0


def refuse_lost_numbers(where: str, particles: Particles) -> None:
    """Check that places, velocities and angular velocities are finite; name the first particle that fails.

    Raises:
        PhysicsError: a particle fails.
    """
    p = particles
    if _all_finite(p.kinematics):
        return
    finite = (np.isfinite(p.position) & np.isfinite(p.velocity) & np.isfinite(p.angular_velocity)).all(axis=1)
    bad = np.flatnonzero(~finite)
    k = bad[np.argmin(p.identity[bad])]
    raise PhysicsError(
        f"{where}: particle {p.identity[k]} is no longer a number, {len(bad) - 1} others too: position "
        f"{p.position[k]} m, velocity {p.velocity[k]} m/s, angular velocity {p.angular_velocity[k]} rad/s, "
        f"last force {p.force[k]} N, torque {p.torque[k]} N m; use a smaller soil.time_step_s"
    )
