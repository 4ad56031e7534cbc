"""The contact law: one function for particle-particle, particle-wall and particle-tool.

Sources: Yuan & Yu (2020) eq. 12-21 with eq. 17 corrected (continuity), table 3; what the paper leaves
open is chosen in docs/physics.md: friction limit, damped zones, lifetime of the tangential spring, rolling.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import overload

from ..scene.pairs import PairValues, layer_soils, pair_values
from ..scene.soil import CohesiveLinearLaw, Soil
from .compiled import inner_kernel
from .inverse_root import inverse_root

SINKS = ("normal_dashpot", "tangential_dashpot", "sliding", "rolling", "separation")
"""Energy sinks a contact books, in this order, joule."""


class PairLaw(NamedTuple):
    """Numbers of one kind of pair. SI."""

    stiffness: float  # K_X [N/m]
    tangential_stiffness: float  # K_Y = K_Z [N/m]
    damping: float  # C_X [N s/m]
    tangential_damping: float  # C_Y = C_Z [N s/m]
    adhesion: float  # K_B [N/m]
    contact_adhesion: float  # K_C [N/m]
    rest_overlap: float  # delta_c [m]
    reach: float  # delta_B [m]
    peak_attraction: float  # K_C delta_c [N]
    static_friction: float
    sliding_friction: float
    rolling_stiffness: float  # K_Y R_eff^2 [N m/rad]
    rolling_arm: float  # mu_r R_eff [m]: torque limit over normal force


YES, NO = np.zeros((1, 1)), np.zeros(1)
"""Values of Features."""


class Features(NamedTuple):
    """What the law contains, told to the compiler: an array of two dimensions says yes, of one no.

    Number of dimensions is part of numba's type, so the code of an absent feature is not compiled; values
    matter in `periodic` only. (Tuples and literals would say it more plainly, but do not pass into parallel
    loops.)
    """

    adhesion: np.ndarray
    tangential: np.ndarray
    rolling: np.ndarray
    hertz: np.ndarray  # stiffness grows with the root of the overlap
    damp_all_zones: np.ndarray
    friction_repulsive: np.ndarray  # neither of the two: friction is limited by F_n + F_peak
    friction_absolute: np.ndarray
    book: np.ndarray  # book every energy sink
    sizes: np.ndarray = NO  # radii differ: dem.mixture
    materials: np.ndarray = NO  # laws or densities differ: dem.mixture
    periodic: np.ndarray = NO  # sides; its one number is the period in y [m]


_TINY = 1e-30
"""Keeps a quotient finite whose numerator is zero too; far below any force [N], also in float32."""

_TINY_SQUARED = 1e-36
"""The same for squares: in float32 a normal number, which an inverse root needs."""


def like(number: float, value: float) -> float:
    """`value` in the floating-point type of `number`: a plain literal would turn float32 into float64."""
    return type(number)(value)


@overload(like, inline="always")
def _like(number, value):
    if number == types.float32:
        return lambda number, value: np.float32(value)
    return lambda number, value: value


@inner_kernel(forceinline=True)
def numbers_like(number, law):
    """A PairLaw in the floating-point type of `number`."""
    return PairLaw(
        like(number, law.stiffness), like(number, law.tangential_stiffness), like(number, law.damping),
        like(number, law.tangential_damping), like(number, law.adhesion),
        like(number, law.contact_adhesion), like(number, law.rest_overlap), like(number, law.reach),
        like(number, law.peak_attraction), like(number, law.static_friction),
        like(number, law.sliding_friction), like(number, law.rolling_stiffness),
        like(number, law.rolling_arm),
    )  # fmt: skip


def pair_law(values: PairValues, effective_radius: float, *, has_adhesion: bool) -> PairLaw:
    """Numbers for the kernels; `effective_radius` [m] is r1 r2/(r1+r2), or r at a boundary."""
    adhesion = values.adhesion if has_adhesion else 0.0
    return PairLaw(
        stiffness=values.stiffness,
        tangential_stiffness=values.tangential_stiffness,
        damping=values.damping,
        tangential_damping=values.tangential_damping,
        adhesion=adhesion,
        contact_adhesion=values.contact_adhesion if has_adhesion else 0.0,
        rest_overlap=values.rest_overlap,
        reach=values.reach,
        peak_attraction=adhesion * values.reach,
        static_friction=values.static_friction,
        sliding_friction=values.sliding_friction,
        rolling_stiffness=values.tangential_stiffness * effective_radius**2,
        rolling_arm=values.rolling_friction * effective_radius,
    )


def law_features(soil: Soil, *, book: bool = False, period_m: float | None = None) -> Features:
    """What the laws of a soil contain, all layers together; period_m: in y, where the sides are periodic."""
    values = [value for layer in layer_soils(soil) for value in pair_values(layer)]
    wet = soil.law if isinstance(soil.law, CohesiveLinearLaw) else None

    def given(yes: bool) -> np.ndarray:
        return YES if yes else NO

    return Features(
        adhesion=given(any(v.adhesion > 0.0 for v in values)),
        tangential=given(any(v.tangential_stiffness + v.tangential_damping > 0.0 for v in values)),
        rolling=given(any(v.rolling_friction * v.tangential_stiffness > 0.0 for v in values)),
        hertz=given(values[0].hertzian),
        damp_all_zones=given(wet is not None and wet.damped_zones == "all"),
        friction_repulsive=given(wet is not None and wet.friction_normal == "repulsive"),
        friction_absolute=given(wet is not None and wet.friction_normal == "absolute"),
        book=given(book),
        sizes=given(soil.particles.sizes is not None),
        materials=given(soil.layers is not None),
        periodic=NO if period_m is None else np.full((1, 1), period_m),
    )


def soil_laws(soil: Soil, features: Features) -> tuple[PairLaw, PairLaw]:
    """Laws of particle-particle and particle-boundary, equal spheres of one material."""
    pair, boundary = pair_values(soil)
    has_adhesion = features.adhesion.ndim == 2
    radius = soil.particles.mean_volume_radius_m
    return (
        pair_law(pair, 0.5 * radius, has_adhesion=has_adhesion),
        pair_law(boundary, radius, has_adhesion=has_adhesion),
    )


@njit(cache=True, forceinline=True, error_model="numpy", fastmath={"contract"})
def normal_elastic(overlap, law, features):
    """Elastic part of the force along the normal, repulsion positive [N] (eq. 12-21, Delta = 0).

    overlap [m] is negative across a gap.
    """
    zero = like(overlap, 0.0)
    if features.hertz.ndim == 2:
        return law.stiffness * math.sqrt(max(overlap, zero)) * overlap
    force = law.stiffness * max(overlap - law.rest_overlap, zero)
    if features.adhesion.ndim == 2:
        touching = law.contact_adhesion * min(overlap - law.rest_overlap, zero)
        apart = -law.adhesion * max(law.reach + overlap, zero)
        force += touching if overlap >= zero else apart
    return force


@njit(cache=True, error_model="numpy")
def normal_potential(overlap, law, features):
    """Energy of the elastic normal force [J], zero out of reach; its derivative is normal_elastic."""
    if features.hertz.ndim == 2:
        return 0.4 * law.stiffness * max(overlap, 0.0) ** 2.5
    energy = 0.0
    if features.adhesion.ndim == 2:
        near = min(max(law.reach + overlap, 0.0), law.reach)
        energy -= 0.5 * law.adhesion * near * near
        inside = min(max(overlap, 0.0), law.rest_overlap)
        energy -= law.contact_adhesion * inside * (law.rest_overlap - 0.5 * inside)
    loaded = max(overlap - law.rest_overlap, 0.0)
    return energy + 0.5 * law.stiffness * loaded * loaded


@njit(cache=True, forceinline=True, error_model="numpy", fastmath={"contract"})
def contact(overlap, normal, velocity, spin, shear, roll, step, law, features):
    """Force and rolling torque of one contact in reach, and its new history.

    normal: unit vector from body i to body j. velocity [m/s]: of i against j at the contact point.
    spin [rad/s]: of i against j. shear [m], roll [rad]: springs of this contact, tangent vectors.
    Returns force on i [N], torque of rolling friction on i [N m], shear, roll, sinks [J] (SINKS order).

    Tangential: spring and damper in parallel, in series with a slider (return mapping), so that both
    the damper and the slider only dissipate. The slider yields at static friction and then carries
    sliding friction.

    Choices are values, not branches, and all numbers have the type of `overlap`: in a loop over pairs the
    compiler makes vector instructions of it.
    """
    zero, half, one = like(overlap, 0.0), like(overlap, 0.5), like(overlap, 1.0)
    tiny, tiny_squared = like(overlap, _TINY), like(overlap, _TINY_SQUARED)
    nx, ny, nz = normal
    ux, uy, uz = velocity
    overlap_rate = ux * nx + uy * ny + uz * nz

    force_n = normal_elastic(overlap, law, features)
    damped = law.damping * overlap_rate
    grown, before, held_fraction = one, one, one  # Hertz: stiffness over its coefficient, now and a step ago
    if features.hertz.ndim == 2:
        grown = math.sqrt(max(overlap, zero))
        before = math.sqrt(max(overlap - step * overlap_rate, zero))
        held_fraction = min(before / max(grown, tiny), one) if grown > zero else zero
        damped *= math.sqrt(grown)
    elif features.damp_all_zones.ndim == 1:
        damped = damped if overlap > law.rest_overlap else zero
    force_n += damped
    fx, fy, fz = -force_n * nx, -force_n * ny, -force_n * nz

    if features.friction_repulsive.ndim == 2:
        pressing = max(force_n, zero)
    elif features.friction_absolute.ndim == 2:
        pressing = abs(force_n)
    else:
        pressing = max(force_n + law.peak_attraction, zero)

    sx, sy, sz = zero, zero, zero
    tangential_loss, sliding_loss, released = zero, zero, zero
    if features.tangential.ndim == 2:
        sx, sy, sz = shear
        along = sx * nx + sy * ny + sz * nz  # keep the spring in the turning tangent plane
        sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
        tx, ty, tz = ux - overlap_rate * nx, uy - overlap_rate * ny, uz - overlap_rate * nz
        k, c = law.tangential_stiffness, law.tangential_damping
        if features.hertz.ndim == 2:
            # Mindlin: a stiffer contact keeps its force, a softer one loses it, so no energy comes in
            if features.book.ndim == 2:
                stored = half * k * (sx * sx + sy * sy + sz * sz)
                released = stored * (before - grown * held_fraction * held_fraction)
            sx, sy, sz = held_fraction * sx, held_fraction * sy, held_fraction * sz
            k, c = k * grown, c * math.sqrt(grown)
        yielding = k * step + c
        # trial force if the slider held
        qx, qy, qz = k * sx + yielding * tx, k * sy + yielding * ty, k * sz + yielding * tz
        squared = qx * qx + qy * qy + qz * qz
        inverse = inverse_root(max(squared, tiny_squared))
        size = squared * inverse
        held = min(law.sliding_friction * pressing * inverse, one)
        held = held if size > law.static_friction * pressing else one
        slip = (one - held) * (one / max(yielding, tiny))  # slip velocity = slip * trial force
        # velocity of the spring and damper: what the slider leaves
        ex, ey, ez = tx - slip * qx, ty - slip * qy, tz - slip * qz
        sx, sy, sz = sx + step * ex, sy + step * ey, sz + step * ez
        fx, fy, fz = fx - held * qx, fy - held * qy, fz - held * qz
        if features.book.ndim == 2:
            sliding_loss = held * slip * squared * step
            tangential_loss = c * (ex * ex + ey * ey + ez * ez) * step

    mx, my, mz = zero, zero, zero
    rx, ry, rz = zero, zero, zero
    rolling_loss = zero
    if features.rolling.ndim == 2:
        rx, ry, rz = roll
        if features.hertz.ndim == 2:  # as the tangential spring: stiffer keeps its torque, softer loses it
            if features.book.ndim == 2:
                stored = half * law.rolling_stiffness * (rx * rx + ry * ry + rz * rz)
                released += stored * (before - grown * held_fraction * held_fraction)
            rx, ry, rz = held_fraction * rx, held_fraction * ry, held_fraction * rz
        wx, wy, wz = spin
        along = wx * nx + wy * ny + wz * nz  # no twist
        wx, wy, wz = wx - along * nx, wy - along * ny, wz - along * nz
        along = rx * nx + ry * ny + rz * nz
        rx = rx - along * nx + step * wx
        ry = ry - along * ny + step * wy
        rz = rz - along * nz + step * wz
        stiffness = law.rolling_stiffness * grown
        squared = stiffness * stiffness * (rx * rx + ry * ry + rz * rz)
        inverse = inverse_root(max(squared, tiny_squared))
        held = min(law.rolling_arm * pressing * inverse, one)
        if features.book.ndim == 2:
            rolling_loss = held * (one - held) * squared / max(stiffness, tiny)
        rx, ry, rz = held * rx, held * ry, held * rz
        mx, my, mz = -stiffness * rx, -stiffness * ry, -stiffness * rz

    sinks = (damped * overlap_rate * step, tangential_loss, sliding_loss, rolling_loss, released)
    return (fx, fy, fz), (mx, my, mz), (sx, sy, sz), (rx, ry, rz), sinks


@njit(cache=True, forceinline=True, error_model="numpy")
def spring_energy(overlap, shear, roll, law, features):
    """Energy in the tangential and the rolling spring [J]; lost when a contact separates."""
    half = like(overlap, 0.5)
    grown = math.sqrt(max(overlap, like(overlap, 0.0))) if features.hertz.ndim == 2 else like(overlap, 1.0)
    return half * grown * law.tangential_stiffness * (
        shear[0] * shear[0] + shear[1] * shear[1] + shear[2] * shear[2]
    ) + half * grown * law.rolling_stiffness * (roll[0] * roll[0] + roll[1] * roll[1] + roll[2] * roll[2])
