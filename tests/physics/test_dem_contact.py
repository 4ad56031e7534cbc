"""The contact law against closed forms, called directly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.contact_laws.base import YES, ContactMotion, ContactState, Features
from subsoil_ros.contact_laws.cohesive_linear.law import CohesiveLinearFeatures, CohesiveLinearNumbers
from subsoil_ros.contact_laws.hertz.law import HertzNumbers
from subsoil_ros.dem.contact import contact, normal_potential, spring_energy

LAW = CohesiveLinearNumbers(
    stiffness=5000.0,
    tangential_stiffness=4000.0,
    damping=10.0,
    tangential_damping=10.0,
    adhesion=3500.0,
    contact_adhesion=3500.0,
    rest_overlap=0.002,
    reach=0.002,
    peak_attraction=7.0,
    static_friction=0.5,
    sliding_friction=0.5,
    rolling_stiffness=4000.0 * 0.005**2,
    rolling_arm=0.3 * 0.005,
)
ALL = CohesiveLinearFeatures(YES, YES, YES, cohesion=YES)
NORMAL = (1.0, 0.0, 0.0)
NONE = (0.0, 0.0, 0.0)


def apply(overlap, velocity=NONE, spin=NONE, shear=NONE, roll=NONE, step=5e-5, law=LAW, features=ALL):
    """One call of the law."""
    motion, state = ContactMotion(NORMAL, velocity, spin), ContactState(shear, roll, ())
    f, m, (shear, roll, _), sinks = contact(overlap, motion, state, step, law, features)
    return f, m, shear, roll, sinks


def elastic(overlap):
    """Force along the normal at rest, repulsion positive [N]."""
    return -apply(overlap)[0][0]


@pytest.mark.parametrize(
    ("overlap_m", "force_newton"),
    [
        (0.003, 5.0),  # zone 1: K_X (delta - delta_c)
        (0.002, 0.0),  # rest
        (0.001, -3.5),  # zone 2: -K_C (delta_c - delta)
        (0.0, -7.0),  # peak: -K_B delta_B
        (-0.001, -3.5),  # zone 3: -K_B (delta_B + delta)
        (-0.002, 0.0),
        (-0.003, 0.0),  # zone 4
    ],
)
def test_elastic_normal_force_of_every_zone(overlap_m, force_newton):
    """Equations 12 to 21, with equation 17 corrected, to round-off."""
    assert_allclose(elastic(overlap_m), force_newton, atol=1e-12)


@pytest.mark.parametrize("border_m", [0.002, 0.0, -0.002])
def test_elastic_normal_force_is_continuous(border_m):
    """No jump at the borders of the zones: K_B delta_B = K_C delta_c (eq. 20)."""
    step = 1e-9
    jump = elastic(border_m + step) - elastic(border_m - step)
    assert abs(jump) <= 2.0 * step * max(LAW.stiffness, LAW.adhesion) * 1.001


def test_elastic_loop_work_is_zero_and_potential_is_its_integral():
    """In and out through all zones returns the work; the potential is minus the integral of the force."""
    overlap = np.linspace(-0.003, 0.006, 9001)
    force = np.array([elastic(o) for o in overlap])
    potential = np.array([normal_potential(o, ContactState(NONE, NONE, ()), LAW, ALL) for o in overlap])
    # the law is piecewise linear and its kinks are nodes: the trapezoid rule is exact
    work = np.concatenate(([0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(overlap))))
    assert_allclose(potential, work, atol=1e-12)


def test_dashpot_acts_in_the_repulsive_zone_only_and_jumps_there():
    """As printed: the force jumps by C times the rate at delta_c; nothing is damped in zones 2 and 3."""
    rate = 0.3
    above = apply(0.002 + 1e-12, (rate, 0.0, 0.0))[0][0]
    below = apply(0.002 - 1e-12, (rate, 0.0, 0.0))[0][0]
    assert_allclose(above - below, -LAW.damping * rate, rtol=1e-6)
    for overlap in (0.001, -0.001):
        assert_allclose(apply(overlap, (rate, 0, 0))[0][0], -elastic(overlap), rtol=1e-12)
    everywhere = ALL._replace(damp_all_zones=YES)
    damped = apply(-0.001, (rate, 0.0, 0.0), features=everywhere)[0][0]
    assert_allclose(damped, 3.5 - LAW.damping * rate, rtol=1e-12)


@pytest.mark.parametrize(
    ("features", "limit_newton"),
    [
        (ALL, 0.5 * (-3.5 + 7.0)),
        (ALL._replace(friction_repulsive=YES), 0.0),
        (ALL._replace(friction_absolute=YES), 0.5 * 3.5),
    ],
    ids=["total", "repulsive", "absolute"],
)
def test_sliding_force_is_friction_times_the_chosen_normal_force(features, limit_newton):
    """Under a long slip the tangential force is mu N against the motion, and the spring carries its part."""
    shear, force = NONE, None
    for _ in range(2000):
        force, _, shear, _, _ = apply(0.001, (0.0, 0.4, 0.0), shear=shear, features=features)
    assert_allclose(force[1], -limit_newton, atol=1e-12)
    assert_allclose(shear[1], limit_newton / LAW.tangential_stiffness, rtol=1e-6, atol=1e-15)


def test_sticking_contact_is_a_spring_and_a_damper():
    """Below the limit: F = -K_Y x - C_Y v, and the spring stores exactly the motion."""
    speed, step = 1e-3, 5e-5
    shear, force = NONE, None
    for _ in range(100):
        force, _, shear, _, sinks = apply(0.003, (0.0, speed, 0.0), shear=shear, step=step)
        assert sinks[2] == 0.0
    assert_allclose(shear[1], 100 * step * speed, rtol=1e-12)
    assert_allclose(force[1], -(4000.0 * 100 * step * speed + 10.0 * speed), rtol=1e-12)


def test_friction_and_dampers_only_dissipate_and_the_books_balance():
    """Work of the tangential force = change of spring energy + dashpot + slider, first order in the step."""

    def defect(step):
        generator = np.random.default_rng(3)
        amplitude = generator.uniform(0.1, 0.6, (4, 2))
        shear, work, lost = NONE, 0.0, 0.0
        for n in range(round(0.05 / step)):
            t = n * step
            v = sum(a * np.sin((k + 1) * 130.0 * t) for k, a in enumerate(amplitude))
            force, _, shear, _, sinks = apply(0.002, (0.0, v[0], v[1]), shear=shear, step=step)
            assert min(sinks) >= 0.0
            work -= (force[1] * v[0] + force[2] * v[1]) * step
            lost += sinks[1] + sinks[2]
        stored = 0.5 * LAW.tangential_stiffness * (shear[1] ** 2 + shear[2] ** 2)
        return abs(work - lost - stored) / work

    coarse, fine = defect(1e-4), defect(5e-5)
    assert coarse < 0.02
    assert 1.6 < coarse / fine < 2.4


def test_rolling_spring_yields_at_its_torque_limit():
    """Torque = K_Y R_eff^2 angle, up to mu_r R_eff N with the N of sliding; twist carries nothing."""
    step = 5e-5
    torque = apply(0.002, spin=(0.0, 0.2, 0.0), step=step)[1]
    assert_allclose(torque[1], -LAW.rolling_stiffness * 0.2 * step, rtol=1e-12)
    roll, torque = NONE, None
    for _ in range(20000):
        _, torque, _, roll, _ = apply(0.002, spin=(0.0, 3.0, 0.0), roll=roll, step=step)
    assert_allclose(torque[1], -0.3 * 0.005 * 7.0, rtol=1e-12)
    assert apply(0.002, spin=(5.0, 0.0, 0.0))[1] == NONE


def test_a_spring_turns_with_the_contact():
    """A shear spring stays in the tangent plane: its part along the normal is dropped."""
    shear = apply(0.003, shear=(1e-5, 2e-5, -3e-5))[2]
    assert_allclose(shear, (0.0, 2e-5, -3e-5), rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize("spring", ["tangential", "rolling"])
def test_a_spring_moved_under_changing_load_gives_no_energy(spring):
    """Hertz: wound up lightly loaded and unwound heavily loaded, in a cycle no spring does work on balance;
    what it does not return is booked as released."""
    law = HertzNumbers(
        stiffness=1e7, tangential_stiffness=8e6, damping=0.0, tangential_damping=0.0, static_friction=1e3,
        sliding_friction=0.5, rolling_stiffness=200.0, rolling_arm=1e3,
    )  # fmt: skip
    features = Features(YES, YES, YES)
    step, quarter, shear, roll = 1e-6, 1000, NONE, NONE
    overlap, work, released = 1e-3, 0.0, 0.0
    for approach, slip in ((0.0, 0.1), (1.0, 0.0), (0.0, -0.1), (-1.0, 0.0)):
        for _ in range(quarter):
            overlap += step * approach
            velocity = (approach, slip if spring == "tangential" else 0.0, 0.0)
            spin = (0.0, 0.0, 100.0 * slip if spring == "rolling" else 0.0)
            force, torque, shear, roll, sinks = apply(
                overlap, velocity, spin, shear, roll, step, law, features
            )
            work -= (force[1] * velocity[1] + np.dot(torque, spin)) * step
            released += sinks[4]
            assert sinks[4] >= 0.0
    assert released > 0.0
    stored = spring_energy(overlap, ContactState(shear, roll, ()), law)
    # first order in the step: a quarter has 1000 of them
    assert_allclose(work - stored, released, rtol=0.01)
