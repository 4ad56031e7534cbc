"""The linear and the Hertz-Mindlin law against closed forms and the published benchmark of Chung and Ooi.

Y.C. Chung, J.Y. Ooi, Benchmark tests for verifying discrete element modelling codes at particle impact level,
Granular Matter 13 (2011) 643-656.
"""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.physics.impacts import hertz, laboratory
from tests.soils import NEGLIGIBLE


def impact(engine, step_ns, until):
    """Advances `until` steps; per step minus the distance of two spheres and the force on the first."""
    overlaps, forces = [], []
    for tick in range(until):
        engine.advance(tick, ())
        x = engine.positions_m()
        overlaps.append(0.0 if len(x) < 2 else -np.linalg.norm(x[1] - x[0]))
        forces.append(np.linalg.norm(engine.forces_newton()[0]))
    return np.array(overlaps), np.array(forces)


@pytest.mark.parametrize("damping", [0.0, 40.0])
def test_linear_collision_has_its_duration_and_restitution(soil, damping):
    """t = pi / omega_d and e = exp(-pi zeta / sqrt(1 - zeta^2)), first order in the step."""
    mass = 1800.0 * 4.0 / 3.0 * math.pi * 0.01**3
    stiffness = 1e5
    row = {
        "stiffness_newton_per_m": stiffness, "tangential_stiffness_newton_per_m": NEGLIGIBLE,
        "damping_newton_s_per_m": damping / 10.0, "tangential_damping_newton_s_per_m": 0.0,
        "static_friction": 0.0, "sliding_friction": 0.0, "rolling_friction": NEGLIGIBLE,
    }  # fmt: skip
    zeta = damping / 10.0 / (2.0 * math.sqrt(stiffness * mass / 2.0))
    omega = math.sqrt(stiffness / (mass / 2.0)) * math.sqrt(1.0 - zeta**2)
    errors = []
    for step_ns in (2000, 1000):
        law = {"kind": "linear", "particle": row, "boundary": row}
        engine = laboratory(soil, law, 0.01, 1800.0, step_ns)
        engine.place([(0.04, 0, -0.06), (0.06 + 1e-9, 0, -0.06)], [(0.2, 0, 0), (-0.2, 0, 0)])
        engine.start(())
        _, force = impact(engine, step_ns, round(1.3 * math.pi / omega / (step_ns * 1e-9)))
        duration = np.count_nonzero(force) * step_ns * 1e-9
        # seen in whole steps; the first and the last may be missed
        assert abs(duration - math.pi / omega) < 3.0 * step_ns * 1e-9
        v = engine.velocities_m_per_s()
        errors.append(abs((v[1, 0] - v[0, 0]) / 0.4 - math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2))))
    assert errors[0] < 0.01
    assert errors[1] < 0.7 * errors[0] + 1e-4


def test_chung_ooi_1_two_glass_spheres(soil):
    """Elastic normal impact of two spheres: 10.697 kN, 274.1 um, 40.34 us as published."""
    step_ns = 20
    engine = laboratory(soil, hertz(48e9, 0.2, 1.0, 0.0), 0.01, 2800.0, step_ns)
    engine.place([(0.04, 0, -0.06), (0.06, 0, -0.06)], [(10.0, 0, 0), (-10.0, 0, 0)])
    engine.start(())
    distance, force = impact(engine, step_ns, 2200)
    assert_allclose(force.max(), 10.697e3, rtol=5e-4)
    assert_allclose(0.02 + distance.max(), 274.1e-6, rtol=5e-4)
    assert_allclose(np.count_nonzero(force) * step_ns * 1e-9, 40.34e-6, rtol=2e-3)


