"""Accelerations and multipliers by the reduced equations of motion (paper eq. 6, 8, 11), or by all of them.

Coordinates, forces and masses are scaled here: y = q / s, mass s^2, force s, s the column scale.

As a whole: M q'' + Phi_q^T lambda = F and Phi_q q'' = gamma (eq. 6, 8), for machines with many freedoms.
Eliminating the dependent coordinates leaves a full matrix of the freedoms, whose cost grows with their cube,
while this matrix is a narrow band (sparsity.py). Also used for all machines next to singular poses
(singular_poses.py). Coordinates are scaled by the roots of their masses there and rows to length one, so that
light and heavy bodies count alike in the pivoting.
"""

import math

from .forces.evaluation import evaluate_forces, held_in
from .forces.in_joints import is_friction, joint_pressure
from .function_tables import function_value
from .geometry import evaluate_turns
from .joints.constraints import evaluate_gamma
from .joints.rows import DRIVER
from .kernel_options import inner_kernel
from .linear import copy, lu_factor, lu_solve, lu_solve_transposed
from .machine_arrays import BY_DRIVERS, JAMMED, MANY_FREEDOMS, NOT_FINITE, OK, SINGULAR
from .partition import close_positions, close_velocities, factor_dependent


@inner_kernel
def factor_whole(model, state, work, yielding):
    """LU of the whole matrix from the Jacobian in `work`; False if singular. Rows left out get lambda = 0.

    `yielding`: 0, or YIELDING of singular_poses.py; the diagonal of the rows is its negative.
    """
    shape, matrix = model.sparsity, work.whole
    size, band, coordinates = matrix.shape[0], model.sparsity.band, model.mass.shape[0]
    for j in range(size):
        for i in range(max(j - 2 * band, 0), min(j + band, size - 1) + 1):
            matrix[j, i] = 0.0
    for c in range(coordinates):
        matrix[shape.place[c], shape.place[c]] = 1.0
    for row in range(work.row_length.shape[0]):
        at = shape.place[coordinates + row]
        if state.row_place[row] < 0:
            matrix[at, at] = 1.0
            continue
        total = 0.0
        for entry in range(shape.first[row], shape.first[row + 1]):
            c = shape.columns[entry]
            total += (work.jacobian[row, c] / model.sqrt_mass[c]) ** 2
        length = math.sqrt(total)
        work.row_length[row] = length
        if yielding > 0.0:
            matrix[at, at] = -yielding
        for entry in range(shape.first[row], shape.first[row + 1]):
            c = shape.columns[entry]
            value = work.jacobian[row, c] / (model.sqrt_mass[c] * length)
            matrix[shape.place[c], at] = value
            matrix[at, shape.place[c]] = value
    return lu_factor(matrix, work.whole_pivots, band, band)


@inner_kernel
def solve_whole(model, state, work, a, yielding):
    """From `force`, `gamma`: accelerations [m/s^2, rad/s^2] into `a`, multipliers [N, N m] to the state.

    With `yielding` above 0, a call improves the multipliers in the state, as one iteration.
    """
    shape, right, coordinates = model.sparsity, work.whole_right, model.mass.shape[0]
    for c in range(coordinates):
        right[shape.place[c]] = model.column_scale[c] * work.force[c] / model.sqrt_mass[c]
    for row in range(work.row_length.shape[0]):
        at, used = shape.place[coordinates + row], state.row_place[row] >= 0
        right[at] = work.gamma[row] / work.row_length[row] if used else 0.0
        if used and yielding > 0.0:
            right[at] -= yielding * state.multipliers[row] / model.row_scale[row] * work.row_length[row]
    lu_solve(work.whole, work.whole_pivots, shape.band, shape.band, right)
    for c in range(coordinates):
        a[c] = model.column_scale[c] * right[shape.place[c]] / model.sqrt_mass[c]
    for row in range(work.row_length.shape[0]):
        if state.row_place[row] >= 0:
            share = right[shape.place[coordinates + row]] / work.row_length[row]
            state.multipliers[row] = model.row_scale[row] * share
        else:
            state.multipliers[row] = 0.0


LAST_FRICTION = 60
"""Most iterations of joint friction, which depends on the reactions, which depend on it."""

FRICTION_SETTLED = 1e-12
"""These iterations end when no reaction changes by more than this part of the largest of them."""

YIELDING_TURNS = 3
"""Number of improvements of the multipliers where constraints yield."""

LARGEST = 1e300
"""An acceleration above this counts as not finite."""


