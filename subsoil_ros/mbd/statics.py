"""Statics of a machine: its pose of rest, the forces in it, its modes."""

import warnings
from dataclasses import dataclass

import numpy as np

from ..errors import SceneError
from ..messages import BodyState, ForceState, JointReaction
from ..scene.mechanism import Mechanism
from .assembly import MovedBodiesWarning, RedundantConstraintsWarning, Start, Topology, assemble
from .equilibrium import settle
from .forces.evaluation import evaluate_forces, held_at, report_forces
from .forces.force_table import POINT_LOAD
from .geometry import turns_of
from .machine_state import locked_forces, reactions_at
from .modes import Mode, linearise, modes_of
from .projection import RANK_TOLERANCE, Closure


@dataclass(frozen=True)
class Rest:
    """The machine at rest under gravity, springs and wheel contact, drivers held, loads left out."""

    bodies: tuple[BodyState, ...]
    joints: tuple[JointReaction, ...]
    forces: tuple[ForceState, ...]
    modes: tuple[Mode, ...]


@dataclass(frozen=True)
class Survey:
    """Results for a machine that need no run."""

    topology: Topology
    rest: Rest | None
    no_rest: str  # why there is none
    moved: str  # how far bodies were moved onto their joints; empty where they fit


def survey(mechanism: Mechanism, gravity_m_per_s2: float = 9.81) -> Survey:
    """Assemble a machine, bring it to rest, and linearise it there; no warnings.

    Raises:
        SceneError: as assembly.assemble.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RedundantConstraintsWarning)
        warnings.simplefilter("ignore", MovedBodiesWarning)
        start = assemble(mechanism, gravity_m_per_s2, step_s=1.0)
    topology = Topology.of(start)
    try:
        return Survey(topology, _rest(start), "", start.moved)
    except SceneError as error:
        return Survey(
            topology, None, str(error).replace("mechanism.initial.static_equilibrium: ", ""), start.moved
        )


def _rest(start: Start) -> Rest:
    machine, model = start.machine, start.machine.model
    # held drivers would be moved by their time functions only after t = 0
    q = settle(Closure(machine), start.q)
    count, still, turns = len(model.mass), np.zeros_like(q), turns_of(q)
    unloaded = model._replace(forces=model.forces[model.forces["kind"] != POINT_LOAD])
    total = np.zeros_like(q)
    held = held_at(unloaded, 0.0, 0.0, q, still)
    evaluate_forces(unloaded, held, 0.0, 0.0, q, turns, still, total, np.zeros(3))
    scaled = np.linalg.lstsq(
        Closure(machine).jacobian(q).T, model.column_scale * total[:count], rcond=RANK_TOLERANCE
    )[0]
    multipliers = model.row_scale * scaled
    report = np.zeros((len(model.forces), 3))
    held = held_at(model, 0.0, 0.0, q, still)._replace(multipliers=multipliers)
    report_forces(model, held, 0.0, 0.0, q, turns, still, report)
    locked_forces(model, multipliers, report)
    bodies = tuple(
        BodyState(name, *(float(x) for x in q[3 * i : 3 * i + 3]), *[0.0] * 6)
        for i, name in enumerate(machine.bodies)
    )
    forces = tuple(
        ForceState(name, *(float(value) for value in values))
        for name, values, kind in zip(machine.forces, report, model.forces["kind"], strict=True)
        if kind != POINT_LOAD
    )
    joints = reactions_at(machine, q, multipliers, start.redundant)
    return Rest(bodies, joints, forces, modes_of(machine, linearise(machine, q)))
