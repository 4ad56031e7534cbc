"""Soil tests on cubic lattices, where strength and modulus have closed forms, and the forces of the box."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import ConvexHull, Voronoi
from scipy.stats import t as student_t

from subsoil_ros.api.simulate import simulate
from subsoil_ros.cli.main import main
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.errors import InputError
from subsoil_ros.experiments.soil_tests import runs as soil_tests
from subsoil_ros.experiments.soil_tests.curves import SoilTests
from subsoil_ros.experiments.soil_tests.options import NORMAL_TOLERANCE
from subsoil_ros.experiments.soil_tests.runs import (
    needs_glue,
    rumpf_strength_pa,
    run_plate,
    run_shear,
    run_tension,
    seated,
)
from subsoil_ros.experiments.soil_tests.shear_box import (
    ShearBox,
    TensionLoading,
    frame_mesh,
    plate_mesh,
    tension_machine,
)
from subsoil_ros.experiments.soil_tests.specimen import Specimen, box_around, prepare_specimen, write_scene
from subsoil_ros.experiments.soil_tests.strength import SoilStrength, strength_warnings
from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.messages import ToolWrenches
from subsoil_ros.scene.pairs import pair_values, tool_values
from tests.soils import DRY as DRY_ROW
from tests.soils import NEGLIGIBLE
from tests.soils import PARTICLE as WET_ROW

GRID = "soil.bed.spacing_m=rest"
DRY = "cohesive_stiffness_newton_per_m"
FACTOR = 10.0
MU = 0.4


@pytest.fixture
def lattice(soil, tmp_path: Path):
    """Maker of specimens: a cubic lattice of 0.144 x 0.108 x 0.126 m, dry or not."""

    def make(name: str, *, dry: bool, size_m=(0.144, 0.108, 0.126)) -> tuple[Specimen, Path]:
        folder = tmp_path / name
        folder.mkdir()
        law = {DRY: 0.0} if dry else None
        resolved = soil.scene(GRID, f"soil.tool_stiffness_factor={FACTOR}", law=law)
        return prepare_specimen(resolved, size_m, folder), folder

    return make


@pytest.fixture
def tiled(soil, tmp_path: Path):
    """Maker of specimens of a dry tiled bed at 0.60, radii within 15 %, with this rolling friction."""

    def make(rolling: float, size_m) -> tuple[Specimen, Path]:
        folder = tmp_path / f"tiled_{rolling:g}"
        folder.mkdir()
        row = DRY_ROW | {"static_friction": MU, "sliding_friction": MU, "rolling_friction": rolling}
        sizes = {"kind": "uniform", "min_radius_m": 0.0085, "max_radius_m": 0.0115}
        found = {
            "bin": {"length_m": 1.0, "width_m": 1.0, "depth_m": 0.5},
            "particles": {"sizes": sizes, "density_kg_per_m3": 2500.0},
            "bed": {"kind": "tiled", "tile_m": 0.5, "solid_fraction": 0.60},
            "law": {"kind": "linear", "particle": row, "boundary": row},
        }
        return prepare_specimen(soil.scene(soil=found), size_m, folder), folder

    return make


def subfolder(folder: Path, name: str) -> Path:
    path = folder / name
    path.mkdir()
    return path


def test_a_specimen_takes_what_its_scene_allows(soil, tmp_path: Path) -> None:
    """A step above the limit that the scene allows is allowed in its specimen too."""
    resolved = soil.scene(GRID, "soil.time_step_s=6e-5", "allow=[unstable_time_step]")
    specimen = prepare_specimen(resolved, (0.144, 0.108, 0.126), tmp_path)
    assert specimen.resolved.scene.allow == ("unstable_time_step",)
    assert specimen.resolved.timing.communication_step_ns == 60_000


def test_density_is_that_of_voronoi_cells(soil, tmp_path: Path) -> None:
    """Equal spheres, each at random beside its place: the points find the volume of the exact cells."""
    specimen = prepare_specimen(
        soil.scene("soil.bed={kind: grid, spacing_m: 0.0185, jitter_m: 0.0005}"), (0.24, 0.16, 0.16), tmp_path
    )
    x = specimen.bed.positions_m
    core = np.flatnonzero(((x > x.min(axis=0) + 0.03) & (x < x.max(axis=0) - 0.03)).all(axis=1))
    cells = Voronoi(x)
    volumes = [ConvexHull(cells.vertices[cells.regions[cells.point_region[k]]]).volume for k in core]
    mass = 1800.0 * 4.0 / 3.0 * np.pi * 0.01**3
    assert_allclose(specimen.density_kg_per_m3, mass / np.mean(volumes), rtol=1e-3)


def test_a_specimen_of_a_tiled_bed(tiled) -> None:
    """The box has the floor, whatever the scene says; its density is the bed's; its faces touch the outermost
    spheres, large or small."""
    specimen, _ = tiled(0.1, (0.276, 0.184, 0.184))
    assert specimen.bed.held is None
    assert_allclose(specimen.density_kg_per_m3, 0.60 * 2500.0, rtol=0.02)
    assert_allclose(specimen.solid_fraction, 0.60, rtol=0.02)
    assert specimen.diameter_m == 0.023
    radii = specimen.bed.radii_m
    assert_allclose(specimen.mass_kg, 2500.0 * 4.0 / 3.0 * np.pi * (radii**3).sum())
    box, bed = box_around(specimen, room_m=0.1, gap_m=0.02)
    x, r = bed.positions_m, radii[:, None]
    assert_allclose((x - r).min(axis=0) - box.lower_m, 1e-6, atol=1e-9)
    assert_allclose(box.upper_m - (x + r).max(axis=0), 1e-6, atol=1e-9)
    assert_array_equal(bed.radii_m, radii)


@pytest.mark.parametrize(
    "rolling", [NEGLIGIBLE, pytest.param(10.0, marks=pytest.mark.full)], ids=["rolls", "rolls not"]
)
def test_friction_on_metal(tiled, rolling: float) -> None:
    """Dry spheres: the stress is at most the friction of the plate, and it where they cannot roll; c_a = 0.

    c_a lies in its interval of 95 %, of a line with one degree of freedom. Over the plate the section stays,
    and the load with it. What rolls slides before the friction is reached, at a stress that still changes.
    """
    specimen, folder = tiled(rolling, (0.24, 0.16, 0.12))
    stresses = (4e3, 8e3, 16e3)
    curves = tuple(
        run_plate(specimen, stress, subfolder(folder, f"{stress:g}"), inertial_number=0.01)
        for stress in stresses
    )
    tests = SoilTests(specimen, (0.24, 0.16, 0.12), curves, curves, None)
    normal, shear = np.array([curve.residual() for curve in curves]).T
    assert_allclose(normal, stresses, rtol=0.01)
    beyond = [curve for curve in curves if curve.normal_error > NORMAL_TOLERANCE]  # so quick a test chatters
    assert max(curve.normal_error for curve in curves) < 0.05
    assert len(strength_warnings(tests)) == 2 * len(beyond)
    assert (shear < 1.01 * MU * normal).all()
    fit = SoilStrength.of(tests).plate
    assert fit is not None
    assert abs(fit.adhesion_pa) < student_t.ppf(0.975, 1) * fit.adhesion_error_pa
    slope = math.tan(math.radians(fit.delta_deg))
    if rolling == NEGLIGIBLE:
        assert 0.5 * MU < slope < MU
    else:
        assert_allclose(slope, MU, rtol=0.03)
        assert fit.adhesion_error_pa < 0.01 * stresses[-1]


def test_meshes_of_the_box() -> None:
    """Closed, outward, of the declared size; the frame's inner faces look at the specimen."""
    box = ShearBox((0.1, -0.08, -0.13), (0.34, 0.08, -0.01), wall_m=0.05, gap_m=0.02)
    frame, plate = frame_mesh(box, box.frame_height_m), plate_mesh(box)
    outside, inside = (0.24 + 0.1) * (0.16 + 0.1), 0.24 * 0.16
    assert frame.is_watertight
    assert frame.is_winding_consistent
    assert_allclose(frame.volume, (outside - inside) * box.frame_height_m, rtol=1e-12)
    assert_allclose(plate.volume, (0.24 + 0.05) * (0.16 + 0.05) * 0.05, rtol=1e-12)
    inner = (np.abs(frame.triangles_center[:, :2]) < (0.1201, 0.0801)).all(axis=1)
    assert inner.sum() == 8
    towards = np.einsum("ij,ij->i", frame.face_normals[inner, :2], frame.triangles_center[inner, :2])
    assert (towards < 0.0).all()
    assert_allclose(box.middle_m + 0.5 * box.gap_m + box.frame_height_m, box.upper_m[2] + box.wall_m)


