"""Advice for a machine whose motion the steps cannot follow: only settings that were tried on it."""

import numpy as np

from ..scene.mechanism import Mechanism
from .advance import advance_tick
from .tables import ADAMS_MOULTON, OK, PAST_COUNT, Model, State, make_workspace

USUAL_TOLERANCE: float = Mechanism.model_fields["tolerance"].default


def copied(state: State) -> State:
    """Return a copy of a state, arrays included."""
    return State(*(array.copy() for array in state))


def passes(model: Model, state: State, start: float, steps: int) -> bool:
    """Whether `steps` steps from the time `start` [s] can be taken with this model; `state` is left alone."""
    trial = copied(state)
    trial.counters[PAST_COUNT] = 0
    work = make_workspace(len(model.mass), len(model.row_scale), len(trial.rows), len(model.forces))
    trial.balance[:] = 0.0  # of this stretch alone
    status = advance_tick(model, trial, work, start, 0)
    if int(status) == OK:
        status = advance_tick(model, trial, work, start, steps)
    return int(status) == OK and bool(np.isfinite(trial.q).all())


def in_parts(model: Model) -> Model:
    """Return the model with steps in parts: the integrator and tolerance that a scene has by default."""
    return model._replace(integrator=ADAMS_MOULTON, tolerance=USUAL_TOLERANCE)
