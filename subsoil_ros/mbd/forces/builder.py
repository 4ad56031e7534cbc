"""Builder of a machine's force table, and of the joints that replace locked springs."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...scene.mechanism import Mechanism, PointOnLine, Prismatic, Revolute
from ..frames import ReferencePoses, along
from ..joints.rows import Pair
from ..joints.table import JOINT
from ..time_functions import NO_FUNCTION, FunctionList
from .table import FORCE


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
