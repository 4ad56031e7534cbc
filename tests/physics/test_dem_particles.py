"""A few particles against closed forms, through the soil engine."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.soils import HERTZ, LINEAR, NEGLIGIBLE

MASS = 1800.0 * 4.0 / 3.0 * math.pi * 0.01**3
BOUNDARY_STIFFNESS = 10_000.0 * 16_000.0 / 26_000.0
"""Series of the particle's and the boundary's K_X [N/m] (eq. 15)."""


def run(engine, steps, motions=()):
    """`steps` ticks with the tools standing at `motions`."""
    for tick in range(steps):
        engine.advance(tick, motions)


FREE = {"cohesive_stiffness_newton_per_m": NEGLIGIBLE, "rolling_friction": NEGLIGIBLE}


@pytest.mark.parametrize("damping", [0.0, 4.0])
def test_head_on_collision_has_the_restitution_of_a_spring_and_dashpot(soil, damping):
    """e = exp(-pi zeta / sqrt(1 - zeta^2)); the error falls with the step; momentum is kept to round-off."""
    pair_stiffness, pair_damping, half = 5000.0, damping / 2.0, MASS / 2.0
    zeta = pair_damping / (2.0 * math.sqrt(pair_stiffness * half))
    expected = math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2))
    errors = []
    for step in (2e-5, 1e-5):
        engine = soil.engine(
            f"soil.time_step_s={step}",
            "gravity_m_per_s2=0",
            law=FREE | {"damping_newton_s_per_m": damping, "tangential_damping_newton_s_per_m": 0.0},
        )
        engine.place([(0.04, 0.0, -0.05), (0.062, 0.0, -0.05)], [(0.1, 0, 0), (-0.1, 0, 0)])
        engine.start(())
        run(engine, round(0.07 / step))
        v = engine.velocities_m_per_s()
        assert_allclose(engine.momentum_kg_m_per_s, 0.0, atol=1e-15)
        assert_array_equal(engine.angular_velocities_rad_per_s(), 0.0)
        errors.append(abs((v[1, 0] - v[0, 0]) / 0.2 - expected))
    # first order in the step: contact lasts 2.7 ms, one step is 1/135 of it
    assert errors[0] < 0.01
    assert errors[1] < 0.7 * errors[0] + 1e-6


@pytest.mark.parametrize("adhesion", [NEGLIGIBLE, 3000.0])
def test_a_sliding_sphere_ends_rolling_at_five_sevenths(soil, adhesion):
    """Without rolling friction and tangential spring memory, slip turns to roll at 5/7 of the speed."""
    law = {"rolling_friction": NEGLIGIBLE, "cohesive_stiffness_newton_per_m": adhesion}
    engine = soil.engine("soil.bin.length_m=0.4", law=law)
    rest = 0.008 - MASS * 9.81 / BOUNDARY_STIFFNESS
    engine.place([(0.05, 0.0, engine.bed.lower_m[2] + rest)], [(0.35, 0.0, 0.0)])
    engine.start(())
    run(engine, 6000)
    v, w = engine.velocities_m_per_s()[0], engine.angular_velocities_rad_per_s()[0]
    # about the contact point, which lies in the middle of the overlap: arm l = r - delta / 2
    arm = 0.5 * (0.01 + rest)
    inertia = 0.4 * 0.01**2
    rolling = 0.35 * arm**2 / (arm**2 + inertia)
    assert_allclose(v[0], rolling, rtol=2e-3)
    assert_allclose(w[1] * arm, v[0], rtol=2e-3)


def test_gross_sliding_decelerates_by_friction_times_normal_force(soil):
    """While it slips, m dv/dt = -mu (m g + peak attraction of the boundary)."""
    engine = soil.engine("soil.bin.length_m=0.4", law={"rolling_friction": NEGLIGIBLE})
    rest = 0.008 - MASS * 9.81 / BOUNDARY_STIFFNESS
    engine.place([(0.05, 0.0, engine.bed.lower_m[2] + rest)], [(3.0, 0.0, 0.0)])
    engine.start(())
    run(engine, 40)
    peak = 7000.0 * 3000.0 / 10_000.0 * 0.002  # K_B in series times delta_B
    assert_allclose(engine.forces_newton()[0, 0], -0.5 * (MASS * 9.81 + peak), rtol=1e-6)


def test_rolling_friction_stops_a_rolling_sphere(soil):
    """A rolling sphere loses speed at the rate of the torque limit mu_r r N."""
    law = FREE | {"rolling_friction": 0.02, "damping_newton_s_per_m": 20.0}
    engine = soil.engine("soil.bin.length_m=0.6", law=law)
    rest = 0.008 - MASS * 9.81 / BOUNDARY_STIFFNESS
    arm = 0.5 * (0.01 + rest)
    engine.place([(0.05, 0.0, engine.bed.lower_m[2] + rest)], [(0.5, 0, 0)], [(0.0, 0.5 / arm, 0.0)])
    engine.start(())
    run(engine, 2000)  # the rolling spring winds up first
    first = engine.velocities_m_per_s()[0, 0]
    run(engine, 4000)
    rate = (first - engine.velocities_m_per_s()[0, 0]) / (4000 * 5e-5)
    inertia = 0.4 * MASS * 0.01**2
    expected = 0.02 * 0.01 * MASS * 9.81 / (MASS * arm + inertia / arm)
    assert_allclose(rate, expected, rtol=0.02)


@pytest.mark.parametrize("law", [LINEAR, HERTZ], ids=["linear", "hertz_mindlin"])
def test_a_dry_grid_bed_stands_still(soil, law):
    """Touching spheres without adhesion rest on each other at the overlap that carries the layers above."""
    engine = soil.engine(
        book=law is HERTZ,
        soil={
            "bin": {"length_m": 0.12, "width_m": 0.1, "depth_m": 0.1},
            "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
            "bed": {"kind": "grid", "spacing_m": 0.02},
            "law": law,
        },
    )
    before = engine.positions_m()
    engine.start(())
    run(engine, 300)
    assert np.abs(engine.positions_m() - before).max() < 1e-11


def test_the_energy_a_collision_loses_is_in_the_sinks(soil):
    """An oblique collision with friction, rolling and adhesion, after which the pair sticks: kinetic +
    stored + sinks is constant up to first order in the step."""
    slippery = {"static_friction": 0.05, "sliding_friction": 0.05}

    def defect(step):
        engine = soil.engine(f"soil.time_step_s={step}", "gravity_m_per_s2=0", book=True, law=slippery)
        engine.place(
            [(0.04, 0.0, -0.05), (0.063, 0.006, -0.052)],
            [(0.6, 0.1, 0.0), (-0.5, 0.0, 0.2)],
            [(15.0, 0.0, 2.0), (0.0, -17.0, 0.0)],
        )
        engine.start(())
        before = engine.energy()
        run(engine, round(0.02 / step))
        after = engine.energy()
        assert after.kinetic_joule < 0.7 * before.kinetic_joule
        assert after.sinks_joule["normal_dashpot"] > 0.0
        assert after.sinks_joule["sliding"] > 0.0
        return abs(after.total_joule - before.total_joule) / sum(after.sinks_joule.values())

    coarse, fine = defect(2e-5), defect(1e-5)
    # the dashpot's time constant m / C = 0.4 ms over a step of 20 us: half a step's share is 2.7 %
    assert coarse < 0.03
    assert 1.8 < coarse / fine < 2.2


def test_displacements_count_from_the_prepared_bed_whoever_is_removed(soil, one, at):
    """A free particle is displaced by velocity times time; one that the tool removed leaves no shift."""
    engine = soil.engine("gravity_m_per_s2=0", tools=one(soil.box(0.02, 0.02, 0.02)))
    engine.place(
        [(0.02, 0.0, -0.05), (0.06, 0.0, -0.05), (0.09, 0.03, -0.05)], [(0.1, 0, 0), (0, 0, 0), (0, -0.2, 0)]
    )
    motions = at(x_m=0.06, z_m=-0.05)
    engine.start(motions)
    assert engine.particle_count == 2
    run(engine, 200, motions)
    assert_allclose(engine.displacements_m(), [(1e-3, 0, 0), (0, -2e-3, 0)], atol=1e-15)
