"""Force elements: one module per kind, with its law, its modes, its report, and its table row.

A new kind needs a class in scene/mechanism.py, a module here and a line in MODULE_OF_SCENE; CONTRIBUTING.md
adds one. Its module has a KIND of its own, `fill`, and the kernels `add` (onto the generalised forces and
powers), `mode_at` (the smooth part of its law that holds, if that has kinks) and `report`; or, between two
bodies, `measure` alone, with the law of elastic.py, and a branch of _measure in evaluation.py.
"""

from typing import Any, Protocol

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
from ..function_tables import FunctionList
from ..geometry import ReferencePoses
from . import (
    coordinate_spring,
    point_load,
    spring_damper,
    torsion_spring,
    wheel_contact,
)
from .force_table import Builder, ForceTables
from .in_joints import fill_friction_of, fill_stops_of


class ForceKind(Protocol):
    """The module of a kind."""

    def fill(self, builder: Builder, name: str, force: Any) -> None:
        """Add its row to the table."""


MODULE_OF_SCENE: dict[type, ForceKind] = {
    SpringDamper: spring_damper,
    TorsionSpring: torsion_spring,
    CoordinateSpring: coordinate_spring,
    PointLoad: point_load,
    WheelContact: wheel_contact,
}

OF_THEIR_OWN: tuple[Any, ...] = tuple(
    module for module in MODULE_OF_SCENE.values() if hasattr(module, "KIND")
)
"""Modules with kernels of their own; the others have the law of elastic.py."""


def tabulate_forces(mechanism: Mechanism, poses: ReferencePoses, functions: FunctionList) -> ForceTables:
    """Return the tables of all forces in scene order, then of friction and stops in the order of the joints.

    Raises:
        SceneError: a locked spring without length.
    """
    builder = Builder(mechanism, poses, functions)
    for name, force in mechanism.forces.items():
        MODULE_OF_SCENE[type(force)].fill(builder, name, force)
    for name, joint in mechanism.joints.items():
        if isinstance(joint, Revolute | Prismatic | PointOnLine):
            fill_friction_of(builder, name, joint)
            fill_stops_of(builder, name, joint)
    return builder.tables()
