"""Steps whose error is estimated: nasty machines at coarse steps, against closed forms and small steps."""

import copy
import math

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from subsoil_ros.errors import PhysicsError
from subsoil_ros.mbd.accuracy import LARGEST_RESIDUAL
from subsoil_ros.mbd.machine_arrays import EVENT_COUNT, LARGEST, PART_COUNT, RESIDUAL
from tests.physics.small_machines import MASS, book
from validation.machines import SEVEN_BODIES

MOMENT_OF_INERTIA = 0.06
START_RAD = 1.2
UNBALANCED = "balance of energy is open"


def _energy(state):
    return state.kinetic_energy_joule + state.spring_energy_joule


def _pendulum(**more):
    centre = (0.5 * math.sin(START_RAD), -0.5 * math.cos(START_RAD))
    return {
        "bodies": {"rod": {"mass_kg": MASS, "inertia_kg_m2": MOMENT_OF_INERTIA, "angle_rad": START_RAD,
                           "position_m": centre}},
        "joints": {"pin": {"kind": "revolute", "body_a": "ground", "body_b": "rod", "point_m": (0.0, 0.0)}},
        **more,
    }  # fmt: skip


def _pendulum_angle(time):
    """From rest at START_RAD (Jacobi's elliptic functions)."""
    frequency = math.sqrt(MASS * 9.81 * 0.5 / (MOMENT_OF_INERTIA + MASS * 0.25))
    k = math.sin(0.5 * START_RAD)
    sn, _, _, _ = ellipj(ellipk(k * k) + frequency * time, k * k)
    return 2.0 * math.asin(k * sn)


@pytest.mark.parametrize("integrator", ["adams_moulton", "runge_kutta_4"])
def test_pendulum_at_half_a_second_a_step(mechanism_engine, integrator):
    """A third of its period a step, without any force element: the angle of the elliptic functions."""
    engine = mechanism_engine(_pendulum(integrator=integrator), 500_000_000)
    for tick in range(40):
        engine.advance(tick, ())
        angle = engine.state("run", tick, 0).bodies[0].angle_rad
        assert angle == pytest.approx(_pendulum_angle(0.5 * (tick + 1)), abs=2e-6 * (tick + 1))
    assert abs(engine.arrays.balance[RESIDUAL]) < 1e-6
    assert engine.arrays.counters[PART_COUNT] > 1000


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.0, 2.0])
def test_first_steps_too_long_to_close_the_joints(mechanism_engine, angle):
    """A lever of 10 g that 8.5 kN set spinning: taken in parts, whichever way the machine is turned."""

    def turned(x, z):
        return math.cos(angle) * x - math.sin(angle) * z, math.sin(angle) * x + math.cos(angle) * z

    light = {"mass_kg": 0.01, "inertia_kg_m2": 1e-5, "position_m": (0.0, 0.0)}
    joints = {
        "rail": {"kind": "prismatic", "body_a": "ground", "body_b": "slide", "point_m": (0.0, 0.0),
                 "axis": turned(1.0, 0.0)},
        "slot": {"kind": "point_on_line", "body_a": "slide", "body_b": "lever", "point_m": turned(0.0, -0.2),
                 "axis": turned(1.0, 0.0)},
    }  # fmt: skip
    spring = {"kind": "spring_damper", "body_a": "ground", "point_a_m": turned(0.0, 0.3), "body_b": "lever",
              "point_b_m": turned(0.8, 0.0), "stiffness_newton_per_m": 1e4, "free_length_m": 0.0}  # fmt: skip
    machine = {"bodies": {"slide": light, "lever": light}, "joints": joints, "forces": {"spring": spring}}
    engine = mechanism_engine(machine, 1_000_000, gravity_m_per_s2=0.0)
    for tick in range(5):
        engine.advance(tick, ())
    state = engine.state("run", 4, 0)
    assert _energy(state) == pytest.approx(0.5 * 1e4 * (0.8**2 + 0.3**2), rel=1e-4)
    assert state.position_residual_m < 1e-11


