"""Springs, stops and friction of every kind against closed forms and energy."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.physics.small_machines import INERTIA, MASS, advance, book
from tests.physics.small_machines import body as make_body


def _slider(x, speed=0.0, rail=(), **spring):
    """A mass on a level rail, on a spring to the ground at the origin."""
    line = {
        "kind": "prismatic",
        "body_a": "ground",
        "body_b": "mass",
        "point_m": (x, 0.0),
        "axis": (1.0, 0.0),
    }
    force = {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0), "body_b": "mass",
             "point_b_m": (x, 0.0), "free_length_m": 1.0, **spring}  # fmt: skip
    return {
        "bodies": {"mass": make_body(x, velocity_m_per_s=(speed, 0.0))},
        "joints": {"rail": line | dict(rail)},
        "forces": {"spring": force} if spring else {},
    }


def _follow(engine, ticks, communication_step_ns):
    """Positions and speeds of the first body, and the largest gap of the energy book."""
    start, worst, path = book(engine.state("run", -1, 0)), 0.0, []
    for tick in range(ticks):
        engine.advance(tick, ())
        state = engine.state("run", tick, (tick + 1) * communication_step_ns)
        worst = max(worst, abs(book(state) - start))
        path.append((state.bodies[0].x_m, state.bodies[0].velocity_x_m_per_s))
    return np.array(path), worst, state


def _exact(force, x, v, end):
    """Position and speed of the slider by a tight solver; `force(x, v)` [N]."""
    run = solve_ivp(lambda _, y: (y[1], force(*y) / MASS), (0.0, end), (x, v), "DOP853", rtol=1e-11,
                    atol=1e-12, max_step=1e-3)  # fmt: skip
    return run.y[:, -1]


# --- springs ----------------------------------------------------------------------------------------


def test_preload_is_the_force_at_the_free_length(mechanism_engine):
    """At its free length a spring pushes with its preload; at the length it then rests at, with nothing."""
    spring = {"stiffness_newton_per_m": 500.0, "preload_newton": 40.0}
    state = mechanism_engine(_slider(1.0, **spring)).state("run", -1, 0)
    assert state.forces[0].load == pytest.approx(40.0, rel=1e-12)
    assert state.bodies[0].acceleration_x_m_per_s2 == pytest.approx(40.0 / MASS, rel=1e-12)
    assert mechanism_engine(_slider(1.08, **spring)).state("run", -1, 0).forces[0].load == (
        pytest.approx(0.0, abs=1e-10)
    )


def test_spring_without_stiffness_pushes_with_its_preload_alone(mechanism_engine):
    """Stiffness 0 and a preload: a constant force, and its work leaves the spring's energy."""
    machine = _slider(1.0, stiffness_newton_per_m=0.0, preload_newton=40.0)
    path, gap, _ = _follow(mechanism_engine(machine), 200, 1_000_000)
    np.testing.assert_allclose(path[-1], (1.0 + 0.5 * 20.0 * 0.04, 20.0 * 0.2), rtol=1e-12)
    assert gap < 1e-10


@pytest.mark.parametrize(("acts_in", "sign"), [("tension", -1.0), ("compression", 1.0)])
def test_one_way_spring(mechanism_engine, acts_in, sign):
    """A rope pulls and a bumper pushes; on its slack side the mass flies on without force."""
    start = 1.0 - 0.1 * sign
    machine = _slider(start, stiffness_newton_per_m=800.0, acts_in=acts_in)
    engine = mechanism_engine(machine, 500_000)
    path, gap, state = _follow(engine, 600, 500_000)
    quarter = 0.5 * math.pi / 20.0
    expected = 1.0 + sign * 0.1 * 20.0 * (0.3 - quarter)
    np.testing.assert_allclose(path[-1], (expected, sign * 2.0), rtol=1e-9)
    assert state.forces[0].load == 0.0
    assert gap < 1e-8


TABLE = {"compressions_m": (-0.2, 0.0, 0.05, 0.1), "forces_newton": (-10.0, 0.0, 40.0, 140.0)}


