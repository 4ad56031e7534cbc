"""Variants of the machine load, assemble, and differ in what they say and nothing else."""

from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.signal import lfilter

from reproduction.yuan_yu_2020 import fit_machine, two_readings
from reproduction.yuan_yu_2020.levers import levers_of, rest_angle_rad
from reproduction.yuan_yu_2020.machine_variants import (
    at_depth,
    coarse_soil,
    locked_shank,
    on_plain_ground,
    start_places,
)
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.yaml_document import dump_yaml
from tests.unit.reproduction.shank_angle import relative_angle_rad

SCENES = Path(__file__).parents[3] / "config/scenes"
GIVEN_TO = 1e-6
"""Angles of the links stand in the scene to so many radians; bodies are brought together by projection."""


def loaded(document: dict, folder: Path) -> ResolvedScene:
    """A document as a scene file, read back."""
    path = folder / "variant.yaml"
    path.write_text(dump_yaml(document), encoding="utf-8")
    return load_scene(path)


def tip_height_m(resolved: ResolvedScene) -> float:
    """z of the tip at the start."""
    scene = resolved.scene
    _, z, angle = start_places(resolved)["shank"]
    reference = scene.mechanism.bodies["shank"].position_m
    dx, dz = scene.report.tip_m[0] - reference[0], scene.report.tip_m[1] - reference[1]
    return z + sin(angle) * dx + cos(angle) * dz


@pytest.mark.parametrize("angle", [0.0, -0.12])
@pytest.mark.parametrize("start", ["end_wall", "lowered"])
def test_locked_shank_stands_at_its_angle(start, angle, tmp_path):
    """The joint in the spring's place holds the angle against the frame, whatever the start; the spring is
    gone."""
    found = loaded(
        locked_shank(load_scene(SCENES / "subsoiler_1s300.yaml", [f"initial_condition={start}"]), angle),
        tmp_path,
    )
    assert "H9_spring" not in found.scene.mechanism.forces
    shank, frame = (found.scene.mechanism.bodies[name].angle_rad for name in ("shank", "frame"))
    places = start_places(found)
    assert places["shank"][2] - shank - (places["frame"][2] - frame) == pytest.approx(angle, abs=1e-9)


def test_shipped_locked_scene_holds_the_angle_of_rest():
    """As the sprung machine starts; another angle by --set."""
    name = SCENES / "subsoiler_1s300_locked.yaml"
    sprung, locked = (
        start_places(load_scene(SCENES / f"subsoiler_1s300{end}.yaml")) for end in ("", "_locked")
    )
    for body, place in sprung.items():  # x moves by 2.5 mm: drivers give way while the bodies are closed
        assert locked[body][1:] == pytest.approx(place[1:], abs=1e-9)
    nominal = start_places(load_scene(name, ["mechanism.initial.coordinates.shank.angle_rad=0.0"]))
    assert nominal["shank"][2] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("depth", [0.18, 0.26])
def test_another_depth_moves_the_machine_over_its_wheels(depth, tmp_path):
    """The tip's height changes by the difference, levers and wheels stay."""
    first = load_scene(SCENES / "subsoiler_1s300.yaml")
    found = loaded(at_depth(first, depth), tmp_path)
    rise = -first.scene.report.tip_m[1] - depth
    assert found.scene.report.tip_m[1] == -depth
    assert tip_height_m(found) - tip_height_m(first) == pytest.approx(rise, abs=GIVEN_TO)
    assert start_places(found)["wheel_left"][1] == pytest.approx(start_places(first)["wheel_left"][1])
    assert rest_angle_rad(found.scene) == pytest.approx(rest_angle_rad(first.scene), abs=1e-9)
    one, two = levers_of(first.scene), levers_of(found.scene)
    assert two.tip_lever_m == pytest.approx(one.tip_lever_m)
    assert two.spring_arm_m == pytest.approx(one.spring_arm_m)


def test_lowered_to_another_depth_starts_where_it_did(tmp_path):
    """The tip stands at the surface, the shank at rest on its spring, and the chain lets down by so much
    less."""
    parameters = {"depth_m": 0.18, "friction_normal": "absolute", "start": "lowered", "damping": 500.0}
    ranges = yaml.safe_load(fit_machine.FIT.read_text())["parameters"]
    path = fit_machine.variant(SCENES / "subsoiler_1s300.yaml", parameters, ranges, tmp_path, None)
    found, first = (
        load_scene(path),
        load_scene(SCENES / "subsoiler_1s300.yaml", ["initial_condition=lowered"]),
    )
    assert -0.005 < tip_height_m(found) < 0.015
    assert relative_angle_rad(found) == pytest.approx(rest_angle_rad(found.scene), abs=1e-6)
    old, new = (scene.scene.mechanism.forces["chain"].target for scene in (first, found))
    rise = -first.scene.report.tip_m[1] - 0.18
    assert new.values[0] == old.values[0]
    assert new.values[1] - old.values[1] == pytest.approx(rise)
    assert (new.values[1] - new.values[0]) / (new.times_s[1] - new.times_s[0]) == pytest.approx(
        (old.values[1] - old.values[0]) / (old.times_s[1] - old.times_s[0])
    )
    assert found.scene.soil.law.friction_normal == "absolute"
    fitted = levers_of(found.scene)
    assert fitted.spring_arm_m == pytest.approx(fit_machine.statics(ranges, 0.18)["spring_lever_m"])
    assert fitted.share_lever_m / fitted.spring_arm_m == pytest.approx(4854.0 / 1823.81, rel=1e-3)


