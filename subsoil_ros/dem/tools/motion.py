"""A tool's motion in the form of the kernels, and between two exchanges.

Kernels get a plain tuple: of PLANAR numbers for a tool that stays in the plane of travel, of more for one
that moves in space. Its length is part of the type, so each kind has kernels of its own, and the planar ones
hold nothing of the other.
"""

import math

from numba.extending import overload

from ...errors import PhysicsError, ProtocolError
from ...messages import SpatialMotion, ToolMotion
from ...rotations import matrix_of, product, quaternion_of, rotation_between
from ..compiled import inner_kernel
from ..contact import compiled_expression

Motion = tuple[float, ...]
"""x [m], z [m], cosine, sine, velocity x, z [m/s], phi rate [rad/s], y [m] of the body; or position [m],
rotation matrix row by row, velocity [m/s] and angular velocity [rad/s]."""

PLANAR, SPATIAL = 8, 18

HALF_TURN_RAD = math.pi
"""Rotation in one exchange from which on two poses no longer determine it."""


def kernel_motion(motion: ToolMotion, reference_angle_rad: float) -> Motion:
    """`motion` as the kernels take it."""
    if isinstance(motion, SpatialMotion):
        pose = (*motion.position_m, *matrix_of(motion.quaternion))
        return (*pose, *motion.velocity_m_per_s, *motion.spin_rad_per_s)
    turn = motion.angle_rad - reference_angle_rad
    return (
        motion.x_m, motion.z_m, math.cos(turn), math.sin(turn),
        motion.velocity_x_m_per_s, motion.velocity_z_m_per_s, motion.angular_velocity_rad_per_s,
        motion.y_m,
    )  # fmt: skip


def motion_at(numbers):
    """Motion from an array (PLANAR,), or (SPATIAL, 1) of a tool that moves in space."""
    return tuple(float(number) for number in numbers.flat)


@overload(motion_at, inline="always")
def _motion_at(numbers):
    places = [f"numbers[{k}]" for k in range(PLANAR)]
    if numbers.ndim == 2:
        places = [f"numbers[{k}, 0]" for k in range(SPATIAL)]
    return compiled_expression("motion_at", "numbers", f"({', '.join(places)})")


@inner_kernel()
def into_body(motion, px, py, pz):
    """A place p [m] of the world in the frame of the tool's facets."""
    if len(motion) == PLANAR:
        dx, dz = px - motion[0], pz - motion[1]
        return motion[2] * dx + motion[3] * dz, py, motion[2] * dz - motion[3] * dx
    else:
        return turned_in(motion, px - motion[0], py - motion[1], pz - motion[2])


@inner_kernel()
def out_of_body(motion, px, py, pz):
    """A place p [m] in the frame of the tool's facets in the world."""
    if len(motion) == PLANAR:
        return (
            motion[0] + motion[2] * px - motion[3] * pz, py, motion[1] + motion[3] * px + motion[2] * pz
        )  # fmt: skip
    else:
        x, y, z = turned_out(motion, px, py, pz)
        return motion[0] + x, motion[1] + y, motion[2] + z


@inner_kernel()
def turned_in(motion, x, y, z):
    """A vector of the world in the tool's axes."""
    if len(motion) == PLANAR:
        return motion[2] * x + motion[3] * z, y, motion[2] * z - motion[3] * x
    else:
        return (
            motion[3] * x + motion[6] * y + motion[9] * z,
            motion[4] * x + motion[7] * y + motion[10] * z,
            motion[5] * x + motion[8] * y + motion[11] * z,
        )


@inner_kernel()
def turned_out(motion, x, y, z):
    """A vector of the tool's axes in the world."""
    if len(motion) == PLANAR:
        return motion[2] * x - motion[3] * z, y, motion[3] * x + motion[2] * z
    else:
        return (
            motion[3] * x + motion[4] * y + motion[5] * z,
            motion[6] * x + motion[7] * y + motion[8] * z,
            motion[9] * x + motion[10] * y + motion[11] * z,
        )


@inner_kernel()
def centre_of(motion):
    """Where the body's centre of mass is [m]."""
    if len(motion) == PLANAR:
        return motion[0], motion[7], motion[1]
    else:
        return motion[0], motion[1], motion[2]


