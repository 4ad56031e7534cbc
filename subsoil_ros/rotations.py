"""Rotations in space: unit quaternions (x, y, z, w) and rotation vectors (axis times angle [rad]), as floats.

A soil step needs a few of them per tool, each a microsecond; scipy's Rotation, for arrays of them, takes ten.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

UNIT_TOLERANCE = 1e-6
"""Tolerance of the squared norm of a unit quaternion: above the round-off of float32, in which other programs
may compute, and too small to scale a tool noticeably."""


def planar_quaternion(angle_rad: float) -> Quaternion:
    """Rotation by a planar angle, about -y."""
    half = 0.5 * angle_rad
    return (0.0, -math.sin(half), 0.0, math.cos(half))


def quaternion_of(rotation_rad: Vector) -> Quaternion:
    """Quaternion of a rotation vector."""
    x, y, z = rotation_rad
    angle = math.sqrt(x * x + y * y + z * z)
    part = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return (part * x, part * y, part * z, math.cos(0.5 * angle))


def product(second: Quaternion, first: Quaternion) -> Quaternion:
    """`first`, and then `second`, both about axes of the world."""
    ax, ay, az, aw = second
    bx, by, bz, bw = first
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def rotation_between(before: Quaternion, after: Quaternion) -> Vector:
    """Shortest rotation vector, in world axes, that turns orientation `before` into `after`."""
    x, y, z, w = product(after, (-before[0], -before[1], -before[2], before[3]))
    sine = math.sqrt(x * x + y * y + z * z)
    part = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 0.0 else 2.0
    part = math.copysign(part, w)
    return (part * x, part * y, part * z)


def matrix_of(quaternion: Quaternion) -> tuple[float, ...]:
    """Rotation matrix, nine numbers row by row; an orientation times it gives world axes."""
    x, y, z, w = quaternion
    s = 2.0 / (x * x + y * y + z * z + w * w)
    return (
        1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),
        s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w),
        s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y),
    )  # fmt: skip


def turned(quaternion: Quaternion, vector: Vector) -> Vector:
    """Vector in world axes, given in the turned axes."""
    m, (x, y, z) = matrix_of(quaternion), vector
    return (
        m[0] * x + m[1] * y + m[2] * z,
        m[3] * x + m[4] * y + m[5] * z,
        m[6] * x + m[7] * y + m[8] * z,
    )


def placed_m(
    points_m: NDArray[np.float64], position_m: Vector, quaternion: Quaternion
) -> NDArray[np.float64]:
    """Points (n, 3) of a body in world axes."""
    return points_m @ np.reshape(matrix_of(quaternion), (3, 3)).T + position_m


def dot(one: Vector, two: Vector) -> float:
    """Scalar product."""
    return one[0] * two[0] + one[1] * two[1] + one[2] * two[2]


class LevelAxes(NamedTuple):
    """Axes of a body of which the first is level: its y axis turned about, in world axes."""

    forward: Vector  # level, across the body's y axis
    left: Vector  # the body's y axis
    up: Vector
    pitch_rad: float  # planar angle of the body's x axis in the plane of forward and up
    roll_rad: float  # of the y axis above the level

    def of(self, vector: Vector) -> Vector:
        """Vector in these axes, given in world axes."""
        return dot(self.forward, vector), dot(self.left, vector), dot(self.up, vector)

    def world(self, vector: Vector) -> Vector:
        """Vector in world axes, given in these axes."""
        x, y, z = vector
        f, s, u = self.forward, self.left, self.up
        return (
            x * f[0] + y * s[0] + z * u[0],
            x * f[1] + y * s[1] + z * u[1],
            x * f[2] + y * s[2] + z * u[2],
        )


def level_axes(quaternion: Quaternion) -> LevelAxes:
    """The level axes of a body, whose y axis does not stand upright."""
    left, nose = turned(quaternion, (0.0, 1.0, 0.0)), turned(quaternion, (1.0, 0.0, 0.0))
    level = math.hypot(left[0], left[1])
    x, y = (left[1] / level, -left[0] / level) if level > 0.0 else (1.0, 0.0)
    up = (y * left[2], -x * left[2], x * left[1] - y * left[0])
    pitch = math.atan2(dot(up, nose), x * nose[0] + y * nose[1])
    return LevelAxes((x, y, 0.0), left, up, pitch, math.atan2(left[2], level))


def is_unit(quaternion: Quaternion) -> bool:
    """Whether it is a rotation: finite, and of length 1."""
    return abs(sum(part * part for part in quaternion) - 1.0) <= UNIT_TOLERANCE
