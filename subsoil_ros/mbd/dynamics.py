"""Accelerations and multipliers by the reduced equations of motion (paper eq. 6, 8, 11).

Coordinates, forces and masses are scaled here: y = q / s, mass s^2, force s, s the column scale.
"""

from .compiled import inner_kernel
from .constraints import evaluate_gamma, evaluate_turns
from .elements import joint_pressure
from .forces import evaluate_forces
from .laws import law_value
from .linear import copy, lu_factor, lu_solve, lu_solve_columns, lu_solve_transposed
from .partition import close_positions, close_velocities, factor_dependent
from .tables import (
    BY_DRIVERS,
    DRIVER,
    JAMMED,
    NOT_FINITE,
    OK,
    SINGULAR,
    TRAVEL_FRICTION,
    TURN_FRICTION,
)

FEW_COLUMNS = 8
"""Up to so many right-hand sides are solved one by one, more of them side by side (both measured)."""

LAST_FRICTION = 60
"""Joint friction depends on the reactions and they on it: iterated, at most so often."""

FRICTION_SETTLED = 1e-12
"""... until the reactions change by no more than this part of the largest of them."""

LARGEST = 1e300
"""An acceleration above this counts as not finite."""


@inner_kernel
def _eliminate(model, state, work):
    """Into `right`: Phi_u^-1 gamma; into `dependence`: B = -Phi_u^-1 Phi_v (eq. 10)."""
    for i in range(state.rows.shape[0]):
        row = state.rows[i]
        work.right[i] = work.gamma[row]
    lu_solve(work.factor, work.pivots, work.right)
    if state.independent.shape[0] <= FEW_COLUMNS:
        for j in range(state.independent.shape[0]):
            for i in range(state.rows.shape[0]):
                work.other[i] = -work.jacobian[state.rows[i], state.independent[j]]
            lu_solve(work.factor, work.pivots, work.other)
            for i in range(state.rows.shape[0]):
                work.dependence[i, j] = work.other[i]
        return
    for i in range(state.rows.shape[0]):
        for j in range(state.independent.shape[0]):
            work.dependence[i, j] = -work.jacobian[state.rows[i], state.independent[j]]
    lu_solve_columns(work.factor, work.pivots, work.dependence)


@inner_kernel
def _reduce(model, state, work):
    """Mhat and Fhat (eq. 11, with M diagonal), from `force`, `right` and `dependence`."""
    freedom = state.independent.shape[0]
    for i in range(freedom):
        k = state.independent[i]
        scale = model.column_scale[k]
        work.reduced_force[i] = scale * work.force[k]
        work.reduced[i, :] = 0.0
        work.reduced[i, i] = scale * scale * model.mass[k]
    for u in range(state.dependent.shape[0]):
        k = state.dependent[u]
        scale = model.column_scale[k]
        mass = scale * scale * model.mass[k]
        surplus = scale * work.force[k] - mass * work.right[u]
        for i in range(freedom):
            share = work.dependence[u, i]
            work.reduced_force[i] += share * surplus
            for j in range(freedom):
                work.reduced[i, j] += share * mass * work.dependence[u, j]


@inner_kernel
def _solve_accelerations(model, state, work, a):
    """Accelerations [m/s^2, rad/s^2] into `a`, and the multipliers [N, N m] into the state."""
    if not lu_factor(work.reduced, work.reduced_pivots):
        return False
    lu_solve(work.reduced, work.reduced_pivots, work.reduced_force)
    for i in range(state.independent.shape[0]):
        k = state.independent[i]
        a[k] = model.column_scale[k] * work.reduced_force[i]
    for u in range(state.dependent.shape[0]):
        k = state.dependent[u]
        scale = model.column_scale[k]
        total = work.right[u]
        for i in range(state.independent.shape[0]):
            total += work.dependence[u, i] * work.reduced_force[i]
        a[k] = scale * total
        work.other[u] = scale * (work.force[k] - model.mass[k] * a[k])
    lu_solve_transposed(work.factor, work.pivots, work.other)
    state.multipliers[:] = 0.0
    for i in range(state.rows.shape[0]):
        row = state.rows[i]
        state.multipliers[row] = model.row_scale[row] * work.other[i]
    return True


@inner_kernel
def _pressure_settled(model, state, work):
    """Whether the reactions that friction depends on are those it was computed from."""
    largest, change = 0.0, 0.0
    for row in range(state.multipliers.shape[0]):
        largest = max(largest, abs(state.multipliers[row]))
    for i in range(model.forces.shape[0]):
        force = model.forces[i]
        if force.friction > 0.0 and (force.kind == TURN_FRICTION or force.kind == TRAVEL_FRICTION):
            now = joint_pressure(model, force, state.multipliers)
            change = max(change, abs(now - joint_pressure(model, force, work.previous)))
    return change <= FRICTION_SETTLED * largest


@inner_kernel
def _accelerate(model, state, work, time, select):
    """Accelerations and powers of the state in `work`; factor and Jacobian must be current."""
    evaluate_gamma(model, time, select, work.q, work.turns, work.v, work.gamma)
    _eliminate(model, state, work)
    settled = False
    for _ in range(LAST_FRICTION):
        if model.pressed:
            copy(work.previous, state.multipliers)
        evaluate_forces(model, state, time, select, work.q, work.turns, work.v, work.force, work.powers)
        for i in range(state.wrench.shape[0]):
            work.force[i] += state.wrench[i]
        _reduce(model, state, work)
        if not _solve_accelerations(model, state, work, work.a):
            return SINGULAR
        settled = not model.pressed or _pressure_settled(model, state, work)
        if settled:
            break
    if not settled:
        return JAMMED
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind >= DRIVER:
            speed = law_value(model.laws, joint.law, time, select)
            work.powers[BY_DRIVERS] -= state.multipliers[joint.row] * speed
    for i in range(state.wrench.shape[0]):
        if not abs(work.a[i]) < LARGEST:
            return NOT_FINITE
    return OK


@inner_kernel
def complete(model, state, work, time, select, closing):
    """Close positions and velocities of the guess in `work` (if `closing`), then accelerate.

    Answers (status, iterations of the position Newton).
    """
    iterations = 0
    if closing:
        status, iterations = close_positions(model, state, work, time, select, work.q)
        if status != OK:
            return status, iterations
        close_velocities(model, state, work, time, select, work.v)
    else:
        evaluate_turns(work.q, work.turns)
        if not factor_dependent(model, state, work, work.q):
            return SINGULAR, iterations
    return _accelerate(model, state, work, time, select), iterations
