"""From a mechanism of a scene to the tables of its model."""

import math
from dataclasses import dataclass

import numpy as np

from ..scene.mechanism import (
    GROUND,
    Driver,
    Joint,
    Mechanism,
    PointOnLine,
    Prismatic,
    Revolute,
)
from .build_forces import ForceTables, LawList, Pair, tabulate_forces
from .frames import COORDINATE_INDEX, Snapshots, across
from .integrators.adams_moulton import multistep_weights
from .sparsity import sparsity_of
from .tables import (
    ADAMS_MOULTON,
    DRIVER,
    FIXED,
    GENERALIZED_ALPHA,
    JOINT,
    POINT_ON_LINE,
    PRISMATIC,
    RELATIVE_DRIVER,
    REVOLUTE,
    ROWS_OF_KIND,
    RUNGE_KUTTA_4,
    TRAVEL_FRICTION,
    TURN_FRICTION,
    TURN_LOCK,
    Model,
)
from .time_functions import tabulate

INTEGRATORS = {
    "adams_moulton": ADAMS_MOULTON,
    "runge_kutta_4": RUNGE_KUTTA_4,
    "generalized_alpha": GENERALIZED_ALPHA,
}


@dataclass(frozen=True)
class Machine:
    """A model and the names of its parts, in the order of the scene."""

    model: Model
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    forces: tuple[str, ...]
    reference: np.ndarray  # (n + 3,) float64: pose of the scene, moved by initial.translate_x_m
    row_joint: np.ndarray  # (m,) int64: joint of every row of Phi

    def coordinate(self, body: str, name: str) -> int:
        """Index into q of a coordinate (x, z, angle, or with its unit) of a body."""
        return 3 * self.bodies.index(body) + COORDINATE_INDEX[name]


def build_machine(mechanism: Mechanism, gravity: float, step_s: float) -> Machine:
    """Tables of a mechanism. Drivers start from the reference pose; assembly.py moves them.

    Raises:
        SceneError: a locked spring without length.
    """
    frames, laws = Snapshots(mechanism), LawList()
    reference = frames.coordinates()
    size = _size(mechanism)
    joints = np.zeros(len(mechanism.joints), dtype=JOINT)
    for row, joint in zip(joints, mechanism.joints.values(), strict=True):
        _fill_joint(row, joint, frames, laws, reference)
    forces = tabulate_forces(mechanism, frames, laws)
    joints = np.concatenate([joints, forces.locks])
    row_joint, row_scale = _number_rows(joints, size)
    table, corners = tabulate(laws.laws)
    bodies = mechanism.bodies
    mass = np.array([[b.mass_kg, b.mass_kg, b.inertia_kg_m2] for b in bodies.values()]).reshape(-1)
    column_scale = np.tile([1.0, 1.0, 1.0 / size], len(bodies))
    model = Model(
        mass=mass,
        joints=joints,
        forces=forces.rows,
        curves=forces.curves,
        laws=table,
        corners=corners,
        row_scale=row_scale,
        column_scale=column_scale,
        root_mass=column_scale * np.sqrt(mass),
        sparsity=sparsity_of(joints, len(bodies)),
        weights=multistep_weights(mechanism.integrator_order),
        gravity=float(gravity),
        size=float(size),
        step=float(step_s),
        integrator=INTEGRATORS[mechanism.integrator],
        pressed=bool((forces.rows["friction"][_frictions(forces)] > 0.0).any()),
    )
    return Machine(
        model=model,
        bodies=tuple(bodies),
        joints=(*mechanism.joints, *forces.lock_names),
        forces=forces.names,
        reference=reference,
        row_joint=row_joint,
    )


def _frictions(forces: ForceTables) -> np.ndarray:
    return np.isin(forces.rows["kind"], (TURN_FRICTION, TRAVEL_FRICTION))


def _number_rows(joints: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Gives every joint its first row; joint (m,) int64 and scale (m,) float64 of every row."""
    row_joint: list[int] = []
    row_scale: list[float] = []
    for i, joint in enumerate(joints):
        joint["row"] = len(row_joint)
        row_joint += [i] * ROWS_OF_KIND[int(joint["kind"])]
        row_scale += _row_scales(joint, size)
    return np.array(row_joint, dtype=np.int64), np.array(row_scale, dtype=np.float64)


def _row_scales(row: np.void, size: float) -> list[float]:
    """1 for a row in metres, the machine's size for one in radians."""
    kind = int(row["kind"])
    if kind in (DRIVER, RELATIVE_DRIVER):
        return [size if int(row["coordinate"]) % 3 == 2 else 1.0]
    if kind == TURN_LOCK:
        return [size]
    turns = kind in (PRISMATIC, FIXED)
    return [1.0] * (ROWS_OF_KIND[kind] - turns) + [size] * turns


def _size(mechanism: Mechanism) -> float:
    """Diagonal of the box around all centres of mass and joint and spring points [m]."""
    points = [body.position_m for body in mechanism.bodies.values()]
    for part in (*mechanism.joints.values(), *mechanism.forces.values()):
        for key in ("point_m", "point_a_m", "point_b_m"):
            point = getattr(part, key, None)
            if point is not None:
                points.append(point)
    spread = float(np.linalg.norm(np.ptp(np.array(points), axis=0)))
    if spread > 0.0:
        return spread
    # all points in one place: the largest radius of gyration
    return max(math.sqrt(b.inertia_kg_m2 / b.mass_kg) for b in mechanism.bodies.values())


def _fill_joint(row: np.void, joint: Joint, frames: Snapshots, laws: LawList, reference: np.ndarray) -> None:
    if isinstance(joint, Driver):
        _fill_driver(row, joint, frames, laws, reference)
        return
    _fill_pair(row, joint, frames)
    row["point_a"] = frames.point(joint.body_a, joint.point_m)
    row["point_b"] = frames.point(joint.body_b, joint.point_m)
    if isinstance(joint, Prismatic | PointOnLine):
        row["kind"] = PRISMATIC if isinstance(joint, Prismatic) else POINT_ON_LINE
        row["normal"] = frames.vector(joint.body_a, *across(joint.axis))
    elif isinstance(joint, Revolute):
        row["kind"] = REVOLUTE
        if joint.point_b_m is not None:
            row["point_b"] = frames.point(joint.body_b, joint.point_b_m)
    else:
        row["kind"] = FIXED


def _fill_pair(row: np.void, part: Pair, frames: Snapshots) -> None:
    """Bodies of a joint between two, and the angle between them in the reference pose."""
    row["body_a"], row["body_b"] = frames.index(part.body_a), frames.index(part.body_b)
    row["offset"] = frames.angle(part.body_b) - frames.angle(part.body_a)


def _fill_driver(
    row: np.void, joint: Driver, frames: Snapshots, laws: LawList, reference: np.ndarray
) -> None:
    row["body_a"] = frames.index(joint.relative_to or GROUND)
    row["body_b"] = frames.index(joint.body)
    row["law"] = laws.add(joint.speed)
    coordinate = COORDINATE_INDEX[joint.coordinate]
    if joint.relative_to is None:
        row["kind"] = DRIVER
        row["coordinate"] = 3 * frames.index(joint.body) + coordinate
        row["offset"] = reference[row["coordinate"]]
        return
    row["kind"] = RELATIVE_DRIVER
    row["coordinate"] = coordinate
    if coordinate < 2:
        row["normal"] = frames.vector(joint.relative_to, 1.0 - coordinate, float(coordinate))
