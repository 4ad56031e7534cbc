"""Crossing a singular pose (a dead centre, a flat parallelogram), where the joints say too little.

With s the smallest pivot of the constraints, velocities there are wrong by round-off / s^2: a step that
happens to end next to such a pose can leave it on another branch of the motion, with any energy. The
accelerations of earlier steps know better, they are smooth through the pose. So the step is taken by the
predictor alone and the acceleration at its end extrapolated from the history, both of the method's order,
until the pose is left.
"""

from .compiled import inner_kernel
from .integrators.adams_moulton import EXTRAPOLATE, guess_multistep
from .linear import copy, pivot_ratio
from .partition import NEAR
from .tables import GENERALIZED_ALPHA, PAST_COUNT, SKIPPED_COUNT

NOT_JUDGED = 30.0
"""Up to so many times the pivots of a pose that is skipped, a step's error is not judged (chosen)."""

MOST_SKIPPED = 100
"""A machine that has not left the pose after so many steps stays in it (chosen)."""


@inner_kernel
def is_doubtful(state, work):
    """Whether Phi_u, as factored in `work`, has become nearly singular."""
    return pivot_ratio(work.factor) < NEAR * state.condition[2]


@inner_kernel
def is_near(state, work):
    """Whether Phi_u is so near to singular that a step errs by its joints, not by its length."""
    return pivot_ratio(work.factor) < NOT_JUDGED * NEAR * state.condition[2]


@inner_kernel
def can_skip(model, state, whole):
    """Whether there is enough history, of equal steps, to extrapolate from."""
    full = state.counters[PAST_COUNT] == state.past_a.shape[0] and model.integrator != GENERALIZED_ALPHA
    return whole and full and state.counters[SKIPPED_COUNT] < MOST_SKIPPED


@inner_kernel
def skip_ahead(model, state, work, step):
    """The end of the step into `work`, from the history alone; reactions stay those of the step before."""
    guess_multistep(model, state, work, step, 1)
    for i in range(state.wrench.shape[0]):
        total = model.weights[EXTRAPOLATE, 0] * state.a[i]
        for k in range(1, model.weights.shape[1]):
            total += model.weights[EXTRAPOLATE, k] * state.past_a[k - 1, i]
        work.a[i] = total
    for i in range(state.powers.shape[0]):
        total = model.weights[EXTRAPOLATE, 0] * state.powers[i]
        for k in range(1, model.weights.shape[1]):
            total += model.weights[EXTRAPOLATE, k] * state.past_powers[k - 1, i]
        work.powers[i] = total
    copy(state.multipliers, work.kept)
