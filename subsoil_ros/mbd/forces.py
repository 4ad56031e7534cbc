"""Forces of the machine: gravity, spring-dampers, coordinate springs, loads, wheels on the ground.

Every kind has one function giving its force and the energy it handles; summing, reporting and the
detection of switching all read that one.
"""

import math

from .compiled import inner_kernel, kernel
from .constraints import turned
from .laws import law_rate, law_value
from .tables import (
    BY_DRIVERS,
    BY_LOADS,
    COORDINATE_SPRING,
    DISSIPATED,
    POINT_LOAD,
    SPRING_DAMPER,
    WHEEL_CONTACT,
)


@inner_kernel
def spring_line(force, q, v):
    """Direction from point a to point b, arms, length and its rate: (ux, uz, ax, az, bx, bz, L, L')."""
    a, b = 3 * force.body_a, 3 * force.body_b
    ax, az = turned(q[a + 2], force.point_a)
    bx, bz = turned(q[b + 2], force.point_b)
    dx, dz = q[b] + bx - q[a] - ax, q[b + 1] + bz - q[a + 1] - az
    length = math.sqrt(dx * dx + dz * dz)
    ux, uz = dx / length, dz / length
    vx = v[b] - v[b + 2] * bz - v[a] + v[a + 2] * az
    vz = v[b + 1] + v[b + 2] * bx - v[a + 1] - v[a + 2] * ax
    return ux, uz, ax, az, bx, bz, length, ux * vx + uz * vz


@inner_kernel
def coordinate_spring(model, force, time, select, q, v):
    """Force on the coordinate, its elastic part, stretch e = target - q, e', and the target's rate.

    With one way only, the whole force is cut at zero, and the elastic part too.
    """
    stretch = law_value(model.laws, force.laws[0], time, select) - q[force.coordinate]
    target_rate = law_rate(model.laws, force.laws[0], time, select)
    rate = target_rate - v[force.coordinate]
    elastic = force.stiffness * stretch
    total = elastic + force.damping * rate
    if force.way * total < 0.0:
        total = 0.0
    if force.way * elastic < 0.0:
        elastic = 0.0
    return total, elastic, stretch, rate, target_rate


@inner_kernel
def wheel_contact(force, q, v):
    """Normal force, its elastic part, friction on the wheel along x, penetration, its rate, slip speed.

    The ground pushes only. Friction acts at the rolling radius and follows tanh(slip / slip speed).
    """
    body = 3 * force.body_b
    penetration = force.ground + force.length - q[body + 1]
    rate = -v[body + 1]
    slip = v[body] + force.length * v[body + 2]
    if penetration <= 0.0:
        return 0.0, 0.0, 0.0, penetration, rate, slip
    elastic = force.stiffness * penetration
    normal = max(0.0, elastic + force.damping * rate)
    friction = -force.friction * normal * math.tanh(slip / force.slip_speed)
    return normal, elastic, friction, penetration, rate, slip


@inner_kernel
def _add_spring_damper(force, q, v, total, powers):
    ux, uz, ax, az, bx, bz, length, rate = spring_line(force, q, v)
    push = force.stiffness * (force.length - length) - force.damping * rate  # compression positive
    a, b = 3 * force.body_a, 3 * force.body_b
    fx, fz = push * ux, push * uz
    total[b] += fx
    total[b + 1] += fz
    total[b + 2] += bx * fz - bz * fx
    total[a] -= fx
    total[a + 1] -= fz
    total[a + 2] -= ax * fz - az * fx
    powers[DISSIPATED] += force.damping * rate * rate


@inner_kernel
def _add_point_load(model, force, time, select, q, v, total, powers):
    body = 3 * force.body_b
    fx = law_value(model.laws, force.laws[0], time, select)
    fz = law_value(model.laws, force.laws[1], time, select)
    px, pz = turned(q[body + 2], force.point_b)
    moment = law_value(model.laws, force.laws[2], time, select) + px * fz - pz * fx
    total[body] += fx
    total[body + 1] += fz
    total[body + 2] += moment
    powers[BY_LOADS] += fx * v[body] + fz * v[body + 1] + moment * v[body + 2]


@kernel
def evaluate_forces(model, time, select, q, v, total, powers):
    """Generalised forces [N, N, N m] into `total` (n + 3,), and their `powers` (3,) [W].

    A moving target of a coordinate spring works on the machine like a driver and is booked there.
    """
    total[:] = 0.0
    powers[:] = 0.0
    for i in range(1, model.mass.shape[0], 3):
        total[i] = -model.mass[i] * model.gravity
    for i in range(model.forces.shape[0]):
        force = model.forces[i]
        if force.kind == SPRING_DAMPER:
            _add_spring_damper(force, q, v, total, powers)
        elif force.kind == POINT_LOAD:
            _add_point_load(model, force, time, select, q, v, total, powers)
        elif force.kind == COORDINATE_SPRING:
            push, elastic, _, rate, target_rate = coordinate_spring(model, force, time, select, q, v)
            total[force.coordinate] += push
            powers[BY_DRIVERS] += push * target_rate
            powers[DISSIPATED] += (push - elastic) * rate
        elif force.kind == WHEEL_CONTACT:
            normal, elastic, friction, _, rate, slip = wheel_contact(force, q, v)
            body = 3 * force.body_b
            total[body] += friction
            total[body + 1] += normal
            total[body + 2] += force.length * friction
            powers[DISSIPATED] += (normal - elastic) * rate - friction * slip


@kernel
def evaluate_regimes(model, time, select, q, v, regimes):
    """The branch every unilateral force is on, into `regimes` (forces,): 0 off, 1 on, 2 cut at zero."""
    for i in range(model.forces.shape[0]):
        force = model.forces[i]
        regimes[i] = 0
        if force.kind == WHEEL_CONTACT:
            normal, _, _, penetration, _, _ = wheel_contact(force, q, v)
            if penetration > 0.0:
                regimes[i] = 1 if normal > 0.0 else 2
        elif force.kind == COORDINATE_SPRING and force.way != 0:
            push, _, _, _, _ = coordinate_spring(model, force, time, select, q, v)
            regimes[i] = 1 if push != 0.0 else 0


@kernel
def report_forces(model, time, select, q, v, report):
    """Length, rate [m, m/s] (or rad) and force of every element into `report` (forces, 3).

    Answers the energy stored in springs and wheel contacts [J].
    """
    stored = 0.0
    for i in range(model.forces.shape[0]):
        force = model.forces[i]
        if force.kind == SPRING_DAMPER:
            _, _, _, _, _, _, length, rate = spring_line(force, q, v)
            stretch = force.length - length
            elastic = force.stiffness * stretch
            report[i, 0], report[i, 1] = length, rate
            report[i, 2] = elastic - force.damping * rate
        elif force.kind == COORDINATE_SPRING:
            push, elastic, stretch, _, _ = coordinate_spring(model, force, time, select, q, v)
            report[i, 0], report[i, 1], report[i, 2] = q[force.coordinate], v[force.coordinate], push
        elif force.kind == WHEEL_CONTACT:
            normal, elastic, _, stretch, rate, _ = wheel_contact(force, q, v)
            report[i, 0], report[i, 1], report[i, 2] = stretch, rate, normal
        else:
            continue
        stored += 0.5 * elastic * stretch
    return stored
