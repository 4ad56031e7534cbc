"""Mixed precision, positions float64 and the rest float32, against float64."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

EPSILON = float(np.finfo(np.float32).eps)

SLIPPERY = {"static_friction": 0.05, "sliding_friction": 0.04, "rolling_friction": 0.02}

pytestmark = pytest.mark.full  # two variants of the kernels


def collided(soil, precision, law, steps=400):
    """Two particles that meet obliquely, spinning, without gravity; they slide, roll and stick."""
    engine = soil.engine("gravity_m_per_s2=0", f"soil.precision={precision}", book=True, law=law)
    engine.place(
        [(0.04, 0.0, -0.05), (0.061, 0.006, -0.052)],
        [(0.4, 0.1, 0.0), (-0.3, 0.0, 0.2)],
        [(5.0, 0.0, 2.0), (0.0, -7.0, 0.0)],
    )
    engine.start(())
    for tick in range(steps):
        engine.advance(tick, ())
    return engine


@pytest.mark.parametrize("law", [{}, SLIPPERY])
def test_a_collision_differs_by_the_rounding_of_float32(soil, law):
    """Two bodies are not chaotic: 400 steps add at most 400 roundings of the largest speed and spin."""
    double, mixed = (collided(soil, precision, law) for precision in ("float64", "mixed"))
    assert_allclose(
        mixed.velocities_m_per_s(), double.velocities_m_per_s(), rtol=0.0, atol=400 * EPSILON * 0.5
    )
    assert_allclose(
        mixed.angular_velocities_rad_per_s(),
        double.angular_velocities_rad_per_s(),
        rtol=0.0,
        atol=400 * EPSILON * 50.0,
    )
    assert_allclose(mixed.positions_m(), double.positions_m(), rtol=0.0, atol=400 * EPSILON * 0.5 * 0.02)
    assert double.angular_velocities_rad_per_s().max() < 50.0
    for sink, joule in double.energy().sinks_joule.items():
        assert mixed.energy().sinks_joule[sink] == pytest.approx(joule, rel=1e-3, abs=1e-9), sink


def test_a_slow_particle_far_from_the_origin_keeps_moving(soil):
    """At x = 2 m one float32 place is 0.2 um: a particle of 1 um/s would stand still in float32."""
    engine = soil.engine("gravity_m_per_s2=0", "soil.precision=mixed", "soil.bin.length_m=2.5", book=True)
    engine.place([(2.0, 0.0, -0.05)], [(1e-6, 0.0, 0.0)])
    engine.start(())
    for tick in range(2000):
        engine.advance(tick, ())
    assert_allclose(engine.positions_m()[0, 0] - 2.0, 1e-7, rtol=1e-6)


def test_the_bed_stands_still_in_mixed_precision(soil):
    """Forces of 7 N round by 4e-7 N, as accelerations 6e-5 m/s2; contacts hold the particles in place."""
    engine = soil.engine("soil.precision=mixed", book=True)
    before = engine.positions_m()
    engine.start(())
    for tick in range(400):
        engine.advance(tick, ())
    # rounding of a contact's force over its stiffness
    assert np.abs(engine.positions_m() - before).max() < 10 * EPSILON * 7.0 / 5000.0
