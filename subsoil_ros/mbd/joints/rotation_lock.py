"""phi_b - phi_a = offset: a locked torsion_spring (forces/torsion_spring.py adds its row)."""

import numpy as np

from .rows import Reaction, angle_columns

columns = angle_columns


def angle_rows(joint: np.void) -> tuple[bool, ...]:
    """An angle."""
    return (True,)


def reaction(joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
    """A moment."""
    return 0.0, 0.0, pushes[0]
