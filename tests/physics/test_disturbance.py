"""Disturbance of a lattice whose moved part is known."""

import csv
from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.analysis.disturbance import (
    Places,
    disturbance_between,
    passed_slab_m,
    write_height_map_csv,
    write_section_csv,
)
from subsoil_ros.analysis.series import Series
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import SoilCloud, ToolMotion, ToolMotions
from subsoil_ros.scene.bed_kinds import SurfaceProfile

SCENES = Path(__file__).parents[2] / "config/scenes"
RADIUS = 0.01


def lattice() -> np.ndarray:
    """A bed 0.6 m long, 0.4 m wide and 0.2 m deep of touching spheres, its top at z = 0."""
    x, y, z = (np.arange(count) * 2.0 * RADIUS for count in (30, 20, 10))
    grid = np.stack(np.meshgrid(x + RADIUS, y - 0.2 + RADIUS, z - 0.2 + RADIUS, indexing="ij"), axis=-1)
    return grid.reshape(-1, 3)


def test_a_moved_prism_is_found_again():
    """A prism 0.12 m wide and 0.10 m deep, lifted by 30 mm: area, width, lift and moved part of it alone."""
    before = lattice()
    after = before.copy()
    prism = (np.abs(before[:, 1]) < 0.06) & (before[:, 2] > -0.10)
    after[prism, 2] += 0.03
    found = disturbance_between(before, after, (0.1, 0.5), RADIUS)
    assert found.bed_section_m2 == pytest.approx(0.4 * 0.2)
    assert found.area_m2 == pytest.approx(0.12 * 0.10)
    assert found.moved_fraction == pytest.approx(0.12 * 0.10 / 0.08)
    assert found.surface_width_m == pytest.approx(0.12)
    assert found.max_lift_m == pytest.approx(0.03)
    assert found.lifted_area_m2 == pytest.approx(0.12 * 0.03)
    assert found.moved_map.shape == (10, 20)
    assert found.moved_map[9, 10] == 1.0  # uppermost layer, mid-plane
    assert found.moved_map[0, 10] == 0.0


def test_motion_of_less_than_a_radius_does_not_count():
    """A bed that settles by 0.9 radii is not loosened; one by 1.1 radii is, all of it."""
    before = lattice()
    assert (
        disturbance_between(before, before - (0.0, 0.0, 0.9 * RADIUS), (0.1, 0.5), RADIUS).moved_fraction
        == 0.0
    )
    assert (
        disturbance_between(before, before - (0.0, 0.0, 1.1 * RADIUS), (0.1, 0.5), RADIUS).moved_fraction
        == 1.0
    )


def test_only_the_slab_counts():
    """What moves before and behind the slab is left out; an empty slab says nothing."""
    before = lattice()
    after = before.copy()
    after[before[:, 0] > 0.3, 2] += 0.05
    assert disturbance_between(before, after, (0.1, 0.3), RADIUS).moved_fraction == 0.0
    assert disturbance_between(before, after, (0.2, 0.4), RADIUS).moved_fraction == pytest.approx(0.5)
    assert disturbance_between(before, after, (5.0, 6.0), RADIUS) is None


def test_the_loosened_section_is_known_along_the_way(tmp_path):
    """A prism whose depth doubles half way: the slices show both depths, their mean is that of the slab, and
    its interval is written down."""
    before = np.concatenate([lattice() + np.array((0.6 * k, 0.0, 0.0)) for k in range(3)])
    after, middle = before.copy(), 0.9
    deep = np.where(before[:, 0] < middle, 0.04, 0.08)
    prism = (np.abs(before[:, 1]) < 0.06) & (before[:, 2] > -deep)
    after[prism, 2] += 0.03
    found = disturbance_between(before, after, (0.1, 1.7), RADIUS)
    first, second = found.slice_m2[found.slices_m < 0.86], found.slice_m2[found.slices_m > 0.94]
    assert first == pytest.approx(0.12 * 0.04, rel=1e-9)
    assert second == pytest.approx(0.12 * 0.08, rel=1e-9)
    assert found.slice_m2.mean() == pytest.approx(found.area_m2, rel=1e-9)
    assert 0.0 < found.metrics()["area_half_width_m2"] < 0.02
    write_section_csv(found, tmp_path / "loosened_section.csv")
    with (tmp_path / "loosened_section.csv").open() as stream:
        rows = [(float(row["x_m"]), float(row["area_m2"])) for row in csv.DictReader(stream)]
    assert np.allclose(rows, np.column_stack((found.slices_m, found.slice_m2)), rtol=1e-5)


def test_a_particle_that_crosses_a_periodic_side_has_not_moved_far():
    """Whoever leaves on the left and comes in on the right moved by less than a radius."""
    before = lattice()
    after = before + np.array([0.0, 0.5 * RADIUS, 0.0])
    wrapped = after[:, 1] > 0.2 - RADIUS + 1e-12
    assert wrapped.any()
    after[wrapped, 1] -= 0.4
    assert disturbance_between(before, after, (0.1, 0.5), RADIUS).moved_fraction == pytest.approx(
        wrapped.mean()
    )
    assert disturbance_between(before, after, (0.1, 0.5), RADIUS, period_m=0.4).moved_fraction == 0.0


