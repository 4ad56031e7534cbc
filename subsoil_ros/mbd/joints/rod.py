"""The length of d is constant: a locked spring_damper (forces/spring_damper.py adds its row)."""

import math

import numpy as np

from ..geometry import difference
from ..kernel_options import part_of_kernel
from .rows import Reaction, along_jacobian, along_rates, line_columns

columns = line_columns


@part_of_kernel
def residual(joint, q, turns, residual):
    """|d| - offset."""
    dx, dz, _, _, _, _ = difference(joint, q, turns)
    residual[joint.row] = math.sqrt(dx * dx + dz * dz) - joint.offset


@part_of_kernel
def jacobian(joint, q, turns, jacobian):
    """Jacobian of |d|: along e = d / |d|, whose rotation has no effect."""
    dx, dz, ax, az, bx, bz = difference(joint, q, turns)
    length = math.sqrt(dx * dx + dz * dz)
    along_jacobian(joint, dx / length, dz / length, 0.0, ax, az, bx, bz, jacobian)


@part_of_kernel
def gamma(joint, q, turns, v, gamma):
    """|d|'' = e . d'' + (d'^2 - (e . d')^2) / |d|."""
    dx, dz, ax, az, bx, bz = difference(joint, q, turns)
    length = math.sqrt(dx * dx + dz * dz)
    along, across = along_rates(joint, dx / length, dz / length, v, ax, az, bx, bz)
    gamma[joint.row] = along - across * across / length


def angle_rows(joint: np.void) -> tuple[bool, ...]:
    """A length."""
    return (False,)


def reaction(joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
    """A force along e."""
    span = _point(joint, "b", q, turns) - _point(joint, "a", q, turns)
    x, z = pushes[0] * span / np.linalg.norm(span)
    return x, z, 0.0


def _point(joint: np.void, side: str, q: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """World position (2,) of the point of body a or b."""
    body = int(joint[f"body_{side}"])
    (c, s), (x, z) = turns[body], joint[f"point_{side}"]
    return np.asarray(q[3 * body : 3 * body + 2] + np.array([c * x - s * z, s * x + c * z]))
