"""Forces of the machine: their sum, the branches they are on, and what is reported of them.

`held` is whatever has `regimes` and `multipliers`: the State, or Held. Summing, reporting and the detection
of switching all read the elements' own functions (elements.py).
"""

from typing import NamedTuple

import numpy as np

from .compiled import inner_kernel, kernel
from .constraints import turned, turns_of
from .elements import (
    coordinate_stretch,
    joint_friction,
    measure,
    spring_push,
    spring_regime,
    stop_push,
    wheel_contact,
    wheel_regime,
)
from .tables import (
    BY_DRIVERS,
    BY_LOADS,
    COORDINATE_SPRING,
    DISSIPATED,
    LOCKED_SPRING,
    LOCKED_TORSION,
    POINT_LOAD,
    SPRING_DAMPER,
    TORSION_SPRING,
    TRAVEL_FRICTION,
    TRAVEL_SPRING,
    TURN_FRICTION,
    WHEEL_CONTACT,
    Model,
)
from .time_functions import law_value


class Held(NamedTuple):
    """What forces depend on beside position and velocity."""

    regimes: np.ndarray  # (forces,) int64
    multipliers: np.ndarray  # (m,) float64 [N or N m]


@inner_kernel
def _is_spring(force):
    return force.kind == SPRING_DAMPER or force.kind == TORSION_SPRING or force.kind == TRAVEL_SPRING


@inner_kernel
def _is_friction(force):
    return force.kind == TURN_FRICTION or force.kind == TRAVEL_FRICTION


@inner_kernel
def _is_locked(force):
    return force.kind == LOCKED_SPRING or force.kind == LOCKED_TORSION


@inner_kernel
def _add_between(model, held, i, q, turns, v, total, powers):
    """A spring, stop or friction between two bodies."""
    force = model.forces[i]
    value, rate, ux, uz, ax, az, bx, bz = measure(force, q, turns, v)
    if _is_friction(force):
        push = joint_friction(model, force, held.multipliers, rate)
        elastic = 0.0
    else:
        push, elastic, _ = spring_push(model, force, held.regimes[i], force.length - value, -rate)
        stop, stop_elastic, _ = stop_push(force, held.regimes[i], value, rate)
        push, elastic = push + stop, elastic + stop_elastic
    a, b = 3 * force.body_a, 3 * force.body_b
    if ux == 0.0 and uz == 0.0:
        total[b + 2] += push
        total[a + 2] -= push
    else:
        fx, fz = push * ux, push * uz
        total[b] += fx
        total[b + 1] += fz
        total[b + 2] += bx * fz - bz * fx
        total[a] -= fx
        total[a + 1] -= fz
        total[a + 2] -= ax * fz - az * fx
    powers[DISSIPATED] += (elastic - push) * rate


@inner_kernel
def _add_point_load(model, force, time, select, q, turns, v, total, powers):
    body = 3 * force.body_b
    fx = law_value(model.laws, force.laws[0], time, select)
    fz = law_value(model.laws, force.laws[1], time, select)
    px, pz = turned(turns, force.body_b, force.point_b)
    moment = law_value(model.laws, force.laws[2], time, select) + px * fz - pz * fx
    total[body] += fx
    total[body + 1] += fz
    total[body + 2] += moment
    powers[BY_LOADS] += fx * v[body] + fz * v[body + 1] + moment * v[body + 2]


