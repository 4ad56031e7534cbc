"""phi_b - phi_a = offset: a locked torsion_spring (forces/torsion_spring.py adds its row)."""

import numpy as np

from ..kernel_options import part_of_kernel
from .rows import Reaction, angle_columns, angle_jacobian, angle_residual, no_gamma

gamma = no_gamma
columns = angle_columns


@part_of_kernel
def residual(joint, q, turns, residual):
    """The angle."""
    angle_residual(joint, joint.row, q, residual)


@part_of_kernel
def jacobian(joint, q, turns, jacobian):
    """Jacobian of the angle."""
    angle_jacobian(joint, joint.row, jacobian)


def angle_rows(joint: np.void) -> tuple[bool, ...]:
    """An angle."""
    return (True,)


def reaction(joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
    """A moment."""
    return 0.0, 0.0, pushes[0]
