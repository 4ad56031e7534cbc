"""Frames of bodies in the reference pose, and the conversion of world points and vectors into them."""

import math
from collections.abc import Sequence

import numpy as np

from ..scene.mechanism import GROUND, Mechanism

COORDINATE_INDEX = {"x": 0, "z": 1, "angle": 2, "x_m": 0, "z_m": 1, "angle_rad": 2}


class ReferencePoses:
    """Reference poses of all bodies and the ground."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.names = (*mechanism.bodies, GROUND)
        self._shift = mechanism.initial.translate_x_m
        poses = [(*body.position_m, body.angle_rad) for body in mechanism.bodies.values()]
        self.poses = np.array([*poses, (-self._shift, 0.0, 0.0)])

    def index(self, body: str) -> int:
        return self.names.index(body)

    def angle(self, body: str) -> float:
        return float(self.poses[self.index(body), 2])

    def vector(self, body: str, x: float, z: float) -> tuple[float, float]:
        """A world vector in the axes of a body."""
        c, s = math.cos(self.angle(body)), math.sin(self.angle(body))
        return c * x + s * z, c * z - s * x

    def point(self, body: str, point: Sequence[float]) -> tuple[float, float]:
        """A world point of the reference pose in the frame of a body; the ground moves with the machine."""
        pose = self.poses[self.index(body)]
        return self.vector(body, point[0] - pose[0], point[1] - pose[1])

    def coordinates(self) -> np.ndarray:
        """q (n + 3,) of the reference pose, moved by translate_x_m."""
        q = self.poses.copy()
        q[:-1, 0] += self._shift
        q[-1] = 0.0
        return q.reshape(-1)


def along(axis: Sequence[float]) -> tuple[float, float]:
    """Unit vector of a line in world axes."""
    length = math.hypot(*axis)
    return axis[0] / length, axis[1] / length


def across(axis: Sequence[float]) -> tuple[float, float]:
    """Unit normal of a line in world axes."""
    x, z = along(axis)
    return -z, x
