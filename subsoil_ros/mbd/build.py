"""From a mechanism of a scene to the tables of its model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..scene.laws import Law
from ..scene.mechanism import (
    GROUND,
    CoordinateSpring,
    Driver,
    Fixed,
    Force,
    Joint,
    Mechanism,
    PointLoad,
    Prismatic,
    Revolute,
    SpringDamper,
    WheelContact,
)
from .adams_moulton import multistep_weights
from .laws import NO_LAW, tabulate
from .tables import (
    COORDINATE_SPRING,
    DRIVER,
    FIXED,
    FORCE,
    JOINT,
    POINT_LOAD,
    PRISMATIC,
    REVOLUTE,
    ROWS_OF_KIND,
    SPRING_DAMPER,
    WHEEL_CONTACT,
    Model,
)

COORDINATE_INDEX = {"x": 0, "z": 1, "angle": 2, "x_m": 0, "z_m": 1, "angle_rad": 2}


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


class _Frames:
    """Reference poses: takes points of the world into the frames of bodies."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.names = (*mechanism.bodies, GROUND)
        self._shift = mechanism.initial.translate_x_m
        poses = [(*body.position_m, body.angle_rad) for body in mechanism.bodies.values()]
        self.poses = np.array([*poses, (-self._shift, 0.0, 0.0)])

    def index(self, body: str) -> int:
        return self.names.index(body)

    def angle(self, body: str) -> float:
        return float(self.poses[self.index(body), 2])

    def vector(self, body: str, x: float, z: float) -> tuple[float, float]:
        """A world vector in the axes of a body."""
        c, s = math.cos(self.angle(body)), math.sin(self.angle(body))
        return c * x + s * z, c * z - s * x

    def point(self, body: str, point: Sequence[float]) -> tuple[float, float]:
        """A world point of the reference pose in the frame of a body; the ground moves with the machine."""
        pose = self.poses[self.index(body)]
        return self.vector(body, point[0] - pose[0], point[1] - pose[1])

    def coordinates(self) -> np.ndarray:
        """q (n + 3,) of the reference pose, moved by translate_x_m."""
        q = self.poses.copy()
        q[:-1, 0] += self._shift
        q[-1] = 0.0
        return q.reshape(-1)


class _Laws:
    """Collects laws and gives each its index."""

    def __init__(self) -> None:
        self.laws: list[Law] = []

    def add(self, law: Law | None) -> int:
        if law is None:
            return NO_LAW
        self.laws.append(law)
        return len(self.laws) - 1


def build_machine(mechanism: Mechanism, gravity: float, step_s: float) -> Machine:
    """Tables of a mechanism. Drivers start from the reference pose; assembly.py moves them."""
    frames, laws = _Frames(mechanism), _Laws()
    reference = frames.coordinates()
    joints = np.zeros(len(mechanism.joints), dtype=JOINT)
    row_joint: list[int] = []
    row_scale: list[float] = []
    size = _size(mechanism)
    for i, joint in enumerate(mechanism.joints.values()):
        _fill_joint(joints[i], joint, frames, laws, reference)
        joints[i]["row"] = len(row_joint)
        count = ROWS_OF_KIND[int(joints[i]["kind"])]
        row_joint += [i] * count
        row_scale += _row_scales(joint, size)
    forces = np.zeros(len(mechanism.forces), dtype=FORCE)
    for i, force in enumerate(mechanism.forces.values()):
        _fill_force(forces[i], force, frames, laws)
    table, corners = tabulate(laws.laws)
    bodies = mechanism.bodies
    model = Model(
        mass=np.array([[b.mass_kg, b.mass_kg, b.inertia_kg_m2] for b in bodies.values()]).reshape(-1),
        joints=joints,
        forces=forces,
        laws=table,
        corners=corners,
        row_scale=np.array(row_scale, dtype=np.float64),
        column_scale=np.tile([1.0, 1.0, 1.0 / size], len(bodies)),
        weights=multistep_weights(mechanism.integrator_order),
        gravity=float(gravity),
        size=float(size),
        step=float(step_s),
    )
    return Machine(
        model=model,
        bodies=tuple(bodies),
        joints=tuple(mechanism.joints),
        forces=tuple(mechanism.forces),
        reference=reference,
        row_joint=np.array(row_joint, dtype=np.int64),
    )