def _table_force(x, _):
    beyond = 2000.0 * max(0.0, 0.9 - x) - 50.0 * max(0.0, x - 1.2)
    return float(np.interp(1.0 - x, TABLE["compressions_m"], TABLE["forces_newton"])) + beyond


def test_table_is_followed_between_and_beyond_its_points(mechanism_engine):
    """A mass on a table spring goes over its kinks as a tight solver does, and keeps its energy."""
    path, gap, _ = _follow(mechanism_engine(_slider(0.86, table=TABLE), 250_000), 1600, 250_000)
    np.testing.assert_allclose(path[-1], _exact(_table_force, 0.86, 0.0, 0.4), atol=1e-7)
    assert gap < 1e-7


@pytest.mark.parametrize("place", [0.86, 0.97, 1.0, 1.02])
def test_table_stores_the_work_from_its_free_length(mechanism_engine, place):
    """The energy of a table spring is the integral of its force over the compression from zero on."""
    state = mechanism_engine(_slider(place, table=TABLE), 250_000).state("run", -1, 0)
    x = np.linspace(1.0, place, 2001)
    force = np.array([_table_force(xi, 0.0) for xi in x])
    work = -np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x))  # trapezoids, across kinks
    assert state.spring_energy_joule == pytest.approx(work, rel=1e-5, abs=1e-12)


@pytest.mark.parametrize("place", ["spring", "rail"])
def test_stops_of_springs_and_rails(mechanism_engine, place):
    """Stops push back one-sidedly; the mass bounces between them as a tight solver says."""
    stops = {"lower_m": 0.95, "upper_m": 1.05, "stiffness_newton_per_m": 5e4}
    if place == "spring":
        machine = _slider(1.0, 0.7, stiffness_newton_per_m=200.0, stops=stops)
    else:
        moved = stops | {"lower_m": -0.05, "upper_m": 0.05}
        machine = _slider(1.0, 0.7, rail={"stops": moved}, stiffness_newton_per_m=200.0)

    def force(x, _):
        return -200.0 * (x - 1.0) + 5e4 * (max(0.0, 0.95 - x) - max(0.0, x - 1.05))

    path, gap, state = _follow(mechanism_engine(machine, 250_000), 2000, 250_000)
    np.testing.assert_allclose(path[-1], _exact(force, 1.0, 0.7, 0.5), atol=1e-5)
    assert path[:, 0].min() < 0.95
    assert path[:, 0].max() > 1.05
    assert gap < 1e-5
    assert [f.name for f in state.forces] == (["spring"] if place == "spring" else ["spring", "rail.stops"])


def test_damped_stop_pushes_only(mechanism_engine):
    """A stop with a strong damper never pulls, and what is lost is booked."""
    stops = {"upper_m": 0.0, "stiffness_newton_per_m": 1e4, "damping_newton_s_per_m": 150.0}
    engine = mechanism_engine(_slider(1.0, 1.0, rail={"stops": stops}), 100_000)
    for tick in range(1000):
        engine.advance(tick, ())
        state = engine.state("run", tick, (tick + 1) * 100_000)
        assert state.forces[0].load <= 1e-9
    assert state.bodies[0].velocity_x_m_per_s < -0.1
    assert book(state) == pytest.approx(0.5 * MASS, rel=1e-7)


def test_torsion_spring_swings_a_flywheel(mechanism_engine):
    """A flywheel on a torsion spring with damper follows the damped cosine; preload shifts its middle."""
    machine = {
        "bodies": {"wheel": make_body(angle_rad=0.3)},
        "joints": {"pin": {"kind": "revolute", "body_a": "ground", "body_b": "wheel", "point_m": (0, 0)}},
        "forces": {
            "coil": {
                "kind": "torsion_spring", "body_a": "ground", "body_b": "wheel", "preload_newton_m": 3.0,
                "stiffness_newton_m_per_rad": 30.0, "damping_newton_m_s_per_rad": 0.6, "rest_angle_rad": 0.1,
            }
        },
    }  # fmt: skip
    engine = mechanism_engine(machine, 500_000)
    assert engine.state("run", -1, 0).forces[0].load == pytest.approx(30.0 * 0.1 + 3.0)
    state = advance(engine, 1000).state("run", 999, 500_000_000)
    decay, frequency = 1.0, math.sqrt(100.0 - 1.0)
    wave = math.cos(0.5 * frequency) + decay / frequency * math.sin(0.5 * frequency)
    assert state.bodies[0].angle_rad - 0.3 == pytest.approx(0.2 * (1.0 - math.exp(-0.5) * wave), abs=1e-8)
    assert state.joints[0].force_z_newton == pytest.approx(MASS * 9.81, rel=1e-9)


