"""The report of a bed, against beds whose state is known."""

import argparse
import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.cli import check
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.free_motion import free_motion
from subsoil_ros.dem.packing.bed_file import read_bed
from subsoil_ros.dem.packing.bed_report import report_bed

RADIUS, SPACING, MASS = 0.01, 0.018, 1800.0 * 4.0 / 3.0 * np.pi * 0.01**3


@pytest.fixture
def grid(soil):
    """A grid bed without weight: every distance is the spacing. And its soil."""
    scene = soil.scene("gravity_m_per_s2=0")
    return build_engine(scene).bed, scene.scene.soil


def test_grid_has_the_density_bonds_and_overlap_of_a_grid(grid):
    """n spheres in the box, 6 neighbours less those missing at the faces, no overlap beyond rest."""
    bed, soil = grid
    report = report_bed(bed, soil)
    nx, ny, nz = 6, 5, 5
    assert report.particle_count == nx * ny * nz
    bonds = (nx - 1) * ny * nz + nx * (ny - 1) * nz + nx * ny * (nz - 1)
    assert_allclose(report.coordination, 2.0 * bonds / (nx * ny * nz), rtol=1e-12)
    assert_allclose(report.max_overlap_m, 0.0, atol=1e-12)
    area = (SPACING * (nx - 1) + 0.016) * (SPACING * (ny - 1) + 0.016)
    height = SPACING * (nz - 1) + 0.008 + RADIUS + report.top_mean_m
    assert_allclose(report.density_kg_per_m3, nx * ny * nz * MASS / (area * height), rtol=1e-12)


def test_layers_have_their_own_particles_and_densities(soil):
    """Of five levels two are in the topsoil; the hardpan is heavier by the ratio of densities."""
    pan = {"name": "hardpan", "density_kg_per_m3": 2400.0}
    layers = [{"name": "topsoil", "thickness_m": 0.036}, pan]
    document = soil.scene().document["soil"]
    scene = soil.scene("gravity_m_per_s2=0", soil={**document, "layers": layers})
    bed = build_engine(scene).bed
    top, pan = report_bed(bed, scene.scene.soil).layers
    assert (top.name, pan.name) == ("layer topsoil", "layer hardpan")
    assert (top.particle_count, pan.particle_count) == (60, 90)
    lower = -bed.floor_m - 0.036
    assert_allclose(pan.density_kg_per_m3, 90 * MASS * 2400.0 / 1800.0 / (area_m2(bed) * lower), rtol=1e-12)


def area_m2(bed):
    """Floor of a bed."""
    return (bed.upper_m[0] - bed.lower_m[0]) * (bed.upper_m[1] - bed.lower_m[1])


def test_top_of_a_grid_is_felt_by_a_sphere(grid):
    """On a particle the top is at its pole, over the middle of four a r (2 - sqrt(4 - (s/r)^2 / 2)) lower."""
    bed, soil = grid
    report = report_bed(bed, soil)
    deepest = RADIUS * (2.0 - np.sqrt(4.0 - 0.5 * (SPACING / RADIUS) ** 2))
    assert -0.5 * deepest < report.top_mean_m < -0.1 * deepest
    assert 0.0 < report.top_spread_m < 0.5 * deepest


def test_gaps_at_walls_are_those_of_the_grid_and_of_a_wall_moved_away(grid):
    """Every wall overlaps its layer by the rest overlap; one moved by 30 mm has a gap of 28 mm."""
    bed, soil = grid
    for gap in report_bed(bed, soil).wall_gaps.values():
        assert_allclose([gap.mean_m, gap.max_m], -0.002, atol=1e-12)
    away = dataclasses.replace(bed, upper_m=(bed.upper_m[0] + 0.03, bed.upper_m[1]))
    gaps = report_bed(away, soil).wall_gaps
    assert_allclose([gaps["far"].mean_m, gaps["far"].max_m], 0.028, atol=1e-12)
    assert_allclose(gaps["near"].max_m, -0.002, atol=1e-12)


def test_largest_void_is_that_of_the_cell_and_of_a_missing_particle(grid):
    """Between eight spheres sqrt(3)/2 s - r; where one is missing s - r. To the lattice's last step, r / 32
    along each axis."""
    bed, soil = grid
    tolerance = np.sqrt(3.0) * RADIUS / 32.0
    found = report_bed(bed, soil).max_void_radius_m
    assert_allclose(found, 0.5 * np.sqrt(3.0) * SPACING - RADIUS, atol=tolerance)
    middle = (bed.lower_m[0] + 0.008 + 2 * SPACING, 0.0, -RADIUS - 2 * SPACING)
    kept = np.linalg.norm(bed.positions_m - middle, axis=1) > 1e-6
    assert kept.sum() == len(kept) - 1
    report = report_bed(dataclasses.replace(bed, positions_m=bed.positions_m[kept]), soil)
    assert_allclose(report.max_void_radius_m, SPACING - RADIUS, atol=tolerance)
    assert_allclose(report.max_void_at_m, middle, atol=tolerance)


def test_free_motion_tells_a_bed_at_rest_from_one_that_contracts(soil):
    """The grid at rest moves by round-off; spheres that just touch pull together by a tenth of a mm."""
    quiet, loose = soil.scene(), soil.scene("soil.bed.spacing_m=0.02")
    still = free_motion(quiet, build_engine(quiet).bed, 1, 0.005)
    assert still.max_move_m < 1e-12
    assert still.kinetic_energy_joule < 1e-18
    pulled = free_motion(loose, build_engine(loose).bed, 1, 0.005)
    assert pulled.max_move_m > 1e-4
    assert pulled.kinetic_energy_joule > 1e-4


def test_check_prints_the_report_and_writes_the_bed(soil, capsys):
    """`subsoil check SCENE --bed --bed-out FILE`: the report on the terminal, the bed in the file."""
    parser = argparse.ArgumentParser()
    check.add_arguments(parser)
    scene, out = soil.scene(), soil.folder / "bed.npz"
    assert check.run(parser.parse_args([str(scene.path), "--bed", "--bed-out", str(out)])) == 0
    printed = capsys.readouterr().out
    for word in ("density", "coordination", "largest void", "gap at far wall", "alone for 20 ms"):
        assert word in printed
    np.testing.assert_array_equal(
        read_bed(out, scene.scene.soil).positions_m, build_engine(scene).bed.positions_m
    )
