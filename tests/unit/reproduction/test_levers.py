"""Levers of the shipped machine, and what they make impossible, against figures by hand and the engine."""

import math
from pathlib import Path

import numpy as np
import pytest

from reproduction.yuan_yu_2020.consistency import statements
from reproduction.yuan_yu_2020.levers import levers_of, rest_angle_rad
from subsoil_ros.coupling.engines import build_mechanism
from subsoil_ros.loading.loader import load_scene
from tests.unit.reproduction.shank_angle import relative_angle_rad

SCENES = Path(__file__).parents[3] / "config/scenes"


@pytest.fixture(scope="module")
def scene():
    """The paper's machine at 0.30 m depth."""
    return load_scene(SCENES / "mechanism_only.yaml").scene


def test_levers_of_the_machine(scene):
    """Spring 0.25 m above the hinge, hinge 0.40 m above the soil, inertia by Steiner."""
    found = levers_of(scene)
    assert found.spring_arm_m == pytest.approx(0.25)
    depth = -scene.report.tip_m[1]
    hinge = scene.mechanism.joints["H8_shank_hinge"].point_m[1]
    assert found.tip_lever_m == pytest.approx(hinge + depth)
    assert found.tip_lever_m == pytest.approx(0.70)
    com = (
        np.array(scene.mechanism.bodies["shank"].position_m)
        - scene.mechanism.joints["H8_shank_hinge"].point_m
    )
    assert found.inertia_kg_m2 == pytest.approx(2.662 + 35.2 * float(com @ com))
    # 345 N at 20 mm in front of the hinge swing the tip back, as a draft does
    assert found.unloaded_newton == pytest.approx(35.2 * 9.81 * 0.02 / 0.25)
    assert found.frequency_hz == pytest.approx(
        math.sqrt(176500.0 * 0.25**2 / found.inertia_kg_m2) / 2 / math.pi
    )


def test_spring_at_rest_is_that_of_the_engine():
    """The quick scene starts in equilibrium: shank against frame stands where the levers say, but for the
    tilt of the frame (1 mrad of it moves 345 N of weight by 0.25 mm against 11 kN m/rad: below 1e-5 rad)."""
    resolved = load_scene(SCENES / "subsoiler_1s300_quick.yaml")
    assert rest_angle_rad(resolved.scene) == pytest.approx(relative_angle_rad(resolved), abs=2e-5)
    force = next(f for f in build_mechanism(resolved).state("", -1, 0).forces if f.name == "H9_spring")
    # there the centre of mass is 20 mm + 0.25 m x angle in front of the hinge; tilt, cosines: 0.5 N of spring
    found = levers_of(resolved.scene)
    part = 1.0 + 0.25 * rest_angle_rad(resolved.scene) / 0.02
    assert found.unloaded_newton * part == pytest.approx(force.load, abs=0.5)


def test_a_draft_compresses_the_spring(scene):
    """1000 N on the share press the spring by 1000 N times 0.62 m over 0.25 m, and back again."""
    found = levers_of(scene)
    force = found.spring_newton(1000.0)
    assert force - found.unloaded_newton == pytest.approx(1000.0 * found.share_lever_m / 0.25)
    assert force > 2000.0
    assert found.draft_newton(force, found.share_lever_m) == pytest.approx(1000.0)


def test_what_cannot_hold(scene):
    """0.11 rad lift the shank by millimetres. 2231 N of tension need -900 N of draft at rest; at -331 N
    inertia has to take up the rest, and a released shank does: stiffness of the spring times arm times half
    the swing."""
    found = levers_of(scene)
    by_claim = {item.claim.split()[0] + " " + item.claim.split()[1]: item for item in statements(found, 0.5)}
    released = 176500.0 * 0.25 * 0.055
    tension = by_claim["the spring"]
    assert tension.needed == pytest.approx(found.unloaded_newton - 331.06 * 0.70 / 0.25 + 2231.0)
    assert tension.available == pytest.approx(released)
    assert tension.holds
    at_share = (-2231.0 - found.unloaded_newton) * 0.25 / found.share_lever_m
    assert at_share == pytest.approx(-900.0, rel=0.02)
    assert f"{at_share:.0f} N" in tension.finding
    phase = by_claim["2623 N"]
    assert phase.needed == pytest.approx(2623.0 - found.unloaded_newton - 363.0 * 0.70 / 0.25)
    assert phase.holds
    height = by_claim["181 mm"]
    assert height.available == pytest.approx(0.25 * (1.0 - math.cos(0.11)) + 0.02 * math.sin(0.11), rel=0.3)
    assert not height.holds
    assert not by_claim["both printed"].holds
    assert by_claim["the energy"].holds


def test_no_levers_without_a_spring():
    """A locked shank, a tool on a path: nothing to say."""
    assert levers_of(load_scene(SCENES / "tine.yaml").scene) is None
    assert levers_of(load_scene(SCENES / "subsoiler_1s300_locked.yaml").scene) is None
