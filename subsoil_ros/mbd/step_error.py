"""Error of one step, estimated in it, and the parts that a step is taken in where the error is too large.

Adams-Moulton: predictor and corrector are of one order, so their difference, times the constant of the
corrector over the sum of both, is the error of the corrector (Milne's device; Hairer, Norsett and Wanner
1993, III.1). Runge-Kutta: the slopes of stage 4 and of the end of the step are of one instant; with the
latter in place of the former the weights are those of a method of order 3, so span / 6 times their difference
is an error that the step itself, of order 4, stays below.
"""

import math

from .compiled import inner_kernel
from .linear import copy
from .tables import ADAMS_MOULTON, GENERALIZED_ALPHA

MOST_HALVINGS = 16
"""A step is taken in up to 2^16 parts (chosen: 8 ns of 500 us, where round-off begins to tell)."""

SPARE = 1.0 / 64.0
"""Below this part of the tolerance the next part is twice as long; its error grows sixteenfold."""

SLOWEST = 1e-3
"""Sizes of the machine per second: a machine that moves slower is judged as if it moved so fast (chosen)."""


@inner_kernel
def keep_guess(state, work, method):
    """Keeps what the end of the step is to be compared with: the predictor, or the slope of stage 4."""
    copy(work.guess[0], work.v)
    if method == ADAMS_MOULTON:
        copy(work.guess[1], work.q)
    else:
        copy(work.guess[1], work.a)


@inner_kernel
def step_error(model, state, work, span, method):
    """Error of the step that ends in `work`, over the machine's motion; 0 where it is not estimated.

    Both are roots of sums of mass times velocity squared: of the error of the velocities, and of that of the
    positions over the span; of the velocities themselves, and of span times the accelerations.
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
    """How often to halve a step whose error is `excess` times the tolerance; it falls with the power 4."""
    count = 1
    while excess > 16.0 and count < MOST_HALVINGS:
        excess /= 16.0
        count += 1
    return count
