"""Joints, drivers and locked springs against closed forms and energy."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.physics.small_machines import INERTIA, MASS, advance, book
from tests.physics.small_machines import body as make_body

# --- joints and drivers -----------------------------------------------------------------------------


def test_point_on_line_is_an_ellipse_trammel(mechanism_engine):
    """A bar with an end on each of two crossed lines falls as the trammel's one equation says."""
    angle, length = 0.6, 1.0
    ends = (length * math.cos(angle), 0.0), (0.0, length * math.sin(angle))
    machine = {
        "bodies": {"bar": make_body(0.5 * ends[0][0], 0.5 * ends[1][1])},
        "joints": {
            "floor": {"kind": "point_on_line", "body_a": "ground", "body_b": "bar", "point_m": ends[0],
                      "axis": (3.0, 0.0)},
            "wall": {"kind": "point_on_line", "body_a": "ground", "body_b": "bar", "point_m": ends[1],
                     "axis": (0.0, 1.0)},
        },
    }  # fmt: skip
    engine = mechanism_engine(machine, 500_000)
    assert engine.topology.freedom_count == 1
    body = advance(engine, 500).state("run", 499, 250_000_000).bodies[0]
    inertia = INERTIA + MASS * 0.25
    exact = solve_ivp(lambda _, y: (y[1], -MASS * 9.81 * 0.5 * math.cos(y[0]) / inertia), (0.0, 0.25),
                      (angle, 0.0), rtol=1e-12, atol=1e-12).y[:, -1]  # fmt: skip
    assert body.angle_rad == pytest.approx(angle - exact[0], abs=1e-8)
    assert body.x_m == pytest.approx(0.5 * math.cos(exact[0]), abs=1e-8)
    # at the start: the wall pushes the bar's end with what moves its middle along x
    state = mechanism_engine(machine).state("run", -1, 0)
    assert state.joints[1].force_x_newton == pytest.approx(MASS * state.bodies[0].acceleration_x_m_per_s2)
    assert state.joints[1].force_z_newton == 0.0


def _arm(coordinate, law):
    """A block on a radial rail of a turntable, driven along it; or a wheel driven against it."""
    spin = {"kind": "driver", "body": "table", "coordinate": "angle",
            "speed": {"kind": "constant", "value": 2.0}}  # fmt: skip
    drive = {
        "kind": "driver",
        "body": "block",
        "coordinate": coordinate,
        "relative_to": "table",
        "speed": law,
    }
    if coordinate == "angle":
        guide = {"kind": "revolute", "body_a": "table", "body_b": "block", "point_m": (1.0, 0.0)}
    else:
        guide = {"kind": "prismatic", "body_a": "table", "body_b": "block", "point_m": (1.0, 0.0),
                 "axis": (1.0, 0.0) if coordinate == "x" else (0.0, 1.0)}  # fmt: skip
    return {
        "bodies": {"table": make_body(), "block": make_body(1.0)},
        "joints": {
            "hub": {"kind": "revolute", "body_a": "ground", "body_b": "table", "point_m": (0.0, 0.0)},
            "guide": guide, "spin": spin, "drive": drive,
        },
    }  # fmt: skip


LAW = {"kind": "polynomial", "coefficients": (0.1, 0.0, 0.6), "end_s": 0.4}


@pytest.mark.parametrize("coordinate", ["x", "z", "angle"])
def test_relative_driver(mechanism_engine, coordinate):
    """A driver against a turning body gives that way along its axes; its force is inertia's along them."""
    engine = mechanism_engine(_arm(coordinate, LAW), 1_000_000, gravity_m_per_s2=0.0)
    state = advance(engine, 300).state("run", 299, 300_000_000)
    way, growth, turn = 0.03 + 0.2 * 0.027, 1.2 * 0.3, 0.6
    block, drive = state.bodies[1], state.joints[3]
    if coordinate == "angle":
        assert block.angle_rad == pytest.approx(turn + way, abs=1e-11)
        assert drive.moment_newton_m == pytest.approx(INERTIA * growth, abs=1e-9)
        return
    along = np.array([math.cos(turn), math.sin(turn)])
    up = np.array([-along[1], along[0]])
    x, z = (1.0 + way, 0.0) if coordinate == "x" else (1.0, way)
    np.testing.assert_allclose((block.x_m, block.z_m), x * along + z * up, atol=1e-11)
    axis = along if coordinate == "x" else up
    inertia = MASS * (growth - 4.0 * (x if coordinate == "x" else z))
    np.testing.assert_allclose((drive.force_x_newton, drive.force_z_newton), inertia * axis, atol=1e-8)


