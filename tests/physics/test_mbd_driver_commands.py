"""A driver under a controller's commands: the motion they ask for, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.coupling.control import SpeedController
from subsoil_ros.errors import PhysicsError, ProtocolError, RunError
from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.messages import DriverCommand, MechanismState
from subsoil_ros.scene.controller import Controller
from subsoil_ros.scene.scene import Scene

INTERVAL_NS, EVERY, MASS = 1_000_000, 10, 40.0
KEYS = {
    "driver": "drive", "interval_ticks": EVERY, "lowest_speed": -1.0, "highest_speed": 1.0,
    "max_acceleration": 20.0, "law": {"kind": "external"},
}  # fmt: skip


def engine_of(speed: dict, controller: dict | None) -> MechanismEngine:
    """A trolley on a rail, driven, that tows a bob on a spring."""
    mechanism = {
        "bodies": {
            "trolley": {"mass_kg": MASS, "inertia_kg_m2": 1.0, "position_m": (0.0, 0.0)},
            "bob": {"mass_kg": 3.0, "inertia_kg_m2": 0.1, "position_m": (-0.5, -0.4)},
        },
        "joints": {
            "rail": {
                "kind": "prismatic", "body_a": "ground", "body_b": "trolley", "point_m": (0, 0),
                "axis": (1, 0),
            },
            "hinge": {"kind": "revolute", "body_a": "trolley", "body_b": "bob", "point_m": (-0.5, 0.0)},
            "drive": {"kind": "driver", "body": "trolley", "coordinate": "x", "speed": speed},
        },
        "draft_driver": "drive",
    }  # fmt: skip
    document = {"name": "trolley", "duration_s": 1.0, "mechanism": mechanism, "record": {"series_ticks": 5}}
    scene = Scene.model_validate(document | ({"controller": controller} if controller else {}))
    return MechanismEngine(scene, Timing(INTERVAL_NS, 1000, 0, 1))


def states(engine: MechanismEngine, ticks: int, speeds: dict[int, float]) -> list[MechanismState]:
    """The state after every tick, commands being given at the ticks named."""
    found = []
    for tick in range(ticks):
        if tick in speeds:
            engine.command(DriverCommand("run", tick, "drive", speeds[tick]))
        engine.advance(tick, ())
        found.append(engine.state("run", tick, (tick + 1) * INTERVAL_NS))
    return found


def test_commands_are_ramps_from_one_to_the_next() -> None:
    """Speed is linear between commands and continuous; the whole machine moves as under a table of speeds."""
    targets = np.array([0.0, 0.0, 0.15, 0.35, 0.3, 0.3, -0.1])
    times = EVERY * INTERVAL_NS * 1e-9 * np.arange(len(targets))
    table = {"kind": "table", "times_s": times.tolist(), "values": targets.tolist()}
    expected = states(engine_of(table, None), 60, {})
    commanded = engine_of({"kind": "constant", "value": 0.0}, KEYS | {"max_acceleration": 50.0})
    speeds = {EVERY * i: float(targets[i + 1]) for i in range(1, 6)}
    found = states(commanded, 60, speeds)
    for a, b in zip(found, expected, strict=True):
        for body, other in zip(a.bodies, b.bodies, strict=True):
            assert_allclose(body.x_m, other.x_m, atol=1e-13)
            assert_allclose(body.velocity_x_m_per_s, other.velocity_x_m_per_s, atol=1e-12)
            assert_allclose(body.angle_rad, other.angle_rad, atol=1e-12)
    ends = [found[EVERY * (i + 1) - 1].bodies[0].velocity_x_m_per_s for i in range(6)]
    assert_allclose(ends, targets[1:], atol=1e-13)
    way = np.sum(0.5 * (targets[1:] + targets[:-1])) * EVERY * INTERVAL_NS * 1e-9
    assert_allclose(found[-1].bodies[0].x_m, way, atol=1e-13)


def test_the_draft_of_a_ramp_is_mass_times_acceleration() -> None:
    """The work of the driver is the kinetic energy it gives (the bob hangs at rest and is light)."""
    engine = engine_of({"kind": "constant", "value": 0.0}, KEYS)
    last = states(engine, 20, {EVERY: 0.2})[-1]
    whole = last.kinetic_energy_joule + last.gravity_energy_joule
    start = engine_of({"kind": "constant", "value": 0.0}, KEYS).state("run", -1, 0)
    # Adams-Moulton of order 4 over ten steps of a smooth motion: far below 1e-6 of the energy
    assert_allclose(last.driver_work_joule, whole - start.gravity_energy_joule, rtol=1e-6)
    assert last.draft_newton > MASS * 20.0  # 0.2 m/s in 10 ms, and the bob's part


@pytest.mark.parametrize(
    ("command", "kind", "words"),
    [
        (
            DriverCommand("run", 0, "drive", math.nan),
            PhysicsError,
            "tick 0: driver_command: speed nan",
        ),
        (DriverCommand("run", 0, "drive", 0.3), PhysicsError, "0.3 .* is a jump: from 0 within 0.01 s .* 20"),
        (DriverCommand("run", 0, "drive", 1.5), PhysicsError, "1.5 .* outside of the controller's limits"),
        (DriverCommand("run", 0, "hinge", 0.1), ProtocolError, "driver 'hinge'; commanded is 'drive'"),
        (DriverCommand("run", 7, "drive", 0.1), ProtocolError, "tick 7 came where tick 0 is due"),
    ],
    ids=lambda value: "",
)
def test_a_bad_command_is_refused_by_name(command: DriverCommand, kind: type[RunError], words: str) -> None:
    """Not a number, a jump, beyond the limits, another driver, another tick."""
    engine = engine_of({"kind": "constant", "value": 0.0}, KEYS)
    with pytest.raises(kind, match=words):
        engine.command(command)


def test_a_scene_without_controller_takes_no_command() -> None:
    """A machine takes no commands unless its scene allows them."""
    with pytest.raises(ProtocolError, match="no controller"):
        engine_of({"kind": "constant", "value": 0.0}, None).command(DriverCommand("run", 0, "drive", 0.0))


def command_of(law: dict, speed: float, draft: float = 0.0) -> float:
    """What a controller at `speed` asks for."""
    keys = Controller.model_validate(KEYS | {"law": law})
    engine = engine_of({"kind": "constant", "value": 0.0}, None)
    state = replace(engine.state("run", 9, 10 * INTERVAL_NS), draft_newton=draft)
    return SpeedController(keys, speed, 0.01).command(10, state).speed


def test_the_draft_limit_slows_and_speeds_up() -> None:
    """acceleration = gain (limit - draft), but no more than the largest, and within the speeds."""
    law = {"kind": "draft_limit", "draft_limit_newton": 600.0, "gain_per_kg": 0.01}
    assert_allclose(command_of(law, 0.5, draft=700.0), 0.5 - 0.01 * 100.0 * 0.01)
    assert_allclose(command_of(law, 0.5, draft=500.0), 0.5 + 0.01 * 100.0 * 0.01)
    assert_allclose(command_of(law, 0.5, draft=1e5), 0.5 - 20.0 * 0.01)
    assert command_of(law, 0.99, draft=-1e5) == 1.0
