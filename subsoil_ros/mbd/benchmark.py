"""CPU time per step of the paper's machine and of chains of rods."""

import time
from dataclasses import dataclass
from typing import Any

from ..scene.mechanism import Mechanism
from .advance import advance_tick
from .assembly import assemble
from .tables import make_state, make_workspace

ROUNDS = 5
"""Number of measurements, of which the shortest counts: other load on the computer only adds time."""


@dataclass(frozen=True)
class ChainCost:
    """A chain of `bodies` rods hung on one another."""

    bodies: int
    us_per_step: float


def us_per_step(mechanism: Mechanism, step_s: float, steps: int) -> float:
    """CPU time of one step [us], the best of ROUNDS times `steps` steps after a start."""
    return least_us_per_step((mechanism,), step_s, steps, ROUNDS)[0]


def least_us_per_step(
    mechanisms: tuple[Mechanism, ...], step_s: float, steps: int, rounds: int
) -> tuple[float, ...]:
    """The same of several machines, measured in turns, so that other load falls on all of them."""
    started = []
    for mechanism in mechanisms:
        start = assemble(mechanism, 9.81, step_s)
        model = start.machine.model
        sizes = (len(model.mass), len(model.row_scale), start.rank, len(model.forces))
        state, work = make_state(*sizes, model.weights.shape[1]), make_workspace(*sizes)
        state.q[:], state.v[:] = start.q, start.v
        advance_tick(model, state, work, 0.0, 10)
        started.append((model, state, work))
    best, done = [float("inf")] * len(started), 10
    for _ in range(rounds):
        for i, (model, state, work) in enumerate(started):
            begin = time.process_time()
            advance_tick(model, state, work, done * step_s, steps)
            best[i] = min(best[i], 1e6 * (time.process_time() - begin) / steps)
        done += steps
    return tuple(best)


@dataclass(frozen=True)
class MachineCost:
    """CPU time of a step of the seven bodies [us]: 21 coordinates, 17 constraints, steps of 0.5 ms."""

    us_per_step: float
    fixed_us_per_step: float  # tolerance: null, without the estimate of errors


def machine_cost() -> MachineCost:
    """Measure steps with the estimate of their error and without it, in turns."""
    machines = [{**SEVEN_BODIES, **more} for more in ({}, {"tolerance": None})]
    mechanisms = tuple(Mechanism.model_validate(machine) for machine in machines)
    return MachineCost(*least_us_per_step(mechanisms, 5e-4, 2000, 4 * ROUNDS))


def chain_costs(largest: int) -> tuple[ChainCost, ...]:
    """CPU time of a step of chains of 1, 2, 5, 10, ... rods, up to `largest`."""
    counts = [count for count in (1, 2, 5, 10, 20, 50, 100, 200) if count <= largest]
    return tuple(
        ChainCost(count, us_per_step(Mechanism.model_validate(chain(count)), 1e-4, max(3, 2000 // count**2)))
        for count in counts
    )


def chain(count: int) -> dict[str, Any]:
    """`count` rods of 0.1 m hung on one another, lying level."""
    rod = {"mass_kg": 0.1, "inertia_kg_m2": 1e-4}
    names = ["ground", *(f"rod{i}" for i in range(count))]
    return {
        "bodies": {names[i + 1]: {**rod, "position_m": (0.1 * i + 0.05, 0.0)} for i in range(count)},
        "joints": {f"pin{i}": _pin(names[i], names[i + 1], 0.1 * i, 0.0) for i in range(count)},
    }


def _pin(body_a: str, body_b: str, x: float, z: float) -> dict[str, Any]:
    return {"kind": "revolute", "body_a": body_a, "body_b": body_b, "point_m": (x, z)}


def _body(mass: float, inertia: float, x: float, z: float) -> dict[str, Any]:
    return {"mass_kg": mass, "inertia_kg_m2": inertia, "position_m": (x, z)}


def _wheel(body: str) -> dict[str, Any]:
    return {
        "kind": "wheel_contact",
        "body": body,
        "radius_m": 0.2,
        "stiffness_newton_per_m": 60_000.0,
        "damping_newton_s_per_m": 1500.0,
        "friction": 0.4,
    }


SEVEN_BODIES: dict[str, Any] = {
    "bodies": {
        "shank": _body(35.2, 2.662, 0.02, 0.15),
        "wheel_left": {**_body(25.0, 0.5585, 0.55, 0.20), "angular_velocity_rad_per_s": -2.5},
        "wheel_right": {**_body(25.0, 0.5585, 0.55, 0.20), "angular_velocity_rad_per_s": -2.5},
        "lower_link": _body(7.8, 0.3104, 1.145, 0.425),
        "trolley": _body(100.0, 8e4, 1.60, 0.68),
        "upper_link": _body(10.0, 0.1896, 1.0872, 0.885),
        "frame": _body(68.0, 7.022, 0.35, 0.52),
    },
    "joints": {
        "H1": {
            "kind": "prismatic",
            "body_a": "ground",
            "body_b": "trolley",
            "point_m": (1.60, 0.68),
            "axis": (1.0, 0.0),
        },
        "H2": _pin("trolley", "lower_link", 1.49, 0.45),
        "H3": _pin("trolley", "upper_link", 1.3244, 0.91),
        "H4": _pin("lower_link", "frame", 0.80, 0.40),
        "H5": _pin("upper_link", "frame", 0.85, 0.86),
        "H6": _pin("frame", "wheel_right", 0.55, 0.20),
        "H7": _pin("frame", "wheel_left", 0.55, 0.20),
        "H8": _pin("frame", "shank", 0.0, 0.40),
        "H10": {
            "kind": "driver",
            "body": "trolley",
            "coordinate": "x",
            "speed": {"kind": "constant", "value": 0.5},
        },
    },
    "forces": {
        "H9": {
            "kind": "spring_damper",
            "body_a": "frame",
            "point_a_m": (0.40, 0.65),
            "body_b": "shank",
            "point_b_m": (0.0, 0.65),
            "stiffness_newton_per_m": 176_500.0,
            "damping_newton_s_per_m": 1000.0,
            "free_length_m": 0.38735,
        },
        "left": _wheel("wheel_left"),
        "right": _wheel("wheel_right"),
    },
    "draft_driver": "H10",
    "initial": {"static_equilibrium": True},
}
"""The seven bodies of the 1S-300 on wheel contacts, at rest, pulled at 0.5 m/s, the wheels rolling."""
