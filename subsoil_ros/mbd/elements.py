"""Single force elements: what they measure, the force they answer with, and the branch they are on.

A branch (`regime`) is a smooth piece of an element's law: slack or taut, a segment of a table, a stop
touched or not, a wheel off or on the ground. Within a step it is held, so that a step sees a smooth force;
where the state leaves its branch, the integrator finds the instant (events.py).

Springs have regime = stop + STOPS * piece: stop 0 free, 1 pressed at the lower end, 2 there but cut at zero
force, 3 and 4 the same at the upper end; piece 0 or 1 (off, on) one way, or the segment of the table.
Wheels: 0 off the ground, 1 pressed, 2 in the ground but cut at zero force.
"""

import math

from .compiled import inner_kernel
from .constraints import difference, turned
from .tables import LOCKED_SPRING, LOCKED_TORSION, SPRING_DAMPER, TORSION_SPRING, TURN_FRICTION
from .time_functions import law_rate, law_value

STOPS = 5
"""States of a spring's stops."""


@inner_kernel
def measure(force, q, turns, v):
    """Length, angle or travel, its rate, and the direction of a force along it with its two arms.

    Answers (value, rate, ux, uz, ax, az, bx, bz); for an angle the direction is zero. A travel's force
    acts on both bodies at the point of body b.
    """
    a, b = 3 * force.body_a, 3 * force.body_b
    if force.kind == TORSION_SPRING or force.kind == TURN_FRICTION or force.kind == LOCKED_TORSION:
        return q[b + 2] - q[a + 2] - force.origin, v[b + 2] - v[a + 2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    dx, dz, ax, az, bx, bz = difference(force, q, turns)
    if force.kind == SPRING_DAMPER or force.kind == LOCKED_SPRING:
        value = math.sqrt(dx * dx + dz * dz)
        ux, uz = dx / value, dz / value
    else:
        ux, uz = turned(turns, force.body_a, force.axis)
        value = ux * dx + uz * dz
        ax, az = ax + dx, az + dz
    vx = v[b] - v[b + 2] * bz - v[a] + v[a + 2] * az
    vz = v[b + 1] + v[b + 2] * bx - v[a + 1] - v[a + 2] * ax
    return value, ux * vx + uz * vz, ux, uz, ax, az, bx, bz


@inner_kernel
def _segment(model, force, stretch):
    """The segment of the table that holds at `stretch`."""
    segment = 0
    while segment < force.curve_count - 2 and model.curves[force.curve + segment + 1, 0] <= stretch:
        segment += 1
    return segment


@inner_kernel
def spring_push(model, force, regime, stretch, rate):
    """Push, its elastic part and the energy stored, `stretch` growing at `rate`; without the stops.

    A one-way spring stores energy while its elastic part alone acts that way.
    """
    if force.curve_count > 0:
        row = force.curve + regime // STOPS
        place, start, energy = model.curves[row, 0], model.curves[row, 1], model.curves[row, 2]
        slope = (model.curves[row + 1, 1] - start) / (model.curves[row + 1, 0] - place)
        span = stretch - place
        elastic = start + slope * span
        stored = energy + span * (start + 0.5 * slope * span) + force.preload * stretch
        return elastic + force.preload + force.damping * rate, elastic + force.preload, stored
    elastic = force.stiffness * stretch
    total = elastic + force.preload + force.damping * rate
    stored = (0.5 * elastic + force.preload) * stretch
    if force.way == 0:
        return total, elastic + force.preload, stored
    if force.way * elastic < 0.0:
        elastic, stored = 0.0, 0.0
    if regime // STOPS == 0:
        total = 0.0
    return total, elastic, stored


@inner_kernel
def stop_push(force, regime, value, rate):
    """Push of the stops, its elastic part and the energy stored."""
    stop = regime % STOPS
    if stop == 0:
        return 0.0, 0.0, 0.0
    side = 1.0 if stop <= 2 else -1.0
    depth = force.lower - value if stop <= 2 else value - force.upper
    elastic = force.stop_stiffness * depth
    total = elastic - side * force.stop_damping * rate
    if stop == 2 or stop == 4:
        total = 0.0
    return side * total, side * elastic, 0.5 * elastic * depth


@inner_kernel
def spring_regime(model, force, stretch, rate, value, value_rate):
    """The branch of a spring and its stops."""
    piece, stop = 0, 0
    if force.curve_count > 0:
        piece = _segment(model, force, stretch)
    elif force.way != 0:
        push = force.stiffness * stretch + force.damping * rate
        piece = 1 if force.way * push > 0.0 else 0
    if value < force.lower:
        push = force.stop_stiffness * (force.lower - value) - force.stop_damping * value_rate
        stop = 1 if push > 0.0 else 2
    elif value > force.upper:
        push = force.stop_stiffness * (value - force.upper) + force.stop_damping * value_rate
        stop = 3 if push > 0.0 else 4
    return stop + STOPS * piece


@inner_kernel
def coordinate_stretch(model, force, time, select, q, v):
    """Stretch e = target - q of a coordinate spring, e', and the target's rate."""
    stretch = law_value(model.laws, force.laws[0], time, select) - q[force.coordinate]
    target_rate = law_rate(model.laws, force.laws[0], time, select)
    return stretch, target_rate - v[force.coordinate], target_rate


@inner_kernel
def wheel_contact(force, regime, q, v):
    """Normal force, its elastic part, friction on the wheel along x, penetration, its rate, slip speed.

    The ground pushes only. Friction acts at the rolling radius and follows tanh(slip / slip speed).
    """
    body = 3 * force.body_b
    penetration = force.ground + force.length - q[body + 1]
    rate = -v[body + 1]
    slip = v[body] + force.length * v[body + 2]
    if regime == 0:
        return 0.0, 0.0, 0.0, penetration, rate, slip
    elastic = force.stiffness * penetration
    normal = elastic + force.damping * rate if regime == 1 else 0.0
    friction = -force.friction * normal * math.tanh(slip / force.slip_speed)
    return normal, elastic, friction, penetration, rate, slip


@inner_kernel
def wheel_regime(force, q, v):
    """The branch of a wheel."""
    normal, _, _, penetration, _, _ = wheel_contact(force, 1, q, v)
    if penetration <= 0.0:
        return 0
    return 1 if normal > 0.0 else 2


@inner_kernel
def joint_pressure(model, force, multipliers):
    """Force that presses in the joint of a friction [N]: in a pin the whole of it, on a line that across."""
    row = model.joints[force.joint].row
    if force.kind == TURN_FRICTION:
        return math.sqrt(multipliers[row] ** 2 + multipliers[row + 1] ** 2)
    return abs(multipliers[row])


@inner_kernel
def joint_friction(model, force, multipliers, rate):
    """Push on the turn or travel of a joint: (preload + coefficient radius N) tanh(rate / slip speed)."""
    limit = force.preload
    if force.friction > 0.0:
        limit += force.friction * force.length * joint_pressure(model, force, multipliers)
    return -limit * math.tanh(rate / force.slip_speed)
