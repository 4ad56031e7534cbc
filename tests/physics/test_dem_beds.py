"""Dense random beds: packed as random close packing is, at rest under the full law, the same for any
number of threads."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from subsoil_ros.dem.bed import ignore_progress, scaled
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.free_motion import free_motion
from subsoil_ros.dem.packing.bed_geometry import top_surface_m
from subsoil_ros.dem.packing.bed_report import report_bed
from subsoil_ros.dem.packing.dense_random import prepare_dense
from subsoil_ros.dem.packing.relaxation import settling_step_s, smooth_soil
from subsoil_ros.errors import SceneError
from subsoil_ros.limits.stable_steps import step_limits, step_notes
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.pair_laws import pair_values, particle_mass_kg

SCENES = Path(__file__).parents[2] / "config" / "scenes"
DENSE_BED = Path(__file__).parents[2] / "benchmarks" / "dense_bed.yaml"
RADIUS = 0.01
MASS = 1800.0 * 4.0 / 3.0 * np.pi * RADIUS**3
REACH = 2.0 * RADIUS + 0.002  # delta_B
STEP_S = 4.0e-5  # 0.87 of the bed's own limit


def dense(maker, seed=0, bed=None, **changes):
    """A scene with a dense random bed of about 1,100 particles."""
    soil = {
        **maker.scene().document["soil"],
        "bin": {"length_m": 0.2, "width_m": 0.18, "depth_m": 0.14},
        "bed": bed or {"kind": "dense_random", "seed": seed},
        "time_step_s": STEP_S,
        **changes,
    }
    return maker.scene(soil=soil)


@pytest.fixture
def engine(soil):
    """Engine on the dense bed of seed 0."""
    return build_engine(dense(soil))


def test_dense_bed_has_the_neighbours_of_random_close_packing(engine):
    """Inside: 11 to 11.5 bonds in reach (10.4 with the surfaces of a bed of 9,000), none at all ordered."""
    x = engine.bed.positions_m
    bonds = np.array(sorted(cKDTree(x).query_pairs(REACH)))
    degree = np.bincount(bonds.ravel(), minlength=len(x))
    low = np.array(engine.bed.lower_m) + 3.0 * RADIUS
    high = np.array([*engine.bed.upper_m, 0.0]) - 3.0 * RADIUS
    inside = ((x > low) & (x < high)).all(axis=1)
    assert inside.sum() > 100
    assert 10.7 < degree[inside].mean() < 11.8
    # spheres of the rest distance: 0.64 when settled, denser by what the bonds pull together
    volume = np.prod(high - low)
    assert 0.64 < inside.sum() * np.pi / 6.0 * 0.018**3 / volume < 0.73


def test_dense_bed_stands_still_under_the_full_law(engine):
    """Friction, rolling and dampers switched on: no particle moves farther than the rest speed, 1 % of the
    radius in a second, would carry it."""
    engine.start(())
    before = engine.positions_m()
    duration_s = 400 * STEP_S
    for tick in range(400):
        engine.advance(tick, ())
    moved = np.linalg.norm(engine.positions_m() - before, axis=1)
    assert np.sqrt((moved**2).mean()) < 0.01 * RADIUS * duration_s
    state = engine.state("r", 0, 0)
    assert state.rms_speed_m_per_s < 0.01 * RADIUS
    assert state.lost_particle_count == 0


def test_dense_bed_fills_its_bin(soil, engine):
    """Top at z = 0 in the mean, walls within half a diameter of the bin, all of every wall touched."""
    bed = engine.bed
    assert_allclose(top_surface_m(bed, RADIUS).mean(), 0.0, atol=1e-12)
    assert_allclose(bed.upper_m[0], 0.2, atol=RADIUS)
    assert_allclose(2.0 * bed.upper_m[1], 0.18, atol=RADIUS)
    assert_allclose(-bed.lower_m[2], 0.14, atol=RADIUS)
    gaps = report_bed(bed, dense(soil).scene.soil).wall_gaps
    assert max(gap.max_m for gap in gaps.values()) < 0.0


def test_dense_bed_is_neither_stretched_nor_pressed(soil, engine):
    """Scaled with its walls by one part in a thousand, larger or smaller, its energy grows: the least lies
    at the size it has, to what the relaxation after the last change of size leaves (0.05 %)."""
    scene, step = dense(soil), 1e-3
    x, y, floor = engine.bed.lower_m
    standing = dataclasses.replace(
        engine.bed, positions_m=engine.bed.positions_m - (0.0, 0.0, floor), lower_m=(x, y, 0.0)
    )  # scaled about its floor, for weight to count

    def energy(scale):
        return SoilEngine(scene, scaled(standing, scale)).potential_joule()

    smaller, here, larger = energy(1.0 - step), energy(1.0), energy(1.0 + step)
    assert here < min(smaller, larger)
    least = 0.5 * step * (smaller - larger) / (smaller - 2.0 * here + larger)
    assert abs(least) < 5e-4


def test_dense_bed_is_the_same_for_any_number_of_threads(soil, engine):
    """Bit for bit; another seed gives another bed."""
    scene = dense(soil)
    assert_array_equal(build_engine(scene, 2).bed.positions_m, engine.bed.positions_m)
    other = build_engine(dense(soil, seed=1)).bed.positions_m
    assert other.shape != engine.bed.positions_m.shape or not np.allclose(other, engine.bed.positions_m)


@pytest.mark.parametrize(("bed", "step_us", "warned"), [
    ("dense_random", 32.0, True), ("dense_random", 22.0, False), ("grid", 32.0, False),
])  # fmt: skip
def test_a_dense_bed_near_its_limit_is_warned_of(bed, step_us, warned):
    """Before the paper's machine it spins at 32 us and is calm at 22 (yuan_yu_2020/accuracy.md)."""
    keys = {"kind": bed} if bed == "dense_random" else {"kind": bed, "spacing_m": "rest"}
    path = SCENES / "subsoiler_1s300_quick.yaml"
    changes = [f"soil.bed={json.dumps(keys)}", f"soil.time_step_s={step_us * 1e-6:.2e}"]
    found = load_scene(path, changes)
    notes = step_notes(found.scene, found.timing.soil_step_s)
    assert any("random bed that a tool compacts may spin" in note for note in notes) == warned