def test_knock_and_sum_of_loads_give_their_impulse(mechanism_engine):
    """A half-sine knock beside a constant and a ramp: the momentum is the integral of their sum."""
    load = {"kind": "sum", "terms": [
        {"kind": "half_sine", "peak": 50.0, "start_s": 0.0123, "duration_s": 0.031},
        {"kind": "constant", "value": -2.0},
        {"kind": "ramp", "end_value": 6.0, "start_s": 0.05, "end_s": 0.0777}]}  # fmt: skip
    machine = {
        "bodies": {"block": make_body()},
        "forces": {
            "push": {"kind": "point_load", "body": "block", "point_m": (0, 0), "force_x_newton": load}
        },
    }
    engine = mechanism_engine(machine, 1_000_000, gravity_m_per_s2=0.0)
    body = advance(engine, 100).state("run", 99, 100_000_000).bodies[0]
    impulse = 50.0 * 0.031 * 2.0 / math.pi - 0.2 + 3.0 * 0.0277 + 6.0 * 0.0223
    # Adams-Moulton of order 4 on a sine of 101 rad/s at 1 ms: (h w)^4 x 19/720 = 3e-6
    assert body.velocity_x_m_per_s == pytest.approx(impulse / MASS, rel=1e-5)


# --- locked springs ---------------------------------------------------------------------------------


def test_locked_spring_makes_the_shank_rigid(mechanism_engine, subsoiler):
    """`locked` takes one freedom away, and the spring reports the force that its rod carries."""
    free = mechanism_engine(subsoiler)
    subsoiler["forces"]["H9"]["locked"] = True
    engine = mechanism_engine(subsoiler)
    assert (free.topology.freedom_count, engine.topology.freedom_count) == (4, 3)
    assert engine.topology.constraint_count == 18
    state = advance(engine, 200).state("run", 199, 200_000_000)
    spring = next(f for f in state.forces if f.name == "H9")
    assert spring.coordinate == pytest.approx(0.4, abs=1e-12)
    assert spring.rate == pytest.approx(0.0, abs=1e-11)
    # the moment about the shank's hinge: rod's force x 0.25 m against the weight 0.02 m ahead of it
    assert spring.load == pytest.approx(35.2 * 9.81 * 0.02 / 0.25, rel=0.05)
    rod = next(j for j in state.joints if j.name == "H9")
    assert math.hypot(rod.force_x_newton, rod.force_z_newton) == pytest.approx(abs(spring.load))
    shank, frame = (next(b for b in state.bodies if b.name == n) for n in ("shank", "frame"))
    assert shank.angle_rad - frame.angle_rad == pytest.approx(0.0, abs=1e-11)


