"""Tiled beds: a sample that repeats itself, pressed to a solid fraction, laid out and brought to rest."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from subsoil_ros.dem.bed import Bed, ignore_progress
from subsoil_ros.dem.build import prepare_bed
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.packing import bed_file
from subsoil_ros.dem.packing.bed_geometry import sample_edge_m
from subsoil_ros.dem.packing.bed_report import report_bed
from subsoil_ros.dem.packing.periodic_sample import PRESSED_OVERLAP, solid_fraction
from subsoil_ros.dem.packing.relaxation import PATIENCE, Rest, Settling
from subsoil_ros.dem.packing.replicate import cached_sample, replicated
from subsoil_ros.dem.packing.start import check_start
from subsoil_ros.dem.periodic import HELD_LAYER
from subsoil_ros.errors import SceneError
from tests.physics.conftest import most_move_m
from tests.soils import LINEAR
from tests.soils import PARTICLE as WET

DENSITY = 2500.0
SIZES = {"kind": "uniform", "min_radius_m": 0.0085, "max_radius_m": 0.0115}
SMALLEST, LARGEST = SIZES["min_radius_m"], SIZES["max_radius_m"]
BIN = {"length_m": 0.3, "width_m": 0.2, "depth_m": 0.12}
WIDE = {"length_m": 0.5, "width_m": 0.45, "depth_m": 0.16}


def tiled(maker, *, box=None, **bed):
    """A scene with a tiled bed of about 1,000 particles, from a sample of some 500."""
    soil = {
        "bin": BIN | (box or {}),
        "particles": {"sizes": SIZES, "density_kg_per_m3": DENSITY},
        "bed": {"kind": "tiled", "tile_m": 0.15} | bed,
        "law": LINEAR,
    }
    return maker.scene(soil=soil)


def tile_of(scene):
    """The pressed sample of a scene's bed, pressed once for all tests."""
    return cached_sample(scene, sample_edge_m(scene.scene.particle_soil), ignore_progress)


def repeated(sample, times):
    """An endless bed of `times` tiles along each axis: the same soil in a larger box."""
    edge = sample.periods_m[0]
    shift = np.stack(np.meshgrid(*[edge * np.arange(times)] * 3, indexing="ij"), -1).reshape(-1, 3)
    inside = sample.positions_m - np.array(sample.lower_m)
    size = times * edge
    corner = (0.0, -0.5 * size, -size)
    return Bed(
        (inside[None] + shift[:, None]).reshape(-1, 3) + corner, corner, (size, 0.5 * size),
        radii_m=np.tile(sample.radii_m, times**3), sides="endless",
    )  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("wanted", [0.57, 0.60, 0.63])
def test_a_tile_has_the_fraction_that_is_asked_for(soil, wanted):
    """Within 1 %: half of what bulk density may differ by; the more friction while pressing, the looser."""
    scene = tiled(soil, solid_fraction=wanted)
    sample = tile_of(scene)
    assert_allclose(solid_fraction(sample, scene.scene.particle_soil), wanted, rtol=0.01)
    assert sample.sides == "endless"


def test_a_tile_carries_its_pressure_on_all_faces(soil):
    """Virial theorem: the stress of the normal forces of overlapping spheres, seen across the periods, is
    PRESSED_OVERLAP K / (4 r) along each axis, to the pressing's tolerance and what 500 scatter."""
    scene = tiled(soil)
    bed = tile_of(scene)
    x, period = bed.positions_m - np.array(bed.lower_m), np.array(bed.periods_m)
    first, second = np.array(sorted(cKDTree(x, boxsize=period).query_pairs(2.0 * LARGEST))).T
    apart = x[second] - x[first]
    apart -= period * np.round(apart / period)
    distance = np.linalg.norm(apart, axis=1)
    overlap = np.maximum(bed.radii_m[first] + bed.radii_m[second] - distance, 0.0)
    unit, stiffness = apart / distance[:, None], 1e5
    stress = np.einsum("k,ka,kb->ab", stiffness * overlap * distance, unit, unit) / period.prod()
    radius = scene.scene.particle_soil.particles.mean_volume_radius_m
    pressure = PRESSED_OVERLAP * stiffness / (4.0 * radius)
    assert_allclose(np.trace(stress) / 3.0, pressure, rtol=0.06)
    assert_allclose(np.diag(stress), pressure, rtol=0.3)
    assert np.abs(stress - np.diag(np.diag(stress))).max() < 0.2 * pressure


def test_forces_in_a_repeated_tile_are_those_of_the_tile(soil):
    """Eight tiles in a box of twice the edge: no force knows where a sample ends, to round-off."""
    scene = tiled(soil)
    bed = tile_of(scene)
    alone, among = SoilEngine(scene, bed), SoilEngine(scene, repeated(bed, 2))
    for engine in (alone, among):
        engine.start(())
    force = alone.forces_newton()
    weight = DENSITY * 4.0 / 3.0 * np.pi * bed.radii_m**3 * scene.scene.gravity_m_per_s2
    contact = np.linalg.norm(force + weight[:, None] * (0.0, 0.0, 1.0), axis=1).max()
    assert contact > 0.01
    assert_allclose(among.forces_newton(), np.tile(force, (8, 1)), atol=1e-9 * np.abs(force).max() + 1e-9)