def test_a_step_that_springs_limit_is_not_warned_of():
    """This scene takes 0.6 of a limit set by springs, which is 0.38 of that set by dampers."""
    scene = load_scene(DENSE_BED)
    limits, step_s = step_limits(scene.scene.particle_soil), scene.timing.soil_step_s
    assert not limits[0].damped
    damped_s = next(limit.limit_s for limit in limits if limit.damped)
    assert 0.36 < step_s / damped_s < 0.41
    assert step_notes(scene.scene, step_s) == ()
    assert "may spin" in step_notes(scene.scene, 0.42 * damped_s)[0]


def test_stiff_contacts_settle_softly():
    """Under the weight of the bed, taken for solid, the lowest contacts overlap by 0.5 % of the radius; the
    damping ratio stays, and with both the step grows with the root of the stiffness. The paper's law is
    softer already and stays as it is."""
    soil = load_scene(DENSE_BED).scene.particle_soil
    radius, (stiff, _) = 0.015, pair_values(soil)
    loose, _ = pair_values(smooth_soil(soil, adhesive=False))
    weight = 2310.0 * 9.81 * 0.28 * (2.0 * radius) ** 2
    assert_allclose(weight / loose.stiffness, 0.005 * radius, rtol=1e-12)
    assert_allclose(loose.damping**2 / loose.stiffness, stiff.damping**2 / stiff.stiffness, rtol=1e-12)
    assert loose.adhesion == 0.0
    bonded = smooth_soil(soil, adhesive=True)
    assert pair_values(bonded)[0].stiffness == stiff.stiffness
    ratio = settling_step_s(smooth_soil(soil, adhesive=False)) / settling_step_s(bonded)
    assert ratio > 0.9 * np.sqrt(stiff.stiffness / loose.stiffness)
    paper = load_scene(SCENES / "tine.yaml", ["soil.bed={kind: dense_random}"]).scene.particle_soil
    assert pair_values(smooth_soil(paper, adhesive=False))[0].stiffness == pair_values(paper)[0].stiffness


