"""Graded beds: small particles about the path of the tools, larger ones away from it, each under the law of
its size; in a bin and in a field."""

import dataclasses
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from subsoil_ros.analysis.disturbance import disturbance_between
from subsoil_ros.cli.main import main
from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.beds.graded import grades_at
from subsoil_ros.dem.beds.ground import kept_ground
from subsoil_ros.dem.beds.prepare import check_start, prepare_bed
from subsoil_ros.dem.beds.report import report_bed
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.mixture import law_tables
from subsoil_ros.dem.window import FieldEngine
from subsoil_ros.errors import SceneError
from subsoil_ros.limits.stable_steps import step_limits
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import ToolMotion
from subsoil_ros.recording.conversion import cloud_from_message, point_cloud
from subsoil_ros.scene.coarse import Coarse
from tests.soils import BOOKED, LINEAR
from tests.verification.conftest import most_move_m, one_tool

SIZES = {"kind": "uniform", "min_radius_m": 0.0085, "max_radius_m": 0.0115}
COARSE = {"times": 1.5, "beyond_m": 0.08, "below_m": 0.07}
LARGEST = 1.5 * SIZES["max_radius_m"]
DENSITY = 2500.0
BIN = {"length_m": 0.4, "width_m": 0.36, "depth_m": 0.12}


def graded(maker, *, coarse=COARSE, tools=None, **changes):
    """A bin of some 2,000 particles, a third of them in the core."""
    soil = {
        "bin": BIN,
        "particles": {"sizes": SIZES, "density_kg_per_m3": DENSITY, "coarse": coarse},
        "bed": {"kind": "tiled", "tile_m": 0.15},
        "law": LINEAR,
        "time_step_s": 5e-5,
        **BOOKED,
        **changes,
    }
    tools = tools or one_tool(maker.box(0.03, 0.04, 0.08, subdivide=1))
    return maker.scene(soil=soil, tools=tools, coupling={"communication_step_ns": 200_000})


def field(maker, sides="periodic", **changes):
    """A field under a window of some 0.3 m; between periodic sides its ground is one tile long, else 22."""
    box = {**BIN, "length_m": 1.2, "sides": sides}
    return graded(maker, **{"bin": box, "window": {"ahead_m": 0.14, "behind_m": 0.12}, **changes})


def bar(tick):
    """A bar on its way through the field."""
    return (ToolMotion("tool", 0.1 + 2e-4 * (tick + 1), 0.0, -0.03, 0.0, 1.0, 0.0, 0.0),)


def above(x_m):
    """The bar above the soil."""
    return (ToolMotion("tool", x_m, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0),)


def solid_fraction(position, radius, low, high, points=150_000):
    """Part of a box that spheres fill, by random points: to 0.13 % (one standard deviation)."""
    at = np.random.default_rng(1).uniform(low, high, (points, 3))
    distance, nearest = cKDTree(position).query(at, k=10)
    return float((distance < radius[nearest]).any(axis=1).mean())


@pytest.mark.parametrize(
    ("times", "count"), [(1.0 + 1e-12, 2), (1.2, 2), (1.5, 2), (1.51, 3), (2.25, 3), (2.9, 4)]
)
def test_neighbouring_sizes_are_at_most_one_and_a_half_apart(times, count):
    """From the core to the coarsest; sizes between have room for four of their diameters."""
    coarse = Coarse(times=times, beyond_m=0.1, below_m=0.2)
    factors = np.array(coarse.factors)
    assert len(factors) == count
    assert_allclose(factors[[0, -1]], (1.0, times))
    assert (factors[1:] / factors[:-1]).max() <= 1.5 * (1.0 + 1e-9)
    assert_allclose(np.diff(coarse.ends_m(0.01)), 0.08 * factors[1:-1])


