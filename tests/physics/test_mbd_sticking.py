"""Coulomb friction that sticks: no creep, against closed forms."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from subsoil_ros.mbd.machine_arrays import EVENT_COUNT
from subsoil_ros.scene.mechanism import Mechanism
from tests.physics.small_machines import INERTIA, MASS, advance, body, book

STIFFNESS = 2e6
DAMPING = 2.0 * math.sqrt(STIFFNESS * MASS)  # critical
STICKS = {"stick_stiffness_newton_per_m": STIFFNESS, "stick_damping_newton_s_per_m": DAMPING}
MU, GRAVITY = 0.5, 9.81


def _incline(angle_deg, **friction):
    angle = math.radians(angle_deg)
    rail = {"kind": "prismatic", "body_a": "ground", "body_b": "block", "point_m": (0.0, 0.0),
            "axis": (-math.cos(angle), -math.sin(angle)),
            "friction": {"coefficient": MU, **friction}}  # fmt: skip
    return {"bodies": {"block": body()}, "joints": {"rail": rail}}


def _way(state):
    return math.hypot(state.bodies[0].x_m, state.bodies[0].z_m)


def test_a_block_below_the_friction_angle_stays(mechanism_engine):
    """22 of 26.6 degrees: it moves by m g sin / k, and no more in ten seconds, where tanh creeps by 0.1 m.

    Let go at rest, the critically damped stick spring pulls with 1 + exp(-2) of the weight at most.
    """
    weight = MASS * GRAVITY * math.sin(math.radians(22.0))
    engine = advance(mechanism_engine(_incline(22.0, **STICKS), 500_000), 2000)
    for tick in range(2000, 20_000, 2000):
        for k in range(tick, tick + 2000):
            engine.advance(k, ())
        state = engine.state("run", tick + 1999, 0)
        assert _way(state) == pytest.approx(weight / STIFFNESS, rel=1e-9)
        assert abs(state.bodies[0].velocity_x_m_per_s) < 1e-12
    assert engine.arrays.counters[EVENT_COUNT] == 0
    creeping = advance(mechanism_engine(_incline(22.0), 500_000), 20_000).state("run", 19_999, 0)
    assert _way(creeping) > 0.1


def test_a_block_above_the_friction_angle_slides(mechanism_engine):
    """28 degrees: g (sin - mu cos), from where the stick spring has reached the limit."""
    angle = math.radians(28.0)
    push, limit = MASS * GRAVITY * math.sin(angle), MU * MASS * GRAVITY * math.cos(angle)
    engine = mechanism_engine(_incline(28.0, **STICKS), 500_000)
    start = book(engine.state("run", -1, 0))
    state = advance(engine, 2000).state("run", 1999, 0)
    pull = (push - limit) / MASS

    def stuck(_, y):
        return y[1], (push - STIFFNESS * y[0] - DAMPING * y[1]) / MASS

    def breaks(_, y):
        return STIFFNESS * y[0] + DAMPING * y[1] - limit

    breaks.terminal = True
    before = solve_ivp(stuck, (0.0, 1.0), (0.0, 0.0), "DOP853", events=breaks, rtol=1e-11, atol=1e-16)
    at, (place, speed) = before.t[-1], before.y[:, -1]
    left = 1.0 - at
    assert _way(state) == pytest.approx(place + speed * left + 0.5 * pull * left**2, rel=1e-6)
    down = math.hypot(state.bodies[0].velocity_x_m_per_s, state.bodies[0].velocity_z_m_per_s)
    assert down == pytest.approx(speed + pull * left, rel=1e-6)
    assert state.forces[0].load == pytest.approx(-limit, rel=1e-12)
    assert engine.arrays.counters[EVENT_COUNT] == 1
    assert book(state) == pytest.approx(start, abs=1e-7)


def test_a_pressed_rail_does_not_creep(mechanism_engine):
    """A block at 3 m/s under 5 kN stops after m v^2 / (2 mu N), to mu N / k, and stays under 10 N."""
    press = {"kind": "point_load", "body": "block", "point_m": (0.0, 0.0),
             "force_z_newton": {"kind": "constant", "value": -5000.0},
             "force_x_newton": {"kind": "constant", "value": 10.0}}  # fmt: skip
    machine = _incline(0.0, **STICKS)
    machine["joints"]["rail"]["axis"] = (1.0, 0.0)
    machine["bodies"]["block"]["velocity_m_per_s"] = (3.0, 0.0)
    engine = mechanism_engine({**machine, "forces": {"press": press}}, 500_000)
    start = book(engine.state("run", -1, 0))
    advance(engine, 400)
    stood = engine.state("run", 399, 0)
    limit = MU * (5000.0 + MASS * GRAVITY)
    assert stood.bodies[0].x_m == pytest.approx(0.5 * MASS * 9.0 / (limit - 10.0), abs=limit / STIFFNESS)
    for tick in range(400, 4400):
        engine.advance(tick, ())
    state = engine.state("run", 4399, 0)
    assert state.bodies[0].x_m == pytest.approx(stood.bodies[0].x_m, abs=1e-12)
    assert abs(state.bodies[0].velocity_x_m_per_s) < 1e-12
    assert state.forces[0].load == pytest.approx(-10.0, rel=1e-6)
    assert book(state) == pytest.approx(start, abs=1e-7)


def _wheel(pull, **more):
    tread = {"kind": "wheel_contact", "body": "wheel", "radius_m": 0.2, "stiffness_newton_per_m": 2e4,
             "damping_newton_s_per_m": 200.0, "friction": MU, **more}  # fmt: skip
    load = {"kind": "point_load", "body": "wheel", "point_m": (0.0, 0.2),
            "force_x_newton": {"kind": "constant", "value": pull}}  # fmt: skip
    return {"bodies": {"wheel": body(0.0, 0.2)}, "forces": {"tread": tread, "pull": load},
            "initial": {"static_equilibrium": True}}  # fmt: skip


def test_a_pulled_wheel_rolls_or_skids(mechanism_engine):
    """F / (m + I / R^2) while F I / (I + m R^2) is below mu m g, (F - mu m g) / m above."""
    turning = INERTIA / 0.2**2
    share = turning / (MASS + turning)
    hold = MU * MASS * GRAVITY / share
    damping = 2.0 * math.sqrt(STIFFNESS / (1.0 / MASS + 0.2**2 / INERTIA))
    sticks = {**STICKS, "stick_damping_newton_s_per_m": damping}
    for pull, pace in ((0.8 * hold, 0.8 * hold / (MASS + turning)),
                       (2.0 * hold, (2.0 * hold - MU * MASS * GRAVITY) / MASS)):  # fmt: skip
        engine = mechanism_engine(_wheel(pull, **sticks), 500_000)
        start = book(engine.state("run", -1, 0))
        state = advance(engine, 1000).state("run", 999, 0)
        wheel = state.bodies[0]
        assert wheel.acceleration_x_m_per_s2 == pytest.approx(pace, rel=1e-9)
        assert wheel.x_m == pytest.approx(0.5 * pace * 0.25, rel=1e-3)
        if pull < hold:  # x + R phi: no creep
            assert wheel.x_m + 0.2 * wheel.angle_rad == pytest.approx(pull * share / STIFFNESS, rel=1e-6)
        assert book(state) == pytest.approx(start, abs=1e-7)


def test_a_block_dragged_by_a_spring_sticks_and_slips(mechanism_engine):
    """It waits until the spring reaches mu N, then follows the end of it that is pulled, by a sine."""
    machine = _incline(0.0, **STICKS)
    machine["joints"]["rail"]["axis"] = (1.0, 0.0)
    machine["forces"] = {
        "pull": {
            "kind": "coordinate_spring",
            "body": "block",
            "coordinate": "x",
            "stiffness_newton_per_m": 200.0,
            "target": {"kind": "ramp", "start_value": 0.0, "end_value": 1.0, "end_s": 10.0},
        }
    }
    engine = mechanism_engine(machine, 1_000_000)
    start, limit = book(engine.state("run", -1, 0)), MU * MASS * GRAVITY
    wave, begin = math.sqrt(200.0 / MASS), limit / 200.0 / 0.1
    places = []
    for tick in range(1500):
        engine.advance(tick, ())
        places.append(engine.state("run", tick, 0).bodies[0].x_m)
    times = 1e-3 * np.arange(1, 1501)
    left = np.maximum(times - begin, 0.0)
    # pulled at 0.1 m/s from rest: x = 0.1 t - 0.1 sin(w t) / w, which comes to rest after a turn
    exact = 0.1 * left - 0.1 / wave * np.sin(wave * left)
    assert_allclose(places, exact, atol=3.0 * limit / STIFFNESS)
    assert book(engine.state("run", 1499, 1_500_000_000)) == pytest.approx(start, abs=1e-7)


def test_a_wheel_that_lands_sticking_leaves_again(mechanism_engine):
    """Hopping wheels of a limit that falls to nothing at every leap: energy is kept or lost, never made."""
    machine = _wheel(30.0, stick_stiffness_newton_per_m=2e5, stick_damping_newton_s_per_m=50.0,
                     damping_newton_s_per_m=10.0)  # fmt: skip
    machine["bodies"]["wheel"] = body(0.0, 0.30, velocity_m_per_s=(1.0, 0.0))
    machine["initial"] = {}
    engine = mechanism_engine(machine, 500_000)
    start = book(engine.state("run", -1, 0))
    for tick in range(4000):
        engine.advance(tick, ())
        assert book(engine.state("run", tick, 0)) == pytest.approx(start, abs=1e-3)
    assert engine.arrays.counters[EVENT_COUNT] > 6


SOFT = 2000.0
"""Stick stiffness [N/m] of a block that swings on it."""


def _thrown(mechanism_engine, speed, press):
    """A block thrown along a rail that `press` [N] presses it on: no weight, a soft stick without damping."""
    machine = _incline(0.0, stick_stiffness_newton_per_m=SOFT)
    machine["bodies"]["block"]["velocity_m_per_s"] = (speed, 0.0)
    machine["forces"] = {
        "press": {"kind": "point_load", "body": "block", "point_m": (0.0, 0.0), "force_z_newton": press}
    }
    return mechanism_engine(machine, 100_000, gravity_m_per_s2=0.0)


def test_a_block_that_comes_to_rest_is_held_by_what_it_slid_with(mechanism_engine):
    """It sticks up to mu N, slides, stops, and swings on about the anchor, mu N / k behind."""
    limit, speed, wave = 20.0, 0.5, math.sqrt(SOFT / MASS)
    engine = _thrown(mechanism_engine, speed, {"kind": "constant", "value": -limit / MU})
    start, strain = book(engine.state("run", -1, 0)), limit / SOFT
    sliding = math.sqrt(speed**2 - (wave * strain) ** 2)
    slid, stops = 0.5 * MASS * sliding**2 / limit, math.asin(wave * strain / speed) / wave
    stops += MASS * sliding / limit
    ticks = int(1e4 * (stops + math.pi / wave))
    state = advance(engine, ticks).state("run", ticks - 1, 0)
    assert state.bodies[0].x_m == pytest.approx(
        slid + strain * math.cos(wave * (1e-4 * ticks - stops)), abs=1e-7
    )
    assert engine.arrays.counters[EVENT_COUNT] == 2
    assert book(state) == pytest.approx(start, abs=1e-7)


@pytest.mark.parametrize("speed", [0.5, -0.5])
def test_a_limit_that_falls_below_what_the_spring_holds(mechanism_engine, speed):
    """The press is let go while the block swings back: the spring pulls on at the limit, its anchor stays.

    The limit is that of the end of a step, so it gives up to a step early: 0.07 N too much for 100 us.
    """
    first, last, ends = 72.0, 4.0, 0.094
    press = {"kind": "ramp", "start_value": -first / MU, "end_value": -last / MU, "end_s": ends}
    engine = _thrown(mechanism_engine, speed, press)
    start = book(engine.state("run", -1, 0))

    def slope(time, y):
        limit = np.interp(time, (0.0, ends), (first, last))
        return y[1], -np.clip(SOFT * y[0], -limit, limit) / MASS

    exact = solve_ivp(
        slope, (0.0, 0.15), (0.0, speed), "DOP853", rtol=1e-10, atol=1e-12, max_step=1e-4, dense_output=True
    )
    assert abs(exact.y[0]).max() * SOFT < 0.9 * first
    for tick in range(1500):
        engine.advance(tick, ())
        state = engine.state("run", tick, 0)
        place, pace = exact.sol(1e-4 * (tick + 1))
        assert state.bodies[0].x_m == pytest.approx(place, abs=1e-6)
        assert state.bodies[0].velocity_x_m_per_s == pytest.approx(pace, abs=1e-5)
    assert engine.arrays.counters[EVENT_COUNT] == 3  # it gives, holds again, and slides the other way
    assert book(state) == pytest.approx(start, abs=1e-6)


def test_damping_alone_is_refused():
    """Sticking needs its stiffness."""
    machine = _incline(0.0, stick_damping_newton_s_per_m=1.0)
    with pytest.raises(ValidationError, match="needs a stick_stiffness_newton_per_m"):
        Mechanism.model_validate(machine)
