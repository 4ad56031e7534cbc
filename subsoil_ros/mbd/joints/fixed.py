"""body_b is welded to body_a: d = 0 (two rows), phi_b - phi_a = offset."""

import numpy as np

from ...scene.mechanism import Fixed
from ..function_tables import FunctionList
from ..geometry import ReferencePoses
from ..kernel_options import part_of_kernel
from .rows import (
    Reaction,
    angle_columns,
    angle_jacobian,
    angle_residual,
    fill_pair,
    points_columns,
    points_gamma,
    points_jacobian,
    points_residual,
)

KIND = 2

gamma = points_gamma  # gamma of the angle is zero


@part_of_kernel
def residual(joint, q, turns, residual):
    """d and the angle."""
    points_residual(joint, q, turns, residual)
    angle_residual(joint, joint.row + 2, q, residual)


@part_of_kernel
def jacobian(joint, q, turns, jacobian):
    """Jacobian of d and the angle."""
    points_jacobian(joint, q, turns, jacobian)
    angle_jacobian(joint, joint.row + 2, jacobian)


def columns(joint: np.void) -> list[list[int]]:
    """Coordinates that its rows depend on."""
    return points_columns(joint) + angle_columns(joint)


def angle_rows(joint: np.void) -> tuple[bool, ...]:
    """Two lengths and an angle."""
    return False, False, True


def fill(row: np.void, joint: Fixed, poses: ReferencePoses, functions: FunctionList) -> None:
    """Fill in its row of the table."""
    fill_pair(row, joint, poses)
    row["kind"] = KIND
    row["point_a"] = poses.point(joint.body_a, joint.point_m)
    row["point_b"] = poses.point(joint.body_b, joint.point_m)


def reaction(joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
    """A force and a moment."""
    return pushes[0], pushes[1], pushes[2]
