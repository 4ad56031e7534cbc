"""Stops of a joint: one-sided spring-dampers at the ends of its rotation or translation (elastic.py)."""

from ...scene.mechanism import PointOnLine, Prismatic, Revolute
from ..geometry import difference, relative_velocity, turned
from ..kernel_options import inner_kernel
from .elastic import fill_stops
from .force_table import TORSION_SPRING, TRANSLATION_STOPS, Builder


@inner_kernel
def measure_translation(force, q, turns, v):
    """Translation along the axis, its rate, the axis, and arms: both forces act at the point of body b."""
    dx, dz, ax, az, bx, bz = difference(force, q, turns)
    ux, uz = turned(turns, force.body_a, force.axis)
    value = ux * dx + uz * dz
    ax, az = ax + dx, az + dz
    vx, vz = relative_velocity(force, v, ax, az, bx, bz)
    return value, ux * vx + uz * vz, ux, uz, ax, az, bx, bz


def fill(builder: Builder, name: str, joint: Revolute | Prismatic | PointOnLine) -> None:
    """Add their row to the table, if the joint has stops."""
    if joint.stops is not None:
        kind = TORSION_SPRING if isinstance(joint, Revolute) else TRANSLATION_STOPS
        fill_stops(builder.row_at_joint(f"{name}.stops", kind, joint), joint.stops)
