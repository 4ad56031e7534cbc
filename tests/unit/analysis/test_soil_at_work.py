"""Soil at work: overlap, damping, inertial number against closed forms; what check and run print of it."""

import math
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

import subsoil_ros as subsoil
from subsoil_ros.api.check_scene import run_notes
from subsoil_ros.cli.main import main
from subsoil_ros.contact_laws.dampers import damping_ratio_at, restitution_at
from subsoil_ros.limits.soil_at_work import (
    damping_ratio,
    force_exponent,
    inertial_number,
    overlap_under,
)
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.soil import Soil
from tests.soils import ELASTIC, HERTZ, LINEAR

SCENES = Path(__file__).parents[3] / "config" / "scenes"
RADIUS_M, DENSITY, STRESS_PA = 0.01, 1800.0, 2e5
MASS_KG = DENSITY * 4.0 / 3.0 * math.pi * RADIUS_M**3
STIFF = {"soil.law.particle.stiffness_newton_per_m": 160000.0}


def soil_under(law: dict[str, Any]) -> Soil:
    """The tine's soil of 10 mm under another law."""
    return load_scene(SCENES / "tine.yaml", {"soil.law": law}).scene.particle_soil


def warnings_of(scene: str, overrides: dict[str, Any] | None = None) -> list[str]:
    """What a run says of the soil at work before it begins."""
    return [
        note for note in run_notes(load_scene(SCENES / f"{scene}.yaml", overrides or {})) if "law" in note
    ]


def test_overlap_of_a_linear_spring() -> None:
    """sigma d^2 / K over r."""
    found = overlap_under(soil_under(LINEAR), STRESS_PA)
    assert_allclose(found, STRESS_PA * 4.0 * RADIUS_M / 1e5, rtol=1e-14)


def test_overlap_of_hertzian_spheres() -> None:
    """F = 4/3 E* sqrt(R*) delta^1.5 with E* = E / (2 (1 - nu^2)) and R* = r / 2."""
    modulus = ELASTIC["youngs_modulus_pa"] / (2.0 * (1.0 - ELASTIC["poisson_ratio"] ** 2))
    overlap_m = overlap_under(soil_under(HERTZ), STRESS_PA) * RADIUS_M
    force = 4.0 / 3.0 * modulus * math.sqrt(0.5 * RADIUS_M) * overlap_m**1.5
    assert_allclose(force, STRESS_PA * (2.0 * RADIUS_M) ** 2, rtol=1e-14)


@pytest.mark.parametrize(("law", "exponent"), [(LINEAR, 1.0), (HERTZ, 1.5)])
def test_exponent_of_the_force(law: dict[str, Any], exponent: float) -> None:
    """1 of linear springs, 1.5 of Hertz."""
    assert_allclose(force_exponent(soil_under(law)), exponent, rtol=1e-12)


def test_damping_ratio_of_a_linear_pair() -> None:
    """C / (2 sqrt(K m / 2)): two spheres have half the mass of one."""
    assert_allclose(
        damping_ratio(soil_under(LINEAR)), 5.0 / (2.0 * math.sqrt(1e5 * 0.5 * MASS_KG)), rtol=1e-12
    )


@pytest.mark.parametrize("given", [0.1, 0.5, 0.9])
def test_hertzian_spheres_have_the_restitution_that_was_given(given: float) -> None:
    """Their damping ratio is that of the linear oscillator with the same restitution."""
    row = ELASTIC | {"restitution": given}
    soil = soil_under({"kind": "hertz_mindlin", "particle": row, "boundary": row})
    assert_allclose(restitution_at(damping_ratio(soil)), given, rtol=1e-12)


def test_restitution() -> None:
    """exp(-pi z / sqrt(1 - z^2)): of z = 0.6 exp(-3 pi / 4); 1 without damping, 0 if critically damped."""
    assert restitution_at(0.0) == 1.0
    assert_allclose(restitution_at(0.6), math.exp(-0.75 * math.pi), rtol=1e-14)
    assert [restitution_at(ratio) for ratio in (1.0, 1.5)] == [0.0, 0.0]
    for given in (1e-3, 0.3, 0.99, 1.0):
        assert_allclose(restitution_at(damping_ratio_at(given)), given, rtol=1e-12)


def test_inertial_number() -> None:
    """Written out with a diameter and a density: shear rate x d sqrt(rho / p)."""
    speed, depth, diameter, density = 0.7, 0.25, 0.02, 2650.0
    pressure = 0.6 * density * 9.81 * depth
    expected = speed / (10.0 * diameter) * diameter * math.sqrt(density / pressure)
    assert_allclose(inertial_number(speed, depth, 9.81), expected, rtol=1e-14)


