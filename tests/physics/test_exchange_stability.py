"""How long soil and mechanism may go without exchange: closed form, exact map, and the engines themselves."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.dem.build import build_engine
from subsoil_ros.limits.communication_steps import (
    DAMPER_SHARE,
    PREDICTED_SHARE,
    force_age_ticks,
    predicted_limits,
)
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.messages import ToolWrenches
from tests.physics.tick_map import Exchange
from tests.soils import NEGLIGIBLE


def crossing(case: Exchange, low: float, high: float) -> float:
    """The first soil damper above `low` at which the map turns stable, or unstable."""

    def stable(damping: float) -> bool:
        return replace(case, damping=damping).radius() < 1.0

    at_low = stable(low)
    dampings = iter(np.geomspace(low, high, 40)[1:].tolist())
    inside, outside = low, next(dampings)
    while stable(outside) == at_low:
        inside, outside = outside, next(dampings)
    for _ in range(24):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if stable(middle) == at_low else (inside, middle)
    return 0.5 * (inside + outside)


def lowest_damping(case: Exchange) -> float:
    """Below it the held force outweighs the damper."""
    unit = case.stiffness * case.interval
    return crossing(case, 0.002 * unit, 10.0 * unit)


def highest_damping(case: Exchange) -> float:
    """Above it the damper's held force overturns the motion."""
    unit = case.mass / case.interval
    return crossing(case, 0.5 * unit, 50.0 * unit)


@pytest.mark.parametrize("interval", [1e-4, 4e-3])
@pytest.mark.parametrize(("force", "soil_steps"), [("tick_end", 1), ("tick_end", 5), ("tick_mean", 4)])
def test_the_lowest_damper_is_stiffness_times_age(force, soil_steps, interval):
    """k H / 2, mean up to k H / 2 more; within the order of k H^2 / m that is left out."""
    ratio = 1e-3
    case = Exchange(interval, 1e4, 0.0, 1e4 * interval**2 / ratio, 0, 0, force, soil_steps)
    age = force_age_ticks(force, soil_steps)
    assert_allclose(lowest_damping(case), age * case.stiffness * interval, rtol=5.0 * ratio)
    if force == "tick_mean":
        assert_allclose(force_age_ticks(force, 100_000), 1.0, rtol=1e-5)


@pytest.mark.parametrize("ratio", [1e-3, 0.1, 0.7])
def test_limits_of_the_end_force_are_exact(ratio):
    """k H / 2 <= c <= 2 m / H whatever k H^2 / m: determinant and trace of the map say so in closed form."""
    case = Exchange(2e-3, ratio * 3.0 / 4e-6, 0.0, 3.0)
    assert_allclose(lowest_damping(case), 0.5 * case.stiffness * case.interval, rtol=1e-7)
    assert_allclose(highest_damping(case), 2.0 * case.mass / case.interval, rtol=1e-7)


def test_the_highest_damper_in_closed_form():
    """Without a spring: 2 m/H; of the mean of n steps min(2 n, 2 n/(n-1)) m/H, never below 2."""
    weak = {"interval": 1e-3, "stiffness": 1e-3, "damping": 0.0, "mass": 1.0}
    unit = 1.0 / 1e-3
    for steps in (2, 3, 8, 60):
        mean = Exchange(**weak, force="tick_mean", soil_steps=steps)
        assert_allclose(highest_damping(mean), unit * min(2.0 * steps, 2.0 * steps / (steps - 1)), rtol=1e-5)
        assert highest_damping(mean) > unit * DAMPER_SHARE


@pytest.mark.parametrize("soil_steps", [1, 2, 5, 1000])
@pytest.mark.parametrize("ratio", [0.01, 0.1, 0.3, 0.7, 1.0])
def test_limits_of_a_predicted_motion(ratio, soil_steps):
    """Dampers from k^2 H^3 / (3 m) to 0.8 m / H are stable; the limits on H say it the other way round."""
    case = Exchange(2e-3, ratio * 3.0 / 4e-6, 0.0, 3.0, force="predicted", soil_steps=soil_steps)
    unit = case.mass / case.interval
    for damping in np.geomspace(ratio**2 / 3.0, PREDICTED_SHARE, 20) * unit:
        assert replace(case, damping=damping).radius() < 1.0
        soil = (case.stiffness, damping, damping / case.stiffness)
        found = predicted_limits(case.mass, *soil, soil_steps)
        assert min(found) >= case.interval * (1.0 - 1e-9)
    if soil_steps == 1:  # exact, and without a lower one
        highest = (2.0 - ratio) * unit
        assert_allclose(crossing(case, 0.1 * unit, 50.0 * unit), highest, rtol=1e-7)
        soil = (case.stiffness, highest, highest / case.stiffness)
        assert_allclose(predicted_limits(case.mass, *soil, 1), (np.inf, case.interval))
    if soil_steps == 1000 and ratio <= 0.1:  # of n steps the lower one is less by k H / (2 n)
        lowest = (ratio**2 / 3.0 - 0.5 * ratio / soil_steps) * unit
        assert_allclose(lowest_damping(case), lowest, rtol=0.02)


