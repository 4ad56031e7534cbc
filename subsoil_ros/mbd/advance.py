"""One tick: steps, their parts up to breakpoints of time functions and switches of forces, supervision.

Within a step every force stays in one mode (forces/evaluation.py). If one is in another mode at its end,
the instant of the first switch is located, the step ends there, and the rest begins without history.
"""

import numpy as np

from .accuracy import MOST_HALVINGS, SPARE, halvings_for, keep_balance, keep_guess, step_error
from .dynamics import complete
from .events import differs, locate_switch
from .explicit_integrators import guess_multistep, guess_runge_kutta, multistep_power
from .forces.evaluation import evaluate_forces, evaluate_modes, held_in, move_anchors, report_forces
from .generalized_alpha import keep_auxiliary, step_generalized_alpha
from .geometry import evaluate_turns
from .joints.constraints import evaluate_residual
from .kernel_options import NO, YES, inner_kernel, kernel, part_of_kernel
from .linear import copy
from .machine_arrays import (
    ADAMS_MOULTON,
    BY_LOADS,
    BY_WRENCHES,
    CONTRADICTION,
    DISSIPATED,
    DOUBTFUL,
    EVENT_COUNT,
    GENERALIZED_ALPHA,
    INACCURATE,
    NEAR_COUNT,
    NOT_CLOSED,
    NOT_FINITE,
    OK,
    PART_COUNT,
    PARTITION_COUNT,
    PAST_COUNT,
    RESTART_COUNT,
    RUNGE_KUTTA_4,
    SINGULAR,
    UNBALANCED,
)
from .partition import choose_partition, condition_estimate
from .singular_poses import MOST_NEAR, NEAR_EXCESS, NEAR_PART, complete_near, count_near, is_near

PATIENCE = 4
"""Iterations of the position Newton after which the partition, nearly singular, is chosen anew."""

WORSENING = 10.0
"""Growth of the condition of Phi_u at which the partition, nearly singular, is chosen anew."""

BREAKPOINT_MARGIN = 1e-6
"""A breakpoint this part of a step away from the end of a step counts as being there."""

SWITCH_MARGIN = 1e-9
"""A switch this part of a step away from the end of a part of a step counts as being there."""

MOST_SWITCHES = 30
"""After so many switches in one step the rest of it is taken without looking for more."""

CONTRADICTION_GAP = 1e-8
"""Gap of constraints left out as redundant, over the machine's size, above which they contradict others."""


@inner_kernel
def _take_start(model, state, work, time, select):
    """Take the accelerations in `work` as those of the state, and shift history by their change.

    Shifted accelerations imply other velocities in the past; past powers are computed at these.
    """
    for k in range(state.counters[PAST_COUNT]):
        changed = False
        for i in range(state.a.shape[0]):
            change = work.a[i] - state.a[i]
            changed = changed or change != 0.0
            state.past_a[k, i] += change
            work.trial_v[i] = state.v[i] - (k + 1) * model.step * change
        for i in range(state.powers.shape[0]):
            state.past_powers[k, i] += work.powers[i] - state.powers[i]
        if changed and model.integrator == ADAMS_MOULTON:
            evaluate_forces(
                model,
                held_in(state),
                time,
                select,
                work.q,
                work.turns,
                work.trial_v,
                work.force,
                work.power_sums,
            )
            for i in (DISSIPATED, BY_LOADS):
                state.past_powers[k, i] += work.power_sums[i] - work.powers[i]
    copy(state.a, work.a)
    copy(state.powers, work.powers)


@inner_kernel
def _refresh(model, state, work, time, select):
    """Evaluate the accelerations at the state again; return the status."""
    copy(work.q, state.q)
    copy(work.v, state.v)
    if state.counters[NEAR_COUNT] > 0:
        status = complete_near(model, state, work, time, select, NO)
    else:
        status, _ = complete(model, state, work, time, select, NO)
    if status == OK:
        _take_start(model, state, work, time, select)
    return status


