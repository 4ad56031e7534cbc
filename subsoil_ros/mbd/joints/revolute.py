"""Two bodies share a point: d = 0 (two rows)."""

import numpy as np

from ...scene.mechanism import Revolute
from ..function_tables import FunctionList
from ..geometry import ReferencePoses
from .rows import (
    Reaction,
    fill_pair,
    points_columns,
    points_gamma,
    points_jacobian,
    points_residual,
)

KIND = 0

residual, jacobian, gamma = points_residual, points_jacobian, points_gamma
columns = points_columns


def angle_rows(joint: np.void) -> tuple[bool, ...]:
    """Both rows are lengths."""
    return False, False


def fill(row: np.void, joint: Revolute, poses: ReferencePoses, functions: FunctionList) -> None:
    """Fill in its row of the table."""
    fill_pair(row, joint, poses)
    row["kind"] = KIND
    row["point_a"] = poses.point(joint.body_a, joint.point_m)
    row["point_b"] = poses.point(joint.body_b, joint.point_b_m or joint.point_m)


def reaction(joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
    """A force."""
    return pushes[0], pushes[1], 0.0
