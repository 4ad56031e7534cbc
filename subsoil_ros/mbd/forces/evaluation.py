"""Forces of the machine: their sum, their modes, and their reports.

A mode is a smooth part of an element's law: slack or taut, a segment of a table, a stop touched or not, a
wheel off or on the ground. It is held within a step, where the force is therefore smooth; where the state
leaves the mode, the integrator locates the instant (events.py).
"""

from typing import NamedTuple

import numpy as np

from ..geometry import turns_of
from ..kernel_options import inner_kernel, kernel, named, part_of_kernel
from ..machine_arrays import DISSIPATED, Model
from . import OF_THEIR_OWN, spring_damper, torsion_spring, wheel_contact
from .elastic import has_modes, push_at, spring_mode
from .force_table import (
    LOCKED_SPRING,
    LOCKED_TORSION,
    ROTATION_FRICTION,
    SPRING_DAMPER,
    TORSION_SPRING,
    WHEEL_CONTACT,
)
from .in_joints import friction_limit, friction_push, is_friction, measure_translation
from .spring_damper import BEFORE
from .sticking import stick_anchor, stick_mode


class Held(NamedTuple):
    """Quantities that forces depend on beside position and velocity."""

    modes: np.ndarray  # (forces,) int64
    multipliers: np.ndarray  # (m,) float64 [N or N m]
    anchors: np.ndarray  # (forces,) float64 [m or rad]: see sticking.py


@part_of_kernel
def held_in(state):
    """Return these quantities of a State. With the State itself the kernels here would have two variants."""
    return Held(state.modes, state.multipliers, state.anchors)


@inner_kernel
def _measure(force, mode, q, turns, v):
    """Length, angle or translation, its rate, and the direction of a force along it with its two arms.

    Returns (value, rate, ux, uz, ax, az, bx, bz); for an angle the direction is zero.
    """
    if force.kind == TORSION_SPRING or force.kind == ROTATION_FRICTION or force.kind == LOCKED_TORSION:
        return torsion_spring.measure(force, q, v)
    if force.kind == SPRING_DAMPER or force.kind == LOCKED_SPRING:
        return spring_damper.measure(force, mode, q, turns, v)
    return measure_translation(force, q, turns, v)


@inner_kernel
def _add_between(model, held, i, at, q, turns, v, total, powers):
    """Add a spring, stop or friction between two bodies; nothing for a locked spring."""
    force = model.forces[i]
    if force.kind >= LOCKED_SPRING:
        return
    mode = held.modes[i]
    value, rate, ux, uz, ax, az, bx, bz = _measure(force, mode, q, turns, v)
    if is_friction(force):
        push, elastic, _ = friction_push(model, force, mode, held.anchors[i], held.multipliers, value, rate)
    else:
        push, elastic, _ = push_at(model, force, mode % BEFORE, value, rate)
    a, b = 3 * force.body_a, 3 * force.body_b
    if force.kind == TORSION_SPRING or force.kind == ROTATION_FRICTION:
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
def _mode_between(model, held, i, at, q, turns, v):
    """The mode of such a force."""
    force, mode = model.forces[i], 0
    if is_friction(force):
        if force.stick_stiffness > 0.0:
            value, rate, _, _, _, _, _, _ = _measure(force, 0, q, turns, v)
            limit = friction_limit(model, force, held.multipliers)
            mode = stick_mode(force, held.modes[i], held.anchors[i], limit, value, rate)
    elif force.kind < LOCKED_SPRING:
        if has_modes(force):
            value, rate, _, _, _, _, _, _ = _measure(force, 0, q, turns, v)
            mode = spring_mode(model, force, force.length - value, -rate, value, rate)
        if force.kind == SPRING_DAMPER:
            mode += spring_damper.passing(model, force, q, turns, v)
    return mode


@inner_kernel
def _report_between(model, held, i, at, q, turns, v):
    """Length, angle or translation, its rate, force, and energy stored."""
    force, mode, push, stored = model.forces[i], held.modes[i], 0.0, 0.0
    value, rate, _, _, _, _, _, _ = _measure(force, mode, q, turns, v)
    if is_friction(force):
        push, _, stored = friction_push(model, force, mode, held.anchors[i], held.multipliers, value, rate)
    elif force.kind < LOCKED_SPRING:
        push, _, stored = push_at(model, force, mode % BEFORE, value, rate)
    return value, rate, push, stored