def test_the_papers_soft_soil_is_warned_of() -> None:
    """What is given, the stiffness for 5 %, and that dampers bind the step; overdamped."""
    overlap, damping = warnings_of("tine")
    for words in (
        "warning: soil.law.particle.stiffness_newton_per_m: given 10000, needed 1.6e+05 or more for 5 %",
        "80 % of the radius beyond rest at 100 kPa, 240 % at 300 kPa",
        "the stable step stays 53.7 us (damping 10 N s/m acting on rotation",
    ):
        assert words in overlap
    assert "soil.law.particle.damping_newton_s_per_m: given 20, needed 17.4 or less" in damping
    assert "draft rises with speed through dashpots" in damping


def test_what_a_warning_asks_for_is_enough() -> None:
    """With the stiffness that is named nothing is warned of, and the stable step stays."""
    soft, stiff = subsoil.check("tine"), subsoil.check("tine", STIFF)
    assert [found.warning for found in stiff.at_work] == [None, None, None]
    assert stiff.limits[0].limit_s == soft.limits[0].limit_s
    assert warnings_of("field_swing") == []


def test_a_step_that_springs_bind_falls() -> None:
    """The Rayleigh time falls with the root of the modulus, which grows as the overlap's power 1.5."""
    (told,) = warnings_of("tine", {"soil.law": HERTZ, "soil.bed.spacing_m": "rest"})
    factor = (overlap_under(soil_under(HERTZ), 1e5) / 0.05) ** 1.5
    assert f"youngs_modulus_pa: given 1e+07, needed {1e7 * factor:.3g} or more" in told
    limit_us = (
        subsoil.check("tine", {"soil.law": HERTZ, "soil.bed.spacing_m": "rest"}).limits[0].limit_s * 1e6
    )
    assert f"falls from {limit_us:.3g} us" in told
    assert f"to {limit_us / math.sqrt(factor):.3g} us" in told


def test_the_softest_layer_is_named() -> None:
    """The topsoil's own stiffness stands under its layer."""
    assert "soil.layers.0.law.particle.stiffness_newton_per_m: given 5000" in warnings_of("tine_hardpan")[0]


@pytest.mark.parametrize(
    ("scene", "overrides", "words"),
    [
        ("tine", {}, "0.5 m/s at 0.2 m: dense flow"),
        ("tine", {"tools.tine.path.speed_x_m_per_s.value": 0.005}, "quasi-static"),
        ("tine", {"tools.tine.path.start_z_m": 0.4}, "not known"),
        ("tine", {"gravity_m_per_s2": 0.0}, "not known"),
        ("subsoiler_1s300", {}, "tool shank, 0.5 m/s at 0.3 m"),  # at rest at the start, driven by a table
        ("subsoiler_1s300_draft_limit", {"controller.highest_speed": 0.8}, "tool shank, 0.8 m/s"),
        ("depth_wheel", {}, "not known"),
    ],
)
def test_speed_and_depth_of_the_tool(scene: str, overrides: dict[str, Any], words: str) -> None:
    """From the path, the drivers or the controller; wheels do not shear."""
    assert words in subsoil.check(scene, overrides).at_work[2].text


def test_a_collisional_tool_is_warned_of() -> None:
    """The speed that is named brings it to 0.1."""
    warning = subsoil.check("tine", {"tools.tine.path.speed_x_m_per_s.value": 2.5}).at_work[2].warning
    speed = 0.1 * 10.0 * math.sqrt(0.6 * 9.81 * 0.2)
    assert "tools.tine: inertial number 0.23" in warning
    assert f"needed for 0.1 is {speed:.3g} m/s or less" in warning


def test_check_prints_them(capsys: pytest.CaptureFixture[str]) -> None:
    """Three rows; warnings only where something is out of its range. Nothing without tools or particles."""
    rows = ("overlap at work", "damping ratio", "inertial number")
    assert main(["check", str(SCENES / "tine.yaml")]) == 0
    soft = capsys.readouterr().out
    changes = [part for key, value in STIFF.items() for part in ("--set", f"{key}={value}")]
    assert main(["check", str(SCENES / "tine.yaml"), *changes]) == 0
    stiff = capsys.readouterr().out
    assert all(row in soft and row in stiff for row in rows)
    assert ("warning:" in soft, "warning:" in stiff) == (True, False)
    assert subsoil.check("subsoiler_1s300_wedge").at_work == ()
    assert subsoil.check("tine", {"tools": {"tine": None}}).at_work == ()
