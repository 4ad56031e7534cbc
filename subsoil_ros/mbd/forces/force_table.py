"""Table of force elements that kernels read, and its builder, which adds the joints of locked springs."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...scene.mechanism import Mechanism, PointOnLine, Prismatic, Revolute
from ..function_tables import NO_FUNCTION, FunctionList
from ..geometry import ReferencePoses, along
from ..joints.rows import JOINT, Pair

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


@dataclass(frozen=True)
class ForceTables:
    """Forces of a machine, and the joints that replace its locked springs."""

    names: tuple[str, ...]  # of the scene, then JOINT.friction and JOINT.stops
    rows: np.ndarray  # (forces,) FORCE
    curves: np.ndarray  # (points, 3) float64, see Model
    lock_names: tuple[str, ...]
    locks: np.ndarray  # (locked springs,) JOINT


class Builder:
    """Collects the rows that the modules of this package add."""

    def __init__(self, mechanism: Mechanism, poses: ReferencePoses, functions: FunctionList) -> None:
        self.poses, self.functions, self.joint_names = poses, functions, list(mechanism.joints)
        self.curves: list[tuple[float, float, float]] = []  # see Model
        self._names: list[str] = []
        self._rows: list[np.ndarray] = []
        self._lock_names: list[str] = []
        self._locks: list[np.ndarray] = []

    def row(self, name: str, kind: int) -> np.ndarray:
        """Add a row (1,) FORCE without stops and time functions, and return it."""
        row = np.zeros(1, dtype=FORCE)
        row["kind"], row["functions"], row["body_a"] = kind, NO_FUNCTION, len(self.poses.names) - 1
        row["lower"], row["upper"], row["slip_speed"] = -math.inf, math.inf, 1.0
        self._names.append(name)
        self._rows.append(row)
        return row

    def row_between(self, name: str, kind: int, part: Pair) -> np.ndarray:
        """The same for a force between two bodies."""
        row, poses = self.row(name, kind), self.poses
        row["body_a"], row["body_b"] = poses.index(part.body_a), poses.index(part.body_b)
        row["origin"] = poses.angle(part.body_b) - poses.angle(part.body_a)
        return row

    def row_at_joint(self, name: str, kind: int, joint: Revolute | Prismatic | PointOnLine) -> np.ndarray:
        """The same for a force in a joint."""
        row, poses = self.row_between(name, kind, joint), self.poses
        row["point_a"] = poses.point(joint.body_a, joint.point_m)
        row["point_b"] = poses.point(joint.body_b, joint.point_m)
        if not isinstance(joint, Revolute):
            row["axis"] = poses.vector(joint.body_a, *along(joint.axis))
        return row

    def lock(self, name: str, row: np.ndarray, kind: int, joint_kind: int, offset: float) -> None:
        """Add a joint that replaces a spring."""
        row["kind"], row["joint"] = kind, len(self.joint_names) + len(self._locks)
        joint = np.zeros(1, dtype=JOINT)
        for key in ("body_a", "body_b", "point_a", "point_b"):
            joint[key] = row[key]
        joint["kind"], joint["offset"], joint["function"] = joint_kind, offset, NO_FUNCTION
        self._locks.append(joint)
        self._lock_names.append(name if name not in self.joint_names else f"{name}_locked")

    def tables(self) -> ForceTables:
        """Return the tables of all rows added."""
        return ForceTables(
            names=tuple(self._names),
            rows=_stack(self._rows, FORCE),
            curves=np.array(self.curves, dtype=np.float64).reshape(-1, 3),
            lock_names=tuple(self._lock_names),
            locks=_stack(self._locks, JOINT),
        )


def _stack(rows: Iterable[np.ndarray], dtype: np.dtype) -> np.ndarray:
    return np.concatenate([np.zeros(0, dtype=dtype), *rows])