def test_every_size_has_its_own_law(soil):
    """Like pairs, and pairs with a tool, have the law of a soil of that size alone; two sizes that of their
    harmonic mean radius, half a contact of each in series: K between the two, K ~ r and C ~ r^2."""
    whole = graded(soil).scene.particle_soil
    engine = SoilEngine(graded(soil), bed=Bed(np.zeros((1, 3)), (-1.0, -1.0, -1.0), (1.0, 1.0),
        radii_m=np.array([0.01]), materials=np.zeros(1, np.int64)))  # fmt: skip
    pairs, _, tools = law_tables(whole, engine._features)
    radius = whole.particles.mean_volume_radius_m
    for k, factor in enumerate((1.0, 1.5)):
        sizes = {"kind": "uniform", "min_radius_m": factor * 0.0085, "max_radius_m": factor * 0.0115}
        particles = {"sizes": sizes, "density_kg_per_m3": DENSITY, "reference_radius_m": radius}
        alone = graded(soil, particles=particles).scene.particle_soil
        own, _, at_tool = law_tables(alone, engine._features)
        assert_allclose(pairs[3 * k], own[0], rtol=1e-9)
        assert_allclose(tools[k], at_tool[0], rtol=1e-9)
    names = list(whole.law.numbers._fields)
    stiffness, damping = (pairs[:, names.index(name)] for name in ("stiffness", "damping"))
    assert_allclose(stiffness[[1, 2]] / stiffness[0], 2.0 * 1.5 / 2.5)
    assert_allclose(damping[[1, 2]] / damping[0], (2.0 * 1.5 / 2.5) ** 2)
    core = graded(soil, particles={"sizes": SIZES, "density_kg_per_m3": DENSITY}).scene.particle_soil
    assert_allclose(step_limits(whole)[0].limit_s, step_limits(core)[0].limit_s, rtol=0.15)
    assert step_limits(whole)[0].limit_s <= step_limits(core)[0].limit_s


def test_two_sizes_exchange_momentum_and_energy(soil):
    """A particle of each size meets the other off centre: momentum and angular momentum stay to round-off,
    energy with what the book says is lost, to the order of the step."""
    scene = graded(soil)
    scene = dataclasses.replace(scene, scene=scene.scene.model_copy(update={"gravity_m_per_s2": 0.0}))
    places = np.array([[0.0, 0.0, 0.0], [0.0252, 0.008, 0.0]])
    radii, kinds = np.array([0.01, 0.015]), np.array([0, 1])
    bed = Bed(places, (-1.0, -1.0, -1.0), (1.0, 1.0), radii_m=radii, materials=kinds)
    engine = SoilEngine(scene, bed=bed, book=True)
    engine.start(above(5.0))
    engine.particles().velocity[engine.particles().radius < 0.012, 0] = 0.5
    mass = DENSITY * 4.0 / 3.0 * np.pi * radii**3

    def moments():
        x, v, w = engine.positions_m(), engine.velocities_m_per_s(), engine.angular_velocities_rad_per_s()
        turning = (np.cross(x, v) * mass[:, None]).sum(axis=0) + (0.4 * mass * radii**2) @ w
        return np.concatenate(((mass[:, None] * v).sum(axis=0), turning))

    before, energy = moments(), engine.energy().total_joule
    for tick in range(100):
        engine.advance(tick, above(5.0))
    assert np.linalg.norm(engine.velocities_m_per_s()[1]) > 0.1
    assert_allclose(moments(), before, atol=1e-12 * np.abs(before).max())
    assert_allclose(engine.energy().total_joule, energy, rtol=0.01)


def test_a_graded_bin_is_filled_and_at_rest(soil):
    """Of the large size 99 % are where it belongs, within a radius of the largest, so that none is at a tool;
    of the small one within a diameter (points are parted, and soil fills the gaps at the walls). The count is
    that of the check; left alone it stands as other beds do."""
    scene = graded(soil)
    found = scene.scene.particle_soil
    bed = prepare_bed(scene, SoilEngine)
    report = report_bed(bed, found)
    assert [layer.particle_count for layer in report.layers] == np.bincount(bed.materials).tolist()
    assert np.bincount(bed.materials).min() > 300
    away = found.particles.coarse.distance_m(bed.positions_m[:, 1], -bed.positions_m[:, 2])
    assert np.quantile(away[bed.materials == 0], 0.99) < 2.0 * LARGEST
    assert np.quantile(away[bed.materials == 1], 0.01) > -LARGEST
    assert (bed.radii_m[bed.materials == 1] >= 1.5 * SIZES["min_radius_m"]).all()
    assert_allclose(check_start(scene), len(bed.positions_m), rtol=0.15)
    assert_allclose(report.layers[0].density_kg_per_m3, 0.60 * DENSITY, rtol=0.05)
    assert most_move_m(scene, bed, 0.05) < 0.005 * 0.01


@pytest.mark.full
def test_the_ground_of_a_field_is_dense_across_its_interfaces(soil):
    """Solid fraction beside the core and below it: within 2 % of what is asked for over four slices about an
    interface, two on either side, and within 4 % in each. Slices are 20 mm thick, some two particles."""
    scene = field(soil, "held", bed={"kind": "tiled", "tile_m": 0.24})
    bed, found = kept_ground(scene, SoilEngine).bed, scene.scene.particle_soil
    x, radius = bed.positions_m + np.array((0.0, 0.0, 4.0 * LARGEST)), bed.radii_m
    period = bed.periods_m[0]
    assert_array_equal(np.abs(grades_at(found, x[:, 1], -x[:, 2]) - bed.materials) <= 1, True)
    aside = [
        np.mean(
            [
                solid_fraction(x, radius, (0.05, right, -0.06), (period - 0.05, right + 0.02, -0.02))
                for right in (y, -y - 0.02)
            ]
        )
        for y in (0.04, 0.06, 0.08, 0.10)
    ]
    below = [
        solid_fraction(x, radius, (0.05, -0.06, -depth - 0.02), (period - 0.05, 0.06, -depth))
        for depth in (0.03, 0.05, 0.07, 0.09)
    ]
    for found_in in (aside, below):
        assert_allclose(np.mean(found_in), 0.60, rtol=0.02)
        assert_allclose(found_in, 0.60, rtol=0.04)


