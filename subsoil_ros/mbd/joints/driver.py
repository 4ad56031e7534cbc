"""The speed u(t) of one coordinate is given; its way since t = 0 is the integral of u in closed form.

Absolute: q_c = offset + way. Relative: the same for n . d, n an axis fixed in body_a, or for phi_b - phi_a.
"""

import numpy as np

from ...scene.mechanism import GROUND, Driver
from ..function_tables import FunctionList
from ..geometry import COORDINATE_INDEX, ReferencePoses
from ..kernel_options import part_of_kernel
from .rows import (
    DRIVER,
    RELATIVE_DRIVER,
    Reaction,
    angle_columns,
    angle_jacobian,
    angle_residual,
    line_columns,
    line_distance,
    line_gamma,
    line_jacobian,
    line_reaction,
)

KIND = DRIVER


@part_of_kernel
def residual(joint, q, turns, residual):
    """The coordinate less its offset and its way, which is given in `residual`."""
    row = joint.row
    way = residual[row]
    if joint.kind == DRIVER:
        residual[row] = q[joint.coordinate] - joint.offset - way
    elif joint.coordinate < 2:
        residual[row] = line_distance(joint, q, turns) - (joint.offset + way)
    else:
        angle_residual(joint, row, q, residual)
        residual[row] -= way


@part_of_kernel
def jacobian(joint, q, turns, jacobian):
    """Jacobian of the coordinate."""
    if joint.kind == DRIVER:
        jacobian[joint.row, joint.coordinate] = 1.0
    elif joint.coordinate < 2:
        line_jacobian(joint, q, turns, jacobian)
    else:
        angle_jacobian(joint, joint.row, jacobian)


@part_of_kernel
def gamma(joint, q, turns, v, gamma):
    """Add the velocity terms of a relative driver of x or z to u', which is given in `gamma`."""
    if joint.kind == RELATIVE_DRIVER and joint.coordinate < 2:
        line_gamma(joint, q, turns, v, gamma)


def columns(joint: np.void) -> list[list[int]]:
    """Coordinates that its row depends on."""
    if joint["kind"] == DRIVER:
        return [[int(joint["coordinate"])]]
    return angle_columns(joint) if joint["coordinate"] == 2 else line_columns(joint)


def angle_rows(joint: np.void) -> tuple[bool, ...]:
    """Whether the coordinate is an angle."""
    return (int(joint["coordinate"]) % 3 == 2,)


def fill(row: np.void, joint: Driver, poses: ReferencePoses, functions: FunctionList) -> None:
    """Fill in its row of the table. It starts from the reference pose; assembly.py moves it."""
    row["body_a"] = poses.index(joint.relative_to or GROUND)
    row["body_b"] = poses.index(joint.body)
    row["function"] = functions.add(joint.speed)
    coordinate = COORDINATE_INDEX[joint.coordinate]
    if joint.relative_to is None:
        row["kind"] = DRIVER
        row["coordinate"] = 3 * poses.index(joint.body) + coordinate
        row["offset"] = poses.coordinates()[row["coordinate"]]
        return
    row["kind"] = RELATIVE_DRIVER
    row["coordinate"] = coordinate
    if coordinate < 2:
        row["normal"] = poses.vector(joint.relative_to, 1.0 - coordinate, float(coordinate))


def reaction(joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
    """A push along the coordinate."""
    coordinate = int(joint["coordinate"]) % 3
    if coordinate == 2:
        return 0.0, 0.0, pushes[0]
    if joint["kind"] == RELATIVE_DRIVER:
        return line_reaction(joint, turns, pushes[0])
    return (pushes[0], 0.0, 0.0) if coordinate == 0 else (0.0, pushes[0], 0.0)
