"""Spring and damper between two points: push = k (L_0 - L) + F_0 - c L' along them (elastic.py)."""

import math

from ...errors import SceneError
from ...scene.mechanism import SpringDamper
from ..compiled import inner_kernel
from ..geometry import difference, relative_velocity
from ..joints.table import ROD
from .builder import Builder
from .elastic import fill_elastic, fill_stops
from .table import LOCKED_SPRING, SPRING_DAMPER


@inner_kernel
def measure(force, q, turns, v):
    """Length, its rate, its direction (none at no length), and the arms of both ends."""
    dx, dz, ax, az, bx, bz = difference(force, q, turns)
    length = math.sqrt(dx * dx + dz * dz)
    inverse = 1.0 / length if length > 0.0 else 0.0
    ux, uz = dx * inverse, dz * inverse
    vx, vz = relative_velocity(force, v, ax, az, bx, bz)
    return length, ux * vx + uz * vz, ux, uz, ax, az, bx, bz


def fill(builder: Builder, name: str, force: SpringDamper) -> None:
    """Its row of the table, and a rod if it is locked."""
    row, poses = builder.row_between(name, SPRING_DAMPER, force), builder.poses
    row["point_a"] = poses.point(force.body_a, force.point_a_m)
    row["point_b"] = poses.point(force.body_b, force.point_b_m)
    if force.locked:
        length = math.dist(force.point_a_m, force.point_b_m)
        if length == 0.0:
            raise SceneError(
                f"mechanism.forces.{name}.locked: its two points are one in the reference pose, and a "
                "rod needs a length; use a revolute joint there"
            )
        builder.lock(name, row, LOCKED_SPRING, ROD, length)
        return
    pushes = force.free_length_m > 0.0 or force.preload_newton != 0.0 or force.table or force.stops
    if pushes and force.point_a_m == force.point_b_m:
        raise SceneError(
            f"mechanism.forces.{name}: its two points are one in the reference pose, where its force has no "
            "direction; move one, or give free_length_m: 0 and neither preload, table nor stops"
        )
    row["acts_in"] = {"both": 0, "compression": 1, "tension": -1}[force.acts_in]
    row["damping"] = force.damping_newton_s_per_m
    table = None if force.table is None else (force.table.compressions_m, force.table.forces_newton)
    fill_elastic(builder, row, force.stiffness_newton_per_m, force.preload_newton, force.free_length_m, table)
    fill_stops(row, force.stops)