@pytest.mark.parametrize("sides", ["periodic", pytest.param("held", marks=pytest.mark.full)])
def test_a_graded_field_stands_as_it_was_laid_out(soil, sides):
    """Forces on free particles away from the ends are a small part of their weight, before and after a shift;
    what was free before a shift feels the same after it, bit for bit."""
    engine = FieldEngine(field(soil, sides))
    engine.start(above(0.5))

    def forces():
        p = engine.particles()
        low, high = engine.bed.lower_m[0] + 4.0 * LARGEST, engine.bed.upper_m[0] - 4.0 * LARGEST
        inside = ~p.held & (p.position[:, 0] > low) & (p.position[:, 0] < high)
        return np.linalg.norm(p.force[inside], axis=1) / (9.81 * p.mass[inside])

    at_rest = forces()
    assert len(at_rest) > 300
    assert np.sqrt((at_rest**2).mean()) < 0.05
    before = dict(zip(engine.particles().identity.tolist(), engine.particles().force.copy(), strict=True))
    held = set(engine.particles().identity[engine.particles().held].tolist())
    rear, front = engine.state_arrays()["window"].tolist()[:2]
    engine._shift(rear + 1, front + 3)
    assert np.sqrt((forces() ** 2).mean()) < 0.05
    p = engine.particles()
    same = [k for k in range(p.count) if not p.held[k] and int(p.identity[k]) in before.keys() - held]
    assert len(same) > 100
    for k in same:
        assert_array_equal(p.force[k], before[int(p.identity[k])])


def test_a_graded_field_has_the_same_bits_on_threads_and_after_a_restart(soil):
    """Over a shift of the window; and its books close."""
    scene = field(soil)
    first, second = FieldEngine(scene), FieldEngine(scene, 2)
    for engine in (first, second):
        engine.start(bar(-1))
    begun, window = first.energy().total_joule, first.state_arrays()["window"].tolist()
    for tick in range(300):
        assert first.advance(tick, bar(tick)) == second.advance(tick, bar(tick))
    kept = {name: np.array(array) for name, array in first.state_arrays().items()}
    resumed = FieldEngine(scene)
    resumed.restore(kept)
    for tick in range(300, 1200):
        assert first.advance(tick, bar(tick)) == resumed.advance(tick, bar(tick))
    assert first.state_arrays()["window"].tolist() != window
    for name, array in first.state_arrays().items():
        assert_array_equal(array, resumed.state_arrays()[name], err_msg=name)
    book = first.energy()
    assert abs(book.total_joule - begun) < 0.02 * book.turned_over_joule
    assert first.lost_particles == ()


def test_clouds_carry_radius_and_material(soil):
    """Those of the particles, through a PointCloud2 and back; beside identities."""
    engine = FieldEngine(field(soil))
    engine.start(above(0.5))
    cloud = cloud_from_message(point_cloud(engine.cloud(0, 200_000)), 200_000)
    assert_array_equal(cloud.radii_m, engine.radii_m().astype(np.float32))
    assert_array_equal(cloud.materials, engine.materials())
    assert set(np.unique(cloud.materials)) == {0, 1}
    assert cloud.identities is not None


@pytest.mark.slow
def test_modes_give_the_same_bits(soil):
    """As one process and as nodes over DDS."""
    mesh = soil.box(0.03, 0.04, 0.08, subdivide=1)
    path = {"start_x_m": 0.1, "start_z_m": -0.03, "speed_x_m_per_s": {"kind": "constant", "value": 1.0}}
    tools = {"tool": {"path": path, "groups": {"body": {"mesh": mesh}}}}
    scene = field(soil, tools=tools)
    digests = []
    for mode in ("direct", "nodes"):
        out = soil.folder / mode
        status = main(["run", str(scene.path), "--mode", mode, "--out", str(out), "--set", "duration_s=0.1"])
        assert status == 0
        digests.append((out / "series.csv").read_bytes())
        summary = json.loads((out / "summary.json").read_text())
        digests.append(summary["run"]["state_sha256"])
    assert digests[1]
    assert digests[:2] == digests[2:]


