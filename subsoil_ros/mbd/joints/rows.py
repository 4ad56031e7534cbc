"""Table of joints that kernels read, and rows of Phi that joints consist of.

Rows: two coincident points, a point on a line, an angle. Each has its value, its entries of the Jacobian, and
gamma = Phi_q q'' without the terms of a driver; all unscaled, d = p_b - p_a (geometry.py). Sources:
docs/decisions/0002-mechanism-integrator.md.
"""

from typing import Protocol

import numpy as np

from ..geometry import ReferencePoses, difference, relative_velocity, turned
from ..kernel_options import part_of_kernel

ROD, ROTATION_LOCK = 4, 5
"""Kinds of joints that replace locked springs; those of a scene have their KIND in their module."""

DRIVER, RELATIVE_DRIVER = 100, 101
"""Above all other kinds, as their rows depend on time: kind >= DRIVER."""

JOINT = np.dtype(
    [
        ("kind", np.int64),
        ("body_a", np.int64),
        ("body_b", np.int64),
        ("row", np.int64),  # its first row of Phi
        ("coordinate", np.int64),  # driver: index into q; relative driver: 0 x, 1 z, 2 angle
        ("function", np.int64),  # driver: its speed
        ("point_a", np.float64, 2),  # in the frame of body_a [m]
        ("point_b", np.float64, 2),  # in the frame of body_b [m]
        ("normal", np.float64, 2),  # unit vector in the frame of body_a: of a line; relative driver: its axis
        ("offset", np.float64),  # phi_b - phi_a [rad]; rod: length [m]; driver: start of the coordinate
    ],
    align=True,
)


Reaction = tuple[float, float, float]
"""Force x, z [N] on body_b at the joint's point, and moment [N m]."""


class Pair(Protocol):
    """A part between two bodies."""

    @property
    def body_a(self) -> str: ...

    @property
    def body_b(self) -> str: ...


def fill_pair(row: np.void, part: Pair, poses: ReferencePoses) -> None:
    """Fill in the bodies of a joint, and the angle between them in the reference pose."""
    row["body_a"], row["body_b"] = poses.index(part.body_a), poses.index(part.body_b)
    row["offset"] = poses.angle(part.body_b) - poses.angle(part.body_a)


@part_of_kernel
def _centripetal(joint, v, ax, az, bx, bz):
    """The centripetal part of -d''."""
    wa, wb = v[3 * joint.body_a + 2], v[3 * joint.body_b + 2]
    return wb * wb * bx - wa * wa * ax, wb * wb * bz - wa * wa * az


# d = 0: two rows


@part_of_kernel
def points_residual(joint, q, turns, residual):
    """d."""
    residual[joint.row], residual[joint.row + 1], _, _, _, _ = difference(joint, q, turns)


@part_of_kernel
def points_jacobian(joint, q, turns, jacobian):
    """Jacobian of d."""
    row, a, b = joint.row, 3 * joint.body_a, 3 * joint.body_b
    _, _, ax, az, bx, bz = difference(joint, q, turns)
    jacobian[row, b], jacobian[row + 1, b + 1] = 1.0, 1.0
    jacobian[row, a], jacobian[row + 1, a + 1] = -1.0, -1.0
    jacobian[row, b + 2], jacobian[row + 1, b + 2] = -bz, bx
    jacobian[row, a + 2], jacobian[row + 1, a + 2] = az, -ax


@part_of_kernel
def points_gamma(joint, q, turns, v, gamma):
    """gamma of d."""
    _, _, ax, az, bx, bz = difference(joint, q, turns)
    gamma[joint.row], gamma[joint.row + 1] = _centripetal(joint, v, ax, az, bx, bz)


def points_columns(joint: np.void) -> list[list[int]]:
    """Coordinates of the two rows of d."""
    a, b = 3 * int(joint["body_a"]), 3 * int(joint["body_b"])
    return [[a, b, a + 2, b + 2], [a + 1, b + 1, a + 2, b + 2]]