METHODS = [
    ("adams_moulton", 2, 1),
    ("adams_moulton", 4, 1),
    ("adams_moulton", 4, 3),
    ("runge_kutta_4", 4, 2),
    ("generalized_alpha", 4, 1),
]


def test_the_integrator_does_not_move_the_limits_of_a_bare_mass():
    """Under a held force alone all integrators are exact, so all have the same limits."""
    base = Exchange(2e-3, 2e4, 0.0, 1.0)
    expected = lowest_damping(base)
    for integrator, order, steps in METHODS:
        case = replace(base, integrator=integrator, order=order, mechanism_steps=steps)
        assert_allclose(lowest_damping(case), expected, rtol=1e-7)


STIFFNESS, MASS, RADIUS, PRESSED, AMPLITUDE = 1e4, 1.0, 0.05, 1e-3, 2e-5
PLACE = -0.25 + RADIUS + 0.03125 - PRESSED
"""z of a block that lies pressed on a sphere [m]."""


def scene_of(soil, case: Exchange, ticks: int):
    """A block of 1 kg on a rail, pressed on one sphere so heavy that it stays where it is."""
    row = {
        "stiffness_newton_per_m": case.stiffness, "damping_newton_s_per_m": case.damping,
        "tangential_stiffness_newton_per_m": NEGLIGIBLE, "tangential_damping_newton_s_per_m": 0.0,
        "static_friction": 0.0, "sliding_friction": 0.0, "rolling_friction": NEGLIGIBLE,
    }  # fmt: skip
    rest = {"kind": "constant", "value": PLACE}
    own = {
        "kind": "coordinate_spring", "body": "block", "coordinate": "z", "target": rest,
        "stiffness_newton_per_m": case.own_stiffness, "damping_newton_s_per_m": case.own_damping,
    }  # fmt: skip
    load = {"kind": "constant", "value": -case.stiffness * PRESSED}
    point = [0.25, PLACE + AMPLITUDE]
    mechanism = {
        "bodies": {"block": {"mass_kg": case.mass, "inertia_kg_m2": 1.0, "position_m": point}},
        "joints": {
            "rail": {
                "kind": "prismatic", "body_a": "ground", "body_b": "block", "point_m": point, "axis": [0, 1],
            }
        },
        "forces": {
            "own": own,
            "load": {"kind": "point_load", "body": "block", "point_m": point, "force_z_newton": load},
        },
        "tolerance": None, "integrator": case.integrator, "integrator_order": case.order,
    }  # fmt: skip
    communication_step_ns = round(case.interval * 1e9)
    mesh = {"mesh": soil.box(0.125, 0.125, 0.0625), "position_m": [0.25, 0.0, PLACE + AMPLITUDE]}
    document = {
        "name": "block", "duration_s": ticks * case.interval, "gravity_m_per_s2": 0.0,
        "soil": {
            "bin": {"length_m": 0.5, "width_m": 0.5, "depth_m": 0.5},
            "particles": {"radius_m": RADIUS, "density_kg_per_m3": 1e20},
            "bed": {"kind": "grid", "spacing_m": 0.1},
            "law": {"kind": "linear", "particle": row, "boundary": row},
            "time_step_s": communication_step_ns * 1e-9 / case.soil_steps, "monitors": None,
        },
        "mechanism": mechanism,
        "tools": {"block": {"body": "block", "groups": {"all": mesh}}},
        "coupling": {
            "communication_step_ns": communication_step_ns, "mechanism_steps": case.mechanism_steps,
            "force": case.force, "residual_bound": 1e9,
        },
    }  # fmt: skip
    return soil.resolve(document)


class Pressed:
    """The soil engine with one sphere, on which the tool is laid before the run."""

    def __init__(self, resolved) -> None:
        self._engine = build_engine(resolved)
        self._engine.place([(0.25, 0.0, -0.25)])

    def start(self, motions):
        """A tool that presses at the start would remove the sphere: it comes from above, then stands."""
        (motion,) = motions
        self._engine.start((replace(motion, z_m=motion.z_m + 2.0 * PRESSED),))
        self._engine.advance(0, motions)
        return self._engine.advance(1, motions)

    def __getattr__(self, name):
        return getattr(self._engine, name)