def test_locked_rod_swings_as_a_pendulum(mechanism_engine):
    """A mass on a locked spring is a pendulum: the rod carries weight and centripetal force."""
    rod = {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0), "body_b": "bob",
           "point_b_m": (0.8, 0.0), "free_length_m": 1.0, "stiffness_newton_per_m": 10.0,
           "locked": True}  # fmt: skip
    machine = {"bodies": {"bob": make_body(0.8)}, "forces": {"rod": rod}}
    engine = mechanism_engine(machine, 500_000)
    assert engine.topology.freedom_count == 2  # it may spin about itself
    state = advance(engine, 800).state("run", 799, 400_000_000)
    body = state.bodies[0]
    assert math.hypot(body.x_m, body.z_m) == pytest.approx(0.8, abs=1e-12)
    assert book(state) == pytest.approx(0.0, abs=1e-8)
    speed2 = body.velocity_x_m_per_s**2 + body.velocity_z_m_per_s**2
    tension = MASS * (speed2 / 0.8 - 9.81 * body.z_m / 0.8)
    assert state.forces[0].load == pytest.approx(-tension, rel=1e-9)
    pull = state.joints[0]  # on the mass, towards the origin
    np.testing.assert_allclose(
        (pull.force_x_newton, pull.force_z_newton),
        -tension * np.array([body.x_m, body.z_m]) / 0.8,
        rtol=1e-9,
    )


def test_locked_torsion_spring_is_a_weld_of_the_angle(mechanism_engine):
    """Locked, a torsion spring holds the angle between its bodies and reports the moment it needs."""
    machine = {
        "bodies": {"rod": make_body(0.5)},
        "joints": {"pin": {"kind": "revolute", "body_a": "ground", "body_b": "rod", "point_m": (0.0, 0.0)}},
        "forces": {"coil": {"kind": "torsion_spring", "body_a": "ground", "body_b": "rod", "locked": True,
                            "stiffness_newton_m_per_rad": 5.0}},
    }  # fmt: skip
    engine = mechanism_engine(machine)
    assert engine.topology.freedom_count == 0
    assert engine.state("run", -1, 0).forces[0].load == pytest.approx(MASS * 9.81 * 0.5)


# --- pairs of moving and turned bodies --------------------------------------------------------------


def test_torsion_spring_turns_both_bodies(mechanism_engine):
    """Two free discs on a coil swing against each other at sqrt(k / reduced inertia); their spin is kept."""
    bodies = {
        "one": make_body(),
        "two": {**make_body(), "inertia_kg_m2": 0.6, "angular_velocity_rad_per_s": 1.5},
    }
    coil = {"kind": "torsion_spring", "body_a": "one", "body_b": "two", "stiffness_newton_m_per_rad": 20.0}
    engine = mechanism_engine({"bodies": bodies, "forces": {"coil": coil}}, gravity_m_per_s2=0.0)
    one, two = advance(engine, 300).state("run", 299, 300_000_000).bodies
    frequency = math.sqrt(20.0 / (INERTIA * 0.6 / (INERTIA + 0.6)))
    twist = 1.5 / frequency * math.sin(frequency * 0.3)
    assert two.angle_rad - one.angle_rad == pytest.approx(twist, abs=1e-7)
    spin = INERTIA * one.angular_velocity_rad_per_s + 0.6 * two.angular_velocity_rad_per_s
    assert spin == pytest.approx(0.6 * 1.5, abs=1e-12)


@pytest.mark.parametrize("kind", ["prismatic", "point_on_line"])
def test_line_is_given_in_world_axes_whatever_the_bodys_angle(mechanism_engine, kind):
    """A block on an incline that belongs to a turned body slides down at g sin(slope)."""
    slope = 0.6
    line = {"kind": kind, "body_a": "wedge", "body_b": "block", "point_m": (1.0, 0.0),
            "axis": (math.cos(slope), math.sin(slope))}  # fmt: skip
    machine = {
        "bodies": {"wedge": make_body(angle_rad=0.9), "block": make_body(1.0)},
        "joints": {
            "ground": {"kind": "fixed", "body_a": "ground", "body_b": "wedge", "point_m": (0.0, 0.0)},
            "line": line,
        },
    }
    block = mechanism_engine(machine).state("run", -1, 0).bodies[1]
    sliding = -9.81 * math.sin(slope)
    assert block.acceleration_x_m_per_s2 == pytest.approx(sliding * math.cos(slope), rel=1e-12)
    assert block.acceleration_z_m_per_s2 == pytest.approx(sliding * math.sin(slope), rel=1e-12)
