"""Largest stable step of the explicit integrators, from the modes of a machine, and steps tried on it.

A method is applied to one mode y'' = -(w^2) y - 2 zeta w y' exactly as advance.py applies it to a machine;
the spectral radius of its one-step map is the growth of the mode in one step.
"""

import math

import numpy as np

from ..errors import SceneError
from ..scene.mechanism import Mechanism
from .advance import advance_tick
from .assembly import Start
from .explicit_integrators import CORRECT_Q, CORRECT_V, PREDICT_Q, PREDICT_V
from .machine_arrays import (
    ADAMS_MOULTON,
    GENERALIZED_ALPHA,
    OK,
    PAST_COUNT,
    Model,
    State,
    make_state,
    make_workspace,
)
from .modes import Mode, linearise, modes_of

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


LARGEST_GROWTH = 1.0 + 5e-8
"""Largest growth in one step of a mode that should decay or keep its size: 1 % of its energy in 1e5 steps.
With a growth of 1.01, an undamped spring would have a million times its energy after 700 steps."""

TRIED_STEPS = 10
"""Number of steps in parts that are tried before they are advised. More would also find later failures, which
the run itself reports."""

RESOLVED = 0.125
"""Angle [rad] that a mode turns by in a step below which it is not judged: fifty steps a period. The growth
that is left, 4e-6 a step of order 3, is the error of the method."""


def growth_per_step(model: Model, eigenvalue: complex, step: float) -> float:
    """Spectral radius of one step of the model's integrator on a mode of this eigenvalue [1/s]."""
    if model.integrator == GENERALIZED_ALPHA:
        return 0.0  # stable for every step (Chung & Hulbert 1993)
    z = eigenvalue * step
    if model.integrator == ADAMS_MOULTON:
        return _multistep_growth(model.weights, z)
    return abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))


def _multistep_growth(weights: np.ndarray, z: complex) -> float:
    """The same for Adams-Moulton PECE; the state is q, v and the accelerations of earlier steps, h = 1."""
    order = weights.shape[1]
    if z.imag != 0.0:
        stiffness, damping = abs(z) ** 2, -2.0 * z.real
    else:
        stiffness, damping = 0.0, -z.real  # a creeping mode: v' = z v
    matrix = np.zeros((order + 1, order + 1))
    for column, (q, v, *past) in enumerate(np.eye(order + 1)):
        now = -stiffness * q - damping * v
        history = [now, *past]
        ahead_q = q + v + weights[PREDICT_Q] @ history
        ahead_v = v + weights[PREDICT_V] @ history
        history = [-stiffness * ahead_q - damping * ahead_v, *history[:-1]]
        matrix[:, column] = [
            q + v + weights[CORRECT_Q] @ history,
            v + weights[CORRECT_V] @ history,
            *[now, *past][: order - 1],
        ]
    if stiffness == 0.0:
        matrix = matrix[1:, 1:]  # the coordinate of a creeping mode has no effect on its growth
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def stable_step(model: Model, mode: Mode) -> float:
    """Largest step [s] at which the integrator keeps a decaying or steady mode from growing."""
    speed = abs(mode.eigenvalue)
    if speed == 0.0 or mode.eigenvalue.real > 1e-6 * speed or model.integrator == GENERALIZED_ALPHA:
        return math.inf
    inside, outside = 0.0, 0.0
    eigenvalue = complex(min(mode.eigenvalue.real, 0.0), mode.eigenvalue.imag)  # round-off is no growth
    for reach in np.arange(0.02, 4.0, 0.02):
        if growth_per_step(model, eigenvalue, reach / speed) > LARGEST_GROWTH:
            outside = float(reach) / speed
            break
        inside = float(reach) / speed
    if outside == 0.0:
        return inside
    for _ in range(30):
        middle = 0.5 * (inside + outside)
        if growth_per_step(model, eigenvalue, middle) > LARGEST_GROWTH:
            outside = middle
        else:
            inside = middle
    return inside


def refuse_unstable_step(start: Start, interval_s: float) -> None:
    """Raise SceneError if the step is above the bound for a mode of the start, all one-sided forces acting.

    With a tolerance no check is needed: it keeps steps below the bound (accuracy.py).
    """
    machine, model = start.machine, start.machine.model
    if model.integrator == GENERALIZED_ALPHA or len(model.forces) == 0 or math.isfinite(model.tolerance):
        return
    modes = modes_of(machine, linearise(machine, start.q, engaged=True))
    swift = [mode for mode in modes if abs(mode.eigenvalue) * model.step > RESOLVED]
    if not swift:
        return
    bound, worst = min(((stable_step(model, mode), mode) for mode in swift), key=lambda pair: pair[0])
    if model.step <= bound:
        return
    name = "adams_moulton" if model.integrator == ADAMS_MOULTON else "runge_kutta_4"
    order = f" of order {model.weights.shape[1]}" if model.integrator == ADAMS_MOULTON else ""
    what = f"the mode of {worst.frequency_hz:.3g} Hz" if worst.oscillates else "a creeping motion"
    raise SceneError(
        f"coupling.mechanism_steps: the step of {model.step:.3g} s is above the stability bound of "
        f"{bound:.3g} s of {name}{order} for {what} ({worst.words}), every one-sided force acting. Use at "
        f"least {math.ceil(interval_s / bound)} steps in an interval of {interval_s:.3g} s"
        f"{_or_in_parts(start)}."
    )


def _or_in_parts(start: Start) -> str:
    """The advice to use a tolerance, if the first steps succeed with it; else empty."""
    model = start.machine.model
    state = make_state(
        len(model.mass), len(model.row_scale), start.rank, len(model.forces), model.weights.shape[1]
    )
    state.q[:], state.v[:] = start.q, start.v
    if not passes(in_parts(model), state, 0.0, TRIED_STEPS):
        return ""
    return f", or a mechanism.tolerance of {USUAL_TOLERANCE:g}, by which steps are taken in parts"
