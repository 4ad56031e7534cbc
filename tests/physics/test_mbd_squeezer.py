"""Andrews' squeezer against its published reference, and against its exact motion.

It has one freedom, so energy gives its speed and a quadrature the time.

The published reference is itself 1.0e-12 s early: 7e-11 of the crank's angle, and up to
5.2e-8 of the small speeds, which change fast there. Against the exact motion every component meets 1e-8.
"""

import numpy as np
import pytest

from validation.squeezer import (
    BETA,
    INERTIAS,
    MASSES,
    REFERENCE,
    REFERENCE_MULTIPLIERS,
    REFERENCE_RATES,
    relative,
    squeezer,
)


@pytest.mark.parametrize("integrator", ["adams_moulton", "runge_kutta_4"])
def test_squeezer_meets_its_published_solution(mechanism_engine, integrator):
    """At 0.03 s, steps of 4 us: every angle within 1e-8 of the reference, relative to itself."""
    engine = mechanism_engine(squeezer(integrator=integrator), 4_000, gravity_m_per_s2=0.0)
    assert engine.topology.freedom_count == 1
    for tick in range(7500):
        engine.advance(tick, ())
    state = engine.state("run", 7499, 30_000_000)
    np.testing.assert_allclose(relative([b.angle_rad for b in state.bodies]), REFERENCE, rtol=1e-8)
    # rates: relative to the largest; the four small ones agree to 5e-8 of themselves
    rates = relative([b.angular_velocity_rad_per_s for b in state.bodies])
    np.testing.assert_allclose(rates, REFERENCE_RATES, atol=1e-8 * 1424.0, rtol=0.0)
    np.testing.assert_allclose(rates, REFERENCE_RATES, rtol=1e-7)
    joint = next(j for j in state.joints if j.name == "F3")
    np.testing.assert_allclose((joint.force_x_newton, joint.force_z_newton), REFERENCE_MULTIPLIERS, rtol=5e-7)


def test_squeezer_at_a_coarse_step_is_taken_in_parts(mechanism_engine):
    """At 500 us, where fixed steps are off by a third of the speed, within 1e-6 of the reference."""
    engine = mechanism_engine(squeezer(), 500_000, gravity_m_per_s2=0.0)
    for tick in range(60):
        engine.advance(tick, ())
    state = engine.state("run", 59, 30_000_000)
    np.testing.assert_allclose(relative([b.angle_rad for b in state.bodies]), REFERENCE, rtol=1e-6)
    rates = relative([b.angular_velocity_rad_per_s for b in state.bodies])
    np.testing.assert_allclose(rates, REFERENCE_RATES, atol=1e-6 * 1424.0, rtol=0.0)


# --- the exact motion --------------------------------------------------------------------------------

A, B, C = -0.06934 - 0.00227j, -0.03635 + 0.03273j, 0.014 + 0.072j
MOMENT, STIFFNESS, FREE_LENGTH = 0.033, 4530.0, 0.07785


def _dot(a, b):
    return (np.conj(a) * b).real


def _meet(p, p_rate, to_p, q, q_rate, to_q, side):
    """Where circles of given radii around p and q meet, to the left (1) or right of p to q; and its rate."""
    span = q - p
    square = _dot(span, span)
    along = 0.5 * (square + to_p**2 - to_q**2) / square
    x = p + span * (along + 1j * side * np.sqrt(to_p**2 / square - along**2))
    a, b = x - p, x - q  # a . x' = a . p', b . x' = b . q'
    right_a, right_b = _dot(a, p_rate), _dot(b, q_rate)
    return x, 1j * (b * right_a - a * right_b) / (a * np.conj(b)).imag


def _link(origin, origin_rate, tip, tip_rate, along, across, turn=0.0):
    """Angle of a body whose line from origin to tip is turned by `turn`; centre of mass; rates of both."""
    line, line_rate = tip - origin, tip_rate - origin_rate
    rate = (np.conj(line) * line_rate).imag / _dot(line, line)
    arm = line / np.abs(line) * np.exp(-1j * turn) * (along + 1j * across)
    return np.angle(line) - turn, rate, origin + arm, origin_rate + 1j * rate * arm


