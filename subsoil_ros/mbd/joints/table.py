"""The table of joints that kernels read, and the numbers of their kinds."""

import numpy as np

REVOLUTE, PRISMATIC, FIXED, POINT_ON_LINE, ROD, ROTATION_LOCK, DRIVER, RELATIVE_DRIVER = (
    0,
    1,
    2,
    3,
    4,
    5,
    6,
    7,
)
"""Drivers come last: kind >= DRIVER. Rods and rotation locks replace locked springs."""

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