def _choose_add(kind, its, other):
    def choose(model, held, i, at, q, turns, v, total, powers):
        if model.forces[i].kind == kind:
            its(model, held, i, at, q, turns, v, total, powers)
        else:
            other(model, held, i, at, q, turns, v, total, powers)

    return inner_kernel(named(choose, f"add_of_kind_{kind}"))


def _choose_value(kind, its, other, what):
    def choose(model, held, i, at, q, turns, v):
        if model.forces[i].kind == kind:
            return its(model, held, i, at, q, turns, v)
        return other(model, held, i, at, q, turns, v)

    return inner_kernel(named(choose, f"{what}_of_kind_{kind}"))


# `add`, `mode_at` and `report` of every kind as one, which chooses by the kind of the force
_add, _mode_at, _report = _add_between, _mode_between, _report_between
for _module in OF_THEIR_OWN:
    _add = _choose_add(_module.KIND, _module.add, _add)
    _mode_at = _choose_value(_module.KIND, _module.mode_at, _mode_at, "mode_at")
    _report = _choose_value(_module.KIND, _module.report, _report, "report")


@kernel
def evaluate_forces(model, held, time, select, q, turns, v, total, powers):
    """Generalised forces [N, N, N m] into `total` (n + 3,), and their `powers` (3,) [W]."""
    total[:] = 0.0
    powers[:] = 0.0
    for i in range(1, model.mass.shape[0], 3):
        total[i] = -model.mass[i] * model.gravity
    for i in range(model.forces.shape[0]):
        _add(model, held, i, (time, select), q, turns, v, total, powers)


@kernel
def evaluate_modes(model, held, time, select, q, turns, v, modes):
    """Write the mode of every force at this state, which follows that in `held`, into `modes` (forces,)."""
    for i in range(model.forces.shape[0]):
        modes[i] = _mode_at(model, held, i, (time, select), q, turns, v)


@kernel
def move_anchors(model, held, q, turns, v, modes, first):
    """Change the anchors in `held` from its modes to `modes`; with `first` they become unstrained."""
    for i in range(model.forces.shape[0]):
        force, before, after = model.forces[i], held.modes[i], modes[i]
        if force.stick_stiffness == 0.0 or (before == after and not first):
            continue
        if force.kind == WHEEL_CONTACT:
            moved = wheel_contact.anchor_at(force, before, after, held.anchors[i], q, v)
            held.anchors[i] = wheel_contact.rolled(force, q) if first else moved
        else:
            value, _, _, _, _, _, _, _ = _measure(force, 0, q, turns, v)
            limit = friction_limit(model, force, held.multipliers)
            moved = stick_anchor(force, before, after, held.anchors[i], limit, value)
            held.anchors[i] = value if first else moved


@kernel
def report_forces(model, held, time, select, q, turns, v, report):
    """Write length, rate [m, m/s] (or rad) and force of every element into `report` (forces, 3).

    Returns the energy stored in springs, stops and wheel contacts [J]. The force of a locked spring is left
    at zero: it is that of its constraint.
    """
    total = 0.0
    for i in range(model.forces.shape[0]):
        value, rate, push, stored = _report(model, held, i, (time, select), q, turns, v)
        report[i, 0], report[i, 1], report[i, 2] = value, rate, push
        total += stored
    return total


def held_at(model: Model, time: float, select: float, q: np.ndarray, v: np.ndarray) -> Held:
    """Return the modes at a state, with multipliers of zero and unstrained sticking friction."""
    count, turns = len(model.forces), turns_of(q)
    held = Held(np.zeros(count, dtype=np.int64), np.zeros(len(model.row_scale)), np.zeros(count))
    move_anchors(model, held, q, turns, v, held.modes, True)
    evaluate_modes(model, held, time, select, q, turns, v, held.modes)
    return held
