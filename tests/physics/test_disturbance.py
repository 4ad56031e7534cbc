"""Disturbance of a lattice whose moved part is known."""

import csv

import numpy as np
import pytest

from subsoil_ros.analysis.disturbance import (
    Places,
    disturbance_between,
    write_height_map_csv,
    write_section_csv,
)
from subsoil_ros.messages import SoilCloud

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
