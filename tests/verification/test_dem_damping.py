"""Lagged damping: one constant, the explicit law as the step goes to zero, stable where that is not."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.cli.main import main
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.errors import SceneError
from subsoil_ros.scene.damping import damping_ratios, integrated_values, largest_lagged_step_s
from subsoil_ros.scene.limits import Timing, step_limits
from subsoil_ros.scene.pairs import pair_values, particle_mass_kg

MASS = 1800.0 * 4.0 / 3.0 * np.pi * 0.01**3


def with_soil(maker, **changes):
    """The small scene with other keys of its soil."""
    return maker.scene(soil=maker.scene().document["soil"] | changes)


def lagged(maker, step_s, **changes):
    """The small scene with lagged damping at a step."""
    return with_soil(maker, damping="lagged", time_step_s=step_s, force_lagged_damping=True, **changes)


def test_the_effective_damper_is_the_closed_form(soil):
    """C / (1 + 4 C dt / m_eff): m/2 and m/7 for two particles, m and 2m/7 at a boundary; springs stay."""
    scene = lagged(soil, 2.0e-5)
    found = integrated_values(scene.scene.soil, 2.0e-5)
    assert particle_mass_kg(scene.scene.soil) == pytest.approx(MASS)
    masses = ((0.5 * MASS, MASS / 7.0), (MASS, 2.0 * MASS / 7.0))
    for values, plain, (normal, tangential) in zip(found, pair_values(scene.scene.soil), masses, strict=True):
        assert values.damping == pytest.approx(10.0 / (1.0 + 4.0 * 10.0 * 2.0e-5 / normal), rel=1e-14)
        assert values.tangential_damping == pytest.approx(
            10.0 / (1.0 + 4.0 * 10.0 * 2.0e-5 / tangential), rel=1e-14
        )
        unchanged = dataclasses.replace(values, damping=10.0, tangential_damping=10.0)
        assert unchanged == plain


def test_damping_is_explicit_unless_the_scene_says_so(soil):
    """No name, no change: the ratios are 1, the values those of the law."""
    plain = soil.scene().scene.soil
    assert integrated_values(plain, 5.0e-5) == pair_values(plain)
    assert {ratio.smallest for ratio in damping_ratios(plain, 5.0e-5)} == {1.0}


def test_auto_takes_the_step_that_leaves_half_of_every_damper(soil):
    """The tangential one of a pair binds: dt = m / (7 z C), in whole microseconds."""
    scene = with_soil(soil, damping="lagged", time_step_s="auto")
    assert largest_lagged_step_s(scene.scene.soil) == pytest.approx(MASS / 280.0)
    assert scene.timing.interval_ns == 26_000
    assert damping_ratios(scene.scene.soil, scene.timing.soil_step_s)[0].smallest >= 0.5


def test_less_than_half_a_damper_is_refused_unless_forced(soil):
    """The message has the ratio, the largest step and the key that forces it."""
    with pytest.raises(SceneError, match=r"leaves 0.35 of a lagged .*2.7e-05 s.*force_lagged_damping: true"):
        with_soil(soil, damping="lagged", time_step_s=5.0e-5)
    lagged(soil, 5.0e-5)


def test_the_limit_is_that_of_the_lagged_dampers(soil):
    """At the limit the rate of the lagged damper times the step is 2; spin, lagged, has no limit at all."""
    part = lagged(soil, 1.0e-4).scene.soil
    dampers = [limit for limit in step_limits(part) if "lagged" in limit.cause]
    assert [("translation" in limit.cause) for limit in dampers] == [True]
    limit_s = dampers[0].limit_s
    damper = integrated_values(part, limit_s)[0].damping
    assert 2.0 * 10.4 * damper / MASS * limit_s == pytest.approx(2.0, rel=1e-12)
    with pytest.raises(
        SceneError, match=r"stable limit 0.000314 s \(lagged damping 10 N s/m acting on transl"
    ):
        lagged(soil, 4.0e-4)


def test_hertz_is_refused(soil):
    """Its dashpots grow with the overlap: no constant."""
    row = {
        "youngs_modulus_pa": 1e7, "poisson_ratio": 0.3, "restitution": 0.5,
        "static_friction": 0.5, "sliding_friction": 0.5,
    }  # fmt: skip
    law = {"kind": "hertz_mindlin", "particle": row, "boundary": row}
    with pytest.raises(SceneError, match="'lagged' weakens dampers that do not depend on the overlap"):
        with_soil(soil, damping="lagged", time_step_s="auto", law=law)


def rms_spin(engine, ticks):
    """Largest rms spin [rad/s] of a bed left alone after a knock."""
    generator = np.random.default_rng(0)
    place = engine.bed.positions_m
    engine.place(place, None, generator.normal(0.0, 1.0, place.shape))
    engine.start(())
    for tick in range(ticks):
        engine.advance(tick, ())
    return engine.state("", ticks - 1, 0).rms_spin_rad_per_s


def test_it_is_stable_where_explicit_damping_is_not(soil):
    """A grid at 1.3 of its own explicit limit (z = 6: 94 us): spins die out lagged, fill the bed explicit."""
    step = 1.2e-4
    assert rms_spin(SoilEngine(lagged(soil, step)), 300) < 0.05
    forced = with_soil(soil, time_step_s=step, force_time_step=True, monitors=None)
    assert rms_spin(SoilEngine(forced), 300) > 5.0


def approach(maker, damping, step_ns):
    """Velocity [m/s] of the second of two particles 2 ms after they met at 0.5 m/s, off centre."""
    soil = maker.scene().document["soil"] | {"damping": damping}
    scene = maker.scene(soil=soil | {"time_step_s": "auto"}, gravity_m_per_s2=0.0)
    scene = dataclasses.replace(scene, timing=Timing(step_ns, 10**9, soil_steps=1, mechanism_steps=0))
    engine = SoilEngine(scene)
    engine.place([[0.05, 0.0, -0.05], [0.069, 0.004, -0.05]], [[0.25, 0.0, 0.0], [-0.25, 0.0, 0.0]])
    engine.start(())
    for tick in range(2_000_000 // step_ns):
        engine.advance(tick, ())
    return engine.velocities_m_per_s()[1]


def test_it_becomes_the_explicit_law_as_the_step_goes_to_zero(soil):
    """A damped collision: the difference between the two is of first order, it halves with the step."""
    away = [
        np.linalg.norm(approach(soil, "lagged", step_ns) - approach(soil, "explicit", step_ns))
        for step_ns in (2000, 1000, 500)
    ]
    assert away[2] > 1e-6
    assert_allclose([away[0] / away[1], away[1] / away[2]], 2.0, rtol=0.1)


def test_check_prints_what_is_left_of_the_dampers(soil, capsys):
    """C_eff / C, normal and tangential, of pairs and at boundaries."""
    scene = with_soil(soil, damping="lagged", time_step_s="auto")
    assert main(["check", str(scene.path)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "at 26 us C_eff / C is 0.784 normal and 0.509 tangential between particles, 0.879" in text
