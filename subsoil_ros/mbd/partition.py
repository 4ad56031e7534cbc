"""Generalized coordinate partitioning: independent and dependent coordinates (paper eq. 9, 10).

Coordinates are scaled (machine_arrays.py), so that pivots, residuals and condition are comparable.
"""

from .geometry import evaluate_turns
from .joints.constraints import evaluate_jacobian, evaluate_residual, evaluate_speed
from .kernel_options import inner_kernel
from .linear import copy, inverse_norm, lu_factor, lu_solve, pivot_fully, pivot_ratio
from .machine_arrays import DOUBTFUL, NOT_CLOSED, OK, PARTITION_COUNT, SINGULAR

CLOSURE = 1e-14
"""Largest residual of closed positions, as a part of the machine's size. 1e-12 would be enough for the
constraints alone, but next to a singular position the residual is divided by small pivots."""

ROUND_OFF = 2e-15
"""The same as a part of the largest coordinate, which counts where a machine is far from the origin."""

STALE_ITERATIONS = 2
"""Position iterations that use the factors of the last evaluation before new ones are made."""

LAST_ITERATION = 25
"""Most iterations of the position Newton; without convergence the machine cannot reach the position."""

SMALLEST_PIVOT = 1e-7
"""Ratio of the last pivot of a full-pivot elimination to its first below which the position is singular."""


NEAR = 3e-2
"""Ratio of the smallest pivot to the best one seen below which a position is near to a singular one.
Round-off over its square, the error of velocities there, is 1e-13."""


@inner_kernel
def condition_estimate(model, state, work):
    """Condition (1-norm) of the scaled Phi_u; its factor and the Jacobian must be current."""
    largest = 0.0
    work.other[:] = 0.0
    for i in range(state.rows.shape[0]):
        row = state.rows[i]
        for entry in range(model.sparsity.first[row], model.sparsity.first[row + 1]):
            column = model.sparsity.columns[entry]
            if state.place[column] >= 0:
                work.other[state.place[column]] += abs(work.jacobian[row, column])
    for i in range(state.rows.shape[0]):
        largest = max(largest, work.other[i])
    lower, upper = state.band[0], state.band[1]
    return largest * inverse_norm(work.factor, work.pivots, lower, upper, work.right, work.other)


@inner_kernel
def factor_dependent(model, state, work, q):
    """Jacobian at `q` (its turns current), and the LU of its dependent part; False if that is singular."""
    evaluate_jacobian(model, q, work.turns, work.jacobian)
    rank, lower, upper = state.rows.shape[0], state.band[0], state.band[1]
    for j in range(rank):
        for i in range(max(j - lower - upper, 0), min(j + lower, rank - 1) + 1):
            work.factor[j, i] = 0.0
    for i in range(rank):
        row = state.rows[i]
        for entry in range(model.sparsity.first[row], model.sparsity.first[row + 1]):
            column = model.sparsity.columns[entry]
            if state.place[column] >= 0:
                work.factor[state.place[column], i] = work.jacobian[row, column]
    return lu_factor(work.factor, work.pivots, lower, upper)


@inner_kernel
def _adopt(model, state, work):
    """Make the first rows and columns that full pivoting took the partition, in the order of the band."""
    rank, shape = state.rows.shape[0], model.sparsity
    for i in range(state.row_place.shape[0]):
        state.row_place[work.row_order[i]] = i - rank  # negative: taken
    for i in range(state.place.shape[0]):
        state.place[work.column_order[i]] = i - rank
    used = 0
    for row in shape.row_order:
        taken = state.row_place[row] < 0
        state.row_place[row] = used if taken else -1
        if taken:
            state.rows[used] = row
            used += 1
    used, free = 0, 0
    for column in shape.column_order:
        if state.place[column] < 0:
            state.dependent[used] = column
            state.place[column] = used
            used += 1
        else:
            state.independent[free] = column
            free += 1
            state.place[column] = -free
    state.band[:] = 0
    for i in range(rank):
        for entry in range(shape.first[state.rows[i]], shape.first[state.rows[i] + 1]):
            j = state.place[shape.columns[entry]]
            if j >= 0:
                state.band[0] = max(state.band[0], i - j)
                state.band[1] = max(state.band[1], j - i)


@inner_kernel
def choose_partition(model, state, work, q):
    """Choose dependent coordinates and independent rows at `q` by full pivoting; OK, DOUBTFUL or SINGULAR."""
    evaluate_turns(q, work.turns)
    evaluate_jacobian(model, q, work.turns, work.jacobian)
    rank = state.rows.shape[0]
    matrix, rows, columns = work.pivoted, work.row_order, work.column_order
    for row in range(matrix.shape[0]):
        copy(matrix[row], work.jacobian[row])
    pivot_fully(matrix, rows, columns)
    _adopt(model, state, work)
    state.counters[PARTITION_COUNT] += 1
    if rank == 0:
        return OK
    first, last = matrix[rows[0], columns[0]], matrix[rows[rank - 1], columns[rank - 1]]
    if not abs(last) > SMALLEST_PIVOT * abs(first) or not factor_dependent(model, state, work, q):
        return SINGULAR
    state.condition[0] = 0.0  # measured after the next step
    ratio = abs(last / first)
    state.condition[1] = max(state.condition[1], ratio)
    state.condition[2] = max(state.condition[2], pivot_ratio(work.factor))
    near = ratio < NEAR * state.condition[1] or pivot_ratio(work.factor) < NEAR * state.condition[2]
    return DOUBTFUL if near else OK


@inner_kernel
def close_positions(model, state, work, time, select, q):
    """Move the dependent coordinates of `q` onto the constraints by Newton's method.

    The first iterations use the factors in `work`, which at the end are those of the closed pose. Returns
    (status, iterations).
    """
    reach = 0.0
    for i in range(q.shape[0]):
        reach = max(reach, abs(q[i]))
    tolerance = max(CLOSURE * model.size, ROUND_OFF * reach)
    for iteration in range(LAST_ITERATION):
        evaluate_turns(q, work.turns)
        evaluate_residual(model, time, select, q, work.turns, work.residual)
        closed = True
        for i in range(state.rows.shape[0]):
            work.right[i] = -work.residual[state.rows[i]]
            closed = closed and abs(work.right[i]) <= tolerance
        fresh = closed or iteration >= STALE_ITERATIONS
        if fresh and not factor_dependent(model, state, work, q):
            return SINGULAR, iteration
        if closed:
            return OK, iteration
        lu_solve(work.factor, work.pivots, state.band[0], state.band[1], work.right)
        for i in range(state.dependent.shape[0]):
            j = state.dependent[i]
            q[j] += model.column_scale[j] * work.right[i]
    return NOT_CLOSED, LAST_ITERATION


@inner_kernel
def close_velocities(model, state, work, time, select, v):
    """Dependent velocities from the independent ones (eq. 4); factor and Jacobian must be current."""
    evaluate_speed(model, time, select, work.residual)
    for i in range(state.rows.shape[0]):
        row = state.rows[i]
        total = work.residual[row]
        for entry in range(model.sparsity.first[row], model.sparsity.first[row + 1]):
            j = model.sparsity.columns[entry]
            if state.place[j] < 0:
                total -= work.jacobian[row, j] * v[j] / model.column_scale[j]
        work.right[i] = total
    lu_solve(work.factor, work.pivots, state.band[0], state.band[1], work.right)
    for i in range(state.dependent.shape[0]):
        j = state.dependent[i]
        v[j] = model.column_scale[j] * work.right[i]
