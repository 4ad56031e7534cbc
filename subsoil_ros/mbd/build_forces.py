"""From the forces of a scene, and the friction and stops of its joints, to the tables of a model."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..errors import SceneError
from ..scene.mechanism import (
    CoordinateSpring,
    Force,
    Joint,
    Mechanism,
    PointLoad,
    PointOnLine,
    Prismatic,
    Revolute,
    RotationFriction,
    RotationStops,
    SpringDamper,
    TorsionSpring,
    TranslationFriction,
    TranslationStops,
    WheelContact,
)
from ..scene.time_functions import Law
from .frames import COORDINATE_INDEX, Snapshots, along
from .tables import (
    COORDINATE_SPRING,
    FORCE,
    JOINT,
    LOCKED_SPRING,
    LOCKED_TORSION,
    POINT_LOAD,
    ROD,
    SPRING_DAMPER,
    TORSION_SPRING,
    TRAVEL_FRICTION,
    TRAVEL_SPRING,
    TURN_FRICTION,
    TURN_LOCK,
    WHEEL_CONTACT,
)
from .time_functions import NO_LAW


class Pair(Protocol):
    """A part between two bodies."""

    @property
    def body_a(self) -> str: ...

    @property
    def body_b(self) -> str: ...


class LawList:
    """Collects laws and gives each its index."""

    def __init__(self) -> None:
        self.laws: list[Law] = []

    def add(self, law: Law | None) -> int:
        if law is None:
            return NO_LAW
        self.laws.append(law)
        return len(self.laws) - 1


@dataclass(frozen=True)
class ForceTables:
    """Forces of a machine, and the joints that stand for its locked springs."""

    names: tuple[str, ...]  # of the scene, then JOINT.friction and JOINT.stops
    rows: np.ndarray  # (forces,) FORCE
    curves: np.ndarray  # (points, 3) float64, see Model
    lock_names: tuple[str, ...]
    locks: np.ndarray  # (locked springs,) JOINT


class _Builder:
    """Collects the rows."""

    def __init__(self, mechanism: Mechanism, frames: Snapshots, laws: LawList) -> None:
        self.frames, self.laws, self.joint_names = frames, laws, list(mechanism.joints)
        self.names: list[str] = []
        self.rows: list[np.ndarray] = []
        self.curves: list[tuple[float, float, float]] = []
        self.lock_names: list[str] = []
        self.locks: list[np.ndarray] = []

    def _row(self, name: str, kind: int) -> np.ndarray:
        """A new row (1,) FORCE without stops and laws."""
        row = np.zeros(1, dtype=FORCE)
        row["kind"], row["laws"], row["body_a"] = kind, NO_LAW, len(self.frames.names) - 1
        row["lower"], row["upper"], row["slip_speed"] = -math.inf, math.inf, 1.0
        self.names.append(name)
        self.rows.append(row)
        return row

    def _between(self, row: np.ndarray, part: Pair) -> None:
        frames = self.frames
        row["body_a"], row["body_b"] = frames.index(part.body_a), frames.index(part.body_b)
        row["origin"] = frames.angle(part.body_b) - frames.angle(part.body_a)

    def add_force(self, name: str, force: Force) -> None:
        if isinstance(force, SpringDamper):
            self._add_spring(name, force)
        elif isinstance(force, TorsionSpring):
            self._add_torsion(name, force)
        else:
            self._add_single(name, force)

    def _add_single(self, name: str, force: CoordinateSpring | PointLoad | WheelContact) -> None:
        """A force on one body."""
        row = self._row(name, POINT_LOAD)
        row["body_b"] = self.frames.index(force.body)
        if isinstance(force, CoordinateSpring):
            row["kind"] = COORDINATE_SPRING
            row["coordinate"] = 3 * self.frames.index(force.body) + COORDINATE_INDEX[force.coordinate]
            row["laws"][0, 0] = self.laws.add(force.target)
            row["way"] = {"both": 0, "pull_up": 1, "push_down": -1}[force.acts_in]
            row["stiffness"], row["damping"] = force.stiffness, force.damping
        elif isinstance(force, PointLoad):
            row["point_b"] = self.frames.point(force.body, force.point_m)
            parts = (force.force_x_newton, force.force_z_newton, force.moment_newton_m)
            row["laws"] = [[self.laws.add(law) for law in parts]]
        else:
            row["kind"] = WHEEL_CONTACT
            row["stiffness"], row["damping"] = force.stiffness_newton_per_m, force.damping_newton_s_per_m
            row["length"], row["ground"] = force.radius_m, force.ground_z_m
            row["friction"], row["slip_speed"] = force.friction, force.slip_speed_m_per_s

    def _add_spring(self, name: str, force: SpringDamper) -> None:
        row = self._row(name, SPRING_DAMPER)
        self._between(row, force)
        row["point_a"] = self.frames.point(force.body_a, force.point_a_m)
        row["point_b"] = self.frames.point(force.body_b, force.point_b_m)
        if force.locked:
            length = math.dist(force.point_a_m, force.point_b_m)
            if length == 0.0:
                raise SceneError(
                    f"mechanism.forces.{name}.locked: its two points are one in the reference pose, and a "
                    "rod needs a length; use a revolute joint there"
                )
            self._lock(name, row, LOCKED_SPRING, ROD, length)
            return
        row["way"] = {"both": 0, "compression": 1, "tension": -1}[force.acts_in]
        row["damping"] = force.damping_newton_s_per_m
        table = None if force.table is None else (force.table.compressions_m, force.table.forces_newton)
        self._characteristic(
            row, force.stiffness_newton_per_m, force.preload_newton, force.free_length_m, table
        )
        self._stops(row, force.stops)

    def _add_torsion(self, name: str, force: TorsionSpring) -> None:
        row = self._row(name, TORSION_SPRING)
        self._between(row, force)
        if force.locked:
            self._lock(name, row, LOCKED_TORSION, TURN_LOCK, float(row["origin"][0]))
            return
        row["way"] = {"both": 0, "positive": 1, "negative": -1}[force.acts_in]
        row["damping"] = force.damping_newton_m_s_per_rad
        table = None if force.table is None else (force.table.angles_rad, force.table.moments_newton_m)
        self._characteristic(
            row, force.stiffness_newton_m_per_rad, force.preload_newton_m, force.rest_angle_rad, table
        )
        self._stops(row, force.stops)

    def _characteristic(
        self,
        row: np.ndarray,
        stiffness: float | None,
        preload: float,
        rest: float,
        table: tuple[tuple[float, ...], tuple[float, ...]] | None,
    ) -> None:
        """Elastic part; the preload of a linear spring is a longer free length."""
        row["stiffness"], row["preload"], row["length"] = stiffness or 0.0, preload, rest
        if table is not None:
            row["curve"], row["curve_count"] = len(self.curves), len(table[0])
            self.curves += _with_energy(*table)
        elif stiffness:
            row["length"], row["preload"] = rest + preload / stiffness, 0.0

    def _stops(self, row: np.ndarray, stops: TranslationStops | RotationStops | None) -> None:
        if stops is None:
            return
        if isinstance(stops, TranslationStops):
            lower, upper = stops.lower_m, stops.upper_m
            row["stop_stiffness"], row["stop_damping"] = (
                stops.stiffness_newton_per_m,
                stops.damping_newton_s_per_m,
            )
        else:
            lower, upper = stops.lower_rad, stops.upper_rad
            row["stop_stiffness"] = stops.stiffness_newton_m_per_rad
            row["stop_damping"] = stops.damping_newton_m_s_per_rad
        row["lower"] = -math.inf if lower is None else lower
        row["upper"] = math.inf if upper is None else upper

    def _lock(self, name: str, row: np.ndarray, kind: int, joint_kind: int, offset: float) -> None:
        """A joint in the place of a spring."""
        row["kind"], row["joint"] = kind, len(self.joint_names) + len(self.locks)
        joint = np.zeros(1, dtype=JOINT)
        for key in ("body_a", "body_b", "point_a", "point_b"):
            joint[key] = row[key]
        joint["kind"], joint["offset"], joint["law"] = joint_kind, offset, NO_LAW
        self.locks.append(joint)
        self.lock_names.append(name if name not in self.joint_names else f"{name}_locked")

    def add_joint(self, name: str, joint: Joint) -> None:
        """Friction and stops of a joint."""
        if not isinstance(joint, Revolute | Prismatic | PointOnLine):
            return
        turning = isinstance(joint, Revolute)
        if joint.friction is not None:
            row = self._row(f"{name}.friction", TURN_FRICTION if turning else TRAVEL_FRICTION)
            self._place(row, joint)
            row["joint"] = self.joint_names.index(name)
            self._friction(row, joint.friction)
        if joint.stops is not None:
            row = self._row(f"{name}.stops", TORSION_SPRING if turning else TRAVEL_SPRING)
            self._place(row, joint)
            self._stops(row, joint.stops)

    def _friction(self, row: np.ndarray, friction: RotationFriction | TranslationFriction) -> None:
        row["friction"] = friction.coefficient
        if isinstance(friction, RotationFriction):
            row["preload"], row["length"] = friction.preload_newton_m, friction.radius_m
            row["slip_speed"] = friction.slip_speed_rad_per_s
        else:
            row["preload"], row["length"] = friction.preload_newton, 1.0
            row["slip_speed"] = friction.slip_speed_m_per_s

    def _place(self, row: np.ndarray, joint: Revolute | Prismatic | PointOnLine) -> None:
        self._between(row, joint)
        row["point_a"] = self.frames.point(joint.body_a, joint.point_m)
        row["point_b"] = self.frames.point(joint.body_b, joint.point_m)
        if not isinstance(joint, Revolute):
            row["axis"] = self.frames.vector(joint.body_a, *along(joint.axis))


def _with_energy(places: tuple[float, ...], forces: tuple[float, ...]) -> list[tuple[float, float, float]]:
    """(compression, force, energy) of every point; the energy is zero at zero compression."""
    x, f = np.array(places), np.array(forces)
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(x))])
    segment = int(np.clip(np.searchsorted(x, 0.0, side="right") - 1, 0, len(x) - 2))
    slope = (f[segment + 1] - f[segment]) / (x[segment + 1] - x[segment])
    span = 0.0 - x[segment]
    energy -= energy[segment] + span * (f[segment] + 0.5 * slope * span)
    return [(float(a), float(b), float(c)) for a, b, c in zip(x, f, energy, strict=True)]


def _stack(rows: Iterable[np.ndarray], dtype: np.dtype) -> np.ndarray:
    return np.concatenate([np.zeros(0, dtype=dtype), *rows])


def tabulate_forces(mechanism: Mechanism, frames: Snapshots, laws: LawList) -> ForceTables:
    """Tables of all forces, in the order of the scene, then friction and stops in the order of joints.

    Raises:
        SceneError: a locked spring without length.
    """
    builder = _Builder(mechanism, frames, laws)
    for name, force in mechanism.forces.items():
        builder.add_force(name, force)
    for name, joint in mechanism.joints.items():
        builder.add_joint(name, joint)
    return ForceTables(
        names=tuple(builder.names),
        rows=_stack(builder.rows, FORCE),
        curves=np.array(builder.curves, dtype=np.float64).reshape(-1, 3),
        lock_names=tuple(builder.lock_names),
        locks=_stack(builder.locks, JOINT),
    )
