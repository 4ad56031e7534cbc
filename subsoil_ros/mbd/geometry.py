"""Points and vectors of bodies in world axes, from the coordinates and the sines of all angles."""

import math

import numpy as np

from .kernel_options import inner_kernel, kernel


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