def test_finer_tolerance_is_nearer(mechanism_engine):
    """The error falls with the tolerance, about in proportion."""
    errors = []
    for tolerance in (1e-3, 1e-5, 1e-7, 1e-9):
        engine = mechanism_engine(_pendulum(tolerance=tolerance), 500_000_000)
        for tick in range(20):
            engine.advance(tick, ())
        errors.append(abs(engine.state("run", 19, 0).bodies[0].angle_rad - _pendulum_angle(10.0)))
    falls = np.array(errors[:-1]) / errors[1:]
    assert (falls > 10.0).all()
    assert errors[-1] < 1e-8


def test_fixed_steps_that_invent_energy_are_stopped(mechanism_engine):
    """The same pendulum without a tolerance: the run ends, and says by how much and what to do."""
    engine = mechanism_engine(_pendulum(tolerance=None), 500_000_000)
    with pytest.raises(PhysicsError, match=rf"at 0\.500000 s: the {UNBALANCED}.*mechanism\.tolerance"):
        engine.advance(0, ())


def test_a_force_that_no_step_follows_is_right_or_stopped(mechanism_engine):
    """1e12 N on 2 kg: the swing of a pendulum in a field of 5e11 m/s2, or the end of the run."""
    pull = {"kind": "point_load", "body": "rod", "point_m": (0.5 * math.sin(1.2), -0.5 * math.cos(1.2)),
            "force_x_newton": {"kind": "constant", "value": 1e12}}  # fmt: skip
    engine = mechanism_engine(_pendulum(forces={"pull": pull}), 500_000)
    largest = 1e12 * 0.5 * (1.0 - math.sin(START_RAD))  # at the lowest point of that field
    for tick in range(20):
        engine.advance(tick, ())
        state = engine.state("run", tick, 0)
        assert state.kinetic_energy_joule <= largest * (1.0 + LARGEST_RESIDUAL)
        assert abs(engine.arrays.balance[RESIDUAL]) < 1e-3 * largest


def test_hopping_wheels_with_stiff_friction(mechanism_engine):
    """The seven bodies dropped by 80 mm, friction 0.5 at a slip of 0.02 m/s: the draft of small steps.

    At fixed steps of 500 us the draft chatters by more than its own size.
    """
    machine = copy.deepcopy(SEVEN_BODIES)
    machine["initial"] = {"coordinates": {"frame.z_m": 0.60}}
    for name in ("left", "right"):
        machine["forces"][name]["friction"] = 0.5

    def draft(steps, **more):
        engine = mechanism_engine({**machine, **more}, 500_000, steps)
        found = []
        for tick in range(800):
            engine.advance(tick, ())
            found.append(engine.state("run", tick, 0).draft_newton)
        return np.array(found)

    exact = draft(50, tolerance=None)
    largest = np.abs(exact).max()
    assert np.abs(draft(1) - exact).max() < 2e-3 * largest
    assert np.abs(draft(1, tolerance=None) - exact).max() > 0.5 * largest


def test_rail_pressed_later_creeps_as_its_friction_says(mechanism_engine):
    """A free block is pressed on its rail by 5 kN: it creeps at slip speed times atanh(push / limit)."""
    table = {"kind": "table", "times_s": (0.0, 0.1, 0.12), "values": (0.0, 0.0, -5000.0)}
    press = {"kind": "point_load", "body": "block", "point_m": (0.0, 0.0), "force_z_newton": table,
             "force_x_newton": {"kind": "constant", "value": 10.0}}  # fmt: skip
    friction = {"coefficient": 0.5, "slip_speed_m_per_s": 1e-3}
    rail = {"kind": "prismatic", "body_a": "ground", "body_b": "block", "point_m": (0.0, 0.0),
            "axis": (1.0, 0.0), "friction": friction}  # fmt: skip
    machine = {
        "bodies": {"block": {"mass_kg": MASS, "inertia_kg_m2": 0.3, "position_m": (0.0, 0.0),
                             "velocity_m_per_s": (0.5, 0.0)}},
        "joints": {"rail": rail}, "forces": {"press": press},
    }  # fmt: skip
    engine = mechanism_engine(machine, 500_000)
    speeds = []
    for tick in range(400):
        engine.advance(tick, ())
        speeds.append(engine.state("run", tick, 0).bodies[0].velocity_x_m_per_s)
    creep = 1e-3 * math.atanh(10.0 / (0.5 * (5000.0 + MASS * 9.81)))
    assert speeds[-100:] == pytest.approx([creep] * 100, abs=1e-3 * creep)