@inner_kernel
def _eliminate(model, state, work):
    """Phi_u^-1 gamma into `right`, B = -Phi_u^-1 Phi_v (eq. 10), the LU of Mhat (eq. 11, with M diagonal).

    Returns whether Mhat is regular.
    """
    rank, freedom = state.rows.shape[0], state.independent.shape[0]
    lower, upper = state.band[0], state.band[1]
    work.dependence[:] = 0.0
    for i in range(rank):
        row = state.rows[i]
        work.right[i] = work.gamma[row]
        for entry in range(model.sparsity.first[row], model.sparsity.first[row + 1]):
            column = model.sparsity.columns[entry]
            if state.place[column] < 0:
                work.dependence[-1 - state.place[column], i] = -work.jacobian[row, column]
    lu_solve(work.factor, work.pivots, lower, upper, work.right)
    for i in range(freedom):
        lu_solve(work.factor, work.pivots, lower, upper, work.dependence[i])
        for j in range(i + 1):
            total = 0.0
            for u in range(rank):
                root = model.sqrt_mass[state.dependent[u]]
                total += root * root * work.dependence[i, u] * work.dependence[j, u]
            work.reduced[i, j] = total
            work.reduced[j, i] = total
        work.reduced[i, i] += model.sqrt_mass[state.independent[i]] ** 2
    return lu_factor(work.reduced, work.reduced_pivots, freedom - 1, freedom - 1)


@inner_kernel
def _solve_reduced(model, state, work, a):
    """Accelerations [m/s^2, rad/s^2] into `a`, and the multipliers [N, N m] into the state (eq. 8, 11)."""
    rank, freedom = state.rows.shape[0], state.independent.shape[0]
    for u in range(rank):
        k = state.dependent[u]
        work.other[u] = model.column_scale[k] * work.force[k] - model.sqrt_mass[k] ** 2 * work.right[u]
    for i in range(freedom):
        k = state.independent[i]
        total = model.column_scale[k] * work.force[k]
        for u in range(rank):
            total += work.dependence[i, u] * work.other[u]
        work.reduced_force[i] = total
    lu_solve(work.reduced, work.reduced_pivots, freedom - 1, freedom - 1, work.reduced_force)
    for i in range(freedom):
        k = state.independent[i]
        a[k] = model.column_scale[k] * work.reduced_force[i]
    for u in range(rank):
        k = state.dependent[u]
        scale = model.column_scale[k]
        total = work.right[u]
        for i in range(freedom):
            total += work.dependence[i, u] * work.reduced_force[i]
        a[k] = scale * total
        work.other[u] = scale * (work.force[k] - model.mass[k] * a[k])
    lu_solve_transposed(work.factor, work.pivots, state.band[0], state.band[1], work.other)
    state.multipliers[:] = 0.0
    for i in range(rank):
        row = state.rows[i]
        state.multipliers[row] = model.row_scale[row] * work.other[i]


@inner_kernel
def _pressure_settled(model, state, work):
    """Whether the reactions agree with those that friction was computed from."""
    largest, change = 0.0, 0.0
    for row in range(state.multipliers.shape[0]):
        largest = max(largest, abs(state.multipliers[row]))
    for i in range(model.forces.shape[0]):
        force = model.forces[i]
        if force.friction > 0.0 and is_friction(force):
            now = joint_pressure(model, force, state.multipliers)
            change = max(change, abs(now - joint_pressure(model, force, work.previous)))
    return change <= FRICTION_SETTLED * largest


@inner_kernel
def accelerate(model, state, work, time, select, yielding):
    """Accelerations and powers of the state in `work`; factor and Jacobian must be current.

    `yielding` as for factor_whole: above 0, its factor is used, and the multipliers are found by iteration.
    """
    evaluate_gamma(model, time, select, work.q, work.turns, work.v, work.gamma)
    whole = yielding > 0.0 or state.independent.shape[0] > MANY_FREEDOMS
    if yielding == 0.0 and not (
        factor_whole(model, state, work, 0.0) if whole else _eliminate(model, state, work)
    ):
        return SINGULAR
    settled = False
    for turn in range(LAST_FRICTION):
        if model.pressed:
            copy(work.previous, state.multipliers)
        evaluate_forces(
            model, held_in(state), time, select, work.q, work.turns, work.v, work.force, work.powers
        )
        for i in range(state.wrench.shape[0]):
            work.force[i] += state.wrench[i]
        if whole:
            solve_whole(model, state, work, work.a, yielding)
        else:
            _solve_reduced(model, state, work, work.a)
        settled = not model.pressed or _pressure_settled(model, state, work)
        if settled and (yielding == 0.0 or turn >= YIELDING_TURNS):
            break
    if not settled:
        return JAMMED
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind >= DRIVER:
            speed = function_value(model.functions, joint.function, time, select)
            work.powers[BY_DRIVERS] -= state.multipliers[joint.row] * speed
    for i in range(state.wrench.shape[0]):
        if not abs(work.a[i]) < LARGEST:
            return NOT_FINITE
    return OK


@inner_kernel
def complete(model, state, work, time, select, closing):
    """Close positions and velocities of the guess in `work` (if `closing`), then accelerate.

    Returns (status, iterations of the position Newton).
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
    return accelerate(model, state, work, time, select, 0.0), iterations