def _pose(beta):
    """Angles and their rates (7, ...) for the crank at `beta` turning at 1 rad/s, inertia, spring energy."""
    down, still = -0.5 * np.pi, np.zeros_like(beta)
    unit = np.exp(1j * beta)
    crank, crank_rate = 7e-3 * unit, 7e-3j * unit
    f, f_rate = _meet(crank, crank_rate, 28e-3, B, still, 35e-3, 1)
    e, e_rate = _meet(A, still, 4e-2, f, f_rate, 2e-2, 1)
    h, h_rate = _meet(A, still, 4e-2, f, f_rate, 2e-2, -1)
    links = (
        _link(still, still, unit, 1j * unit, 92e-5, 0.0),
        _link(crank, crank_rate, 2.0 * crank - f, 2.0 * crank_rate - f_rate, -115e-4, 0.0),
        _link(B, still, f, f_rate, 1043e-5, -1874e-5, down),
        _link(e, e_rate, f, f_rate, 0.0, 1421e-5 - 2e-2, down),
        _link(A, still, e, e_rate, 2308e-5, 916e-5),
        _link(h, h_rate, f, f_rate, 2e-2 - 1421e-5, 0.0),
        _link(A, still, h, h_rate, -449e-5, -1228e-5, down),
    )
    angles, rates = np.array([link[0] for link in links]), np.array([link[1] for link in links])
    inertia = sum(
        m * np.abs(centre_rate) ** 2 + i * rate**2
        for (_, rate, _, centre_rate), m, i in zip(links, MASSES, INERTIAS, strict=True)
    )
    spring = B + np.exp(1j * angles[2]) * (2e-2 - 18e-3j) - C
    return angles, rates, inertia, 0.5 * STIFFNESS * (np.abs(spring) - FREE_LENGTH) ** 2


def _crank_rate(beta):
    """Speed of the crank from the energy: work of the moment less what the spring has taken up."""
    _, _, inertia, stored = _pose(beta)
    _, _, _, first = _pose(np.longdouble(BETA))
    return np.sqrt(2.0 * (MOMENT * (beta - BETA) - (stored - first)) / inertia)


def _time(beta):
    """Time [s] to reach `beta` from rest: the integral of 1 / rate, regular in s, s^2 = beta - start."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    edges = np.sqrt(beta - BETA) * np.linspace(0.0, 1.0, 301)
    half = 0.5 * np.diff(edges)[:, None]
    s = 0.5 * (edges[1:] + edges[:-1])[:, None] + half * nodes
    return np.sum(half * weights * 2.0 * s / _crank_rate(BETA + s**2))


@pytest.fixture(scope="module")
def exact():
    """The published coordinates and their rates at 0.03 s."""
    beta = np.longdouble(REFERENCE[0])  # near the start the energy is a small difference of large ones
    for _ in range(3):  # Newton's method, down to round-off
        beta = beta - (_time(beta) - 0.03) * _crank_rate(beta)
    angles, rates, _, _ = _pose(beta)
    angles = relative([beta, *angles[1:]])  # the crank turns more than once
    angles += 2.0 * np.pi * np.round((REFERENCE - angles) / (2.0 * np.pi))
    return angles, relative(rates * _crank_rate(beta))


def test_published_reference_is_a_little_early(exact):
    """Its deviation is that of a clock: every angle is off by its own speed times the same 1.0e-12 s."""
    angles, rates = exact
    early = (angles - REFERENCE) / rates
    np.testing.assert_allclose(early[[0, 1, 2, 3, 5]], -1.0e-12, rtol=0.05)
    assert np.abs(rates / REFERENCE_RATES - 1.0).max() == pytest.approx(5.1e-8, rel=0.05)


@pytest.mark.parametrize("integrator", ["adams_moulton", "runge_kutta_4"])
def test_squeezer_meets_its_exact_motion(mechanism_engine, integrator, exact):
    """At 0.03 s, steps of 4 us: every angle and every speed within 1e-8 of its own value."""
    engine = mechanism_engine(squeezer(integrator=integrator), 4_000, gravity_m_per_s2=0.0)
    for tick in range(7500):
        engine.advance(tick, ())
    state = engine.state("run", 7499, 30_000_000)
    np.testing.assert_allclose(relative([b.angle_rad for b in state.bodies]), exact[0], rtol=1e-8)
    np.testing.assert_allclose(
        relative([b.angular_velocity_rad_per_s for b in state.bodies]), exact[1], rtol=1e-8
    )


def test_squeezer_converges_to_the_exact_motion(mechanism_engine, exact):
    """The largest relative error of a speed falls by 16 or more when the step halves (order 4)."""
    errors = []
    for communication_step_ns in (20_000, 10_000, 5_000):
        engine = mechanism_engine(squeezer(), communication_step_ns, gravity_m_per_s2=0.0)
        ticks = 30_000_000 // communication_step_ns
        for tick in range(ticks):
            engine.advance(tick, ())
        state = engine.state("run", ticks - 1, 30_000_000)
        rates = relative([b.angular_velocity_rad_per_s for b in state.bodies])
        errors.append(np.abs(rates / exact[1] - 1.0).max())
    assert errors[0] > 16.0 * errors[1] > 256.0 * errors[2]