@inner_kernel
def _method(model, state, whole):
    """The method of the next step: Adams-Moulton needs whole steps and enough history."""
    if model.integrator != ADAMS_MOULTON:
        return model.integrator
    multistep = whole and state.counters[PAST_COUNT] == state.past_a.shape[0]
    return ADAMS_MOULTON if multistep else RUNGE_KUTTA_4


@inner_kernel
def _try(model, state, work, start, span, select, method, near, strict):
    """Take one step from the state, its end into `work`: (status, most position iterations of a stage).

    `near`: by the equations next to a singular pose (singular_poses.py). `strict`: a stage that comes next to
    one ends the step with DOUBTFUL.
    """
    if method == GENERALIZED_ALPHA:
        return step_generalized_alpha(model, state, work, start, span, select)
    if method == RUNGE_KUTTA_4:
        copy(work.v, state.v)
        copy(work.a, state.a)
        copy(work.powers, state.powers)
    most = 0
    for stage in range(1, 3 if method == ADAMS_MOULTON else 5):
        time = start + span
        if stage == (2 if method == ADAMS_MOULTON else 4):
            keep_guess(state, work, method)
        if method == ADAMS_MOULTON:
            guess_multistep(model, state, work, span, stage)
        else:
            time = start + (0.5 * span if stage < 3 else span)
            guess_runge_kutta(state, work, span, stage)
        if near:
            status, iterations = complete_near(model, state, work, time, select, YES), 0
        else:
            status, iterations = complete(model, state, work, time, select, YES)
        if status == OK and strict and is_near(state, work):
            status = DOUBTFUL
        if status != OK:
            return status, iterations
        most = max(most, iterations)
    return OK, most


@inner_kernel
def _book(model, state, work, step, method):
    """Add the work of this step, by the formula of its velocities; the work of constant wrenches is exact."""
    for i in range(state.powers.shape[0]):
        if method == ADAMS_MOULTON:
            mean = multistep_power(model, state, work, i)
        elif method == RUNGE_KUTTA_4:
            mean = work.power_sums[i] / 6.0
        else:
            mean = 0.5 * (state.powers[i] + work.powers[i])
        state.work[i] += step * mean
    for i in range(state.wrench.shape[0]):
        state.work[BY_WRENCHES] += state.wrench[i] * (work.q[i] - state.q[i])


@inner_kernel
def _accept(state, work, method):
    """Make the end of the step, in `work`, the state; the old accelerations become history."""
    if method == GENERALIZED_ALPHA:
        keep_auxiliary(state, work)
    else:
        past = state.past_a.shape[0]
        for k in range(past - 1, 0, -1):
            copy(state.past_a[k], state.past_a[k - 1])
            copy(state.past_powers[k], state.past_powers[k - 1])
        copy(state.past_a[0], state.a)
        copy(state.past_powers[0], state.powers)
        state.counters[PAST_COUNT] = min(past, state.counters[PAST_COUNT] + 1)
    copy(state.q, work.q)
    copy(state.v, work.v)
    copy(state.a, work.a)
    copy(state.powers, work.powers)


@inner_kernel
def _restart(state):
    """Discard history; the next steps are Runge-Kutta until there is enough of it."""
    state.counters[PAST_COUNT] = 0
    state.counters[RESTART_COUNT] += 1


@inner_kernel
def _change_modes(model, state, work, time, select):
    """Copy the modes in `work` to the state; energy left in a spring that lets go counts as dissipated."""
    evaluate_turns(state.q, work.turns)
    before = report_forces(model, held_in(state), time, select, state.q, work.turns, state.v, work.report)
    move_anchors(model, held_in(state), state.q, work.turns, state.v, work.modes, NO)
    copy(state.modes, work.modes)
    after = report_forces(model, held_in(state), time, select, state.q, work.turns, state.v, work.report)
    state.work[DISSIPATED] += before - after


@inner_kernel
def _next_breakpoint(model, time, end):
    """The first breakpoint after `time` and clearly before `end`, or `end`."""
    margin = BREAKPOINT_MARGIN * model.step
    for breakpoint in model.breakpoints:
        if breakpoint > time + margin and breakpoint < end - margin:
            return breakpoint
    return end