def test_a_periodic_bed_is_as_wide_as_its_period():
    """No sides hold its outermost particles, so they reach over them; of a random bed from side to side."""
    before = lattice() * (1.0, 0.40 / 0.38, 1.0)
    after = before.copy()
    after[before[:, 2] > -0.10, 2] += 0.03
    found = disturbance_between(before, after, (0.1, 0.5), RADIUS, period_m=0.4)
    assert found.area_m2 == pytest.approx(0.4 * 0.10)
    assert found.surface_width_m == pytest.approx(0.4)


def test_the_section_of_a_slope_is_that_of_the_bed_below_it():
    """A bed 0.2 m deep, whose surface falls to half its depth, a strip of which moves: slice by slice what is
    left of it, and the width at the surface of all of the slope."""
    slope = SurfaceProfile(x_m=(0.0, 0.6), z_m=(0.0, -0.10))
    before = lattice()
    before = before[before[:, 2] + RADIUS <= np.interp(before[:, 0], slope.x_m, slope.z_m) + 1e-9]
    after = before.copy()
    strip = np.abs(before[:, 1]) < 0.06
    after[strip, 2] += 0.03
    found = disturbance_between(before, after, (0.1, 0.5), RADIUS, surface=slope)
    assert found.area_m2 == pytest.approx(0.12 * 0.15, rel=0.04)  # layers are 20 mm thick
    heights = 0.2 + np.interp(found.slices_m, slope.x_m, slope.z_m)
    assert found.slice_m2 == pytest.approx(0.12 * heights, rel=0.07)
    assert found.slice_m2.mean() == pytest.approx(found.area_m2, rel=0.02)
    assert found.surface_width_m == pytest.approx(0.12)


def height_of(way: str, x_m: float) -> float:
    """How much higher than at work a tine is: lifted out, or plunged in, 1 m from the start of its bin."""
    return {"whole": 0.0, "lifted": 0.5 * (x_m > 1.0), "plunged": 0.5 * (x_m < 1.0)}[way]


@pytest.mark.parametrize(
    ("way", "slab"), [("whole", (0.2, 1.8)), ("lifted", (0.2, 0.824)), ("plunged", (1.2, 1.8))]
)
def test_the_slab_is_what_the_tool_has_passed(way, slab):
    """From 0.2 m behind where the tip comes into the soil to where the rear of the share, 176 mm behind it,
    was last in it, or to 0.2 m before the end."""
    resolved = load_scene(SCENES / "tine.yaml", ("soil.bin.length_m=2.0",))
    tip = np.arange(-0.0475, 2.5, 0.005)
    z = np.array([0.1 + height_of(way, x) for x in tip])
    columns = {"time_s": 0.01 * np.arange(len(tip)), "tool.tine.x_m": tip - 0.12, "tool.tine.z_m": z}
    series = Series(columns | {"tool.tine.angle_rad": 0.0 * tip}, "run", 1.0)
    motions = [
        ToolMotions("run", k, 10_000_000 * k, (ToolMotion("tine", tip[k] - 0.12, 0.0, z[k], *[0.0] * 4),))
        for k in range(len(tip))
    ]
    found = passed_slab_m(series, resolved, motions, motions[-1].end_time_ns)
    assert found == pytest.approx(slab, abs=0.006)  # a row is 5 mm


def test_soil_under_a_tool_in_the_air_is_not_passed():
    """A tine that stays above the soil, and one that comes into it after the last cloud."""
    resolved = load_scene(SCENES / "tine.yaml", ("soil.bin.length_m=2.0",))
    times = np.array((0.0, 1.0, 2.0, 3.0))
    for z, until_ns in ((np.full(4, 0.6), 3_000_000_000), (np.array((0.6, 0.6, 0.6, 0.1)), 2_000_000_000)):
        columns = {"time_s": times, "tool.tine.x_m": 0.5 * times, "tool.tine.z_m": z}
        series = Series(columns | {"tool.tine.angle_rad": 0.0 * times}, "run", 1.0)
        motion = ToolMotion("tine", 1.0, 0.0, float(z[2]), *[0.0] * 4)
        start, end = passed_slab_m(series, resolved, [ToolMotions("run", 0, until_ns, (motion,))], until_ns)
        assert end < start


def test_height_map_file(tmp_path):
    """One row for each cell, the lift in metres."""
    before = lattice()
    found = disturbance_between(before, before + np.array([0.0, 0.0, 0.02]), (0.1, 0.5), RADIUS)
    write_height_map_csv(found.lift, tmp_path / "height_map.csv")
    with (tmp_path / "height_map.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == found.lift.height_m.size
    assert {row["lift_m"] for row in rows} == {"0.02"}


def test_soil_that_comes_and_goes_is_followed_by_its_identity():
    """First where it came in, last where it was seen last."""
    places = Places()
    at = [np.full((2, 3), 0.0), np.full((3, 3), 1.0), np.full((2, 3), 2.0)]
    for cloud, identities in zip(at, ([1, 5], [1, 5, 40], [40, 3]), strict=True):
        places.see(SoilCloud(0, 0, cloud, np.zeros(len(cloud)), np.array(identities, np.uint32)))
    assert places.first_m[:, 0].tolist() == [0.0, 0.0, 1.0, 2.0]
    assert places.last_m[:, 0].tolist() == [1.0, 1.0, 2.0, 2.0]