def test_the_box_touches_every_face_and_removes_nothing(lattice) -> None:
    """Its faces stand where the outermost particles feel nothing, the bin's walls far away."""
    specimen, _ = lattice("box", dry=True)
    box, bed = box_around(specimen, room_m=0.1, gap_m=0.02)
    rest = specimen.soil.particles.radius_m - pair_values(specimen.soil)[1].rest_overlap
    x = bed.positions_m
    assert_allclose(x.min(axis=0) - box.lower_m, rest, atol=2e-6)
    assert_allclose(np.array(box.upper_m) - x.max(axis=0), rest, atol=2e-6)
    assert (x[:, 0] - bed.lower_m[0]).min() > 0.1
    assert bed.upper_m[1] - x[:, 1].max() > 0.1


def test_settlement_of_a_lattice(lattice) -> None:
    """Every column carries sigma d^2 and shortens by its contacts in series, those with the box among them.

    Without adhesion nothing touches the side walls with a force. The lid loads all columns alike; the
    weight of the upper half and of the lid is part of the load on the plane of shear, so the mean load of
    the height is that to some weights: compared are two loads, where it drops out. The tolerance is what
    is left of the motion when the load rests.
    """
    specimen, folder = lattice("settlement", dry=True)
    pair, boundary = pair_values(specimen.soil)[0], tool_values(specimen.soil)
    levels = np.unique(specimen.bed.positions_m[:, 2].round(5))
    columns = len(specimen.bed.positions_m) // len(levels)
    box, _ = box_around(specimen, 0.1, 0.02)
    stresses = (4e3, 12e3)
    settled = [
        run_shear(specimen, stress, subfolder(folder, f"{stress:g}"), inertial_number=0.1).settled
        for stress in stresses
    ]
    force = (stresses[1] - stresses[0]) * box.area_m2 / columns
    softness = (len(levels) - 1) / pair.stiffness + 2.0 / boundary.stiffness
    assert_allclose((settled[1] - settled[0]) * box.height_m, force * softness, rtol=0.02)