@inner_kernel
def _breakpoint_at(model, time):
    found = False
    for breakpoint in model.breakpoints:
        found = found or abs(breakpoint - time) <= BREAKPOINT_MARGIN * model.step
    return found


@inner_kernel
def _reach(model, state, work, start, span, select, method):
    """Take one step, next to a singular pose too: (status, position iterations, whether next to such a pose).

    If only the partition is nearly singular, another one is chosen. If the pose itself is, the step is taken
    with constraints that yield (singular_poses.py).
    """
    if method == GENERALIZED_ALPHA:
        status, iterations = _try(model, state, work, start, span, select, method, NO, NO)
        return status, iterations, False
    if state.counters[NEAR_COUNT] == 0:
        status, iterations = _try(model, state, work, start, span, select, method, NO, YES)
        if status not in (DOUBTFUL, SINGULAR, NOT_CLOSED):
            return status, iterations, False
        if choose_partition(model, state, work, state.q) == OK:
            again, iterations = _try(model, state, work, start, span, select, method, NO, YES)
            if again == OK:
                return again, iterations, False
    elif state.counters[NEAR_COUNT] > MOST_NEAR:
        return SINGULAR, 0, True
    copy(state.multipliers, work.kept)
    status, _ = _try(model, state, work, start, span, select, method, YES, NO)
    return status, 0, True


@part_of_kernel
def _take_part(model, state, work, start, span, select, locating, judged):
    """One step of at most `span`, to the first switch of a force if there is one.

    Returns (status, span taken, most position iterations of a stage, whether a force has switched, its error
    over the tolerance). INACCURATE: the step is `judged` and its error too large, or it is too long for a
    singular pose or to close the joints at its end; the state is unchanged.
    """
    whole = span > (1.0 - BREAKPOINT_MARGIN) * model.step
    method = _method(model, state, whole)
    copy(work.kept, state.multipliers)
    status, iterations, near = _reach(model, state, work, start, span, select, method)
    missed = status in (NOT_CLOSED, NOT_FINITE) and span > 1.5 * model.step / 2.0**MOST_HALVINGS
    if status != OK and not (missed and judged):
        return status, span, iterations, False, 0.0
    if judged and (missed or (near and span > NEAR_PART * model.step)):
        copy(state.multipliers, work.kept)
        return INACCURATE, span, iterations, False, NEAR_EXCESS
    near_count = count_near(model, state, work) if near else 0
    excess = 1.0 if near else 0.0  # where it is not judged, the next part is no longer than this one
    if judged and near_count < 2:
        excess = step_error(model, state, work, span, method) / model.tolerance
        if not excess <= 1.0:
            copy(state.multipliers, work.kept)
            return INACCURATE, span, iterations, False, excess
    evaluate_modes(model, held_in(state), start + span, select, work.q, work.turns, work.v, work.modes)
    switched = differs(work.modes, state.modes)
    if switched and locating:
        part = locate_switch(model, state, work, start, span, select)
        if part * span < SWITCH_MARGIN * model.step:
            span = 0.0
        elif (1.0 - part) * span > SWITCH_MARGIN * model.step:
            span *= part
            method = _method(model, state, False)
            whole = False
            status, more = _try(model, state, work, start, span, select, method, near, NO)
            iterations = max(iterations, more)
            if status != OK:
                return status, span, iterations, False, 0.0
            near_count = count_near(model, state, work) if near else 0
    if span > 0.0:
        state.counters[NEAR_COUNT] = near_count
        _book(model, state, work, span, method)
        _accept(state, work, method)
        if not whole and method != GENERALIZED_ALPHA:
            state.counters[PAST_COUNT] = 0  # history is of equal steps
    if switched:
        _change_modes(model, state, work, start + span, select)
        state.counters[EVENT_COUNT] += 1
        _restart(state)
    return OK, span, iterations, switched, excess


