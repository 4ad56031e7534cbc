"""Adams-Moulton predictor-corrector (PECE) with a Runge-Kutta start, tick by tick.

One polynomial through the accelerations gives both updates: its integral the velocities (the
Adams formulas), its double integral the positions. History is therefore accelerations only, and when
the wrench from outside changes they are shifted by what that changes now: the past becomes the one that
the new wrench would have led through. The sum of the weights being one, a body takes wrench times
interval to round-off, whatever came before.
"""

import numpy as np
from numpy.polynomial import polynomial

from .compiled import inner_kernel, kernel
from .constraints import evaluate_residual
from .dynamics import complete
from .forces import evaluate_regimes
from .partition import choose_partition, condition_estimate
from .tables import (
    BY_WRENCHES,
    CONTRADICTION,
    OK,
    PARTITION_COUNT,
    PAST_COUNT,
    RESTART_COUNT,
)

PATIENCE = 4
"""Iterations of the position Newton after which the partition is chosen anew (DESIGN.md)."""

WORSENING = 10.0
"""Growth of the condition of Phi_u at which the partition is chosen anew (DESIGN.md)."""

CORNER_MARGIN = 1e-6
"""A corner of a law this part of a step away from the end of a step counts as being there."""

CONTRADICTION_GAP = 1e-8
"""Constraints left out as redundant may open by this part of the machine's size."""

PREDICT_V, PREDICT_Q, CORRECT_V, CORRECT_Q = 0, 1, 2, 3


def multistep_weights(order: int) -> np.ndarray:
    """Weights (4, order) float64 on the accelerations at times 0, -1, ... (predictor, rows 0 and 1)
    and 1, 0, -1, ... (corrector, rows 2 and 3), times in steps.

    Rows 0 and 2 are the Adams-Bashforth and Adams-Moulton weights of v' = a; rows 1 and 3 those of
    q(1) = q(0) + v(0) + integral of (1 - s) a(s).
    """
    weights = np.zeros((4, order))
    for row, newest in ((PREDICT_V, 0), (CORRECT_V, 1)):
        nodes = [newest - i for i in range(order)]
        for i, node in enumerate(nodes):
            others = [other for other in nodes if other != node]
            basis = polynomial.polyfromroots(others) / np.prod([node - other for other in others])
            weights[row, i] = polynomial.polyval(1.0, polynomial.polyint(basis))
            doubled = polynomial.polymul([1.0, -1.0], basis)
            weights[row + 1, i] = polynomial.polyval(1.0, polynomial.polyint(doubled))
    return weights


@inner_kernel
def _take_start(state, work):
    """The acceleration evaluated again at the state; history is shifted by what has changed."""
    for k in range(state.counters[PAST_COUNT]):
        for i in range(state.a.shape[0]):
            state.past_a[k, i] += work.a[i] - state.a[i]
        for i in range(state.powers.shape[0]):
            state.past_powers[k, i] += work.powers[i] - state.powers[i]
    state.a[:] = work.a
    state.powers[:] = work.powers


@inner_kernel
def _guess_multistep(model, state, work, step, stage):
    """Predict (stage 1) or correct (stage 2) all coordinates from the accelerations."""
    order = model.weights.shape[1]
    row = PREDICT_V if stage == 1 else CORRECT_V
    for i in range(state.wrench.shape[0]):
        sum_v, sum_q = 0.0, 0.0
        for k in range(order):
            age = k + 1 - stage  # -1: being computed, 0: now, 1 and on: history
            a = work.a[i] if age < 0 else (state.a[i] if age == 0 else state.past_a[age - 1, i])
            sum_v += model.weights[row, k] * a
            sum_q += model.weights[row + 1, k] * a
        work.v[i] = state.v[i] + step * sum_v
        work.q[i] = state.q[i] + step * (state.v[i] + step * sum_q)


@inner_kernel
def _guess_runge_kutta(state, work, step, stage):
    """The point of stage 1 to 3 from the slopes of the stage before; at stage 4 the end of the step."""
    count = state.wrench.shape[0]
    weight = 1.0 if stage == 1 or stage == 4 else 2.0
    if stage == 1:
        work.sums[:] = 0.0
        work.power_sums[:] = 0.0
    for i in range(count):
        work.sums[0, i] += weight * work.v[i]
        work.sums[1, i] += weight * work.a[i]
    for i in range(state.powers.shape[0]):
        work.power_sums[i] += weight * work.powers[i]
    reach = step if stage == 3 else 0.5 * step
    for i in range(count):
        rate_q = work.sums[0, i] / 6.0 if stage == 4 else work.v[i]
        rate_v = work.sums[1, i] / 6.0 if stage == 4 else work.a[i]
        span = step if stage == 4 else reach
        work.q[i] = state.q[i] + span * rate_q
        work.v[i] = state.v[i] + span * rate_v


