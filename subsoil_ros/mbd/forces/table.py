"""The table of force elements that kernels read, and the numbers of their kinds."""

import numpy as np

SPRING_DAMPER, COORDINATE_SPRING, POINT_LOAD, WHEEL_CONTACT, TORSION_SPRING = 0, 1, 2, 3, 4
TRANSLATION_STOPS, ROTATION_FRICTION, TRANSLATION_FRICTION = 5, 6, 7  # of joints
LOCKED_SPRING, LOCKED_TORSION = 8, 9  # joints replace them
"""Stops of a revolute joint are a TORSION_SPRING without a spring."""

FRICTIONS = (ROTATION_FRICTION, TRANSLATION_FRICTION)

FORCE = np.dtype(
    [
        ("kind", np.int64),
        ("body_a", np.int64),
        ("body_b", np.int64),  # the only body of a one-body force
        ("coordinate", np.int64),  # coordinate spring: index into q
        ("functions", np.int64, 3),  # coordinate spring: target; point load: x, z, moment
        ("acts_in", np.int64),  # spring: 0 both, 1 only positive, -1 only negative force
        ("kinked", np.int64),  # spring_damper: 1 if its push reverses where it passes through its anchor
        ("joint", np.int64),  # friction: the joint whose reaction presses; locked: the joint in its place
        ("curve", np.int64),  # first row of its table in Model.curves
        ("curve_count", np.int64),  # rows of its table, 0 without
        ("point_a", np.float64, 2),  # in the frame of body_a [m]
        ("point_b", np.float64, 2),  # in the frame of body_b [m]
        ("origin", np.float64),  # phi_b - phi_a that counts as zero angle [rad]
        ("axis", np.float64, 2),  # unit vector of the translation, in the frame of body_a
        ("stiffness", np.float64),  # [N/m] or [N m/rad]
        ("damping", np.float64),  # [N s/m] or [N m s/rad]
        ("preload", np.float64),  # [N] or [N m]
        ("length", np.float64),  # spring: free length [m] or rest angle [rad]; wheel, pin: radius [m]
        ("lower", np.float64),  # stops on length, angle or translation, -inf or inf without [m] or [rad]
        ("upper", np.float64),
        ("stop_stiffness", np.float64),
        ("stop_damping", np.float64),
        ("ground", np.float64),  # wheel: height of the ground [m]
        ("friction", np.float64),
        ("slip_speed", np.float64),  # [m/s] or [rad/s]
        ("stick_stiffness", np.float64),  # [N/m] or [N m/rad], 0: regularised
        ("stick_damping", np.float64),  # [N s/m] or [N m s/rad]
    ],
    align=True,
)
