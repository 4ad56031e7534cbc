"""Force elements: one module per kind, with its law, its modes, its report, and its table row.

A new kind needs
- an entry in scene/mechanism.py: a class with a `kind` of its own, in the union `Force`;
- a number in table.py;
- a module here: kernels `add` (onto the generalised forces and powers), `report`, and `mode_at` if its law
  has kinks; or, between two bodies, `measure` alone, with the law of elastic.py; and `fill`;
- a line in FILL_OF_SCENE below, and in the three kernels of evaluation.py;
- a row in docs/mechanism.md and a test in closed form (tests/physics/test_mbd_forces.py).
"""

from collections.abc import Callable
from typing import Any

from ...scene.mechanism import (
    CoordinateSpring,
    Mechanism,
    PointLoad,
    PointOnLine,
    Prismatic,
    Revolute,
    SpringDamper,
    TorsionSpring,
    WheelContact,
)
from ..frames import ReferencePoses
from ..function_tables import FunctionList
from . import (
    coordinate_spring,
    joint_friction,
    joint_stops,
    point_load,
    spring_damper,
    torsion_spring,
    wheel_contact,
)
from .force_table import Builder, ForceTables

FILL_OF_SCENE: dict[type, Callable[[Builder, str, Any], None]] = {
    SpringDamper: spring_damper.fill,
    TorsionSpring: torsion_spring.fill,
    CoordinateSpring: coordinate_spring.fill,
    PointLoad: point_load.fill,
    WheelContact: wheel_contact.fill,
}


def tabulate_forces(mechanism: Mechanism, poses: ReferencePoses, functions: FunctionList) -> ForceTables:
    """Return the tables of all forces in scene order, then of friction and stops in the order of the joints.

    Raises:
        SceneError: a locked spring without length.
    """
    builder = Builder(mechanism, poses, functions)
    for name, force in mechanism.forces.items():
        FILL_OF_SCENE[type(force)](builder, name, force)
    for name, joint in mechanism.joints.items():
        if isinstance(joint, Revolute | Prismatic | PointOnLine):
            joint_friction.fill(builder, name, joint)
            joint_stops.fill(builder, name, joint)
    return builder.tables()