def test_an_endless_box_of_two_spheres_changes_size_as_its_energy_says(soil):
    """Two spheres that overlap across a border: K d^2 / 2, and its change when the box is resized."""
    scene = tiled(soil)
    size, radius = 0.2, 0.01
    places = np.array([[0.0045, 0.0, -0.1], [size - 0.0045, 0.0, -0.1]])
    bed = Bed(places, (0.0, -0.1, -size), (size, 0.1), radii_m=np.full(2, radius), sides="endless")
    engine = SoilEngine(scene, bed)
    engine.start(())
    at_rest = engine.energy().stored_joule
    assert_allclose(at_rest, 0.5 * 1e5 * (2.0 * radius - 0.009) ** 2, rtol=1e-12)
    engine.resize(1.01)
    assert_allclose(engine.energy().stored_joule, 0.5 * 1e5 * (2.0 * radius - 0.00909) ** 2, rtol=1e-9)
    assert_allclose(engine.bed.periods_m, (0.202, 0.202, 0.202))


@pytest.mark.full
def test_a_tiled_bed_fills_its_bin_at_its_density(soil):
    """Mean top at z = 0, density over depth that of the sample, walls not passed, a held floor.

    The density inside so small a bed scatters: six seeds differ by 0.0 % in the mean, with a standard
    deviation of 1.7 %, of which two are allowed. Each processor rounds, and so packs, in its own way.
    """
    scene = tiled(soil, box=WIDE)
    found = scene.scene.particle_soil
    bed = prepare_bed(scene, 2)
    report = report_bed(bed, found)
    assert_allclose(report.top_mean_m, 0.0, atol=1e-12)
    assert_allclose(report.density_inside_kg_per_m3, 0.60 * DENSITY, rtol=0.035)
    assert bed.positions_m[bed.held, 2].max() < -WIDE["depth_m"] + 0.001
    assert np.ptp(bed.positions_m[bed.held, 2]) > (HELD_LAYER - 0.5) * LARGEST
    assert_allclose(check_start(scene), len(bed.positions_m), rtol=0.15)


@pytest.mark.full
def test_nothing_lines_up_at_the_floor(soil):
    """Centres over the held floor, in slices of a quarter of a diameter: none has half as many again as the
    mean (random packings settled on a plane have nearly twice as many in their first layers)."""
    scene = tiled(soil, box=WIDE)
    bed = prepare_bed(scene, 2)
    x, y, z = bed.positions_m[~bed.held].T
    inner = (np.abs(x - 0.25) < 0.19) & (np.abs(y) < 0.165)
    height = z[inner] - bed.floor_m
    counts, _ = np.histogram(height, bins=np.arange(0.0, 0.101, 0.005))
    assert counts.max() < 1.5 * counts.mean()
    assert counts.min() > 0.5 * counts.mean()


def test_a_tiled_bed_stands_still_and_holds_its_floor(soil):
    """Left alone, 9 in 10 move by less than half a per cent of a radius; the held do not move by a bit."""
    scene = tiled(soil)
    bed = prepare_bed(scene)
    assert most_move_m(scene, bed, 0.05) < 0.005 * 0.01
    engine = SoilEngine(scene, bed)
    engine.start(())
    for tick in range(5):
        engine.advance(tick, ())
    assert_array_equal(engine.positions_m()[bed.held], bed.positions_m[bed.held])
    assert (engine.velocities_m_per_s()[bed.held] == 0.0).all()


@pytest.mark.parametrize(
    ("moving_joule", "rests"), [(math.inf, 1), (3.5, 1), (2.5, 2), (1.5, 3), (0.0, 1 + PATIENCE)]
)
def test_a_bed_that_still_moves_settles_on(soil, moving_joule, rests):
    """An engine whose energy falls by 1 J in each longest time, from 4 J, and which never is at rest."""
    ticks = 0

    class Falling:
        """Only the energy counts."""

        def start(self, motions) -> None:
            pass

        def advance(self, tick, motions) -> None:
            nonlocal ticks
            ticks = tick + 1

        def damp(self, kept) -> None:
            pass

        def state(self, run_id, tick, end_time_ns):
            energy = 4.0 - ticks * settling.interval_s / longest_s
            return SimpleNamespace(kinetic_energy_joule=energy, rms_speed_m_per_s=1.0)

    class OfFalling(Settling):
        def engine(self, bed):
            return Falling()

    scene = tiled(soil)
    settling = OfFalling(scene, 1, soil=scene.scene.particle_soil, step_s=1e-5, gravity_m_per_s2=9.81)
    longest_s = 40 * settling.interval_s
    settling.settled(None, Rest(1e-3, longest_s, moving_joule), 1.0, "relaxing")
    assert ticks == 40 * rests