@pytest.mark.full
def test_a_bed_of_stiff_contacts_stands_still():
    """Its relaxation ends before it is at rest without friction. With that of the run, which holds what is
    out of balance, no particle moves farther in 20 ms than a thousandth of the radius (rms)."""
    resolved = load_scene(DENSE_BED, ["soil.bin={length_m: 0.36, width_m: 0.36, depth_m: 0.24}"])
    soil = resolved.scene.particle_soil
    bed = prepare_dense(resolved, 0, 1, ignore_progress)
    assert 0.58 < len(bed.positions_m) * particle_mass_kg(soil) / 2310.0 / (0.36 * 0.36 * 0.24) < 0.64
    moved = free_motion(resolved, bed, 1, 0.02)
    assert moved.rms_move_m < 1e-3 * soil.particles.radius_m


def test_rest_spacing_is_that_of_the_law(soil):
    """`spacing_m: rest` is 2 r - delta_c: the same grid, standing still."""
    named = build_engine(dense(soil, bed={"kind": "grid", "spacing_m": "rest"}))
    given = build_engine(dense(soil, bed={"kind": "grid", "spacing_m": 0.018}))
    assert_allclose(named.bed.positions_m, given.bed.positions_m, rtol=0.0, atol=1e-15)


RAMP = {"x_m": [0.05, 0.15], "z_m": [0.0, -0.06]}


def top_over_x(bed):
    """Place and mean height over y of the columns."""
    top = top_surface_m(bed, RADIUS).mean(axis=1)
    return (np.arange(len(top)) + 0.5) / len(top) * bed.upper_m[0], top


def test_surface_profile_trims_a_grid(soil):
    """Without weight: no particle reaches above the profile, every one below it stays where it was."""
    grid = {"kind": "grid", "spacing_m": "rest"}
    part = dense(soil, bed=grid).document["soil"]
    whole = build_engine(soil.scene("gravity_m_per_s2=0", soil=part)).bed
    cut = build_engine(soil.scene("gravity_m_per_s2=0", soil={**part, "surface": RAMP})).bed
    x, _, z = whole.positions_m.T
    below = z + RADIUS <= np.interp(x, RAMP["x_m"], RAMP["z_m"]) + 1e-9
    assert 0.5 < below.mean() < 0.95
    assert_allclose(cut.positions_m, whole.positions_m[below], rtol=0.0, atol=1e-15)
    assert cut.lower_m == whole.lower_m


def test_a_trimmed_grid_carries_the_weight_that_is_left(soil):
    """Columns side by side differ by their weight only: none moves farther in 5 ms than what the weight
    of one layer presses one contact together, m g / K."""
    scene = dense(soil, bed={"kind": "grid", "spacing_m": "rest"}, surface=RAMP)
    motion = free_motion(scene, build_engine(scene).bed, 1, 0.005)
    assert motion.max_move_m < MASS * 9.81 / 5000.0


def test_surface_profile_trims_a_dense_bed_before_it_relaxes(soil):
    """The top follows the profile to a third of a radius in the mean and one radius everywhere; at rest."""
    scene = dense(soil, surface=RAMP)
    engine = build_engine(scene)
    x, top = top_over_x(engine.bed)
    off = top - np.interp(x, RAMP["x_m"], RAMP["z_m"])
    assert_allclose(off.mean(), 0.0, atol=1e-12)
    assert np.sqrt((off**2).mean()) < RADIUS / 3.0
    assert np.abs(off).max() < RADIUS
    engine.start(())
    for tick in range(100):
        engine.advance(tick, ())
    assert engine.state("r", 0, 0).rms_speed_m_per_s < 0.01 * RADIUS


@pytest.mark.parametrize(
    ("surface", "message"),
    [
        ({"x_m": [0.0, 0.1], "z_m": [0.0, 0.01]}, r"soil.surface.z_m.*it must be a number at most 0"),
        ({"x_m": [0.0, 0.1], "z_m": [0.0]}, r"soil.surface.z_m: has 1 heights for the 2 places"),
        ({"x_m": [0.1, 0.1], "z_m": [0.0, -0.1]}, r"soil.surface.x_m: must grow"),
        ({"x_m": [0.0], "z_m": [-0.13]}, r"soil.surface.z_m: -0.13 m .* at least -0.12 m"),
    ],
)
def test_a_wrong_surface_profile_is_refused(soil, surface, message):
    """Above the bed, of unequal lengths, not growing, below the floor."""
    with pytest.raises(SceneError, match=message):
        dense(soil, surface=surface)