def test_revolute_stops_turn_a_wheel_back(mechanism_engine):
    """A wheel between stops of its pin turns back at the speed it came, and stays within them."""
    stops = {"lower_rad": -0.2, "upper_rad": 0.2, "stiffness_newton_m_per_rad": 3000.0}
    pin = {"kind": "revolute", "body_a": "ground", "body_b": "wheel", "point_m": (0.0, 0.0), "stops": stops}
    machine = {
        "bodies": {"wheel": make_body(angle_rad=0.5, angular_velocity_rad_per_s=2.0)},
        "joints": {"pin": pin},
    }
    # 0.1 s to the stop, half a period of 100 rad/s in it, 0.2 s to the other stop
    state = advance(mechanism_engine(machine, 500_000), 400).state("run", 399, 200_000_000)
    turned = 0.2 - 2.0 * (0.2 - 0.1 - math.pi / 100.0)
    assert state.bodies[0].angle_rad - 0.5 == pytest.approx(turned, abs=1e-7)
    assert state.bodies[0].angular_velocity_rad_per_s == pytest.approx(-2.0, abs=1e-7)


# --- friction ---------------------------------------------------------------------------------------


def test_rail_friction_slows_with_its_reaction(mechanism_engine):
    """A block on a level rail loses speed by mu g + preload / m while it slides."""
    friction = {"preload_newton": 3.0, "coefficient": 0.2, "slip_speed_m_per_s": 5e-3}
    engine = mechanism_engine(_slider(1.0, 2.0, rail={"friction": friction}), 500_000)
    state = advance(engine, 800).state("run", 799, 400_000_000)
    slowing = 0.2 * 9.81 + 3.0 / MASS
    assert state.bodies[0].velocity_x_m_per_s == pytest.approx(2.0 - 0.4 * slowing, abs=1e-9)
    assert state.bodies[0].x_m == pytest.approx(1.8 - 0.5 * 0.16 * slowing, abs=1e-9)
    assert state.forces[0].load == pytest.approx(-MASS * slowing, rel=1e-9)
    assert book(state) == pytest.approx(0.5 * MASS * 4.0, rel=1e-9)


def test_pin_friction_holds_with_the_force_in_the_pin(mechanism_engine):
    """A spinning rod of off-centre mass: friction is mu r |reaction|, the reaction that motion asks for."""
    friction = {"coefficient": 0.3, "radius_m": 0.04, "slip_speed_rad_per_s": 1e-3}
    pin = {"kind": "revolute", "body_a": "ground", "body_b": "rod", "point_m": (0, 0), "friction": friction}
    machine = {"bodies": {"rod": make_body(0.5, angular_velocity_rad_per_s=6.0)}, "joints": {"pin": pin}}

    def slope(_, y):
        angle, rate = y
        inertia, arm = INERTIA + 0.25 * MASS, 0.5
        spin = -9.81 * MASS * arm * math.cos(angle) / inertia
        for _ in range(60):
            x = -MASS * arm * (spin * math.sin(angle) + rate**2 * math.cos(angle))
            z = MASS * arm * (spin * math.cos(angle) - rate**2 * math.sin(angle)) + 9.81 * MASS
            drag = 0.3 * 0.04 * math.hypot(x, z) * math.tanh(rate / 1e-3)
            spin = (-9.81 * MASS * arm * math.cos(angle) - drag) / inertia
        return rate, spin

    exact = solve_ivp(slope, (0.0, 0.3), (0.0, 6.0), rtol=1e-11, atol=1e-12).y[:, -1]
    body = advance(mechanism_engine(machine, 500_000), 600).state("run", 599, 300_000_000).bodies[0]
    np.testing.assert_allclose((body.angle_rad, body.angular_velocity_rad_per_s), exact, atol=1e-7)
