"""Published benchmarks and independent integrations: double pendulum, N-four-bar, Andrews' squeezer."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from subsoil_ros.errors import PhysicsError


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
    ours = (upper.phi_rad, lower.phi_rad, upper.phi_rate_rad_per_s, lower.phi_rate_rad_per_s)
    np.testing.assert_allclose(ours, exact, atol=bound)


# --- N-four-bar (IFToMM Library of Computational Benchmark Problems, A02) -----------------------------


def _windows(count, integrator="adams_moulton"):
    """`count` windows of rods of 1 m and 1 kg; the upper left corner starts to the right at 1 m/s."""
    rod = {"mass_kg": 1.0, "inertia_kg_m2": 1.0 / 12.0}
    bodies, joints = {}, {}
    for i in range(count + 1):
        bodies[f"post{i}"] = {**rod, "position_m": (float(i), 0.5)}
        joints[f"foot{i}"] = _pin("ground", f"post{i}", (float(i), 0.0))
    bodies["post0"]["angular_velocity_rad_per_s"] = -1.0
    for i in range(count):
        bodies[f"bar{i}"] = {**rod, "position_m": (i + 0.5, 1.0)}
        joints[f"left{i}"] = _pin(f"post{i}", f"bar{i}", (float(i), 1.0))
        joints[f"right{i}"] = _pin(f"bar{i}", f"post{i + 1}", (i + 1.0, 1.0))
    return {"bodies": bodies, "joints": joints, "integrator": integrator}


def _drift(engine, ticks, interval_ns):
    start, worst = _energy(engine.state("run", -1, 0)), 0.0
    for tick in range(ticks):
        engine.advance(tick, ())
        if tick % 20 == 19:
            state = engine.state("run", tick, (tick + 1) * interval_ns)
            worst = max(worst, abs(_energy(state) - start))
    return worst, state


@pytest.mark.parametrize(("count", "interval_ns", "integrator"), [
    (1, 1_000_000, "adams_moulton"), (2, 1_000_000, "adams_moulton"), (10, 2_000_000, "adams_moulton"),
    (40, 5_000_000, "adams_moulton"), (1, 1_000_000, "runge_kutta_4"),
])  # fmt: skip
def test_windows_turn_for_ten_seconds(mechanism_engine, count, interval_ns, integrator):
    """10 s with ten passages of the flat, singular pose; energy within the benchmark's 0.1 J."""
    engine = mechanism_engine(_windows(count, integrator), interval_ns)
    assert engine.topology.freedom_count == 1
    drift, state = _drift(engine, 10_000_000_000 // interval_ns, interval_ns)
    assert drift < 0.1
    # all windows turn as one body: m v^2 / 2 over the turns is that of a compound pendulum
    inertia = (count + 1) / 3.0 + count
    weight = 9.81 * ((count + 1) * 0.5 + count)
    exact = solve_ivp(lambda _, y: (y[1], weight * math.sin(y[0]) / inertia), (0.0, 10.0), (0.0, 1.0),
                      "DOP853", rtol=1e-11, atol=1e-11).y[0, -1]  # fmt: skip
    posts = [body.phi_rad for body in state.bodies[: count + 1]]
    np.testing.assert_allclose(posts, posts[0], atol=1e-6)
    assert -posts[0] == pytest.approx(exact, abs=0.5)
    assert state.position_residual_m < 1e-10


def test_implicit_method_ends_by_name_before_the_flat_pose(mechanism_engine):
    """generalized_alpha does not pass the singular pose: it stops with a name and an advice, never NaN."""
    engine = mechanism_engine(_windows(1, "generalized_alpha"), 1_000_000)
    with pytest.raises(PhysicsError, match="generalized_alpha: Newton's method does not converge"):
        _drift(engine, 10_000, 1_000_000)
    assert np.isfinite(engine.arrays.q).all()


# --- Andrews' squeezer -------------------------------------------------------------------------------

# Geometry, masses, start and solution at 0.03 s: Mazzia & Magherini, Test Set for IVP Solvers, release 2.4,
# problem "Andrews' squeezing mechanism" (reference by PSIDE at a tolerance of 1e-14); the same problem is in
# Hairer & Wanner, Solving Ordinary Differential Equations II, VII.7.
MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
INERTIAS = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
BETA, GAMMA = -0.0617138900142764496, 0.455279819163070380
PHI, DELTA, EPSILON = 0.222668390165885885, 0.487364979543842550, 1.23054744454982119
REFERENCE = np.array([15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948,
                      0.5244099658805304, 0.5347301163226948, 1.048080741042263])  # fmt: skip
REFERENCE_RATES = np.array([1139.920302151208, -1424.379294994111, 11.03291221937134, 19.29337464421385,
                            0.5735699284790808, -19.29337464421385, 0.3231791658026955])  # fmt: skip
REFERENCE_MULTIPLIERS = (199.1753333731910, -29.75531228015052)  # of the loop over K3


def _local(origin, angle, along, across):
    """A point given along the direction `angle` and 90 degrees to its left."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([origin[0] + along * c - across * s, origin[1] + along * s + across * c])


def _squeezer(integrator):
    a, b, c = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
    crank = _local((0.0, 0.0), BETA, 7e-3, 0.0)
    meeting = _local(crank, BETA, -28e-3, 0.0)
    joint_e = _local(a, DELTA, 4e-2, 0.0)
    joint_h = _local(a, EPSILON, 0.0, -4e-2)
    centres = {
        "K1": (_local((0.0, 0.0), BETA, 92e-5, 0.0), BETA),
        "K2": (_local(crank, BETA, -115e-4, 0.0), BETA),
        "K3": (_local(b, GAMMA, 1043e-5, -1874e-5), GAMMA),
        "K4": (_local(joint_e, PHI + DELTA, 0.0, -(2e-2 - 1421e-5)), PHI + DELTA),
        "K5": (_local(a, DELTA, 2308e-5, 916e-5), DELTA),
        "K6": (_local(joint_h, EPSILON - PHI, 2e-2 - 1421e-5, 0.0), EPSILON - PHI),
        "K7": (_local(a, EPSILON, -449e-5, -1228e-5), EPSILON),
    }
    bodies = {
        name: {"mass_kg": m, "inertia_kg_m2": i, "position_m": tuple(centre), "angle_rad": angle}
        for (name, (centre, angle)), m, i in zip(centres.items(), MASSES, INERTIAS, strict=True)
    }
    joints = {
        "O": _pin("ground", "K1", (0.0, 0.0)), "crank": _pin("K1", "K2", crank),
        "F3": _pin("K2", "K3", meeting), "F4": _pin("K2", "K4", meeting), "F6": _pin("K2", "K6", meeting),
        "B": _pin("ground", "K3", b), "A5": _pin("ground", "K5", a), "A7": _pin("ground", "K7", a),
        "E": _pin("K4", "K5", joint_e), "H": _pin("K6", "K7", joint_h),
    }  # fmt: skip
    forces = {
        "spring": {"kind": "spring_damper", "body_a": "ground", "point_a_m": c, "body_b": "K3",
                   "point_b_m": tuple(_local(b, GAMMA, 2e-2, -18e-3)), "stiffness_newton_per_m": 4530.0,
                   "free_length_m": 0.07785},
        "motor": {"kind": "point_load", "body": "K1", "point_m": tuple(centres["K1"][0]),
                  "moment_newton_m": {"kind": "constant", "value": 0.033}},
    }  # fmt: skip
    return {"bodies": bodies, "joints": joints, "forces": forces, "integrator": integrator}


def _relative(values):
    """beta, Theta, gamma, Phi, delta, Omega, epsilon from the absolute angles of K1 to K7."""
    k1, k2, k3, k4, k5, k6, k7 = values
    return np.array([k1, k2 - k1, k3, k4 - k5, k5, k6 - k7, k7])


@pytest.mark.parametrize("integrator", ["adams_moulton", "runge_kutta_4"])
def test_squeezer_meets_its_published_solution(mechanism_engine, integrator):
    """At 0.03 s, steps of 4 us: every angle within 1e-8 of the reference, relative to itself."""
    engine = mechanism_engine(_squeezer(integrator), 4_000, gravity_m_per_s2=0.0)
    assert engine.topology.freedom_count == 1
    for tick in range(7500):
        engine.advance(tick, ())
    state = engine.state("run", 7499, 30_000_000)
    np.testing.assert_allclose(_relative([b.phi_rad for b in state.bodies]), REFERENCE, rtol=1e-8)
    # rates: relative to the largest; the four small ones agree to 5e-8 of themselves
    rates = _relative([b.phi_rate_rad_per_s for b in state.bodies])
    np.testing.assert_allclose(rates, REFERENCE_RATES, atol=1e-8 * 1424.0, rtol=0.0)
    np.testing.assert_allclose(rates, REFERENCE_RATES, rtol=1e-7)
    joint = next(j for j in state.joints if j.name == "F3")
    np.testing.assert_allclose((joint.force_x_newton, joint.force_z_newton), REFERENCE_MULTIPLIERS, rtol=5e-7)