class Watched:
    """The mechanism engine; keeps (ticks, state of the map without the soil's answer)."""

    def __init__(self, resolved) -> None:
        self._engine = MechanismEngine(resolved.scene, resolved.timing)
        self.states: list[np.ndarray] = []

    def advance(self, tick, wrenches):
        motions = self._engine.advance(tick, wrenches)
        arrays = self._engine.arrays
        self.states.append(np.array([arrays.q[1] - PLACE, arrays.v[1], arrays.a[1], *arrays.past_a[:, 1]]))
        return motions

    def __getattr__(self, name):
        return getattr(self._engine, name)


class Forces(list):
    """Takes the records of a run, keeps the forces."""

    def write(self, record) -> None:
        if isinstance(record, ToolWrenches) and record.tick >= 0:
            self.append(record.tools[0].force_z_newton)


def run_engines(soil, case: Exchange, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Place and speed of the block (ticks, 2) as the engines and as the map give them, from tick 5 on."""
    resolved = scene_of(soil, case, ticks)
    block, forces = Watched(resolved), Forces()
    simulate(RunSettings(resolved), motion_source=block, soil=Pressed(resolved), sink=forces)
    first = 5  # Adams-Moulton has its history
    held = forces[first] - case.stiffness * PRESSED
    state = np.array([*block.states[first][: 3 + case.past_count], held])
    expected, matrix = [], case.matrix()
    for _ in range(first, ticks):
        expected.append(state[:2])
        state = matrix @ state
    return np.array(block.states)[first:, :2], np.array(expected)


CASES = [
    Exchange(1.5e-3, STIFFNESS, 0.0, MASS),
    Exchange(7e-3, STIFFNESS, 0.0, MASS),
    Exchange(3e-3, STIFFNESS, 0.0, MASS, force="tick_mean", soil_steps=4, mechanism_steps=3),
    Exchange(7e-3, STIFFNESS, 0.0, MASS, force="tick_end", soil_steps=4, integrator="generalized_alpha"),
    Exchange(5e-3, STIFFNESS, 0.0, MASS, 5e3, 3.0, integrator="adams_moulton", order=2),
    Exchange(5e-3, STIFFNESS, 0.0, MASS, 5e3, 3.0, integrator="adams_moulton", order=3, mechanism_steps=2),
    Exchange(
        5e-3, STIFFNESS, 0.0, MASS, 5e3, 3.0, integrator="adams_moulton", force="tick_mean", soil_steps=3
    ),
    Exchange(3.5e-3, STIFFNESS, 0.0, MASS, 5e3, 3.0, "tick_mean", 2, 2, "generalized_alpha"),
    Exchange(2e-3, STIFFNESS, 0.0, MASS, 5e3, 3.0, "tick_mean", 3, 1, "runge_kutta_4"),
    Exchange(7e-3, STIFFNESS, 0.0, MASS, force="predicted", soil_steps=20),
    Exchange(8e-3, STIFFNESS, 0.0, MASS, 2e3, 0.0, "predicted", 20, 2, "generalized_alpha"),
]
UPPER = [
    Exchange(2e-3, STIFFNESS, 0.0, MASS),
    Exchange(5e-3, STIFFNESS, 0.0, MASS, force="tick_mean", soil_steps=3),
]


@pytest.mark.full
@pytest.mark.parametrize("side", [0.8, 1.2])
@pytest.mark.parametrize(
    ("case", "limit"),
    [(case, lowest_damping) for case in CASES] + [(case, highest_damping) for case in UPPER],
)
def test_the_engines_follow_the_map_and_its_limit(soil, case, limit, side):
    """Engines and direct run go tick by tick as the map; they are stable on its stable side only."""
    case = replace(case, damping=side * limit(case))
    rate = math.log(case.radius())
    ticks = min(4000, 20 + math.ceil(2.0 / abs(rate)))
    found, expected = run_engines(soil, case, ticks)
    # places of 0.2 m are known to 3e-17 m, forces to 1e-15 of 10 N; motions are above 1e-6 m and 1e-4 m/s
    largest = np.abs(expected).max(axis=0)
    assert_allclose(found / largest, expected / largest, rtol=0.0, atol=1e-6)
    period = len(found) // 8
    early, late = (np.abs(part[:, 0]).max() for part in (found[:period], found[-period:]))
    assert (late < early) == (rate < 0.0) == ((side > 1.0) == (limit is lowest_damping))
