"""Shared parts of the kernels of laws: tangential and rolling springs, each with a slider.

A law that uses them has the numbers tangential_stiffness, tangential_damping, static_friction,
sliding_friction, rolling_stiffness and rolling_arm.
"""

import math
from functools import partial

import numpy as np
from numba import njit, types
from numba.extending import overload

from .features import books_energy, has_rolling, has_tangential
from .inverse_root import inverse_root

law_kernel = partial(njit, forceinline=True, error_model="numpy", fastmath={"contract"})
"""Decorator, called, of functions that those of a kernel.py call; numba caches them with the engine's."""

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


@njit(cache=True, inline="always")
def overlap_rate(motion):
    """Velocity along the normal of a ContactMotion [m/s]."""
    nx, ny, nz = motion.normal
    ux, uy, uz = motion.velocity
    return ux * nx + uy * ny + uz * nz


@njit(cache=True, inline="always")
def contact_with_springs(push, pressing, motion, state, step, law, features, grown, before):
    """Force and torque of a contact whose force on i along the normal is the vector `push` [N].

    pressing [N]: normal force that limits friction. grown, before: stiffness of the springs over the numbers
    of the law, now and a step ago. A contact that becomes stiffer keeps its force, one that becomes softer
    loses some, so no energy is created. The rest: dem.contact.

    Returns force on i [N], torque of rolling friction on i [N m], the new shear and rolling of its
    state, and all sinks but the first.

    Tangential: spring and damper in parallel, in series with a slider (return mapping), so that both
    the damper and the slider only dissipate. The slider yields at static friction and then carries
    sliding friction.

    Choices are values, not branches, and all numbers have the type of `step`, so that a loop over pairs
    compiles to vector instructions.
    """
    zero, half, one = like(step, 0.0), like(step, 0.5), like(step, 1.0)
    tiny, tiny_squared = like(step, _TINY), like(step, _TINY_SQUARED)
    nx, ny, nz = motion.normal
    ux, uy, uz = motion.velocity
    rate = overlap_rate(motion)
    fx, fy, fz = push
    held_fraction = min(before / max(grown, tiny), one) if grown > zero else zero

    sx, sy, sz = zero, zero, zero
    tangential_loss, sliding_loss, released = zero, zero, zero
    if has_tangential(features):
        sx, sy, sz = state.shear
        along = sx * nx + sy * ny + sz * nz  # keep the spring in the turning tangent plane
        sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
        tx, ty, tz = ux - rate * nx, uy - rate * ny, uz - rate * nz
        k, c = law.tangential_stiffness, law.tangential_damping
        if books_energy(features):
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
        if books_energy(features):
            sliding_loss = held * slip * squared * step
            tangential_loss = c * (ex * ex + ey * ey + ez * ez) * step

    mx, my, mz = zero, zero, zero
    rx, ry, rz = zero, zero, zero
    rolling_loss = zero
    if has_rolling(features):
        rx, ry, rz = state.rolling
        if books_energy(features):
            stored = half * law.rolling_stiffness * (rx * rx + ry * ry + rz * rz)
            released += stored * (before - grown * held_fraction * held_fraction)
        rx, ry, rz = held_fraction * rx, held_fraction * ry, held_fraction * rz
        wx, wy, wz = motion.angular_velocity
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
        if books_energy(features):
            rolling_loss = held * (one - held) * squared / max(stiffness, tiny)
        rx, ry, rz = held * rx, held * ry, held * rz
        mx, my, mz = -stiffness * rx, -stiffness * ry, -stiffness * rz

    lost = (tangential_loss, sliding_loss, rolling_loss, released)
    return (fx, fy, fz), (mx, my, mz), (sx, sy, sz), (rx, ry, rz), lost


@law_kernel(fastmath=False)
def energy_of_springs(grown, state, law):
    """Energy in the tangential and rolling springs [J]; grown: as in contact_with_springs."""
    half, shear, roll = like(grown, 0.5), state.shear, state.rolling
    return half * grown * law.tangential_stiffness * (
        shear[0] * shear[0] + shear[1] * shear[1] + shear[2] * shear[2]
    ) + half * grown * law.rolling_stiffness * (roll[0] * roll[0] + roll[1] * roll[1] + roll[2] * roll[2])
