"""The implicit generalized-alpha method, order 2, on the independent coordinates.

Source: Chung & Hulbert (1993), J. Appl. Mech. 60(2); the auxiliary acceleration p as in Arnold & Bruels
(2007), Multibody Syst. Dyn. 18(2): (1 - am) p1 + am p0 = (1 - af) a1 + af a0. Here the unknowns are the
accelerations of the independent coordinates, so the equations are free of constraints.
"""

import numpy as np

from .dynamics import complete
from .kernel_options import YES, inner_kernel
from .linear import copy, lu_factor, lu_solve
from .machine_arrays import NOT_SOLVED, OK, PAST_COUNT, SINGULAR

DAMPING_RADIUS = 0.8
"""Spectral radius at infinite frequency. 1 would damp nothing, 0 would remove fast modes in one step."""

ALPHA_M = (2.0 * DAMPING_RADIUS - 1.0) / (DAMPING_RADIUS + 1.0)
ALPHA_F = DAMPING_RADIUS / (DAMPING_RADIUS + 1.0)
GAMMA = 0.5 + ALPHA_F - ALPHA_M
BETA = 0.25 * (GAMMA + 0.5) ** 2

LAST_ITERATION = 30
SOLVED = 1e-12
"""Size of a correction, as a part of the accelerations, that ends Newton's method."""

STALLED = 1e-9
"""The same for a correction of more than half the last one, as a part of the accelerations or of 1 m/s2: near
rest, forces that cancel leave their round-off. It may also move places by no more than PLACE_ROUND_OFF."""

PLACE_ROUND_OFF = 16.0 * np.finfo(np.float64).eps
"""Round-off of places, as a part of the machine's reach: several operations, each of which rounds."""

DIFFERENCE = 1e-5
"""Change of an acceleration, as a part of the largest, in the differences of the Jacobian."""


@inner_kernel
def _guess(state, work, step):
    """q and v of the end of the step from the auxiliary accelerations in `unknown`."""
    for i in range(state.wrench.shape[0]):
        old = state.past_a[0, i] if state.counters[PAST_COUNT] > 0 else state.a[i]
        new = work.unknown[i]
        work.v[i] = state.v[i] + step * ((1.0 - GAMMA) * old + GAMMA * new)
        work.q[i] = state.q[i] + step * (state.v[i] + step * ((0.5 - BETA) * old + BETA * new))


@inner_kernel
def _defect(state, work, i):
    """Defect of coordinate `i` in (1 - am) p1 + am p0 = (1 - af) a1 + af a0."""
    old = state.past_a[0, i] if state.counters[PAST_COUNT] > 0 else state.a[i]
    sought = (1.0 - ALPHA_F) * work.a[i] + ALPHA_F * state.a[i]
    return (1.0 - ALPHA_M) * work.unknown[i] + ALPHA_M * old - sought


@inner_kernel
def _evaluate(model, state, work, time, select, step):
    _guess(state, work, step)
    return complete(model, state, work, time, select, YES)


@inner_kernel
def step_generalized_alpha(model, state, work, start, step, select):
    """Take one step into `work`, the auxiliary accelerations into `unknown`: (status, position iterations).

    By Newton's method, with a Jacobian by differences once a step.
    """
    time, freedom = start + step, state.independent.shape[0]
    copy(work.unknown, state.a)
    status, most = _evaluate(model, state, work, time, select, step)
    if status != OK or freedom == 0:
        return status, most
    largest = 1e-3
    for j in state.independent:
        largest = max(largest, abs(work.a[j]), abs(state.a[j]))
    for i in range(freedom):
        work.newton_right[i] = _defect(state, work, state.independent[i])
    for k in range(freedom):
        j = state.independent[k]
        work.unknown[j] += DIFFERENCE * largest
        status, iterations = _evaluate(model, state, work, time, select, step)
        if status != OK:
            return status, iterations
        for i in range(freedom):
            change = _defect(state, work, state.independent[i]) - work.newton_right[i]
            work.newton[k, i] = change / (DIFFERENCE * largest)
        work.unknown[j] -= DIFFERENCE * largest
    if not lu_factor(work.newton, work.newton_pivots, freedom - 1, freedom - 1):
        return SINGULAR, most
    before, reach = np.inf, model.size
    for i in range(state.q.shape[0]):
        reach = max(reach, abs(state.q[i]))
    unseen = PLACE_ROUND_OFF * reach / (BETA * step * step)
    for _ in range(LAST_ITERATION):
        lu_solve(work.newton, work.newton_pivots, freedom - 1, freedom - 1, work.newton_right)
        change = 0.0
        for i in range(freedom):
            work.unknown[state.independent[i]] -= work.newton_right[i]
            change = max(change, abs(work.newton_right[i]))
        status, iterations = _evaluate(model, state, work, time, select, step)
        most = max(most, iterations)
        stalled = change >= 0.5 * before and change <= max(STALLED * max(largest, 1.0), unseen)
        if status != OK or stalled or change <= SOLVED * largest:
            return status, most
        before = change
        for i in range(freedom):
            j = state.independent[i]
            largest = max(largest, abs(work.a[j]))
            work.newton_right[i] = _defect(state, work, j)
    return NOT_SOLVED, most


@inner_kernel
def keep_auxiliary(state, work):
    """Write the auxiliary accelerations of all coordinates into history, before the step is accepted."""
    for i in range(state.wrench.shape[0]):
        old = state.past_a[0, i] if state.counters[PAST_COUNT] > 0 else state.a[i]
        sought = (1.0 - ALPHA_F) * work.a[i] + ALPHA_F * state.a[i]
        state.past_a[0, i] = (sought - ALPHA_M * old) / (1.0 - ALPHA_M)
    state.counters[PAST_COUNT] = 1
