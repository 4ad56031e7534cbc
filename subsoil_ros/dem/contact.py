"""The contact law: one function for particle-particle, particle-wall and particle-tool.

Sources: Yuan & Yu (2020) eq. 12-21 with eq. 17 corrected (continuity), table 3; what the paper leaves
open is chosen in docs/physics.md: friction limit, damped zones, lifetime of the tangential spring, rolling.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from ..scene.damping import integrated_values
from ..scene.pairs import PairValues
from ..scene.soil import Soil, WetLaw

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


YES, NO = np.empty((1, 1)), np.empty(1)
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
    periodic: np.ndarray = NO  # sides; its one number is the period in y [m]


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


def soil_laws(
    soil: Soil, step_s: float, *, book: bool = False, period_m: float | None = None
) -> tuple[PairLaw, PairLaw, Features]:
    """Laws of particle-particle and particle-boundary at a soil step, and the features of both.

    period_m: in y, where the sides are periodic.
    """
    pair, boundary = integrated_values(soil, step_s)
    both = (pair, boundary)
    wet = soil.law if isinstance(soil.law, WetLaw) else None
    has_adhesion = any(v.adhesion > 0.0 for v in both)
    radius = soil.particles.radius_m
    features = Features(
        adhesion=YES if has_adhesion else NO,
        tangential=YES if any(v.tangential_stiffness + v.tangential_damping > 0.0 for v in both) else NO,
        rolling=YES if any(v.rolling_friction * v.tangential_stiffness > 0.0 for v in both) else NO,
        hertz=YES if pair.hertzian else NO,
        damp_all_zones=YES if wet and wet.damped_zones == "all" else NO,
        friction_repulsive=YES if wet and wet.friction_normal == "repulsive" else NO,
        friction_absolute=YES if wet and wet.friction_normal == "absolute" else NO,
        book=YES if book else NO,
        periodic=NO if period_m is None else np.full((1, 1), period_m),
    )
    return (
        pair_law(pair, 0.5 * radius, has_adhesion=has_adhesion),
        pair_law(boundary, radius, has_adhesion=has_adhesion),
        features,
    )


@njit(cache=True, inline="always", error_model="numpy")
def normal_elastic(overlap, law, features):
    """Elastic part of the force along the normal, repulsion positive [N] (eq. 12-21, Delta = 0).

    overlap [m] is negative across a gap.
    """
    if features.hertz.ndim == 2:
        return law.stiffness * np.sqrt(max(overlap, 0.0)) * overlap
    if overlap > law.rest_overlap:
        return law.stiffness * (overlap - law.rest_overlap)
    if features.adhesion.ndim == 1:
        return 0.0
    if overlap >= 0.0:
        return -law.contact_adhesion * (law.rest_overlap - overlap)
    if overlap >= -law.reach:
        return -law.adhesion * (law.reach + overlap)
    return 0.0


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


@njit(cache=True, inline="always", error_model="numpy")
def contact(overlap, normal, velocity, spin, shear, roll, step, law, features):
    """Force and rolling torque of one contact in reach, and its new history.

    normal: unit vector from body i to body j. velocity [m/s]: of i against j at the contact point.
    spin [rad/s]: of i against j. shear [m], roll [rad]: springs of this contact, tangent vectors.
    Returns force on i [N], torque of rolling friction on i [N m], shear, roll, sinks [J] (SINKS order).

    Tangential: spring and damper in parallel, in series with a slider (return mapping), so that both
    the damper and the slider only dissipate. The slider yields at static friction and then carries
    sliding friction.
    """
    nx, ny, nz = normal
    ux, uy, uz = velocity
    overlap_rate = ux * nx + uy * ny + uz * nz

    force_n = normal_elastic(overlap, law, features)
    damped = 0.0
    grown, held_part = 1.0, 1.0  # Hertz: stiffness over its coefficient, and that of a step ago over it
    if features.hertz.ndim == 2:
        grown = np.sqrt(max(overlap, 0.0))
        before = np.sqrt(max(overlap - step * overlap_rate, 0.0))
        held_part = min(before / grown, 1.0) if grown > 0.0 else 0.0
        damped = law.damping * np.sqrt(grown) * overlap_rate
    elif overlap > law.rest_overlap or features.damp_all_zones.ndim == 2:
        damped = law.damping * overlap_rate
    force_n += damped
    fx, fy, fz = -force_n * nx, -force_n * ny, -force_n * nz

    if features.friction_repulsive.ndim == 2:
        pressing = max(force_n, 0.0)
    elif features.friction_absolute.ndim == 2:
        pressing = abs(force_n)
    else:
        pressing = max(force_n + law.peak_attraction, 0.0)

    sx, sy, sz = 0.0, 0.0, 0.0
    tangential_loss, sliding_loss, released = 0.0, 0.0, 0.0
    if features.tangential.ndim == 2:
        sx, sy, sz = shear
        along = sx * nx + sy * ny + sz * nz  # keep the spring in the turning tangent plane
        sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
        tx, ty, tz = ux - overlap_rate * nx, uy - overlap_rate * ny, uz - overlap_rate * nz
        k, c = law.tangential_stiffness, law.tangential_damping
        if features.hertz.ndim == 2:
            # Mindlin: a stiffer contact keeps its force, a softer one loses it, so no energy comes in
            if features.book.ndim == 2:
                stored = 0.5 * k * (sx * sx + sy * sy + sz * sz)
                released = stored * (before - grown * held_part * held_part)
            sx, sy, sz = held_part * sx, held_part * sy, held_part * sz
            k, c = k * grown, c * np.sqrt(grown)
        yielding = k * step + c
        # trial force if the slider held
        qx, qy, qz = k * sx + yielding * tx, k * sy + yielding * ty, k * sz + yielding * tz
        size = np.sqrt(qx * qx + qy * qy + qz * qz)
        slip = 0.0
        if size > law.static_friction * pressing:
            limit = min(law.sliding_friction * pressing, size)
            slip = (size - limit) / (yielding * size)  # slip velocity = slip * trial force
            sliding_loss = limit * slip * size * step
            held = limit / size
        else:
            held = 1.0
        # velocity of the spring and damper: what the slider leaves
        ex, ey, ez = tx - slip * qx, ty - slip * qy, tz - slip * qz
        sx, sy, sz = sx + step * ex, sy + step * ey, sz + step * ez
        fx, fy, fz = fx - held * qx, fy - held * qy, fz - held * qz
        tangential_loss = c * (ex * ex + ey * ey + ez * ez) * step

    mx, my, mz = 0.0, 0.0, 0.0
    rx, ry, rz = 0.0, 0.0, 0.0
    rolling_loss = 0.0
    if features.rolling.ndim == 2:
        rx, ry, rz = roll
        wx, wy, wz = spin
        along = wx * nx + wy * ny + wz * nz  # no twist
        wx, wy, wz = wx - along * nx, wy - along * ny, wz - along * nz
        along = rx * nx + ry * ny + rz * nz
        rx = rx - along * nx + step * wx
        ry = ry - along * ny + step * wy
        rz = rz - along * nz + step * wz
        stiffness = law.rolling_stiffness * grown
        size = stiffness * np.sqrt(rx * rx + ry * ry + rz * rz)
        limit = law.rolling_arm * pressing
        if size > limit:
            held = limit / size
            rolling_loss = limit * (size - limit) / stiffness
            rx, ry, rz = held * rx, held * ry, held * rz
        mx, my, mz = -stiffness * rx, -stiffness * ry, -stiffness * rz

    sinks = (damped * overlap_rate * step, tangential_loss, sliding_loss, rolling_loss, released)
    return (fx, fy, fz), (mx, my, mz), (sx, sy, sz), (rx, ry, rz), sinks


@njit(cache=True, inline="always", error_model="numpy")
def spring_energy(overlap, shear, roll, law, features):
    """Energy in the tangential and the rolling spring [J]; lost when a contact separates."""
    grown = np.sqrt(max(overlap, 0.0)) if features.hertz.ndim == 2 else 1.0
    return 0.5 * grown * law.tangential_stiffness * (
        shear[0] * shear[0] + shear[1] * shear[1] + shear[2] * shear[2]
    ) + 0.5 * grown * law.rolling_stiffness * (roll[0] * roll[0] + roll[1] * roll[1] + roll[2] * roll[2])
