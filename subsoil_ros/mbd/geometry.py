"""Points and vectors of bodies, in their frames and in world axes: of the reference pose, and of any pose."""

import math
from collections.abc import Sequence

import numpy as np

from ..scene.mechanism import GROUND, Mechanism
from .kernel_options import inner_kernel, kernel

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


@kernel
def evaluate_turns(q, turns):
    """Cosine and sine of every angle of `q` (n + 3,) into `turns` (bodies + 1, 2)."""
    for i in range(turns.shape[0]):
        turns[i, 0] = math.cos(q[3 * i + 2])
        turns[i, 1] = math.sin(q[3 * i + 2])


def turns_of(q: np.ndarray) -> np.ndarray:
    """Cosines and sines (bodies + 1, 2) of the angles of `q` (n + 3,)."""
    turns = np.empty((len(q) // 3, 2))
    evaluate_turns(q, turns)
    return turns


@inner_kernel
def turned(turns, body, point):
    """A vector in the frame of a body in world axes."""
    c, s = turns[body, 0], turns[body, 1]
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


@inner_kernel
def difference(part, q, turns):
    """d = p_b - p_a of a joint or force, and the arms from the centres of mass to the two points."""
    a, b = 3 * part.body_a, 3 * part.body_b
    ax, az = turned(turns, part.body_a, part.point_a)
    bx, bz = turned(turns, part.body_b, part.point_b)
    return q[b] + bx - q[a] - ax, q[b + 1] + bz - q[a + 1] - az, ax, az, bx, bz


@inner_kernel
def relative_velocity(part, v, ax, az, bx, bz):
    """d' in a frame that does not turn, from the arms."""
    a, b = 3 * part.body_a, 3 * part.body_b
    vx = v[b] - v[b + 2] * bz - v[a] + v[a + 2] * az
    vz = v[b + 1] + v[b + 2] * bx - v[a + 1] - v[a + 2] * ax
    return vx, vz