def test_coarse_machine_on_plain_ground(tmp_path):
    """Wheels stand on wheel contacts, particles are larger under the scaled law, in a bin of its own."""
    document = on_plain_ground(at_depth(load_scene(SCENES / "subsoiler_1s300.yaml"), 0.2))
    found = loaded(coarse_soil(document, 0.02, (1.2, 0.6, 0.4)), tmp_path)
    assert list(found.scene.tools) == ["shank"]
    assert {f"ground_wheel_{side}" for side in ("left", "right")} <= set(found.scene.mechanism.forces)
    soil = found.scene.particle_soil
    assert (soil.particles.radius_m, soil.particles.reference_radius_m, soil.bin.length_m) == (
        0.02,
        0.01,
        1.2,
    )


def test_matrix_of_both_readings_loads(tmp_path):
    """Every case of a start has a scene; a coarse and a whole one are read back."""
    cases = list(two_readings.matrix())
    assert len({case.name for case in cases}) == len(cases)
    whole = load_scene(two_readings.scene_of(cases[0], tmp_path, None)).scene
    dense = next(case for case in cases if case.bed == "dense_random")
    coarse = load_scene(two_readings.scene_of(dense, tmp_path, 0.02)).scene
    assert whole.particle_soil.particles.radius_m == 0.01
    assert coarse.particle_soil.bed.kind == "dense_random"
    working_m = coarse.soil.bin.length_m - 2.0 * coarse.report.window_inside_m
    assert working_m >= 0.5 * two_readings.STEADY_S


def test_what_weakens_slides_on_half(tmp_path):
    """Sliding friction half of static at particles and boundaries, the limit that of `total`."""
    case = next(case for case in two_readings.matrix() if case.friction == "weakening")
    law = load_scene(two_readings.scene_of(case, tmp_path, 0.02)).scene.particle_soil.law
    assert law.friction_normal == "total"
    for row in (law.particle, law.boundary):
        assert row.sliding_friction == 0.5 * row.static_friction


def test_a_period_repeats_itself():
    """A sine of 0.9 s is found on a trend; noise that is correlated over 0.05 s has none."""
    times, noise = np.arange(0.0, 6.6, 0.0016), np.random.default_rng(0).normal(size=4125)
    period, height = two_readings.repeat_period(times, 3.0 * times + np.sin(2.0 * np.pi * times / 0.9))
    assert (period, height) == pytest.approx((0.9, 1.0), abs=0.01)
    red = np.zeros(len(times))
    for i in range(1, len(times)):
        red[i] = red[i - 1] * np.exp(-0.0016 / 0.05) + noise[i]
    assert two_readings.repeat_period(times, red)[1] < two_readings.REGULAR


@pytest.mark.parametrize(("part", "least", "most"), [(0.3, 0, 4), (0.5, 4, 16), (0.7, 19, 20)])
def test_how_strong_a_period_must_be(part, least, most):
    """1 Hz in 6 s of red noise of 0.05 s, with that part of the power: how many of 20 are found."""
    times, random = np.arange(0.0, 6.0, 0.0016), np.random.default_rng(1)
    hold = np.exp(-0.0016 / 0.05)
    found = 0
    for _ in range(20):
        white = random.standard_normal(len(times) + 500)
        noise = lfilter([np.sqrt(1.0 - hold**2)], [1.0, -hold], white)[500:]
        tone = np.sqrt(2.0) * np.sin(2.0 * np.pi * times + random.uniform(0.0, 6.0))
        period, height = two_readings.repeat_period(times, np.sqrt(1.0 - part) * noise + np.sqrt(part) * tone)
        found += height >= two_readings.REGULAR and 0.4 <= period <= 2.0
    assert least <= found <= most


def test_statics_of_the_fit():
    """Inside the ranges, with the printed relations met: 44.1 kN/rad, 2.66 N of spring for one of draft."""
    ranges = yaml.safe_load(fit_machine.FIT.read_text())["parameters"]
    found = fit_machine.statics(ranges, 0.30)
    for name in ("spring_stiffness_newton_per_m", "spring_lever_m", "free_length_m"):
        low, high = ranges[name]["range"]
        assert low <= found[name] <= high, name
    lever = found["spring_lever_m"]
    assert found["spring_stiffness_newton_per_m"] * lever == pytest.approx(4854.0 / 0.11, rel=1e-3)
    assert 0.619 / lever == pytest.approx(4854.0 / 1823.81, rel=1e-3)


def test_score_counts_what_is_held():
    """The printed values themselves hold all; a wrong sign and a factor of two do not."""
    exact = fit_machine.targets()
    assert len(exact) == 9
    found = fit_machine.score(exact)
    assert (found["held"], found["rms_log"]) == (len(fit_machine.targets()), pytest.approx(0.0, abs=1e-12))
    wrong = {"series.draft_newton.mean": 2.0 * 681.5, "series.draft_newton.run.moving_10ms.min": 331.0}
    worse = fit_machine.score({**exact, **wrong})
    assert worse["held"] == len(fit_machine.targets()) - 2
    assert worse["rms_log"] > 0.7
