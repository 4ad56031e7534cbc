"""Forces in a joint: friction, and stops, which are one-sided spring-dampers at the ends (elastic.py).

Friction acts against rotation or translation: (preload + mu R N) tanh(rate / slip speed). N is the whole
reaction in a pin of radius R; on a line, the reaction across it, with R = 1. Friction with a stick stiffness:
sticking.py.
"""

import math

from ...scene.mechanism import PointOnLine, Prismatic, Revolute, RotationFriction
from ..geometry import difference, relative_velocity, turned
from ..kernel_options import inner_kernel
from .elastic import fill_stops
from .force_table import (
    FRICTIONS,
    ROTATION_FRICTION,
    TORSION_SPRING,
    TRANSLATION_FRICTION,
    TRANSLATION_STOPS,
    Builder,
)
from .sticking import stick_push


@inner_kernel
def measure_translation(force, q, turns, v):
    """Translation along the axis, its rate, the axis, and arms: both forces act at the point of body b."""
    dx, dz, ax, az, bx, bz = difference(force, q, turns)
    ux, uz = turned(turns, force.body_a, force.axis)
    value = ux * dx + uz * dz
    ax, az = ax + dx, az + dz
    vx, vz = relative_velocity(force, v, ax, az, bx, bz)
    return value, ux * vx + uz * vz, ux, uz, ax, az, bx, bz


def fill_stops_of(builder: Builder, name: str, joint: Revolute | Prismatic | PointOnLine) -> None:
    """Add the row of its stops to the table, if the joint has any."""
    if joint.stops is not None:
        kind = TORSION_SPRING if isinstance(joint, Revolute) else TRANSLATION_STOPS
        fill_stops(builder.row_at_joint(f"{name}.stops", kind, joint), joint.stops)


@inner_kernel
def is_friction(force):
    """Whether a force is the friction of a joint."""
    return force.kind in FRICTIONS


@inner_kernel
def joint_pressure(model, force, multipliers):
    """Normal force in the joint [N]."""
    row = model.joints[force.joint].row
    if force.kind == ROTATION_FRICTION:
        return math.sqrt(multipliers[row] ** 2 + multipliers[row + 1] ** 2)
    return abs(multipliers[row])


@inner_kernel
def friction_limit(model, force, multipliers):
    """Largest force or moment of the friction."""
    limit = force.preload
    if force.friction > 0.0:
        limit += force.friction * force.length * joint_pressure(model, force, multipliers)
    return limit


@inner_kernel
def friction_push(model, force, mode, anchor, multipliers, value, rate):
    """Push on the rotation or translation, its elastic part and the energy stored."""
    limit = friction_limit(model, force, multipliers)
    if force.stick_stiffness > 0.0:
        return stick_push(force, mode, anchor, limit, value, rate)
    return -limit * math.tanh(rate / force.slip_speed), 0.0, 0.0


def fill_friction_of(builder: Builder, name: str, joint: Revolute | Prismatic | PointOnLine) -> None:
    """Add the row of its friction to the table, if the joint has any."""
    friction = joint.friction
    if friction is None:
        return
    kind = ROTATION_FRICTION if isinstance(joint, Revolute) else TRANSLATION_FRICTION
    row = builder.row_at_joint(f"{name}.friction", kind, joint)
    row["joint"] = builder.joint_names.index(name)
    row["friction"] = friction.coefficient
    if isinstance(friction, RotationFriction):
        row["preload"], row["length"] = friction.preload_newton_m, friction.radius_m
        row["slip_speed"] = friction.slip_speed_rad_per_s
        row["stick_stiffness"] = friction.stick_stiffness_newton_m_per_rad or 0.0
        row["stick_damping"] = friction.stick_damping_newton_m_s_per_rad
    else:
        row["preload"], row["length"] = friction.preload_newton, 1.0
        row["slip_speed"] = friction.slip_speed_m_per_s
        row["stick_stiffness"] = friction.stick_stiffness_newton_per_m or 0.0
        row["stick_damping"] = friction.stick_damping_newton_s_per_m