def test_what_is_held_bears_any_force(soil):
    """A sphere falls on a held one: it comes to rest on it, the other does not move by a bit."""
    scene = tiled(soil)
    low = np.array([[0.1, 0.0, -0.05], [0.1, 0.0, -0.029]])
    bed = Bed(low, (0.0, -0.1, -0.12), (0.3, 0.1), radii_m=np.full(2, 0.01), held=np.array([True, False]))
    engine = SoilEngine(scene, bed)
    engine.start(())
    mass = DENSITY * 4.0 / 3.0 * np.pi * 0.01**3
    for tick in range(4000):
        engine.advance(tick, ())
        engine.damp(0.999)
    places = engine.positions_m()
    assert_array_equal(places[0], low[0])
    assert_allclose(places[1, 2] - places[0, 2], 0.02 - mass * scene.scene.gravity_m_per_s2 / 1e5, atol=1e-8)


@pytest.mark.full
def test_periodic_sides_are_a_whole_number_of_tiles_apart(soil):
    """No seam: across the period neighbours are as near as elsewhere."""
    scene = tiled(soil, box={"width_m": 0.32, "sides": "periodic"})
    bed = prepare_bed(scene)
    assert_allclose(bed.period_m, 0.32, rtol=0.02)
    near = np.abs(np.abs(bed.positions_m[:, 1]) - 0.5 * bed.period_m) < 0.02
    middle = np.abs(bed.positions_m[:, 1]) < 0.02
    assert_allclose(near.sum(), middle.sum(), rtol=0.1)
    assert most_move_m(scene, bed, 0.02) < 0.005 * 0.01


@pytest.mark.parametrize("tiles", [1, 3, 5, 6, 7])
def test_no_tile_lies_on_another(soil, tiles):
    """Whatever the edge, as many tiles as there are along y hold so many times its particles."""
    random = np.random.default_rng(tiles)
    scene = tiled(soil, box={"width_m": 0.1 * tiles, "sides": "periodic"}, tile_m=0.1, floor="plane")
    found = scene.scene.particle_soil
    for edge in 0.1 * random.uniform(0.99, 1.01, 50):
        places = np.array([[0.5, 0.0, -0.5]]) * edge
        sample = Bed(
            places, (0.0, -0.5 * edge, -edge), (edge, 0.5 * edge), radii_m=np.array([0.01]), sides="endless"
        )
        bed = replicated(sample, found)
        _, counts = np.unique(np.round(bed.positions_m[:, 0], 6), return_counts=True)
        assert len(np.unique(np.round(bed.positions_m[:, 1], 6))) == tiles
        assert (counts == counts[0]).all()


@pytest.mark.full
def test_a_tile_serves_every_bin_and_law(soil, monkeypatch, tmp_path):
    """The second bed presses no sample; another seed gives another bed."""
    phases = []

    def note(progress):
        phases.append(progress.phase)

    with monkeypatch.context() as patch:
        patch.setattr(bed_file, "user_cache_folder", lambda: tmp_path)
        first = prepare_bed(tiled(soil, seed=7), 1, note)
        assert {"parting", "pressing", "filling", "relaxing"} == set(phases)
        longest = phases.count("pressing")
        phases.clear()
        again = prepare_bed(tiled(soil, seed=7, box={"depth_m": 0.1}), 2, note)
    assert "parting" not in phases
    assert phases.count("pressing") < longest  # under its own law only
    assert len(again.positions_m) < len(first.positions_m)
    other = prepare_bed(tiled(soil))
    assert other.positions_m.shape != first.positions_m.shape or not np.allclose(
        other.positions_m, first.positions_m
    )


@pytest.mark.parametrize(("changes", "message"), [
    ({"tile_m": 0.25}, r"soil.bed.tile_m: 0.25 m given; allowed is at least .* at most 0.2 m"),
    ({"tile_m": 0.05}, r"soil.bed.tile_m: 0.05 m given; allowed is at least"),
    ({"box": {"width_m": 0.06}, "tile_m": None}, r"soil.bin: 0.3 x 0.06 m is narrower than"),
])  # fmt: skip
def test_a_tile_that_does_not_fit_is_refused(soil, changes, message):
    """Before anything is prepared."""
    with pytest.raises(SceneError, match=message):
        check_start(tiled(soil, **changes))


@pytest.mark.full
def test_a_law_that_changes_the_fraction_is_refused(soil):
    """The paper's soft, sticky spheres pull each other together by a fifth of the volume."""
    scene = tiled(soil)
    document = scene.document["soil"] | {"law": {"kind": "cohesive_linear", "particle": WET, "boundary": WET}}
    with pytest.raises(
        SceneError, match=r"soil.bed.solid_fraction: 0.6 given; under soil.law the bed rests at"
    ):
        prepare_bed(soil.scene(soil=document))


def test_a_bed_file_keeps_what_is_held(soil, tmp_path):
    """Written and read again, bit for bit."""
    from subsoil_ros.dem.packing.bed_file import read_bed, write_bed

    scene = tiled(soil)
    bed = prepare_bed(scene)
    write_bed(tmp_path / "bed.npz", bed, scene.scene.particle_soil)
    read = read_bed(tmp_path / "bed.npz", scene.scene.particle_soil)
    for item in dataclasses.fields(bed):
        assert_array_equal(getattr(read, item.name), getattr(bed, item.name))
