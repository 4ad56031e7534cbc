"""Observed order of the alternative integrators, and of all of them across stops, kinks and contacts."""

import math

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

METHODS = [("adams_moulton", 2, 2), ("adams_moulton", 3, 3), ("adams_moulton", 4, 4),
           ("runge_kutta_4", 4, 4), ("generalized_alpha", 4, 2)]  # fmt: skip
MASS = 2.0

SCATTER = 0.5
"""A switch falls anywhere in its step, so errors of single steps scatter about the order."""


def _orders(errors):
    return np.log2(np.array(errors[:-1]) / errors[1:])


def _run(engine, ticks):
    for tick in range(ticks):
        engine.advance(tick, ())
    return engine


def _pendulum_angle(time):
    """A mass on a rod of 0.5 m from rest at 1.2 rad (Jacobi's elliptic functions)."""
    frequency = math.sqrt(MASS * 9.81 * 0.5 / (0.06 + MASS * 0.25))
    k = math.sin(0.6)
    sn, cn, _, _ = ellipj(ellipk(k * k) + frequency * time, k * k)
    return 2.0 * math.asin(k * sn), 2.0 * frequency * k * cn


@pytest.mark.parametrize(("integrator", "order"), [("runge_kutta_4", 4), ("generalized_alpha", 2)])
def test_pendulum_converges_with_the_order_of_the_method(mechanism_engine, integrator, order):
    """Angle and rate after 1.6 s come nearer to the elliptic functions by 2^order per halved step."""
    machine = {
        "bodies": {"rod": {"mass_kg": MASS, "inertia_kg_m2": 0.06, "angle_rad": 1.2,
                           "position_m": (0.5 * math.sin(1.2), -0.5 * math.cos(1.2))}},
        "joints": {"pin": {"kind": "revolute", "body_a": "ground", "body_b": "rod", "point_m": (0.0, 0.0)}},
        "integrator": integrator, "tolerance": None,
    }  # fmt: skip
    errors = []
    for ticks in (100, 200, 400):
        engine = _run(mechanism_engine(machine, 1_600_000_000 // ticks), ticks)
        body = engine.state("run", ticks - 1, 1_600_000_000).bodies[0]
        angle, rate = _pendulum_angle(1.6)
        errors.append(math.hypot(body.angle_rad - angle, body.angular_velocity_rad_per_s - rate))
    assert _orders(errors) == pytest.approx(order, abs=0.3)


def _rail(**spring):
    return {
        "bodies": {"mass": {"mass_kg": MASS, "inertia_kg_m2": 0.1, "position_m": (1.0, 0.0),
                            "velocity_m_per_s": (-1.0, 0.0)}},
        "joints": {"rail": {"kind": "prismatic", "body_a": "ground", "body_b": "mass", "point_m": (1.0, 0.0),
                            "axis": (1.0, 0.0)}},
        "forces": {"spring": {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0),
                              "body_b": "mass", "point_b_m": (1.0, 0.0), "free_length_m": 1.0, **spring}},
    }  # fmt: skip


def _bounce(stiffness, damping):
    """Time in a damped stop met at 1 m/s until it would pull, and the speed then."""
    decay = 0.5 * damping / MASS
    frequency = math.sqrt(stiffness / MASS - decay**2)
    # depth = exp(-d t) sin(w t) / w; force zero where k depth + c depth' = 0
    time = (math.pi - math.atan2(2.0 * decay * frequency, frequency**2 - decay**2)) / frequency
    depth = math.exp(-decay * time) * math.sin(frequency * time) / frequency
    speed = math.exp(-decay * time) * math.cos(frequency * time) - decay * depth
    assert abs(stiffness * depth + damping * speed) < 1e-9
    return time, depth, -speed


def _slope(errors):
    """Order fitted over all steps."""
    return -np.polyfit(np.arange(len(errors)), np.log2(errors), 1)[0]


@pytest.mark.parametrize(("integrator", "order", "expected"), METHODS)
@pytest.mark.parametrize("damping", [0.0, 30.0])
def test_stop_keeps_the_order_of_the_method(mechanism_engine, integrator, order, expected, damping):
    """A mass thrown at a stop whose damper makes the force jump: position and speed on its way back."""
    stops = {"lower_m": 0.937, "stiffness_newton_per_m": 5000.0, "damping_newton_s_per_m": damping}
    machine = _rail(stiffness_newton_per_m=0.0, stops=stops)
    time, depth, speed = _bounce(5000.0, damping)
    place = 0.937 - depth + speed * (0.2 - 0.063 - time)
    errors = []
    for ticks in (100, 200, 400, 800):
        options = {"integrator": integrator, "integrator_order": order, "tolerance": None}
        engine = _run(mechanism_engine({**machine, **options}, 200_000_000 // ticks), ticks)
        body = engine.state("run", ticks - 1, 200_000_000).bodies[0]
        errors.append(math.hypot(body.x_m - place, body.velocity_x_m_per_s - speed))
    assert _slope(errors) > expected - SCATTER
    # in and out; with a damper first to zero force, then out of the stop
    assert engine.arrays.counters[3] == (3 if damping else 2)


@pytest.mark.parametrize(("integrator", "order", "expected"), METHODS)
def test_kink_of_a_table_keeps_the_order_of_the_method(mechanism_engine, integrator, order, expected):
    """Through the kink of a table from one spring to a stiffer one and back, in closed form."""
    table = {"compressions_m": (-1.0, 0.0, 1.0), "forces_newton": (-200.0, 0.0, 1800.0)}
    # half a period on the stiff side, then a time on the soft one
    fast, slow = 30.0, 10.0
    left = 0.2 - math.pi / fast
    place, speed = math.sin(slow * left) / slow, math.cos(slow * left)
    errors = []
    for ticks in (50, 100, 200, 400, 800):
        options = {"integrator": integrator, "integrator_order": order, "tolerance": None}
        engine = _run(mechanism_engine({**_rail(table=table), **options}, 200_000_000 // ticks), ticks)
        body = engine.state("run", ticks - 1, 200_000_000).bodies[0]
        errors.append(math.hypot(slow * (body.x_m - 1.0 - place), body.velocity_x_m_per_s - speed))
    assert _slope(errors) > expected - SCATTER


@pytest.mark.parametrize(("integrator", "order", "expected"), METHODS)
def test_wheel_contact_keeps_the_order_of_the_method(mechanism_engine, integrator, order, expected):
    """A wheel dropped on the ground: its second flight against parabola, damped bounce, parabola."""
    stiffness, damping, weight = 4000.0, 20.0, MASS * 9.81
    machine = {
        "bodies": {"wheel": {"mass_kg": MASS, "inertia_kg_m2": 0.1, "position_m": (0.0, 0.3)}},
        "forces": {"tread": {"kind": "wheel_contact", "body": "wheel", "radius_m": 0.2, "friction": 0.0,
                             "stiffness_newton_per_m": stiffness, "damping_newton_s_per_m": damping}},
    }  # fmt: skip
    fall = math.sqrt(0.2 / 9.81)
    decay = 0.5 * damping / MASS
    frequency = math.sqrt(stiffness / MASS - decay**2)
    rest = weight / stiffness

    def depth(t):
        """Depth and its rate t after touching at 9.81 fall."""
        c, s = math.cos(frequency * t), math.sin(frequency * t)
        slope = 9.81 * fall - decay * rest
        fade = math.exp(-decay * t)
        value = rest + fade * (-rest * c + slope / frequency * s)
        return value, fade * (rest * frequency * s + slope * c) - decay * (value - rest)

    low, high = 0.5 * math.pi / frequency, 1.4 * math.pi / frequency
    for _ in range(100):
        middle = 0.5 * (low + high)
        value, rate = depth(middle)
        low, high = (middle, high) if stiffness * value + damping * rate > 0.0 else (low, middle)
    value, rate = depth(low)
    left = 0.26 - fall - low
    place, speed = 0.2 - value - rate * left - 0.5 * 9.81 * left**2, -rate - 9.81 * left
    errors = []
    for ticks in (65, 130, 260, 520, 1040):
        options = {"integrator": integrator, "integrator_order": order, "tolerance": None}
        engine = _run(mechanism_engine({**machine, **options}, 260_000_000 // ticks), ticks)
        body = engine.state("run", ticks - 1, 260_000_000).bodies[0]
        errors.append(math.hypot(10.0 * (body.z_m - place), body.velocity_z_m_per_s - speed))
    assert _slope(errors) > expected - SCATTER


def test_generalized_alpha_damps_a_stiff_mode_as_published(mechanism_engine):
    """On a spring of w h = 32 the method is a fixed map: Chung & Hulbert (1993), spectral radius 0.8."""
    stiffness, step = 2e9, 1e-3
    machine = _rail(stiffness_newton_per_m=stiffness)
    engine = mechanism_engine({**machine, "integrator": "generalized_alpha"}, 1_000_000)
    radius, mass = 0.8, machine["bodies"]["mass"]["mass_kg"]
    alpha_m, alpha_f = (2.0 * radius - 1.0) / (radius + 1.0), radius / (radius + 1.0)
    gamma, beta = 0.5 - alpha_m + alpha_f, 0.25 * (1.0 - alpha_m + alpha_f) ** 2
    k = stiffness / mass
    x, v = engine.arrays.q[0] - 1.0, engine.arrays.v[0]
    a = p = -k * x
    for tick in range(12):
        engine.advance(tick, ())
        guess = x + step * v + step**2 * (0.5 - beta) * p
        # (1 - am) p1 + am p = (1 - af) a1 + af a, a1 = -k (guess + h^2 beta p1)
        right = -(1.0 - alpha_f) * k * guess + alpha_f * a - alpha_m * p
        p1 = right / (1.0 - alpha_m + (1.0 - alpha_f) * k * beta * step**2)
        x = guess + step**2 * beta * p1
        v += step * ((1.0 - gamma) * p + gamma * p1)
        a, p = -k * x, p1
    assert engine.arrays.q[0] - 1.0 == pytest.approx(x, rel=1e-6)


def test_history_begins_anew_with_whole_steps(mechanism_engine):
    """Pieces of a step cut at a stop or at a corner of a law are no history, which is of equal steps."""
    stops = {"lower_m": 0.937, "stiffness_newton_per_m": 5000.0}
    machine = _rail(stiffness_newton_per_m=0.0, stops=stops)
    push = {"kind": "half_sine", "peak": 5.0, "start_s": 0.0105, "duration_s": 0.0100}
    machine["forces"]["push"] = {"kind": "point_load", "body": "mass", "point_m": (1.0, 0.0),
                                 "force_x_newton": push}  # fmt: skip
    engine = mechanism_engine({**machine, "tolerance": None}, 1_000_000)
    cut = []
    for tick in range(100):
        before = engine.arrays.counters[2:4].sum()
        engine.advance(tick, ())
        if engine.arrays.counters[2:4].sum() > before:
            cut.append(tick)
            assert engine.arrays.counters[0] == 0
        else:
            assert engine.arrays.counters[0] > 0
    assert len(cut) == 3  # two corners, and the stop
    assert cut[:2] == [10, 20]