def test_forces_of_the_box_balance(lattice) -> None:
    """The drive pulls with what the soil puts on the upper half, and the plane carries the nominal stress to
    the end.

    Its section falls to some two thirds, and the load with it; the rest is the lid that a lattice throws up
    at each of its rows. Getting some 2 kg to 0.3 m/s takes 0.6 N s of the 0.17 s of shear, 3.5 N of the 100
    N that the drive reaches.
    """
    specimen, folder = lattice("balance", dry=True)
    curve = run_shear(specimen, 8e3, subfolder(folder, "shear"), inertial_number=0.02)
    assert_allclose(curve.normal_pa[0], 8e3, rtol=0.01)
    assert curve.imbalance < 0.05
    box, _ = box_around(specimen, 0.1, 0.02)
    left = 1.0 - curve.displacement_m / box.length_m  # of the section; down to some two thirds
    assert_allclose(left[-1], 0.70, atol=0.01)
    assert_allclose(curve.normal_pa.mean(), 8e3, rtol=0.02)
    assert curve.normal_error < 0.1
    assert curve.peak()[1] > 1e3


def test_a_weak_soil_is_not_glued(lattice) -> None:
    """Glue is for a soil whose tension is above the normal stress; a dry one never needs it."""
    dry, sticky = lattice("no_glue", dry=True)[0], lattice("glue", dry=False)[0]
    strength = rumpf_strength_pa(sticky)
    assert needs_glue(sticky, 0.9 * strength)
    assert not needs_glue(sticky, 1.1 * strength)
    assert not needs_glue(dry, 1.0)


