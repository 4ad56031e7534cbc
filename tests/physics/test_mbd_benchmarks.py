"""Published benchmarks and independent integrations: double pendulum, N-four-bar."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from subsoil_ros.errors import PhysicsError
from validation.four_bars import DURATION_NS, HIGH_PRECISION_JOULE, windows


def _pin(body_a, body_b, point):
    return {"kind": "revolute", "body_a": body_a, "body_b": body_b, "point_m": tuple(point)}


def _energy(state):
    return state.kinetic_energy_joule + state.gravity_energy_joule + state.spring_energy_joule


# --- double pendulum --------------------------------------------------------------------------------

MASS, INERTIA, LENGTH = 2.0, 0.1, 1.0


def _double_slope(_, y):
    """Two rods hung on one another, angles from the vertical: Lagrange's equations."""
    a, b, u, w = y
    c, s = math.cos(a - b), math.sin(a - b)
    cross = 0.5 * MASS * LENGTH**2
    mass = np.array([[INERTIA + 1.25 * MASS * LENGTH**2, cross * c],
                     [cross * c, INERTIA + 0.25 * MASS * LENGTH**2]])  # fmt: skip
    right = [-cross * s * w * w - 1.5 * MASS * 9.81 * LENGTH * math.sin(a),
             cross * s * u * u - 0.5 * MASS * 9.81 * LENGTH * math.sin(b)]  # fmt: skip
    return [u, w, *np.linalg.solve(mass, right)]


@pytest.mark.parametrize(("integrator", "bound"), [
    ("adams_moulton", 1e-6), ("runge_kutta_4", 1e-7), ("generalized_alpha", 2e-2)])  # fmt: skip
def test_double_pendulum_follows_minimal_coordinates(mechanism_engine, integrator, bound):
    """1 s of free swinging from rest agrees with Lagrange's equations under a tight solver."""
    first, second = 1.9, 1.2
    knee = np.array([math.sin(first), -math.cos(first)])
    end = knee + np.array([math.sin(second), -math.cos(second)])
    body = {"mass_kg": MASS, "inertia_kg_m2": INERTIA}
    machine = {
        "bodies": {
            "upper": {**body, "position_m": tuple(0.5 * knee), "angle_rad": first},
            "lower": {**body, "position_m": tuple(0.5 * (knee + end)), "angle_rad": second},
        },
        "joints": {"top": _pin("ground", "upper", (0.0, 0.0)), "knee": _pin("upper", "lower", knee)},
        "integrator": integrator,
    }
    engine = mechanism_engine(machine, 1_000_000)
    for tick in range(1000):
        engine.advance(tick, ())
    upper, lower = engine.state("run", 999, 1_000_000_000).bodies
    exact = solve_ivp(_double_slope, (0.0, 1.0), (first, second, 0.0, 0.0), "DOP853", rtol=1e-12,
                      atol=1e-12).y[:, -1]  # fmt: skip
    ours = (
        upper.angle_rad,
        lower.angle_rad,
        upper.angular_velocity_rad_per_s,
        lower.angular_velocity_rad_per_s,
    )
    np.testing.assert_allclose(ours, exact, atol=bound)


# --- N-four-bar (IFToMM Library of Computational Benchmark Problems, A02) -----------------------------


def _drift(engine, ticks, communication_step_ns):
    start, worst = _energy(engine.state("run", -1, 0)), 0.0
    for tick in range(ticks):
        engine.advance(tick, ())
        if tick % 20 == 19:
            state = engine.state("run", tick, (tick + 1) * communication_step_ns)
            worst = max(worst, abs(_energy(state) - start))
    return worst, state


@pytest.mark.full
@pytest.mark.parametrize(("count", "communication_step_ns", "integrator"), [
    (1, 1_000_000, "adams_moulton"), (2, 1_000_000, "adams_moulton"), (10, 2_000_000, "adams_moulton"),
    (40, 5_000_000, "adams_moulton"), (1, 1_000_000, "runge_kutta_4"), (10, 500_000, "adams_moulton"),
    (1, 250_000, "adams_moulton"), (2, 250_000, "adams_moulton"), (2, 250_000, "runge_kutta_4"),
    (40, 500_000, "adams_moulton"), (40, 500_000, "runge_kutta_4"),
])  # fmt: skip
def test_windows_turn_for_ten_seconds(mechanism_engine, count, communication_step_ns, integrator):
    """10 s with ten passages of the flat, singular pose; energy to the benchmark's high precision, 1e-3 J.

    Small steps end nearer to the pose itself: they are the ones that singular_poses.py has to save.
    """
    engine = mechanism_engine(windows(count, integrator=integrator), communication_step_ns)
    assert engine.topology.freedom_count == 1
    drift, state = _drift(engine, DURATION_NS // communication_step_ns, communication_step_ns)
    assert drift < HIGH_PRECISION_JOULE
    # all windows turn as one body: m v^2 / 2 over the turns is that of a compound pendulum
    inertia = (count + 1) / 3.0 + count
    weight = 9.81 * ((count + 1) * 0.5 + count)
    exact = solve_ivp(lambda _, y: (y[1], weight * math.sin(y[0]) / inertia), (0.0, 10.0), (0.0, 1.0),
                      "DOP853", rtol=1e-11, atol=1e-11).y[0, -1]  # fmt: skip
    posts = [body.angle_rad for body in state.bodies[: count + 1]]
    np.testing.assert_allclose(posts, posts[0], atol=1e-6)
    assert -posts[0] == pytest.approx(exact, abs=0.5)
    assert state.position_residual_m < 1e-10


@pytest.mark.full
@pytest.mark.parametrize("count", [1, 10, 40])
def test_smaller_steps_keep_the_energy_of_the_windows_better(mechanism_engine, count):
    """A smaller step never adds to the drift, down to round-off, wherever its end meets the flat pose."""
    drifts = []
    for communication_step_ns in (5_000_000, 4_000_000, 2_000_000, 1_000_000, 500_000):
        engine = mechanism_engine(windows(count), communication_step_ns)
        drifts.append(_drift(engine, DURATION_NS // communication_step_ns, communication_step_ns)[0])
    round_off = 1e-7 * count
    for coarse, fine in itertools.pairwise(drifts):
        assert fine < max(coarse, round_off)
    assert drifts[-1] < round_off


def test_implicit_method_ends_by_name_before_the_flat_pose(mechanism_engine):
    """generalized_alpha does not pass the singular pose: it stops with a name and an advice, never NaN."""
    engine = mechanism_engine(windows(1, integrator="generalized_alpha"), 1_000_000)
    with pytest.raises(PhysicsError, match="generalized_alpha: Newton's method does not converge"):
        _drift(engine, 10_000, 1_000_000)
    assert np.isfinite(engine.arrays.q).all()
