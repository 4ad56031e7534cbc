"""Layers of depth, with equal spheres and with several sizes: density and law by depth, beds, files."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.packing.bed_file import read_bed, write_bed
from subsoil_ros.dem.packing.bed_report import masses_kg, report_bed
from subsoil_ros.errors import SceneError

RADIUS = 0.01
HARD = {
    "kind": "cohesive_linear",
    "particle": {"stiffness_newton_per_m": 20_000.0, "cohesive_stiffness_newton_per_m": 14_000.0},
    "boundary": {"stiffness_newton_per_m": 8_000.0},
}
LAYERS = [
    {"name": "topsoil", "thickness_m": 0.05},
    {"name": "hardpan", "density_kg_per_m3": 2400.0, "law": HARD},
]
SIZES = {"kind": "uniform", "min_radius_m": 0.008, "max_radius_m": 0.013, "seed": 4}


def layered(maker, *overrides, law=None, **changes):
    """The small scene with two layers; `changes` replace keys of its soil."""
    part = {**maker.scene(law=law).document["soil"], "layers": LAYERS, **changes}
    return maker.scene(*overrides, soil=part)


def run(engine, steps, motions=()):
    """`steps` ticks with the tools standing at `motions`."""
    for tick in range(steps):
        engine.advance(tick, motions)


@pytest.mark.full
@pytest.mark.parametrize("reading", ["series", "none"])
def test_a_column_of_two_layers_stands_on_its_own_springs(soil, reading):
    """The overlap of every pair beyond rest is the weight above over K of that pair: half of each layer's own
    between equal bodies, K1 K2 / (K1 + K2) between the layers (eq. 15), twice that for values of pairs."""
    scene = layered(soil, f"soil.law.combining_rule={reading}", "soil.time_step_s=2.5e-5")
    engine = build_engine(scene)
    z = engine.bed.positions_m[:5, 2]  # one column, from below
    assert np.ptp(engine.bed.positions_m[:5, :2], axis=0).max() == 0.0
    weight = 9.81 * 4.0 / 3.0 * np.pi * RADIUS**3 * np.array([2400.0, 2400.0, 1800.0, 1800.0, 1800.0])
    above = np.cumsum(weight[::-1])[::-1]
    stiffness = np.array([20e3 / 2.0, 10e3 * 20e3 / 30e3, 10e3 / 2.0, 10e3 / 2.0]) * (
        2.0 if reading == "none" else 1
    )
    assert_allclose(0.018 - np.diff(z), above[1:] / stiffness, atol=1e-16)
    at_floor = 8e3 if reading == "none" else 20e3 * 8e3 / 28e3
    assert_allclose(0.008 - (z[0] - engine.bed.lower_m[2]), above[0] / at_floor, atol=1e-16)
    before = engine.positions_m()
    engine.start(())
    run(engine, 200)
    assert np.abs(engine.positions_m() - before).max() < 1e-12
    per_layer = len(before) / 5
    report = report_bed(engine.bed, scene.scene.soil)
    assert [layer.particle_count for layer in report.layers] == [3 * per_layer, 2 * per_layer]
    depth = -engine.bed.lower_m[2]
    area = np.prod(np.subtract(engine.bed.upper_m, engine.bed.lower_m[:2]))
    sphere = 4.0 / 3.0 * np.pi * RADIUS**3
    assert_allclose(
        report.layers[0].density_kg_per_m3,
        3 * per_layer * sphere * 1800.0 / (area * (report.top_mean_m + 0.05)),
        rtol=1e-9,
    )
    assert_allclose(
        report.layers[1].density_kg_per_m3,
        2 * per_layer * sphere * 2400.0 / (area * (depth - 0.05)),
        rtol=1e-9,
    )
    assert_allclose(
        engine.energy().gravity_joule, (masses_kg(engine.bed, scene.scene.soil) * before[:, 2]).sum() * 9.81
    )


@pytest.mark.full
def test_layers_that_say_nothing_of_their_own_change_nothing(soil):
    """A soil cut into two equal layers moves as the one without: pair numbers are the same to round-off."""
    same = [{"name": "upper", "thickness_m": 0.05}, {"name": "lower"}]
    whole = build_engine(soil.scene("soil.bed.jitter_m=0.0005"))
    parts = build_engine(layered(soil, "soil.bed.jitter_m=0.0005", layers=same))
    for engine in (whole, parts):
        engine.start(())
        run(engine, 200)
    assert np.ptp(parts.materials()) == 1
    assert np.abs(whole.displacements_m()).max() > 1e-5
    assert_allclose(parts.positions_m(), whole.positions_m(), rtol=0.0, atol=1e-12)


@pytest.mark.full
def test_depth_counts_from_the_surface_before_it_is_trimmed(soil):
    """Under a profile that takes half of the topsoil away, the hardpan is where it was."""
    grid = {"kind": "grid", "spacing_m": "rest"}
    cut = {"x_m": [0.0], "z_m": [-0.03]}
    whole = build_engine(layered(soil, bed=grid)).bed
    rest = build_engine(layered(soil, bed=grid, surface=cut)).bed
    assert (rest.materials == 1).sum() == (whole.materials == 1).sum()
    assert 0 < (rest.materials == 0).sum() < (whole.materials == 0).sum()
    assert_allclose(
        rest.positions_m[rest.materials == 1, 2].max(),
        whole.positions_m[whole.materials == 1, 2].max(),
        atol=1e-4,  # less weight presses on it: 0.15 N on springs of 6 kN/m and more
    )


@pytest.fixture
def both(soil):
    """A scene with sizes and layers, and its dense random bed."""
    scene = layered(
        soil,
        bed={"kind": "dense_random", "seed": 2},
        bin={"length_m": 0.2, "width_m": 0.16, "depth_m": 0.14},
        layers=[{"name": "topsoil", "thickness_m": 0.07}, LAYERS[1]],
        particles={"sizes": SIZES, "density_kg_per_m3": 1800.0},
        time_step_s="auto",
    )  # fmt: skip
    return scene, build_engine(scene).bed


@pytest.mark.full
def test_a_dense_bed_of_sizes_and_layers_stands_still(both):
    """Under the full law no particle moves farther than 1 % of a radius in a second would take it; all walls
    are touched; layers follow depth, but for what the relaxation moved; radii follow the distribution."""
    scene, bed = both
    report = report_bed(bed, scene.scene.soil)
    assert max(gap.max_m for gap in report.wall_gaps.values()) < 0.0
    assert_allclose(-bed.lower_m[2], 0.14, atol=0.01)
    depth = -bed.positions_m[:, 2]
    upper, lower = depth[bed.materials == 0], depth[bed.materials == 1]
    assert upper.max() < 0.07 + 0.5 * RADIUS
    assert lower.min() > 0.07 - 0.5 * RADIUS
    # twice the standard deviation of the mean of a uniform distribution
    assert abs(bed.radii_m.mean() - 0.0105) < 2.0 * 0.005 / np.sqrt(12.0 * len(bed.radii_m))
    counts = [layer.particle_count for layer in report.layers]
    assert sum(counts) == len(bed.positions_m) == report.particle_count
    whole = np.prod(np.subtract(bed.upper_m, bed.lower_m[:2])) * -bed.lower_m[2]
    assert_allclose(report.density_kg_per_m3, masses_kg(bed, scene.scene.soil).sum() / whole, rtol=1e-9)
    first, second = (layer.density_kg_per_m3 for layer in report.layers)
    assert 1.2 < second / first < 1.5  # 4 / 3 by the particles; the free top is looser
    engine = SoilEngine(scene, bed, book=True)
    engine.start(())
    before = engine.positions_m()
    ticks = round(0.01 / scene.timing.communication_step_s)
    run(engine, ticks)
    moved = np.linalg.norm(engine.positions_m() - before, axis=1)
    assert np.sqrt((moved**2).mean()) < 0.01 * RADIUS * 0.01


def test_a_bed_file_carries_sizes_and_layers(both, tmp_path):
    """They come back as they were, and a file whose radii or layers cannot be is refused."""
    scene, bed = both
    part, path = scene.scene.soil, tmp_path / "bed.npz"
    write_bed(path, bed, part)
    back = read_bed(path, part)
    for field in dataclasses.fields(Bed):
        assert_array_equal(getattr(back, field.name), getattr(bed, field.name))
    for wrong in (
        dataclasses.replace(bed, radii_m=bed.radii_m[:-1]),
        dataclasses.replace(bed, radii_m=2.0 * bed.radii_m),
        dataclasses.replace(bed, materials=bed.materials + 1),
    ):
        write_bed(path, wrong, part)
        with pytest.raises(SceneError, match=r"radii_m|materials"):
            read_bed(path, part)


def test_sizes_and_layers_give_the_same_bits_for_any_number_of_threads(soil, both, one, at):
    """A box drawn through a bed of both: positions, spins and wrench, to the last bit."""
    scene, bed = both
    tools = one(soil.box(0.02, 0.05, 0.1))
    scene = soil.scene(soil=scene.document["soil"], tools=tools)
    found = []
    for threads in (1, 2):
        engine = SoilEngine(scene, bed, threads, book=True)
        engine.start(at(x_m=0.05, z_m=-0.05))
        for tick in range(60):
            x_m = 0.05 + 0.5 * (tick + 1) * scene.timing.communication_step_s
            wrench = engine.advance(tick, at(x_m=x_m, z_m=-0.05, vx=0.5))[0]
        found.append((engine.positions_m(), engine.angular_velocities_rad_per_s(), wrench, engine.energy()))
    assert_array_equal(found[0][0], found[1][0])
    assert_array_equal(found[0][1], found[1][1])
    assert found[0][2:] == found[1][2:]
    assert abs(found[0][2].force_x_newton) > 1.0


@pytest.mark.full  # the only test of this variant of the kernels
def test_mixed_precision_knows_sizes_and_layers(soil):
    """The same bed in mixed precision: a distance of 18 mm in float32 is off by 2 nm, its spring's force by K
    times that, and six such forces move a particle by no more than half their acceleration times t^2.
    (Dampers of zone 1 alone would switch a step earlier or later.)"""
    changes = ("soil.time_step_s=2.5e-5", "soil.law.damped_zones=all")
    bed = build_engine(layered(soil, *changes)).bed
    moved = []
    for precision in ("float64", "mixed"):
        engine = SoilEngine(layered(soil, *changes, f"soil.precision={precision}"), bed)
        engine.place(bed.positions_m, np.random.default_rng(2).normal(0.0, 0.05, bed.positions_m.shape))
        engine.start(())
        run(engine, 100)
        moved.append(engine.displacements_m())
    mass = 1800.0 * 4.0 / 3.0 * np.pi * RADIUS**3
    off = 6.0 * 10e3 * np.finfo(np.float32).eps * 0.018 / mass
    assert np.abs(moved[0]).max() > 1e-5
    assert_allclose(moved[1], moved[0], rtol=0.0, atol=0.5 * off * (100 * 2.5e-5) ** 2)
