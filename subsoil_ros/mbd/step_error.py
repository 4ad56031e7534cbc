"""Estimate of the error of one step, and the number of halvings where it is too large.

Adams-Moulton: predictor and corrector are of one order, so their difference, times the constant of the
corrector over the sum of both, is the error of the corrector (Milne's device; Hairer, Norsett and Wanner
1993, III.1). Runge-Kutta: the slopes of stage 4 and of the end of the step belong to one instant; with the
latter in place of the former the weights are those of a method of order 3. So span / 6 times their difference
is an upper estimate of the error of the step itself, which is of order 4.
"""

import math

from .kernel_options import inner_kernel
from .linear import copy
from .machine_arrays import ADAMS_MOULTON, GENERALIZED_ALPHA

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