@inner_kernel
def _book(model, state, work, step, multistep):
    """Work of this step, by the formula that gave the velocities; that of constant wrenches exactly."""
    for i in range(state.powers.shape[0]):
        total = work.power_sums[i] / 6.0
        if multistep:
            total = model.weights[CORRECT_V, 0] * work.powers[i]
            total += model.weights[CORRECT_V, 1] * state.powers[i]
            for k in range(2, model.weights.shape[1]):
                total += model.weights[CORRECT_V, k] * state.past_powers[k - 2, i]
        state.work[i] += step * total
    for i in range(state.wrench.shape[0]):
        state.work[BY_WRENCHES] += state.wrench[i] * (work.q[i] - state.q[i])


@inner_kernel
def _accept(state, work):
    """The state being tried becomes the state; the old accelerations become history."""
    past = state.past_a.shape[0]
    for k in range(past - 1, 0, -1):
        state.past_a[k] = state.past_a[k - 1]
        state.past_powers[k] = state.past_powers[k - 1]
    state.past_a[0] = state.a
    state.past_powers[0] = state.powers
    state.counters[PAST_COUNT] = min(past, state.counters[PAST_COUNT] + 1)
    state.q[:] = work.q
    state.v[:] = work.v
    state.a[:] = work.a
    state.powers[:] = work.powers


@inner_kernel
def _restart(state):
    """Forget history; the next steps are Runge-Kutta until there is enough of it."""
    state.counters[PAST_COUNT] = 0
    state.counters[RESTART_COUNT] += 1


@inner_kernel
def _move(model, state, work, start, span, select, fresh):
    """One step of length `span`, by Adams-Moulton PECE or, without enough history, Runge-Kutta 4.

    Stage 0 evaluates the start again, and shifts history: at a tick's beginning (`fresh`), and before
    Runge-Kutta. A span of 0 does only that. Answers (status, most position iterations of a stage).
    """
    multistep = state.counters[PAST_COUNT] == state.past_a.shape[0]
    first = 0 if fresh or not multistep else 1
    last = 0 if span == 0.0 else (2 if multistep else 4)
    most = 0
    for stage in range(first, last + 1):
        time = start + span
        if stage == 0:
            time = start
            work.q[:] = state.q
            work.v[:] = state.v
        elif multistep:
            _guess_multistep(model, state, work, span, stage)
        else:
            time = start + (0.5 * span if stage < 3 else span)
            _guess_runge_kutta(state, work, span, stage)
        status, iterations = complete(model, state, work, time, select, stage > 0)
        if status != OK:
            return status, iterations
        most = max(most, iterations)
        if stage == 0:
            _take_start(state, work)
    if last > 0:
        _book(model, state, work, span, multistep)
        _accept(state, work)
    return OK, most


@inner_kernel
def _next_corner(model, time, end):
    """The first corner after `time` and clearly before `end`, or `end`."""
    margin = CORNER_MARGIN * model.step
    for corner in model.corners:
        if corner > time + margin and corner < end - margin:
            return corner
    return end


@inner_kernel
def _corner_at(model, time):
    found = False
    for corner in model.corners:
        found = found or abs(corner - time) <= CORNER_MARGIN * model.step
    return found


@inner_kernel
def _supervise(model, state, work, time, select, iterations):
    """After a step: restart where a unilateral force has switched, choose the partition anew if due."""
    evaluate_regimes(model, time, select, state.q, state.v, work.regimes)
    switched = False
    for i in range(work.regimes.shape[0]):
        switched = switched or work.regimes[i] != state.regimes[i]
        state.regimes[i] = work.regimes[i]
    if switched:
        _restart(state)
    if state.rows.shape[0] < work.residual.shape[0]:
        gap = evaluate_residual(model, time, select, state.q, work.residual)
        if not gap <= CONTRADICTION_GAP * model.size:
            return CONTRADICTION
    estimate = condition_estimate(state, work)
    if state.condition[0] == 0.0:
        state.condition[0] = estimate
    if estimate > WORSENING * state.condition[0] or iterations > PATIENCE:
        return choose_partition(model, state, work, state.q)
    return OK


@kernel
def advance_tick(model, state, work, start, steps):
    """One tick of `steps` steps from the time `start` [s], the wrench in the state held constant.

    A step with corners of laws inside is taken piece by piece, each piece a restart. No steps: only
    the acceleration at `start` is evaluated.
    """
    if state.counters[PARTITION_COUNT] == 0:
        evaluate_regimes(model, start, start + 0.5 * model.step, state.q, state.v, state.regimes)
        status = choose_partition(model, state, work, state.q)
        if status != OK:
            return status
    time, finished, fresh = start, 0, True
    end = start + model.step
    while finished < steps or fresh:
        corner = _next_corner(model, time, end)
        select = 0.5 * (time + corner)
        whole = corner - time > (1.0 - CORNER_MARGIN) * model.step
        if _corner_at(model, time) or not whole:
            _restart(state)
        span = 0.0 if steps == 0 else (model.step if whole else corner - time)
        status, iterations = _move(model, state, work, time, span, select, fresh)
        if status != OK or steps == 0:
            return status
        fresh = False
        if not whole:
            _restart(state)
        status = _supervise(model, state, work, corner, select, iterations)
        if status != OK:
            return status
        time = corner
        if corner == end:
            finished += 1
            time = start + finished * model.step
            end = start + (finished + 1) * model.step
    return OK
