"""Accuracy of steps: the error of one, the halvings where it is too large, and the balance of energy.

Adams-Moulton: predictor and corrector are of one order, so their difference, times the constant of the
corrector over the sum of both, is the error of the corrector (Milne's device; Hairer, Norsett and Wanner
1993, III.1). Runge-Kutta: the slopes of stage 4 and of the end of the step belong to one instant; with the
latter in place of the former the weights are those of a method of order 3. So span / 6 times their difference
is an upper estimate of the error of the step itself, which is of order 4.

Balance: stored and dissipated energy less the work done on the machine is constant.
"""

import math

from .forces.evaluation import held_in, report_forces
from .geometry import evaluate_turns
from .kernel_options import inner_kernel
from .linear import copy
from .machine_arrays import (
    ADAMS_MOULTON,
    AT_START,
    BY_DRIVERS,
    BY_LOADS,
    BY_WRENCHES,
    DISSIPATED,
    GENERALIZED_ALPHA,
    LARGEST,
    RESIDUAL,
)

MOST_HALVINGS = 16
"""A step is taken in up to 2^16 parts: 8 ns of 500 us, where round-off begins to count."""

SPARE = 1.0 / 64.0
"""Part of the tolerance below which the next part is twice as long; its error grows sixteenfold."""

SLOWEST = 1e-3
"""Speed, in sizes of the machine per second, that every body is taken to move at least with when an error is
judged: a machine at rest does not need endless accuracy."""


@inner_kernel
def keep_guess(state, work, method):
    """Keep the values that the end of the step is compared with: the predictor, or the slope of stage 4."""
    copy(work.guess[0], work.v)
    if method == ADAMS_MOULTON:
        copy(work.guess[1], work.q)
    else:
        copy(work.guess[1], work.a)


@inner_kernel
def step_error(model, state, work, span, method):
    """Error of the step that ends in `work`, over the machine's motion; 0 where it is not estimated.

    Both are roots of sums of mass times velocity squared. The error has the errors of the velocities, and of
    the positions over the span; the motion has the velocities, and span times the accelerations.
    """
    if method == GENERALIZED_ALPHA:
        return 0.0
    error, motion = 0.0, 0.0
    order = model.weights.shape[1]
    milne = 1.0 / 6.0 if order == 2 else (1.0 / 10.0 if order == 3 else 19.0 / 270.0)
    for i in range(model.mass.shape[0]):
        if method == ADAMS_MOULTON:
            dv = milne * (work.v[i] - work.guess[0, i])
            dq = milne * (work.q[i] - work.guess[1, i]) / span
        else:
            dv = span / 6.0 * (work.a[i] - work.guess[1, i])
            dq = (work.v[i] - work.guess[0, i]) / 6.0
        slow = SLOWEST * model.size if i % 3 < 2 else 0.0
        swing = span * max(abs(state.a[i]), abs(work.a[i]))
        error += model.mass[i] * (dv * dv + dq * dq)
        motion += model.mass[i] * (work.v[i] ** 2 + swing * swing + slow * slow)
    return math.sqrt(error / motion)


@inner_kernel
def halvings_for(excess):
    """Number of halvings of a step whose error, of order 4, is `excess` times the tolerance."""
    count = 1
    while excess > 16.0 and count < MOST_HALVINGS:
        excess /= 16.0
        count += 1
    return count


LARGEST_RESIDUAL = 1e-2
"""Largest residual of the balance, as a part of the largest energy turned over; a mean draft needs no better.
At least the kinetic energy of a machine at the speed SLOWEST counts as turned over."""


@inner_kernel
def keep_balance(model, state, work, time, select):
    """Update State.balance at the time [s]; return whether it closes. The first call stores the energy there.

    generalized_alpha damps fast modes, so energy may vanish with it.
    """
    evaluate_turns(state.q, work.turns)
    stored = report_forces(model, held_in(state), time, select, state.q, work.turns, state.v, work.report)
    kinetic, gravity, slow = 0.0, 0.0, 0.0
    for i in range(model.mass.shape[0]):
        kinetic += 0.5 * model.mass[i] * state.v[i] ** 2
        if i % 3 == 1:
            gravity += model.mass[i] * model.gravity * state.q[i]
            slow += model.mass[i] * (SLOWEST * model.size) ** 2
    came = state.work[BY_DRIVERS] + state.work[BY_LOADS] + state.work[BY_WRENCHES]
    energy = kinetic + gravity + stored + state.work[DISSIPATED] - came
    if state.balance[LARGEST] == 0.0:
        state.balance[AT_START] = energy
    turned = abs(state.work[BY_DRIVERS]) + abs(state.work[BY_LOADS]) + abs(state.work[BY_WRENCHES])
    turned += kinetic + abs(stored) + abs(state.work[DISSIPATED]) + slow + 1e-9 * abs(gravity)
    state.balance[LARGEST] = max(state.balance[LARGEST], turned)
    state.balance[RESIDUAL] = energy - state.balance[AT_START]
    residual, bound = state.balance[RESIDUAL], LARGEST_RESIDUAL * state.balance[LARGEST]
    lost = residual < 0.0 and model.integrator == GENERALIZED_ALPHA
    return lost or abs(residual) <= bound
