"""Spring and damper between two points: push = k (L_0 - L) + F_0 - c L' along them (elastic.py).

Where one point passes through the other, the push reverses at once: a kink, with a mode on either side.
Within a step of it, the direction is minus or plus that of the relative velocity, so that the law of a mode
continues smoothly beyond, to a length below zero.
"""

import math

from ...errors import SceneError
from ...scene.mechanism import SpringDamper
from ..geometry import difference, relative_velocity
from ..joints.rows import ROD
from ..kernel_options import inner_kernel
from .elastic import fill_elastic, fill_stops
from .force_table import LOCKED_SPRING, SPRING_DAMPER, Builder

BEFORE, BEYOND = 2**40, 2**41
"""Numbers added to the mode of a spring that is about to pass through its anchor, or just has."""

MISSED = 1e-9
"""Distance, over the machine's size, below which points that pass count as meeting. The push on one that
passes at 1 m/s and 1 nm reverses within 1 ns, which parts of steps cannot follow."""


@inner_kernel
def measure(force, mode, q, turns, v):
    """Length, its rate, its direction (none at no length), and the arms of both ends."""
    dx, dz, ax, az, bx, bz = difference(force, q, turns)
    vx, vz = relative_velocity(force, v, ax, az, bx, bz)
    if mode >= BEFORE:
        speed = math.sqrt(vx * vx + vz * vz)
        inverse = 0.0 if speed == 0.0 else (1.0 / speed if mode >= BEYOND else -1.0 / speed)
        ux, uz = vx * inverse, vz * inverse
        return ux * dx + uz * dz, ux * vx + uz * vz, ux, uz, ax, az, bx, bz
    length = math.sqrt(dx * dx + dz * dz)
    inverse = 1.0 / length if length > 0.0 else 0.0
    ux, uz = dx * inverse, dz * inverse
    return length, ux * vx + uz * vz, ux, uz, ax, az, bx, bz


@inner_kernel
def passing(model, force, q, turns, v):
    """Return BEFORE or BEYOND next to the anchor; 0 if it is farther away than a step, or is missed."""
    if force.kinked == 0:
        return 0
    dx, dz, ax, az, bx, bz = difference(force, q, turns)
    vx, vz = relative_velocity(force, v, ax, az, bx, bz)
    far, speed = math.sqrt(dx * dx + dz * dz), math.sqrt(vx * vx + vz * vz)
    if far >= speed * model.step or abs(dx * vz - dz * vx) > MISSED * model.size * speed:
        return 0
    return BEFORE if dx * vx + dz * vz < 0.0 else BEYOND


def fill(builder: Builder, name: str, force: SpringDamper) -> None:
    """Add its row to the table, and a rod if it is locked."""
    row, poses = builder.row_between(name, SPRING_DAMPER, force), builder.poses
    row["point_a"] = poses.point(force.body_a, force.point_a_m)
    row["point_b"] = poses.point(force.body_b, force.point_b_m)
    if force.locked:
        length = math.dist(force.point_a_m, force.point_b_m)
        if length == 0.0:
            raise SceneError(
                f"mechanism.forces.{name}.locked: its two points coincide in the reference pose, and a "
                "rod needs a length; use a revolute joint there"
            )
        builder.lock(name, row, LOCKED_SPRING, ROD, length)
        return
    pushes = force.free_length_m > 0.0 or force.preload_newton != 0.0 or force.table or force.stops
    if pushes and force.point_a_m == force.point_b_m:
        raise SceneError(
            f"mechanism.forces.{name}: its two points coincide in the reference pose, where its force has no "
            "direction; move one, or give free_length_m: 0 and neither preload, table nor stops"
        )
    row["kinked"] = bool(pushes)
    row["acts_in"] = {"both": 0, "compression": 1, "tension": -1}[force.acts_in]
    row["damping"] = force.damping_newton_s_per_m
    table = None if force.table is None else (force.table.compressions_m, force.table.forces_newton)
    fill_elastic(builder, row, force.stiffness_newton_per_m, force.preload_newton, force.free_length_m, table)
    fill_stops(row, force.stops)