@inner_kernel()
def velocity_at(motion, rx, ry, rz):
    """Velocity of the tool [m/s] at r [m] from its centre of mass, world axes."""
    if len(motion) == PLANAR:
        return motion[4] - motion[6] * rz, 0.0, motion[5] + motion[6] * rx
    else:
        wx, wy, wz = motion[15], motion[16], motion[17]
        return (
            motion[12] + (wy * rz - wz * ry),
            motion[13] + (wz * rx - wx * rz),
            motion[14] + (wx * ry - wy * rx),
        )


@inner_kernel()
def angular_velocity_of(motion):
    """Angular velocity of the tool [rad/s], world axes."""
    if len(motion) == PLANAR:
        return 0.0, -motion[6], 0.0
    else:
        return motion[15], motion[16], motion[17]


def motion_within(start: ToolMotion, end: ToolMotion, interval_s: float, part: float) -> ToolMotion:
    """Cubic in place and angle between two motions, at `part` (0 to 1] of the interval (Hermite).

    In space the angle is that about the axis of the rotation from one pose to the other.
    """
    if part == 1.0:
        return end
    t, h = part, interval_s
    h00, h10 = (1.0 + 2.0 * t) * (1.0 - t) ** 2, t * (1.0 - t) ** 2
    h01, h11 = t * t * (3.0 - 2.0 * t), t * t * (t - 1.0)
    d00, d10 = 6.0 * t * (t - 1.0), (1.0 - t) * (1.0 - 3.0 * t)
    d01, d11 = -d00, t * (3.0 * t - 2.0)

    def between(p0: float, v0: float, p1: float, v1: float) -> tuple[float, float]:
        return (
            h00 * p0 + h10 * h * v0 + h01 * p1 + h11 * h * v1,
            (d00 * p0 + d01 * p1) / h + d10 * v0 + d11 * v1,
        )

    x, vx = between(start.x_m, start.velocity_x_m_per_s, end.x_m, end.velocity_x_m_per_s)
    z, vz = between(start.z_m, start.velocity_z_m_per_s, end.z_m, end.velocity_z_m_per_s)
    if isinstance(start, SpatialMotion) and isinstance(end, SpatialMotion):
        y, vy = between(start.y_m, start.velocity_y_m_per_s, end.y_m, end.velocity_y_m_per_s)
        turn = rotation_between(start.quaternion, end.quaternion)
        angle = math.hypot(*turn)
        ax, ay, az = (part / angle for part in turn) if angle > 0.0 else (0.0, 0.0, 0.0)
        rates = [w[0] * ax + w[1] * ay + w[2] * az for w in (start.spin_rad_per_s, end.spin_rad_per_s)]
        done, rate = between(0.0, rates[0], angle, rates[1])
        at = product(quaternion_of((done * ax, done * ay, done * az)), start.quaternion)
        return SpatialMotion.of(end.tool, (x, y, z), at, (vx, vy, vz), (rate * ax, rate * ay, rate * az))
    phi, rate = between(
        start.angle_rad, start.angular_velocity_rad_per_s, end.angle_rad, end.angular_velocity_rad_per_s
    )
    return ToolMotion(end.tool, x, end.y_m, z, phi, vx, vz, rate)


def refuse_other_kind(where: str, before: ToolMotion, after: ToolMotion, interval_s: float) -> None:
    """Check that a tool stays planar or spatial, and turns by less than half a turn in an exchange.

    Raises:
        ProtocolError, PhysicsError: it does not.
    """
    spatial = isinstance(after, SpatialMotion)
    if spatial != isinstance(before, SpatialMotion):
        kinds = ("planar", "spatial (angle_rad: NaN)")
        raise ProtocolError(
            f"{where}: tool {after.tool}: a {kinds[spatial]} motion came after a {kinds[not spatial]} one; a "
            "tool keeps the kind it began with"
        )
    if spatial:
        turned = interval_s * max(math.hypot(*motion.spin_rad_per_s) for motion in (before, after))
        if turned >= HALF_TURN_RAD:
            raise PhysicsError(
                f"{where}: tool {after.tool} turns by {turned:.3g} rad in one exchange, {interval_s:.3g} s; "
                f"two poses determine only less than {HALF_TURN_RAD:.3g} rad: turn it more slowly, or lower "
                "coupling.communication_step_ns"
            )
