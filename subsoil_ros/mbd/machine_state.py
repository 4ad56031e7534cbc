"""Reports of a machine: body states, joint reactions, forces, energies."""

import numpy as np

from ..messages import BodyState, ForceState, JointReaction, MechanismState
from .forces.evaluation import Held, evaluate_forces, report_forces
from .forces.force_table import LOCKED_SPRING, LOCKED_TORSION, POINT_LOAD
from .geometry import turns_of
from .joints import kind_of
from .joints.constraints import evaluate_jacobian, evaluate_residual, evaluate_speed
from .machine import Machine
from .machine_arrays import BY_DRIVERS, BY_LOADS, BY_WRENCHES, DISSIPATED, PART_COUNT, RESIDUAL, Model, State


def body_states(machine: Machine, state: State) -> tuple[BodyState, ...]:
    """All bodies, in the order of the scene."""
    return tuple(
        BodyState(
            name,
            *(float(array[3 * i + k]) for array in (state.q, state.v, state.a) for k in range(3)),
        )
        for i, name in enumerate(machine.bodies)
    )


def multipliers(machine: Machine, state: State, time: float, select: float) -> np.ndarray:
    """Lagrange multipliers (m,) [N, N m] of eq. 6; the smallest ones where they are not unique."""
    model = machine.model
    if len(state.rows) == len(model.row_scale):
        return state.multipliers
    count = len(model.mass)
    jacobian = np.zeros((len(model.row_scale), count + 3))
    turns = turns_of(state.q)
    evaluate_jacobian(model, state.q, turns, jacobian)
    total = np.zeros(count + 3)
    held = Held(state.modes, state.multipliers, state.anchors)
    evaluate_forces(model, held, time, select, state.q, turns, state.v, total, np.zeros(3))
    rest = total[:count] + state.wrench - model.mass * state.a[:count]
    scaled = np.linalg.lstsq(jacobian[:, :count].T, model.column_scale * rest, rcond=1e-9)[0]
    return model.row_scale * scaled


def reactions_at(
    machine: Machine, q: np.ndarray, row_multipliers: np.ndarray, redundant: tuple[str, ...]
) -> tuple[JointReaction, ...]:
    """Force and moment of every joint on its body_b, about the joint point: -Phi_q^T lambda."""
    turns = turns_of(q)
    reactions = []
    for name, joint in zip(machine.joints, machine.model.joints, strict=True):
        x, z, moment = kind_of(joint).reaction(joint, q, turns, -row_multipliers[joint["row"] :])
        reactions.append(JointReaction(name, float(x), float(z), float(moment), unique=name not in redundant))
    return tuple(reactions)


def locked_forces(model: Model, row_multipliers: np.ndarray, report: np.ndarray) -> None:
    """Write the forces of locked springs, which are those of their constraints, into `report` (forces, 3)."""
    for values, force in zip(report, model.forces, strict=True):
        if force["kind"] in (LOCKED_SPRING, LOCKED_TORSION):
            values[2] = -row_multipliers[model.joints["row"][force["joint"]]]


def mechanism_state(
    machine: Machine,
    state: State,
    redundant: tuple[str, ...],
    draft_driver: str | None,
    stamp: tuple[str, int, int],
    select: float,
) -> MechanismState:
    """State of the whole machine at the time of `stamp` = (run id, tick, end time [ns]).

    select: a time [s] that chooses the segments of time functions at a breakpoint.
    """
    model = machine.model
    time = stamp[2] * 1e-9
    report = np.zeros((len(machine.forces), 3))
    held = Held(state.modes, state.multipliers, state.anchors)
    stored = report_forces(model, held, time, select, state.q, turns_of(state.q), state.v, report)
    row_multipliers = multipliers(machine, state, time, select)
    locked_forces(model, row_multipliers, report)
    reactions = reactions_at(machine, state.q, row_multipliers, redundant)
    draft = next((r.force_x_newton for r in reactions if r.name == draft_driver), 0.0)
    count = len(model.mass)
    position, velocity = residuals(machine, state, time, select)
    forces = tuple(
        ForceState(name, *(float(value) for value in values))
        for name, values, kind in zip(machine.forces, report, model.forces["kind"], strict=True)
        if kind != POINT_LOAD
    )
    work = [float(value) for value in state.work]
    return MechanismState(
        *stamp,
        draft_newton=draft,
        kinetic_energy_joule=float(0.5 * np.sum(model.mass * state.v[:count] ** 2)),
        gravity_energy_joule=float(model.gravity * np.sum(model.mass[1::3] * state.q[1:count:3])),
        spring_energy_joule=float(stored),
        dissipated_joule=work[DISSIPATED],
        driver_work_joule=work[BY_DRIVERS],
        external_work_joule=work[BY_LOADS] + work[BY_WRENCHES],
        position_residual_m=position,
        velocity_residual_m_per_s=velocity,
        energy_residual_joule=float(state.balance[RESIDUAL]),
        part_count=int(state.counters[PART_COUNT]),
        bodies=body_states(machine, state),
        joints=reactions,
        forces=forces,
    )


def residuals(machine: Machine, state: State, time: float, select: float) -> tuple[float, float]:
    """Largest violation of all constraints [m] and of their rates [m/s], redundant ones included."""
    model = machine.model
    count = len(model.mass)
    phi = np.zeros(len(model.row_scale))
    turns = turns_of(state.q)
    position = float(evaluate_residual(model, time, select, state.q, turns, phi))
    jacobian = np.zeros((len(phi), count + 3))
    evaluate_jacobian(model, state.q, turns, jacobian)
    evaluate_speed(model, time, select, phi)
    rates = jacobian[:, :count] @ (state.v[:count] / model.column_scale) - phi
    return position, float(np.abs(rates).max(initial=0.0))
