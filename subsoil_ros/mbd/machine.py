"""From a mechanism of a scene to the tables of its model."""

import math
from dataclasses import dataclass

import numpy as np

from ..scene.mechanism import Mechanism
from .explicit_integrators import multistep_weights
from .forces import tabulate_forces
from .forces.force_table import FRICTIONS
from .function_tables import FunctionList, tabulate
from .geometry import COORDINATE_INDEX, ReferencePoses
from .joints import MODULE_OF_SCENE, kind_of
from .joints.rows import JOINT
from .machine_arrays import ADAMS_MOULTON, GENERALIZED_ALPHA, RUNGE_KUTTA_4, Model
from .sparsity import sparsity_of

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
    poses, functions = ReferencePoses(mechanism), FunctionList()
    size = _size(mechanism)
    joints = np.zeros(len(mechanism.joints), dtype=JOINT)
    for row, joint in zip(joints, mechanism.joints.values(), strict=True):
        MODULE_OF_SCENE[type(joint)].fill(row, joint, poses, functions)
    forces = tabulate_forces(mechanism, poses, functions)
    joints = np.concatenate([joints, forces.locks])
    row_joint, row_scale = _number_rows(joints, size)
    table, breakpoints = tabulate(functions.functions)
    bodies = mechanism.bodies
    mass = np.array([[b.mass_kg, b.mass_kg, b.inertia_kg_m2] for b in bodies.values()]).reshape(-1)
    column_scale = np.tile([1.0, 1.0, 1.0 / size], len(bodies))
    model = Model(
        mass=mass,
        joints=joints,
        forces=forces.rows,
        curves=forces.curves,
        functions=table,
        breakpoints=breakpoints,
        row_scale=row_scale,
        column_scale=column_scale,
        sqrt_mass=column_scale * np.sqrt(mass),
        sparsity=sparsity_of(joints, len(bodies)),
        weights=multistep_weights(mechanism.integrator_order),
        gravity=float(gravity),
        size=float(size),
        step=float(step_s),
        tolerance=math.inf if mechanism.tolerance is None else mechanism.tolerance,
        integrator=INTEGRATORS[mechanism.integrator],
        pressed=bool((forces.rows["friction"][np.isin(forces.rows["kind"], FRICTIONS)] > 0.0).any()),
    )
    return Machine(
        model=model,
        bodies=tuple(bodies),
        joints=(*mechanism.joints, *forces.lock_names),
        forces=forces.names,
        reference=poses.coordinates(),
        row_joint=row_joint,
    )


def _number_rows(joints: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Gives every joint its first row; joint (m,) int64 and scale (m,) float64 of every row."""
    row_joint: list[int] = []
    row_scale: list[float] = []
    for i, joint in enumerate(joints):
        joint["row"] = len(row_joint)
        for angle in kind_of(joint).angle_rows(joint):
            row_joint.append(i)
            row_scale.append(size if angle else 1.0)
    return np.array(row_joint, dtype=np.int64), np.array(row_scale, dtype=np.float64)


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
