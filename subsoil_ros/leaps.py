"""Leaps: motions that a tool's velocities do not explain, after which it enters the soil anew."""

import math
from dataclasses import replace

from .messages import SpatialMotion, ToolMotion
from .rotations import Vector, rotation_between

TIMES = 2.0
"""Largest way over that of the faster of both velocities; a tool that is driven moves by their mean."""

NO_SPIN: Vector = (0.0, 0.0, 0.0)
"""Of the motion that a tool in space enters by: it keeps its orientation through that one tick."""

LEAST_M, LEAST_RAD = 1e-4, 1e-3
"""Largest way that needs no velocity: less than an encoder and a tracking camera tell."""


def entry(before: ToolMotion, after: ToolMotion, interval_s: float) -> ToolMotion | None:
    """The motion from which a tool that leapt moves to `after` within an interval; None: it did not leap."""
    speed, spin = (
        max(math.hypot(*first), math.hypot(*second))
        for first, second in (
            (before.velocity_m_per_s, after.velocity_m_per_s),
            (before.spin_rad_per_s, after.spin_rad_per_s),
        )
    )
    if isinstance(after, SpatialMotion):
        turn = math.hypot(*rotation_between(before.quaternion, after.quaternion))
    else:
        turn = abs(after.angle_rad - before.angle_rad)
    way = math.dist(before.position_m, after.position_m)
    if way <= TIMES * speed * interval_s + LEAST_M and turn <= TIMES * spin * interval_s + LEAST_RAD:
        return None
    x, y, z = (
        at - interval_s * rate for at, rate in zip(after.position_m, after.velocity_m_per_s, strict=True)
    )
    if isinstance(after, SpatialMotion):
        return SpatialMotion.of(after.tool, (x, y, z), after.quaternion, after.velocity_m_per_s, NO_SPIN)
    angle = after.angle_rad - interval_s * after.angular_velocity_rad_per_s
    return replace(after, x_m=x, z_m=z, angle_rad=angle)