def test_frames_that_meet_are_refused(lattice, monkeypatch: pytest.MonkeyPatch) -> None:
    """Settlement closes a gap that is too narrow from the start."""
    monkeypatch.setattr(soil_tests, "GAP_DIAMETERS", {True: 0.0, False: 0.0})
    specimen, folder = lattice("closed", dry=True)
    with pytest.raises(InputError, match=r"normal stress: under 12000 Pa the specimen settles by"):
        run_shear(specimen, 12e3, subfolder(folder, "shear"), inertial_number=0.1)


def test_tension_between_glued_plates(lattice) -> None:
    """Walls far away, plates alone hold the lattice: its columns break at once, under n K_B delta_B.

    Pulled at 30 mm/s: a wave of the mass above any bond at that speed, rho c v A, is below 1 % of it.
    """
    specimen, folder = lattice("plates", dry=False, size_m=(0.108, 0.108, 0.09))
    box, bed = box_around(specimen, 0.1, 0.02)
    box = dataclasses.replace(
        box,
        lower_m=(box.lower_m[0] - 0.05, box.lower_m[1] - 0.05, box.lower_m[2]),
        upper_m=(box.upper_m[0] + 0.05, box.upper_m[1] + 0.05, box.upper_m[2]),
    )
    loading = TensionLoading(rest_s=0.0, speed_m_per_s=0.03, travel_m=0.015)
    resolved = write_scene(
        specimen, "plates", folder, box, bed, loading.duration_s, tension_machine(box, loading)
    )
    felt: list[float] = []

    class Sink:
        def write(self, record: object) -> None:
            if isinstance(record, ToolWrenches):
                felt.append(-record.tools[1].force_z_newton)

    simulate(resolved, sink=Sink())
    levels = np.unique(specimen.bed.positions_m[:, 2].round(5))
    columns = len(specimen.bed.positions_m) // len(levels)
    weight_above = specimen.mass_kg * 9.81 * (0.5 + 0.5 / len(levels))  # breaks somewhere below the lid
    strength = columns * pair_values(specimen.soil)[0].peak_attraction
    assert max(felt) == pytest.approx(strength, rel=0.02, abs=2.0 * weight_above)


def test_tension_of_a_lattice(lattice) -> None:
    """Between glued walls it breaks in the middle, and not above the strength of all columns at once.

    Columns at the walls are held up to the gap and break before those inside, so it stays below that. An odd
    number of layers: one in the middle of the gap, the next ones held by the frames.
    """
    specimen, folder = lattice("tension", dry=False, size_m=(0.108, 0.108, 0.198))
    levels = np.unique(specimen.bed.positions_m[:, 2].round(5))
    assert len(levels) == 11
    columns = len(specimen.bed.positions_m) // len(levels)
    box, _ = box_around(specimen, 0.1, 0.02)
    curve = run_tension(specimen, subfolder(folder, "pull"), inertial_number=0.01)
    strength = columns * pair_values(specimen.soil)[0].peak_attraction / box.area_m2
    assert 0.5 * strength < curve.strength_pa < 1.02 * strength
    assert 0.3 < curve.break_height < 0.7
    assert abs(curve.tension_pa[-1]) < 0.02 * strength


@pytest.mark.full
def test_tension_of_a_tiled_bed(soil, tmp_path: Path) -> None:
    """Its faces hold few particles, so its ends are cemented: it breaks between them, near Rumpf's strength.

    That counts the contacts before the column is pressed by 20 kPa, which makes more.
    """
    sizes = {"kind": "uniform", "min_radius_m": 0.0085, "max_radius_m": 0.0115}
    law = {"rolling_friction": 0.3, "equilibrium_overlap_m": 5e-5, "cohesion_range_m": 5e-4}
    law |= {"stiffness_newton_per_m": 4e4, "cohesive_stiffness_newton_per_m": 3e3}
    found = {
        "bin": {"length_m": 1.0, "width_m": 1.0, "depth_m": 0.5},
        "particles": {"sizes": sizes, "density_kg_per_m3": 2500.0},
        "bed": {"kind": "tiled"},
        "law": {"kind": "cohesive_linear", "particle": WET_ROW | law, "boundary": WET_ROW | law},
    }
    specimen = prepare_specimen(soil.scene(soil=found), (0.13, 0.13, 0.2), tmp_path)
    pressed = seated(specimen, subfolder(tmp_path, "seating"))
    curve = run_tension(pressed, subfolder(tmp_path, "pull"), inertial_number=0.03)
    assert 0.2 < curve.break_height < 0.8
    assert 0.5 < curve.strength_pa / rumpf_strength_pa(specimen) < 1.5
    assert abs(curve.tension_pa[-1]) < 0.05 * curve.strength_pa