@kernel
def evaluate_forces(model, held, time, select, q, turns, v, total, powers):
    """Generalised forces [N, N, N m] into `total` (n + 3,), and their `powers` (3,) [W].

    A moving target of a coordinate spring works on the machine like a driver and is booked there.
    """
    total[:] = 0.0
    powers[:] = 0.0
    for i in range(1, model.mass.shape[0], 3):
        total[i] = -model.mass[i] * model.gravity
    for i in range(model.forces.shape[0]):
        force = model.forces[i]
        if _is_spring(force) or _is_friction(force):
            _add_between(model, held, i, q, turns, v, total, powers)
        elif force.kind == POINT_LOAD:
            _add_point_load(model, force, time, select, q, turns, v, total, powers)
        elif force.kind == COORDINATE_SPRING:
            stretch, rate, target_rate = coordinate_stretch(model, force, time, select, q, v)
            push, elastic, _ = spring_push(model, force, held.regimes[i], stretch, rate)
            total[force.coordinate] += push
            powers[BY_DRIVERS] += push * target_rate
            powers[DISSIPATED] += (push - elastic) * rate
        elif force.kind == WHEEL_CONTACT:
            normal, elastic, friction, _, rate, slip = wheel_contact(force, held.regimes[i], q, v)
            body = 3 * force.body_b
            total[body] += friction
            total[body + 1] += normal
            total[body + 2] += force.length * friction
            powers[DISSIPATED] += (normal - elastic) * rate - friction * slip


@kernel
def evaluate_regimes(model, time, select, q, turns, v, regimes):
    """The branch every force is on at this state, into `regimes` (forces,)."""
    for i in range(model.forces.shape[0]):
        force = model.forces[i]
        regimes[i] = 0
        if force.kind == WHEEL_CONTACT:
            regimes[i] = wheel_regime(force, q, v)
        elif force.kind == COORDINATE_SPRING:
            if force.way != 0:
                stretch, rate, _ = coordinate_stretch(model, force, time, select, q, v)
                regimes[i] = spring_regime(model, force, stretch, rate, 0.0, 0.0)
        elif _is_spring(force) and (
            force.way != 0 or force.curve_count > 0 or force.lower > -np.inf or force.upper < np.inf
        ):
            value, rate, _, _, _, _, _, _ = measure(force, q, turns, v)
            regimes[i] = spring_regime(model, force, force.length - value, -rate, value, rate)


@kernel
def report_forces(model, held, time, select, q, turns, v, report):
    """Length, rate [m, m/s] (or rad) and force of every element into `report` (forces, 3).

    Answers the energy stored in springs, stops and wheel contacts [J]. Of a locked spring the force is left
    at zero: it is that of its constraint.
    """
    total = 0.0
    for i in range(model.forces.shape[0]):
        force = model.forces[i]
        regime = held.regimes[i]
        if _is_spring(force) or _is_friction(force) or _is_locked(force):
            value, rate, _, _, _, _, _, _ = measure(force, q, turns, v)
            report[i, 0], report[i, 1], report[i, 2] = value, rate, 0.0
            if _is_friction(force):
                report[i, 2] = joint_friction(model, force, held.multipliers, rate)
            elif _is_spring(force):
                push, _, stored = spring_push(model, force, regime, force.length - value, -rate)
                stop, _, stop_stored = stop_push(force, regime, value, rate)
                report[i, 2] = push + stop
                total += stored + stop_stored
        elif force.kind == COORDINATE_SPRING:
            stretch, rate, _ = coordinate_stretch(model, force, time, select, q, v)
            push, _, stored = spring_push(model, force, regime, stretch, rate)
            report[i, 0], report[i, 1], report[i, 2] = q[force.coordinate], v[force.coordinate], push
            total += stored
        elif force.kind == WHEEL_CONTACT:
            normal, elastic, _, penetration, rate, _ = wheel_contact(force, regime, q, v)
            report[i, 0], report[i, 1], report[i, 2] = penetration, rate, normal
            total += 0.5 * elastic * penetration
    return total


def held_at(model: Model, time: float, select: float, q: np.ndarray, v: np.ndarray) -> Held:
    """The branches at a state; multipliers zero."""
    regimes = np.zeros(len(model.forces), dtype=np.int64)
    evaluate_regimes(model, time, select, q, turns_of(q), v, regimes)
    return Held(regimes, np.zeros(len(model.row_scale)))