def _row_scales(joint: Joint, size: float) -> list[float]:
    if isinstance(joint, Driver):
        return [size if joint.coordinate == "angle" else 1.0]
    if isinstance(joint, Prismatic):
        return [1.0, size]
    return [1.0, 1.0, size] if isinstance(joint, Fixed) else [1.0, 1.0]


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


def _fill_joint(row: np.void, joint: Joint, frames: _Frames, laws: _Laws, reference: np.ndarray) -> None:
    if isinstance(joint, Driver):
        row["kind"] = DRIVER
        row["body_a"] = frames.index(GROUND)
        row["body_b"] = frames.index(joint.body)
        row["coordinate"] = 3 * frames.index(joint.body) + COORDINATE_INDEX[joint.coordinate]
        row["law"] = laws.add(joint.speed)
        row["offset"] = reference[row["coordinate"]]
        return
    row["body_a"], row["body_b"] = frames.index(joint.body_a), frames.index(joint.body_b)
    row["point_a"] = frames.point(joint.body_a, joint.point_m)
    row["point_b"] = frames.point(joint.body_b, joint.point_m)
    row["offset"] = frames.angle(joint.body_b) - frames.angle(joint.body_a)
    if isinstance(joint, Prismatic):
        row["kind"] = PRISMATIC
        length = math.hypot(*joint.axis)
        row["normal"] = frames.vector(joint.body_a, -joint.axis[1] / length, joint.axis[0] / length)
    elif isinstance(joint, Revolute):
        row["kind"] = REVOLUTE
        if joint.point_b_m is not None:
            row["point_b"] = frames.point(joint.body_b, joint.point_b_m)
    else:
        row["kind"] = FIXED


def _fill_force(row: np.void, force: Force, frames: _Frames, laws: _Laws) -> None:
    row["laws"] = NO_LAW
    row["body_a"] = frames.index(GROUND)
    if isinstance(force, SpringDamper):
        row["kind"] = SPRING_DAMPER
        row["body_a"], row["body_b"] = frames.index(force.body_a), frames.index(force.body_b)
        row["point_a"] = frames.point(force.body_a, force.point_a_m)
        row["point_b"] = frames.point(force.body_b, force.point_b_m)
        row["stiffness"], row["damping"] = force.stiffness_newton_per_m, force.damping_newton_s_per_m
        row["length"] = force.free_length_m
        return
    row["body_b"] = frames.index(force.body)
    if isinstance(force, CoordinateSpring):
        row["kind"] = COORDINATE_SPRING
        row["coordinate"] = 3 * frames.index(force.body) + COORDINATE_INDEX[force.coordinate]
        row["laws"][0] = laws.add(force.target)
        row["way"] = {"both": 0, "pull_up": 1, "push_down": -1}[force.only]
        row["stiffness"], row["damping"] = force.stiffness_newton_per_m, force.damping_newton_s_per_m
    elif isinstance(force, PointLoad):
        row["kind"] = POINT_LOAD
        row["point_b"] = frames.point(force.body, force.point_m)
        row["laws"] = [
            laws.add(law) for law in (force.force_x_newton, force.force_z_newton, force.moment_newton_m)
        ]
    elif isinstance(force, WheelContact):
        row["kind"] = WHEEL_CONTACT
        row["stiffness"], row["damping"] = force.stiffness_newton_per_m, force.damping_newton_s_per_m
        row["length"], row["ground"] = force.radius_m, force.ground_z_m
        row["friction"], row["slip_speed"] = force.friction, force.slip_speed_m_per_s
