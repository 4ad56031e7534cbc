"""Explicit integrators: Adams-Moulton predictor-corrector (PECE), and Runge-Kutta, which starts it.

Adams-Moulton works on a history of accelerations. One polynomial through them gives both updates: its
integral the velocities (the Adams formulas), its double integral the positions. When the wrench held in a
tick changes, they are shifted by the change of the present acceleration: the past becomes the one that the
new wrench would have caused. As the sum of the weights is one, the momentum of a body changes by wrench times
interval to round-off, whatever the history.
"""

import numpy as np
from numpy.polynomial import polynomial

from .kernel_options import inner_kernel

PREDICT_V, PREDICT_Q, CORRECT_V, CORRECT_Q = 0, 1, 2, 3


def multistep_weights(order: int) -> np.ndarray:
    """Weights (4, order) float64 on the accelerations at times 0, -1, ... (predictor, rows 0 and 1) and
    1, 0, -1, ... (corrector, rows 2 and 3), times in steps.

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
def guess_multistep(model, state, work, step, stage):
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
def multistep_power(model, state, work, i):
    """Mean of the power `i` over the step, by the formula that gave the velocities."""
    total = model.weights[CORRECT_V, 0] * work.powers[i]
    total += model.weights[CORRECT_V, 1] * state.powers[i]
    for k in range(2, model.weights.shape[1]):
        total += model.weights[CORRECT_V, k] * state.past_powers[k - 2, i]
    return total


@inner_kernel
def guess_runge_kutta(state, work, step, stage):
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
