"""body_b slides along a line fixed in body_a and does not turn: n . d = 0, phi_b - phi_a = offset."""

import numpy as np

from ...scene.mechanism import Prismatic
from ..function_tables import FunctionList
from ..geometry import ReferencePoses
from ..kernel_options import part_of_kernel
from . import point_on_line
from .rows import (
    Reaction,
    angle_columns,
    angle_jacobian,
    angle_residual,
    line_columns,
    line_gamma,
    line_jacobian,
    line_residual,
)

KIND = 1

gamma = line_gamma  # gamma of the angle is zero


@part_of_kernel
def residual(joint, q, turns, residual):
    """n . d and the angle."""
    line_residual(joint, q, turns, residual)
    angle_residual(joint, joint.row + 1, q, residual)


@part_of_kernel
def jacobian(joint, q, turns, jacobian):
    """Jacobian of n . d and the angle."""
    line_jacobian(joint, q, turns, jacobian)
    angle_jacobian(joint, joint.row + 1, jacobian)


def columns(joint: np.void) -> list[list[int]]:
    """Coordinates that its rows depend on."""
    return line_columns(joint) + angle_columns(joint)


def angle_rows(joint: np.void) -> tuple[bool, ...]:
    """A length and an angle."""
    return False, True


def fill(row: np.void, joint: Prismatic, poses: ReferencePoses, functions: FunctionList) -> None:
    """Fill in its row of the table."""
    point_on_line.fill(row, joint, poses, functions)
    row["kind"] = KIND


def reaction(joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
    """A force across the line, and a moment."""
    x, z, _ = point_on_line.reaction(joint, q, turns, pushes)
    return x, z, pushes[1]
