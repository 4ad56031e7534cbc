"""A wheel on level ground, p in it: N = max(0, k p - c z') up, and -mu N tanh(w / w_s) along x at the rim.

w = x' + R phi' is the slip. Modes: 0 off the ground, 1 pressed, 2 in the ground, force set to zero; with a
stick stiffness also CONTACTS times that of sticking.py, whose value is x + R phi.
"""

import math

from ...scene.mechanism import WheelContact
from ..kernel_options import inner_kernel
from ..machine_arrays import DISSIPATED
from .force_table import WHEEL_CONTACT, Builder
from .sticking import STICKS, stick_anchor, stick_mode, stick_push

KIND = WHEEL_CONTACT

PRESSED = 1

CONTACTS = 3
"""Number of states of a wheel against the ground."""


@inner_kernel
def rolled(force, q):
    """Way of the rim along the ground [m], which sticking friction holds; its rate is the slip."""
    body = 3 * force.body_b
    return q[body] + force.length * q[body + 2]


@inner_kernel
def _contact(force, mode, anchor, q, v):
    """Normal force, its elastic part, friction on the wheel along x, its elastic part and energy stored,
    penetration, its rate, slip speed."""
    body = 3 * force.body_b
    penetration = force.ground + force.length - q[body + 1]
    rate = -v[body + 1]
    slip = v[body] + force.length * v[body + 2]
    if mode == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, penetration, rate, slip
    elastic = force.stiffness * penetration
    normal = elastic + force.damping * rate if mode % CONTACTS == PRESSED else 0.0
    if force.stick_stiffness > 0.0:
        friction, sticking, stored = 0.0, 0.0, 0.0
        if mode % CONTACTS == PRESSED:
            limit = force.friction * normal
            friction, sticking, stored = stick_push(
                force, mode // CONTACTS, anchor, limit, rolled(force, q), slip
            )
        return normal, elastic, friction, sticking, stored, penetration, rate, slip
    friction = -force.friction * normal * math.tanh(slip / force.slip_speed)
    return normal, elastic, friction, 0.0, 0.0, penetration, rate, slip


@inner_kernel
def add(model, held, i, at, q, turns, v, total, powers):
    """Add its forces; friction acts at the rolling radius."""
    force = model.forces[i]
    normal, elastic, friction, sticking, _, _, rate, slip = _contact(
        force, held.modes[i], held.anchors[i], q, v
    )
    body = 3 * force.body_b
    total[body] += friction
    total[body + 1] += normal
    total[body + 2] += force.length * friction
    powers[DISSIPATED] += (normal - elastic) * rate - (friction - sticking) * slip


@inner_kernel
def mode_at(model, held, i, at, q, turns, v):
    """Return the mode after that in `held`; a wheel that lands sticks or slides anew."""
    force, before, anchor = model.forces[i], held.modes[i], held.anchors[i]
    normal, _, _, _, _, penetration, _, slip = _contact(force, PRESSED, anchor, q, v)
    if penetration <= 0.0:
        return 0
    if normal <= 0.0:
        return 2
    if force.stick_stiffness == 0.0:
        return PRESSED
    value, limit = rolled(force, q), force.friction * normal
    if before % CONTACTS != PRESSED:
        return PRESSED + CONTACTS * stick_mode(force, STICKS, value, limit, value, slip)
    return PRESSED + CONTACTS * stick_mode(force, before // CONTACTS, anchor, limit, value, slip)


@inner_kernel
def anchor_at(force, before, after, anchor, q, v):
    """Return the anchor of its friction after a change of mode."""
    if after % CONTACTS != PRESSED:
        return anchor
    if before % CONTACTS != PRESSED:
        return rolled(force, q)
    normal, _, _, _, _, _, _, _ = _contact(force, after, anchor, q, v)
    limit = force.friction * normal
    return stick_anchor(force, before // CONTACTS, after // CONTACTS, anchor, limit, rolled(force, q))


@inner_kernel
def report(model, held, i, at, q, turns, v):
    """Penetration, its rate, normal force, and energy stored."""
    force = model.forces[i]
    normal, elastic, _, _, stored, penetration, rate, _ = _contact(
        force, held.modes[i], held.anchors[i], q, v
    )
    return penetration, rate, normal, 0.5 * elastic * penetration + stored


def fill(builder: Builder, name: str, force: WheelContact) -> None:
    """Add its row to the table."""
    row = builder.row(name, WHEEL_CONTACT)
    row["body_b"] = builder.poses.index(force.body)
    row["stiffness"], row["damping"] = force.stiffness_newton_per_m, force.damping_newton_s_per_m
    row["length"], row["ground"] = force.radius_m, force.ground_z_m
    row["friction"], row["slip_speed"] = force.friction, force.slip_speed_m_per_s
    row["stick_stiffness"] = force.stick_stiffness_newton_per_m or 0.0
    row["stick_damping"] = force.stick_damping_newton_s_per_m