def test_chain_let_go_faster_than_its_damper_follows(mechanism_engine):
    """What a one-way spring has stored as its push ends is dissipated, not lost from the book."""
    table = {"kind": "table", "times_s": (0.0, 0.1, 0.11), "values": (0.1, 0.1, -1.0)}
    chain = {"kind": "coordinate_spring", "body": "load", "coordinate": "z", "target": table,
             "stiffness_newton_per_m": 1e4, "damping_newton_s_per_m": 2500.0,
             "acts_in": "pull_up"}  # fmt: skip
    load = {"mass_kg": MASS, "inertia_kg_m2": 0.3, "position_m": (0.0, 0.1 - MASS * 9.81 / 1e4)}
    engine = mechanism_engine({"bodies": {"load": load}, "forces": {"chain": chain}}, 1_000_000)
    start = engine.state("run", -1, 0)
    for tick in range(200):
        engine.advance(tick, ())
    state = engine.state("run", 199, 0)
    assert state.spring_energy_joule == 0.0
    assert state.dissipated_joule == pytest.approx(0.5 * (MASS * 9.81) ** 2 / 1e4, rel=1e-9)
    assert book(state) == pytest.approx(book(start), abs=1e-9)
    fall = 0.5 * 9.81 * 0.1**2
    assert state.bodies[0].z_m == pytest.approx(load["position_m"][1] - fall, abs=1e-9)


def test_a_spring_that_stores_less_than_nothing_is_in_the_balance(mechanism_engine):
    """A constant push of 800 N stores -800 N times its length: energy turned over counts it all the same."""
    push = {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0), "body_b": "load",
            "point_b_m": (0.5, 0.0), "stiffness_newton_per_m": 0.0, "preload_newton": 800.0,
            "free_length_m": 0.0}  # fmt: skip
    load = {"mass_kg": MASS, "inertia_kg_m2": 0.3, "position_m": (0.5, 0.0)}
    machine = {"bodies": {"load": load}, "forces": {"push": push}}
    engine = mechanism_engine(machine, 1_000_000, gravity_m_per_s2=0.0)
    assert engine.state("run", -1, 0).spring_energy_joule == pytest.approx(-400.0)
    for tick in range(100):
        engine.advance(tick, ())
    assert engine.state("run", 99, 0).bodies[0].velocity_x_m_per_s == pytest.approx(0.1 * 800.0 / MASS)
    assert engine.arrays.balance[LARGEST] > 400.0
    assert abs(engine.arrays.balance[RESIDUAL]) < 1e-9


def test_a_machine_that_needs_no_parts_takes_none(mechanism_engine, subsoiler):
    """The paper's machine at rest on its wheels moves by the same bits with and without a tolerance."""
    ends = []
    for more in ({}, {"tolerance": None}):
        engine = mechanism_engine({**subsoiler, **more}, 500_000)
        for tick in range(500):
            engine.advance(tick, ())
        assert engine.arrays.counters[PART_COUNT] == 0
        ends.append(engine.arrays.q.tobytes())
    assert ends[0] == ends[1]


def test_a_state_taken_up_again_goes_on_by_the_same_bits(mechanism_engine):
    """Parts, books and balance are in the state: half a run, restored, ends as the whole one."""
    engine, other = (mechanism_engine(_pendulum(), 500_000_000) for _ in range(2))
    for tick in range(20):
        engine.advance(tick, ())
        if tick == 9:
            kept = {name: array.copy() for name, array in engine.state_arrays().items()}
    other.restore(kept)
    for tick in range(10, 20):
        other.advance(tick, ())
    for name, array in engine.state_arrays().items():
        assert array.tobytes() == other.state_arrays()[name].tobytes(), name
    assert engine.arrays.counters[EVENT_COUNT] == 0
