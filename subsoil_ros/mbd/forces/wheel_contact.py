"""A wheel on level ground, p in it: N = max(0, k p - c z') up, and -mu N tanh(w / w_s) along x at the rim.

w = x' + R phi' is the slip. Modes: 0 off the ground, 1 pressed, 2 in the ground but cut at zero force.
"""

import math

from ...scene.mechanism import WheelContact
from ..compiled import inner_kernel
from ..tables import DISSIPATED
from .builder import Builder
from .table import WHEEL_CONTACT

PRESSED = 1


@inner_kernel
def _contact(force, mode, q, v):
    """Normal force, its elastic part, friction on the wheel along x, penetration, its rate, slip speed."""
    body = 3 * force.body_b
    penetration = force.ground + force.length - q[body + 1]
    rate = -v[body + 1]
    slip = v[body] + force.length * v[body + 2]
    if mode == 0:
        return 0.0, 0.0, 0.0, penetration, rate, slip
    elastic = force.stiffness * penetration
    normal = elastic + force.damping * rate if mode == PRESSED else 0.0
    friction = -force.friction * normal * math.tanh(slip / force.slip_speed)
    return normal, elastic, friction, penetration, rate, slip


@inner_kernel
def add(force, mode, q, v, total, powers):
    """Its forces; friction acts at the rolling radius."""
    normal, elastic, friction, _, rate, slip = _contact(force, mode, q, v)
    body = 3 * force.body_b
    total[body] += friction
    total[body + 1] += normal
    total[body + 2] += force.length * friction
    powers[DISSIPATED] += (normal - elastic) * rate - friction * slip


@inner_kernel
def mode_at(force, q, v):
    """Its mode."""
    normal, _, _, penetration, _, _ = _contact(force, PRESSED, q, v)
    if penetration <= 0.0:
        return 0
    return PRESSED if normal > 0.0 else 2


@inner_kernel
def report(force, mode, q, v):
    """Penetration, its rate, normal force, and energy stored."""
    normal, elastic, _, penetration, rate, _ = _contact(force, mode, q, v)
    return penetration, rate, normal, 0.5 * elastic * penetration


def fill(builder: Builder, name: str, force: WheelContact) -> None:
    """Its row of the table."""
    row = builder.row(name, WHEEL_CONTACT)
    row["body_b"] = builder.poses.index(force.body)
    row["stiffness"], row["damping"] = force.stiffness_newton_per_m, force.damping_newton_s_per_m
    row["length"], row["ground"] = force.radius_m, force.ground_z_m
    row["friction"], row["slip_speed"] = force.friction, force.slip_speed_m_per_s