def test_chung_ooi_2_aluminium_sphere_on_a_rigid_wall(soil):
    """Elastic normal impact on a plane: 11.370 kN, 49.72 um, 731.6 us as published."""
    step_ns = 500
    law = hertz(70e9, 0.3, 1.0, 0.0, wall=(1e18, 0.3))
    engine = laboratory(soil, law, 0.1, 2699.0, step_ns)
    floor = engine.bed.lower_m[2]
    engine.place([(0.6, 0, floor + 0.1)], [(0, 0, -0.2)])
    engine.start(())
    heights, force = [], []
    for tick in range(1600):
        engine.advance(tick, ())
        heights.append(engine.positions_m()[0, 2] - floor)
        force.append(abs(engine.forces_newton()[0, 2]))
    assert_allclose(max(force), 11.370e3, rtol=5e-4)
    assert_allclose(0.1 - min(heights), 49.72e-6, rtol=1e-3)
    assert_allclose(np.count_nonzero(force) * step_ns * 1e-9, 731.6e-6, rtol=2e-3)


@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.8, 1.0])
def test_chung_ooi_3_restitution_of_a_damped_impact(soil, restitution):
    """The rebound of a sphere from a wall has the restitution asked for, at any speed.

    The dashpot's formula is that of an ideal contact ending at zero overlap, good to about 0.5 % here.
    """
    step_ns = 100  # half: z neighbours, for which the limit allows, would damp more
    for speed in (0.5, 3.9):
        engine = laboratory(
            soil, hertz(380e9, 0.23, restitution, 0.0, wall=(1e18, 0.2)), 0.0025, 4000.0, step_ns
        )
        floor = engine.bed.lower_m[2]
        engine.place([(0.015, 0, floor + 0.0025)], [(0, 0, -speed)])
        engine.start(())
        for tick in range(800):
            engine.advance(tick, ())
        assert_allclose(engine.velocities_m_per_s()[0, 2] / speed, restitution, atol=0.012)


@pytest.mark.parametrize("angle_deg", [70.0, 80.0, 85.0])
def test_chung_ooi_4_oblique_impact_in_gross_sliding(soil, angle_deg):
    """Sliding through the whole impact: v_t' = v_t - mu (1 + e) v_n, spin from the impulse."""
    step_ns, friction, speed, e = 100, 0.092, 3.9, 0.98
    engine = laboratory(soil, hertz(380e9, 0.23, e, friction, wall=(1e18, 0.2)), 0.0025, 4000.0, step_ns)
    floor = engine.bed.lower_m[2]
    vn, vt = speed * math.cos(math.radians(angle_deg)), speed * math.sin(math.radians(angle_deg))
    engine.place([(0.015, 0, floor + 0.0025)], [(vt, 0, -vn)])
    engine.start(())
    for tick in range(600):
        engine.advance(tick, ())
    v, w = engine.velocities_m_per_s()[0], engine.angular_velocities_rad_per_s()[0]
    rebound = v[2] / vn
    assert_allclose(v[0], vt - friction * (1.0 + rebound) * vn, rtol=1e-3)
    # the arm shortens by half the overlap: below 1 % of the radius here
    assert_allclose(w[1], 2.5 * friction * (1.0 + rebound) * vn / 0.0025, rtol=1e-2)


@pytest.mark.parametrize("angle_deg", [5.0, 20.0, 40.0, 60.0, 80.0, 89.0])
@pytest.mark.parametrize("restitution", [1.0, 0.7])
def test_no_impact_at_any_angle_gains_energy(soil, angle_deg, restitution):
    """Kinetic energy after a frictional impact on a wall is not larger than before, and the books close."""
    step_ns, speed = 100, 3.9
    engine = laboratory(
        soil, hertz(380e9, 0.23, restitution, 0.3, wall=(380e9, 0.23)), 0.0025, 4000.0, step_ns, True
    )
    floor = engine.bed.lower_m[2]
    vn, vt = speed * math.cos(math.radians(angle_deg)), speed * math.sin(math.radians(angle_deg))
    engine.place([(0.015, 0, floor + 0.0025)], [(vt, 0, -vn)])
    engine.start(())
    before = engine.energy()
    for tick in range(2500 if angle_deg > 85 else 900):
        engine.advance(tick, ())
    after = engine.energy()
    assert after.kinetic_joule <= before.kinetic_joule * (1.0 + 1e-9)
    assert min(after.sinks_joule.values()) >= -1e-12
    # first order: the impact of about 9 us takes 90 steps
    assert abs(after.total_joule - before.total_joule) < 0.02 * before.kinetic_joule