def test_the_loosened_section_of_a_graded_bed_is_that_of_its_volume():
    """Half of the particles, the small ones, move: an eighth of the larger ones' volume each."""
    before = np.random.default_rng(0).uniform((0.0, -0.2, -0.2), (1.0, 0.2, 0.0), (4000, 3))
    radii = np.where(np.arange(4000) % 2 == 0, 0.01, 0.02)
    after = before + np.where(radii < 0.015, 0.05, 0.0)[:, None] * (1.0, 0.0, 0.0)
    found = disturbance_between(before, after, (0.1, 0.9), 0.01, radii_m=radii)
    assert_allclose(found.moved_fraction, 1.0 / 9.0, rtol=0.05)
    assert_allclose(found.slice_m2.mean(), found.area_m2, rtol=0.2)


def test_the_core_follows_from_the_tools():
    """Of the shipped tine: half of its share and half its depth aside, two coarse diameters below the tip."""
    scene = load_scene("field_tine", {"soil.particles.coarse": {"times": 1.5}})
    coarse = scene.scene.particle_soil.particles.coarse
    assert_allclose(coarse.beyond_m, 0.03 + 0.10, atol=0.001)
    radius = scene.scene.particle_soil.particles.mean_volume_radius_m
    assert_allclose(coarse.below_m, 0.20 + 6.0 * radius, atol=0.001)
    assert scene.document["soil"]["particles"]["coarse"]["beyond_m"] == coarse.beyond_m
    assert scene.material is not None


def cutting(maker, start_z_m, **part):
    """A box of 0.04 x 0.125 m across and high, its middle at this height."""
    tools = one_tool(maker.box(0.03, 0.04, 0.125))
    tools["tool"]["path"]["start_z_m"] = start_z_m
    tools["tool"]["groups"]["body"].update(part)
    return tools


def test_the_core_is_as_wide_as_the_tillage_tools_reach_aside(soil):
    """Of a box that stands aside of the middle the farther side counts, wheels do not; in whole millimetres
    that do not fall short."""
    tools = cutting(soil, 0.0325, position_m=[0.0, -0.015, 0.0])
    wheel = {"mesh": soil.box(0.03, 0.1, 0.2), "position_m": [0.1, 0.0, 0.0]}
    tools["wheel"] = {"role": "wheel", "path": {}, "groups": {"tread": wheel}}
    found = graded(soil, coarse={"times": 1.5}, tools=tools).scene.particle_soil.particles
    exact = np.array((0.035 + 0.5 * 0.03, 0.03 + 2.0 * 2.0 * 1.5 * found.mean_volume_radius_m))
    over = np.array((found.coarse.beyond_m, found.coarse.below_m)) - exact
    assert (over > -1e-9).all()
    assert (over <= 1e-3).all()


@pytest.mark.parametrize("start_z_m", [0.0625, 0.1])
def test_a_core_needs_a_tool_in_the_soil(soil, start_z_m):
    """One that stands on the surface, or above it, gives no depth."""
    with pytest.raises(SceneError, match=r"coarse.beyond_m: is missing, and no tillage tool is below"):
        graded(soil, coarse={"times": 1.5}, tools=cutting(soil, start_z_m))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"times": 0.9}, r"coarse.times: .*greater than 1"),
        ({"times": 4.0}, r"times the smallest radius"),
        ({"times": 1.5, "beyond_m": 0.01}, r"coarse.beyond_m: 0.01 m given, and the tillage tools reach to"),
        ({"times": 1.5, "below_m": 0.1}, r"coarse.below_m: 0.1 m given, and the tillage tools reach to"),
        ({"times": 1.5, "beyond_m": 0.3, "below_m": 0.3}, r"fills the bin; make beyond_m or below_m smaller"),
    ],
)
def test_graded_beds_that_cannot_be(changes, told):
    """One message each, before anything is prepared."""
    with pytest.raises(SceneError, match=told):
        load_scene("field_tine", {"soil.particles.coarse": changes})


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"bed": {"kind": "dense_random"}}, r"coarse: needs bed.kind 'tiled', 'dense_random' is given"),
        ({"layers": [{"name": "a", "thickness_m": 0.05}, {"name": "b"}]}, r"not for a soil with layers"),
        ({"particles": {"radius_m": 0.01, "density_kg_per_m3": 1e3, "coarse": COARSE}}, r"needs particles"),
    ],
)  # fmt: skip
def test_soils_that_cannot_be_graded(soil, changes, told):
    """One message each."""
    with pytest.raises(SceneError, match=told):
        graded(soil, **changes)