def test_scaled_soil_moves_alike(soil) -> None:
    """Particles 1.5 times as large in a box as much larger, gravity less: the same motion in their lengths.

    Lengths and times grow with s, so speeds stay and gravity falls as 1 / s. To round-off of chaotic
    contacts over a short time.
    """
    ratio, ticks = 1.5, 300
    resolved: ResolvedScene = soil.scene(
        "soil.bin.length_m=0.1", "soil.bed={kind: grid, spacing_m: 0.0185, jitter_m: 0.0005}"
    )
    assert resolved.scene.soil is not None
    small = resolved.scene.soil
    box = {key: ratio * getattr(small.bin, key) for key in ("length_m", "width_m", "depth_m")}
    wide = soil.scene(
        f"soil.bin={box}",
        f"soil.particles.radius_m={ratio * small.particles.radius_m}",
        f"soil.particles.reference_radius_m={small.particles.radius_m}",
        f"soil.bed={{kind: grid, spacing_m: {ratio * 0.0185}, jitter_m: {ratio * 0.0005}}}",
        f"soil.skin_m={ratio * small.skin_m}",
        f"soil.time_step_s={ratio * 5e-5}",
        gravity_m_per_s2=resolved.scene.gravity_m_per_s2 / ratio,
    )
    timing = Timing(round(ratio * resolved.timing.communication_step_ns), ticks, 1, 0)
    larger = SoilEngine(dataclasses.replace(wide, timing=timing))
    smaller = SoilEngine(resolved)
    for engine in (smaller, larger):
        engine.start(())
    before = smaller.positions_m()
    for tick in range(ticks):
        smaller.advance(tick, ())
        larger.advance(tick, ())
    moved = smaller.positions_m() - before
    assert np.abs(moved).max() > 1e-4
    assert_allclose(larger.positions_m() / ratio, smaller.positions_m(), atol=1e-9)
    assert_allclose(larger.velocities_m_per_s(), smaller.velocities_m_per_s(), atol=1e-6)


def test_the_command_writes_all_or_nothing(soil, tmp_path: Path) -> None:
    """A series of a dry lattice: the folder has numbers, curves, figure and the scenes; c and phi agree."""
    scene = soil.scene(GRID, law={DRY: 0.0}).path
    out = tmp_path / "out" / "lattice"
    arguments = ["--normal-pa", "4e3", "8e3", "12e3", "--inertial-number", "0.2"]
    assert main(["soil-test", str(scene), "--set", GRID, "--out", str(out), *arguments]) == 0
    assert [path.name for path in out.parent.iterdir()] == ["lattice"]
    assert {"soil_test.json", "shear.csv", "plate.csv", "soil_test.png", "tests"} <= {
        p.name for p in out.iterdir()
    }
    result = json.loads((out / "soil_test.json").read_text())
    fit, rows = result["strength"]["peak"], result["tests"]
    line = [
        fit["cohesion_pa"] + row["peak_normal_pa"] * math.tan(math.radians(fit["friction_angle_deg"]))
        for row in rows
    ]
    assert_allclose(sum(line), sum(row["peak_shear_pa"] for row in rows), rtol=1e-9)
    assert result["strength"]["tensile_strength_pa"] is None
    assert result["size_m"] == [0.24, 0.16, 0.16]
    assert {"delta_deg", "delta_error_deg", "adhesion_pa", "adhesion_error_pa"} < set(
        result["strength"]["plate"]
    )
    assert [row["nominal_normal_pa"] for row in result["plate_tests"]] == [4e3, 8e3, 12e3]
    doubtful = [row for row in rows + result["plate_tests"] if row["normal_error"] > NORMAL_TOLERANCE]
    assert len(result["warnings"]) == len(doubtful)
    curves = np.genfromtxt(out / "shear.csv", delimiter=",", names=True)
    assert_array_equal(np.unique(curves["nominal_normal_pa"]), [4e3, 8e3, 12e3])