@inner_kernel
def _supervise(model, state, work, time, select, iterations):
    """Check the constraints left out after a part of a step, and choose the partition anew if due."""
    if state.counters[NEAR_COUNT] > 0:
        return OK
    if state.rows.shape[0] < work.residual.shape[0]:
        evaluate_turns(state.q, work.turns)
        gap = evaluate_residual(model, time, select, state.q, work.turns, work.residual)
        if not gap <= CONTRADICTION_GAP * model.size:
            return CONTRADICTION
    estimate = condition_estimate(model, state, work)
    if state.condition[0] == 0.0:
        state.condition[0] = estimate
    if estimate > WORSENING * state.condition[0] or iterations > PATIENCE:
        status = choose_partition(model, state, work, state.q)
        return OK if status == DOUBTFUL else status
    return OK


@part_of_kernel
def _take_step(model, state, work, start, end, fresh):
    """Advance by one step, from `start` to `end`, part by part; return the status.

    A part whose error is above the tolerance is halved, as often as halvings_for gives. Parts are doubled
    again where their error is below SPARE of the tolerance.
    """
    time, switches, halvings, inside = start, 0, 0, False
    while time < end:
        breakpoint = _next_breakpoint(model, time, end)
        select = 0.5 * (time + breakpoint)
        if inside:
            fresh = False
        elif _breakpoint_at(model, time):
            _restart(state)
            evaluate_turns(state.q, work.turns)
            evaluate_modes(model, held_in(state), time, select, state.q, work.turns, state.v, work.modes)
            _change_modes(model, state, work, time, select)
        if fresh or (state.counters[PAST_COUNT] == 0 and not inside):
            status = _refresh(model, state, work, time, select)
            if status != OK:
                return status
        locating = switches < MOST_SWITCHES
        span, judged = breakpoint - time, locating and model.tolerance < np.inf
        if halvings > 0:
            span = min(span, model.step / 2.0**halvings)
            if breakpoint - time - span < 0.5 * span:
                span = breakpoint - time
        status, span, iterations, switched, excess = _take_part(
            model, state, work, time, span, select, locating, judged
        )
        if status == INACCURATE and halvings < MOST_HALVINGS:
            halvings = min(halvings + halvings_for(excess), MOST_HALVINGS)
            state.counters[PAST_COUNT] = 0  # history is of whole steps
            inside = True
            continue
        if status != OK:
            return status
        if halvings > 0:
            state.counters[PART_COUNT] += 1
            if excess < SPARE:
                halvings -= 1
        status = _supervise(model, state, work, time + span, select, iterations)
        if status != OK:
            return status
        reached = breakpoint - time - span <= SWITCH_MARGIN * model.step
        inside = not switched and not reached
        switches += 1 if switched else 0
        time = breakpoint if reached else time + span
        fresh = False
    return OK


@kernel
def advance_tick(model, state, work, start, steps):
    """Advance one tick of `steps` steps from the time `start` [s], the wrench in the state held constant.

    A step with breakpoints inside is taken part by part, each of them a restart. No steps: only
    the acceleration at `start` is evaluated.
    """
    if state.counters[PARTITION_COUNT] == 0:
        evaluate_turns(state.q, work.turns)
        move_anchors(model, held_in(state), state.q, work.turns, state.v, state.modes, YES)
        select = start + 0.5 * model.step
        evaluate_modes(model, held_in(state), start, select, state.q, work.turns, state.v, state.modes)
        status = choose_partition(model, state, work, state.q)
        if status == SINGULAR:
            return status
    if steps == 0:
        status = _refresh(model, state, work, start, start + 0.5 * model.step)
        if status == OK:
            keep_balance(model, state, work, start, start + 0.5 * model.step)
        return status
    for step in range(steps):
        begin, end = start + step * model.step, start + (step + 1) * model.step
        status = _take_step(model, state, work, begin, end, step == 0)
        if status != OK:
            return status
    end = start + steps * model.step
    return OK if keep_balance(model, state, work, end, end - 0.5 * model.step) else UNBALANCED
