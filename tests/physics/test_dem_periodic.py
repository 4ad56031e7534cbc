"""Periodic sides: the seam is no place at all, and what cannot work with it is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from subsoil_ros.cli.main import main
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.packing.bed_file import read_bed, write_bed
from subsoil_ros.dem.packing.bed_geometry import bed_tree, seen_from_corner
from subsoil_ros.dem.packing.bed_report import report_bed
from subsoil_ros.errors import SceneError

WIDTH = 0.108  # six spacings of 18 mm
STEP = 5.0e-5


def periodic(maker, bed=None, gravity=0.0, **changes):
    """The small scene with periodic sides, 0.12 x 0.108 x 0.1 m; `changes` replace keys of its soil."""
    soil = maker.scene().document["soil"]
    box = {"length_m": 0.12, "width_m": WIDTH, "depth_m": 0.1, "sides": "periodic"}
    return maker.scene(
        soil={**soil, "bin": box, "bed": bed or soil["bed"], **changes}, gravity_m_per_s2=gravity
    )


def run(engine, steps, motions=()):
    """Starts, and advances so many ticks."""
    engine.start(motions)
    for tick in range(steps):
        engine.advance(tick, motions)


def cluster(seed=1):
    """Positions and velocities of 60 particles in contact, clear of floor and ends, all around the seam."""
    generator = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(range(3), range(5), range(4), indexing="ij"), axis=-1).reshape(-1, 3)
    place = np.array([0.04, 0.5 * WIDTH - 0.036, -0.06]) + 0.018 * grid
    place += generator.uniform(-2e-4, 2e-4, place.shape)
    return place, generator.normal(0.0, 0.1, place.shape)


def test_momentum_is_conserved_across_the_seam(soil):
    """Forces between images are opposite: the sum of momenta changes by rounding only."""
    engine = build_engine(periodic(soil))
    place, velocity = cluster()
    engine.place(place, velocity)
    before = engine.momentum_kg_m_per_s
    run(engine, 200)
    scale = engine.mass_kg * np.abs(velocity).sum()
    assert_allclose(engine.momentum_kg_m_per_s, before, rtol=0.0, atol=1e-13 * scale)
    assert np.abs(engine.velocities_m_per_s() - velocity).max() > 0.05  # they did collide


def test_a_shift_in_y_changes_nothing(soil):
    """The same bed half a period, or a little, further: the same motion but for rounding.

    Rounding of a place is 1e-17 m; contacts amplify it less than ten-thousandfold within 40 steps. (A grid
    without jitter stands where the normal damper sets in, and rounding decides whether it does.)
    """
    engine = build_engine(periodic(soil, gravity=9.81))
    x, row, z = np.stack(np.meshgrid(range(4), range(8), range(4), indexing="ij"), axis=-1).reshape(-1, 3).T
    staggered = 0.009 * (row % 2)  # bonds across the seam lean both ways, into other cells
    place = np.stack((0.03 + 0.018 * x + staggered, 0.0135 * row, 0.018 * z + staggered - 0.085), axis=1)
    place += np.random.default_rng(1).uniform(-2e-4, 2e-4, place.shape)
    velocity = np.random.default_rng(2).normal(0.0, 0.2, place.shape)
    moved = []
    for shift in (0.0, 0.5 * WIDTH, 0.0031, -0.777):
        engine.place(place + np.array([0.0, shift, 0.0]), velocity)
        run(engine, 40)
        moved.append(engine.displacements_m())
        assert np.abs(engine.positions_m()[:, 1]).max() <= 0.5 * WIDTH
    for other in moved[1:]:
        assert_allclose(other, moved[0], rtol=0.0, atol=1e-13)


def test_a_pair_on_its_way_across_the_seam_keeps_its_contact(soil):
    """Bonded, spun up and moving at 2 m/s, it passes the seam as if there were none, springs and all."""
    pair = np.array([[0.06, 0.0, -0.05], [0.064, 0.0175, -0.05]])
    velocity = np.array([[0.0, 2.0, 0.0], [0.1, 1.8, 0.05]])
    spin = np.array([[3.0, -2.0, 1.0], [0.0, 5.0, -4.0]])
    found = []
    for start in (-0.045, 0.03):  # the second crosses after 0.4 to 24 mm
        engine = build_engine(periodic(soil))
        engine.place(pair + np.array([0.0, start, 0.0]), velocity, spin)
        run(engine, 200)
        found.append((engine.displacements_m(), engine.angular_velocities_rad_per_s()))
    assert np.abs(found[1][0][:, 1]).min() > 0.018  # both went over
    for there, here in zip(*found, strict=True):
        assert_allclose(there, here, rtol=0.0, atol=1e-11)


def test_a_sliding_block_goes_round_and_its_displacement_goes_on(soil):
    """A block that fills the period slides at 3 m/s for 60 mm: displacement is v t, and it stays whole."""
    engine = build_engine(periodic(soil))
    grid = np.stack(np.meshgrid(range(3), range(6), range(3), indexing="ij"), axis=-1).reshape(-1, 3)
    place = np.array([0.04, -0.045, -0.06]) + 0.018 * grid
    engine.place(place, np.tile([0.0, 3.0, 0.0], (len(place), 1)))
    run(engine, 400)
    expected = np.tile([0.0, 3.0 * 400 * STEP, 0.0], (len(place), 1))
    assert_allclose(engine.displacements_m(), expected, rtol=0.0, atol=1e-11)
    y = engine.positions_m()[:, 1]
    assert y.min() >= -0.5 * WIDTH
    assert y.max() < 0.5 * WIDTH


def test_same_bits_for_one_and_two_threads(soil):
    """Also across the seam."""
    found = []
    for threads in (1, 2):
        engine = build_engine(periodic(soil, gravity=9.81), threads)
        place = engine.bed.positions_m
        engine.place(place, np.random.default_rng(3).normal(0.0, 0.5, place.shape))
        run(engine, 100)
        found.append(engine.positions_m())
    assert_array_equal(found[0], found[1])


def test_a_grid_is_a_whole_number_of_spacings_wide_and_stands_still(soil):
    """0.12 m hold six spacings of 18 mm; no side walls carry anything."""
    box = {"length_m": 0.12, "width_m": 0.12, "depth_m": 0.1, "sides": "periodic"}
    scene = periodic(soil, gravity=9.81, bin=box)
    engine = build_engine(scene)
    assert engine.bed.period_m == pytest.approx(WIDTH, abs=1e-15)
    run(engine, 100)
    assert np.abs(engine.displacements_m()).max() < 1e-9
    report = report_bed(engine.bed, scene.scene.soil)
    assert set(report.wall_gaps) == {"near", "far", "floor"}
    nx, ny, nz = 6, 6, 5
    bonds = (nx - 1) * ny * nz + nx * ny * nz + nx * ny * (nz - 1)  # a ring of six has six bonds
    assert report.coordination == pytest.approx(2.0 * bonds / (nx * ny * nz))


def bonds(bed, soil):
    """(n,) particles within reach of each."""
    tree = bed_tree(bed)
    near = tree.query_ball_point(seen_from_corner(bed, bed.positions_m), 0.022, return_length=True)
    return near - 1


@pytest.mark.full
def test_a_dense_bed_is_as_dense_at_its_sides_as_inside(soil):
    """Bonds per particle in the outer thirds and in the middle one: equal within four standard errors.

    Between walls the same comparison misses by far more: particles there have no neighbour on one side.
    """
    dense = {"kind": "dense_random", "seed": 0}
    differs = {}
    for sides in ("periodic", "walls"):
        box = {"length_m": 0.15, "width_m": 0.12, "depth_m": 0.1, "sides": sides}
        scene = periodic(soil, bed=dense, gravity=9.81, bin=box, time_step_s=4.0e-5)
        bed = build_engine(scene).bed
        count = bonds(bed, scene.scene.soil)
        outer = np.abs(bed.positions_m[:, 1]) > 0.25 * (bed.upper_m[1] - bed.lower_m[1])
        error = count.std() * np.sqrt(1.0 / outer.sum() + 1.0 / (~outer).sum())
        differs[sides] = (count[~outer].mean() - count[outer].mean()) / error
    assert abs(differs["periodic"]) < 4.0
    assert differs["walls"] > 4.0


def test_a_saved_bed_keeps_its_sides(soil, tmp_path):
    """A bed file says what its sides are; a scene with the others refuses it."""
    scene = periodic(soil)
    path = tmp_path / "bed.npz"
    bed = build_engine(scene).bed
    write_bed(path, bed, scene.scene.soil)
    again = read_bed(path, scene.scene.soil)
    assert again.period_m == bed.period_m
    walls = soil.scene().scene.soil
    with pytest.raises(SceneError, match=r"prepared between sides 'periodic', soil.bin.sides is\s+'walls'"):
        read_bed(path, walls)


def test_a_period_below_three_cells_is_refused(soil):
    """3 x (2 r + reach + skin) = 75 mm; 72 mm is said to be too narrow, with the smallest width."""
    box = {"length_m": 0.12, "width_m": 0.08, "depth_m": 0.1, "sides": "periodic"}
    with pytest.raises(SceneError, match=r"period of 0.072 m, sides: periodic needs at least 0.075 m"):
        build_engine(periodic(soil, bin=box))


@pytest.mark.parametrize(("width_m", "fits"), [(0.06, True), (0.08, False), (0.14, False), (0.145, True)])
def test_a_tool_keeps_off_the_seam(soil, one, at, capsys, tmp_path, width_m, fits):
    """12 mm of reach and 6 mm of skin on both sides of 108 mm leave 72 mm, and from 144 mm on a prism reaches
    through both. Check and run say so, too."""
    mesh = soil.box(0.03, width_m, 0.03)
    scene = soil.scene(soil=periodic(soil).document["soil"], tools=one(mesh))
    engine = build_engine(scene)
    if fits:
        engine.start(at(0.06, -0.05))
        return
    with pytest.raises(SceneError, match=r"tools.tool: .* stay between -0.036 and 0.036 m"):
        engine.start(at(0.06, -0.05))
    assert main(["check", str(scene.path)]) == 2
    assert main(["run", str(scene.path), "--out", str(tmp_path / "out"), "--mode", "direct"]) == 2
    assert "widen soil.bin.width_m" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_prism_through_both_sides_meets_the_same_soil_wherever_the_seam_is(soil, one, at):
    """A plate through a slice of an endless bed, and the bed a third of a period further: the same wrench but
    for rounding; twice as large in a bed of two periods."""
    mesh = soil.box(0.02, 0.3, 0.1)

    def wrench(shift, periods=1):
        box = {"length_m": 0.12, "width_m": periods * WIDTH, "depth_m": 0.1, "sides": "periodic"}
        scene = soil.scene(soil={**periodic(soil).document["soil"], "bin": box}, tools=one(mesh))
        engine = build_engine(scene)
        place, velocity = cluster()
        place = np.concatenate([place + np.array((0.0, WIDTH * k, 0.0)) for k in range(periods)])
        low, period = engine.bed.lower_m[1], engine.bed.period_m
        place[:, 1] = low + (place[:, 1] + shift - low) % period
        engine.place(place, np.tile(velocity, (periods, 1)))
        engine.start(at(0.02, -0.05))
        for tick in range(40):
            (felt,) = engine.advance(tick, at(0.02 + 2.5e-5 * (tick + 1), -0.05, vx=0.5))
        return np.array([felt.force_x_newton, felt.force_z_newton, felt.torque_y_newton_m])

    here = wrench(0.0)
    assert np.abs(here[0]) > 1.0
    assert_allclose(wrench(WIDTH / 3.0), here, rtol=1e-6)
    assert_allclose(wrench(0.0, periods=2), 2.0 * here, rtol=1e-6)