# n . d = 0: one row


@part_of_kernel
def line_distance(joint, q, turns):
    """n . d, n fixed in body a."""
    dx, dz, _, _, _, _ = difference(joint, q, turns)
    nx, nz = turned(turns, joint.body_a, joint.normal)
    return nx * dx + nz * dz


@part_of_kernel
def line_residual(joint, q, turns, residual):
    """n . d."""
    residual[joint.row] = line_distance(joint, q, turns)


@part_of_kernel
def along_jacobian(joint, nx, nz, swing, ax, az, bx, bz, jacobian):
    """Jacobian of the part of d along unit vector (nx, nz); `swing` is the term of its turning with a."""
    row, a, b = joint.row, 3 * joint.body_a, 3 * joint.body_b
    jacobian[row, b], jacobian[row, b + 1] = nx, nz
    jacobian[row, a], jacobian[row, a + 1] = -nx, -nz
    jacobian[row, b + 2] = nz * bx - nx * bz
    jacobian[row, a + 2] = swing - (nz * ax - nx * az)


@part_of_kernel
def line_jacobian(joint, q, turns, jacobian):
    """Jacobian of n . d."""
    dx, dz, ax, az, bx, bz = difference(joint, q, turns)
    nx, nz = turned(turns, joint.body_a, joint.normal)
    along_jacobian(joint, nx, nz, nx * dz - nz * dx, ax, az, bx, bz, jacobian)


@part_of_kernel
def along_rates(joint, nx, nz, v, ax, az, bx, bz):
    """Return the centripetal part of -d'' along (nx, nz), and d' across it."""
    cx, cz = _centripetal(joint, v, ax, az, bx, bz)
    ux, uz = relative_velocity(joint, v, ax, az, bx, bz)
    return nx * cx + nz * cz, nx * uz - nz * ux


@part_of_kernel
def line_gamma(joint, q, turns, v, gamma):
    """Add gamma of n . d to that of a driver: (n . d)'' = n . d'' + 2 wa (k x n) . d' - wa^2 n . d + ..."""
    dx, dz, ax, az, bx, bz = difference(joint, q, turns)
    nx, nz = turned(turns, joint.body_a, joint.normal)
    wa = v[3 * joint.body_a + 2]
    along, across = along_rates(joint, nx, nz, v, ax, az, bx, bz)
    gamma[joint.row] += along - 2.0 * wa * across
    gamma[joint.row] += wa * wa * (nx * dx + nz * dz)


def line_columns(joint: np.void) -> list[list[int]]:
    """Coordinates of the row of n . d."""
    a, b = 3 * int(joint["body_a"]), 3 * int(joint["body_b"])
    return [[a, a + 1, a + 2, b, b + 1, b + 2]]


def line_reaction(joint: np.void, turns: np.ndarray, push: float) -> Reaction:
    """Reaction of a push along n."""
    (c, s), (x, z) = turns[joint["body_a"]], joint["normal"]
    return push * (c * x - s * z), push * (s * x + c * z), 0.0


# phi_b - phi_a - offset = 0: one row, whose gamma is zero


@part_of_kernel
def no_gamma(joint, q, turns, v, gamma):
    """Leave gamma at zero."""


@part_of_kernel
def angle_residual(joint, row, q, residual):
    """phi_b - phi_a - offset."""
    residual[row] = q[3 * joint.body_b + 2] - q[3 * joint.body_a + 2] - joint.offset


@part_of_kernel
def angle_jacobian(joint, row, jacobian):
    """Jacobian of phi_b - phi_a."""
    jacobian[row, 3 * joint.body_b + 2], jacobian[row, 3 * joint.body_a + 2] = 1.0, -1.0


def angle_columns(joint: np.void) -> list[list[int]]:
    """Coordinates of the row of the angle."""
    return [[3 * int(joint["body_a"]) + 2, 3 * int(joint["body_b"]) + 2]]
