"""Energy balance of the mechanism: stored and dissipated energy less the work done on it is constant."""

from .forces.evaluation import held_in, report_forces
from .geometry import evaluate_turns
from .kernel_options import inner_kernel
from .machine_arrays import (
    AT_START,
    BY_DRIVERS,
    BY_LOADS,
    BY_WRENCHES,
    DISSIPATED,
    GENERALIZED_ALPHA,
    LARGEST,
    RESIDUAL,
)
from .step_error import SLOWEST

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
