"""A point of body_b slides along a line fixed in body_a: n . d = 0."""

import numpy as np

from ...scene.mechanism import PointOnLine, Prismatic
from ..function_tables import FunctionList
from ..geometry import ReferencePoses, across
from .rows import (
    Reaction,
    fill_pair,
    line_columns,
    line_gamma,
    line_jacobian,
    line_reaction,
    line_residual,
)

KIND = 3

residual, jacobian, gamma = line_residual, line_jacobian, line_gamma
columns = line_columns


def angle_rows(joint: np.void) -> tuple[bool, ...]:
    """A length."""
    return (False,)


def fill(
    row: np.void, joint: PointOnLine | Prismatic, poses: ReferencePoses, functions: FunctionList
) -> None:
    """Fill in its row of the table."""
    fill_pair(row, joint, poses)
    row["kind"] = KIND
    row["point_a"] = poses.point(joint.body_a, joint.point_m)
    row["point_b"] = poses.point(joint.body_b, joint.point_m)
    row["normal"] = poses.vector(joint.body_a, *across(joint.axis))


def reaction(joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
    """A force across the line."""
    return line_reaction(joint, turns, pushes[0])
