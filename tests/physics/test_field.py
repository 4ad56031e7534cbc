"""Soil in a window that goes with a tool through a field: the packing of one block, its contacts, what enters
and leaves, and the same bits on two threads and after a restart on either side of a shift."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.blocks import history_place, history_places
from subsoil_ros.dem.bonds.kernel import SHAPE, STATE
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.field import field_period
from subsoil_ros.dem.packing.bed_geometry import top_surface_m
from subsoil_ros.dem.packing.bed_report import report_bed
from subsoil_ros.dem.periodic import HELD_LAYER
from subsoil_ros.errors import InputError, PhysicsError, SceneError
from subsoil_ros.messages import SpatialMotion, ToolMotion
from tests.physics.conftest import one_tool
from tests.soils import BOOKED, LINEAR

SIZES = {"kind": "uniform", "min_radius_m": 0.0085, "max_radius_m": 0.0115}
ALIKE = {"radius_m": 0.01, "density_kg_per_m3": 1800.0}
LARGEST = SIZES["max_radius_m"]
SPEED, START_M = 1.0, 0.1
STEP_S = 5e-5


def field(maker, *, sides="held", **changes):
    """A field 1.2 m long under a window of some 0.3 m: 1,500 particles, in strips of about 37 mm."""
    soil = {
        "bin": {"length_m": 1.2, "width_m": 0.3, "depth_m": 0.1, "sides": sides},
        "window": {"ahead_m": 0.12, "behind_m": 0.1},
        "particles": {"sizes": SIZES, "density_kg_per_m3": 2500.0},
        "bed": {"kind": "tiled", "tile_m": 0.15},
        "law": LINEAR,
        "time_step_s": STEP_S,
        **BOOKED,
        **changes,
    }
    tools = one_tool(maker.box(0.03, 0.04, 0.08, subdivide=1))
    return maker.scene(soil=soil, tools=tools, coupling={"communication_step_ns": 200_000})


def bar(tick):
    """A bar on its way through the field."""
    time_s = 2e-4 * (tick + 1)
    return (ToolMotion("tool", START_M + SPEED * time_s, 0.0, -0.03, 0.0, SPEED, 0.0, 0.0),)


def driven(scene, threads=1, *, ticks):
    """An engine after so many ticks, and the wrenches."""
    engine = build_engine(scene, threads)
    engine.start(bar(-1))
    return engine, [engine.advance(tick, bar(tick)) for tick in range(ticks)]


def window_of(engine):
    """First strip, and the one after the last."""
    return tuple(engine.state_arrays()["window"].tolist()[:2])


def far_from_ends(engine, diameters=2.0):
    """(n,) bool: free particles that many diameters within what is held, or within walls."""
    p, margin = engine.particles(), (HELD_LAYER + 2.0 * diameters) * LARGEST
    low, high = engine.bed.lower_m, engine.bed.upper_m
    inside = (p.position[:, 0] > low[0] + margin) & (p.position[:, 0] < high[0] - margin)
    if engine.bed.sides == "walls":
        inside &= (p.position[:, 1] > low[1] + margin) & (p.position[:, 1] < high[1] - margin)
    return inside & ~p.held


def above(x_m):
    """The bar above the soil, where the window still follows it."""
    return (ToolMotion("tool", x_m, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0),)


@pytest.mark.full
@pytest.mark.parametrize("sides", ["held", "periodic"])
def test_a_field_stands_as_its_block_does(soil, sides):
    """Copies of one particle of the block feel the same to round-off, next to nothing: no contact and no
    spring is missing."""
    scene = field(soil, sides=sides, window={"ahead_m": 0.6, "behind_m": 0.1})
    engine = build_engine(scene)
    engine.start(above(0.3))
    p, inside = engine.particles(), far_from_ends(engine)
    number = engine.window.field._number[p.identity % len(engine.window.field._place)]
    force, weight = engine.particles().force[inside], 9.81 * engine.mass_kg
    assert np.sqrt((force**2).sum(axis=1).mean()) < 0.05 * weight
    order = np.argsort(number[inside], kind="stable")
    same = np.diff(number[inside][order]) == 0
    assert same.sum() > 300
    assert np.abs(np.diff(force[order], axis=0)[same]).max() < 1e-8
    first, history = engine.contact_histories()
    assert np.abs(history[:, :3]).max() > 0.0
    assert len(first) > 3 * p.count


@pytest.mark.full
@pytest.mark.parametrize("sides", ["held", "periodic"])
def test_report_is_of_the_soil_between_the_held_layers(soil, sides):
    """Density, floor and voids of a window are those of its soil; it has no walls to be away from."""
    scene = field(soil, sides=sides)
    report = report_bed(build_engine(scene).bed, scene.scene.soil)
    density = scene.scene.soil.bed.solid_fraction * 2500.0
    assert report.density_kg_per_m3 == pytest.approx(density, rel=0.04)  # a thin bed: its surface counts
    assert report.floor_m == pytest.approx(-0.1, abs=LARGEST)
    assert report.max_void_radius_m < LARGEST
    assert report.wall_gaps == {}


@pytest.mark.full
def test_a_strip_is_laid_out_without_a_jolt(soil):
    """With the tool away: what acts on particles that were free stays as it is, bit for bit; those laid out
    and freed feel what their copies in the block do, to 5 % of the weight (rms); no energy is made."""
    engine = build_engine(field(soil))
    engine.start(above(0.5))
    field_of, p = engine.window.field, engine.particles()
    inside = far_from_ends(engine)
    number = field_of._number[p.identity % len(field_of._place)]
    resting = np.full((number.max() + 1, 3), np.nan)
    resting[number[inside]] = p.force[inside]
    for tick in range(100):
        engine.advance(tick, above(0.5))
    p = engine.particles()
    before = dict(zip(p.identity.tolist(), p.force.copy(), strict=True))
    held = set(p.identity[p.held].tolist())
    book, (rear, front) = engine.energy(), window_of(engine)
    engine.shift(rear, front + 4)
    p = engine.particles()
    free_before = np.isin(p.identity, list(before.keys() - held))
    for k in np.flatnonzero(~p.held & free_before):
        assert_array_equal(p.force[k], before[int(p.identity[k])])
    fresh = ~p.held & ~free_before & (np.abs(p.position[:, 1]) < 0.15 - (HELD_LAYER + 4.0) * LARGEST)
    copies = resting[field_of._number[p.identity[fresh] % len(field_of._place)]]
    known = np.isfinite(copies[:, 0])
    assert known.sum() > 100
    change, weight = np.linalg.norm(p.force[fresh] - copies, axis=1)[known], 9.81 * p.mass.mean()
    assert np.sqrt((change**2).mean()) < 0.05 * weight
    assert change.max() < 0.1 * weight
    for tick in range(100, 200):
        engine.advance(tick, above(0.5))
    drafts_work = 100.0 * engine.window.field.strip_m  # of 100 N, a small tine's
    assert engine.energy().kinetic_joule - book.kinetic_joule < 1e-4 * drafts_work


def test_the_window_covers_the_way_of_a_tool_through_a_long_tick(soil):
    """In each tick soil stands as far ahead of where the tool ends, and as far behind of where it begins, as
    the scene asks for."""
    scene = field(soil)
    tick_s = 0.05
    scene = soil.resolve(scene.document | {"coupling": {"communication_step_ns": 50_000_000}})
    engine = build_engine(scene)
    engine.start((ToolMotion("tool", 0.3, 0.0, -0.03, 0.0, SPEED, 0.0, 0.0),))
    for tick in range(2):
        begin, end = (0.3 + SPEED * tick_s * (tick + k) for k in (0, 1))
        engine.advance(tick, (ToolMotion("tool", end, 0.0, -0.03, 0.0, SPEED, 0.0, 0.0),))
        rear, front = (strip * engine.window.field.strip_m for strip in window_of(engine))
        assert front >= end + 0.5 * 0.03 + 0.12 - 1e-9
        assert rear <= begin - 0.5 * 0.03 - 0.1 + 1e-9


def test_the_width_that_a_refusal_names_suffices(soil):
    """Rounded up to whole millimetres; where held sides leave nothing, the message says so."""
    from subsoil_ros.dem.packing.start import check_start

    def narrow(width_m):
        box = {"length_m": 0.6, "width_m": width_m, "depth_m": 0.1, "sides": "held"}
        scene = field(soil, bin=box, bed={"kind": "tiled"})
        return soil.scene(soil=scene.document["soil"], tools=one_tool(soil.box(0.03, 0.0333, 0.08)))

    with pytest.raises(SceneError, match=r"no width is left for tools.* at least 0.126 m"):
        check_start(narrow(0.085))
    check_start(narrow(0.126))


def test_a_window_that_jumps_lays_out_what_is_in_it(soil):
    """Tools that were lifted come down beyond the window: nothing is laid out behind it."""
    engine = build_engine(field(soil))
    engine.start(above(0.2))
    engine.shift(20, 28)
    x, strip = engine.particles().position[:, 0], engine.window.field.strip_m
    assert x.min() >= 20 * strip - LARGEST
    assert x.max() <= 28 * strip + LARGEST
    assert engine.particles().held[x < 20 * strip + 2.0 * LARGEST].all()
    assert not engine.whole_state().domain.outside(engine.particles()).any()


def test_a_tool_is_where_its_edges_cross_the_height_too(soil):
    """A raked plate whose corners are at its tip and high above: its whole length counts that is below."""
    scene = field(soil)
    plate = soil.scene(soil=scene.document["soil"], tools=one_tool(soil.box(1.6, 0.04, 0.01)))
    engine = build_engine(plate)
    engine.start((ToolMotion("tool", 0.6, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0),))
    low, high = engine.whole_state().tools[0].span_m(0.1)
    assert high - low == pytest.approx(0.8 * np.cos(0.5) + 0.1 / np.tan(0.5), abs=0.03)


@pytest.mark.full
def test_soil_that_moves_at_the_held_front_is_told(soil, caplog):
    """A blade as wide as the field pushes soil up to where it is held: the draft would be that of a wall."""
    scene = field(soil, sides="periodic")
    wide = soil.scene(
        soil=scene.document["soil"], tools=one_tool(soil.box(0.03, 0.5, 0.08)),
        coupling={"communication_step_ns": 200_000},
    )  # fmt: skip
    engine = build_engine(wide)
    engine.start(bar(-1))
    for tick in range(700):
        engine.advance(tick, bar(tick))
    assert "soil moves at the front of the window" in caplog.text


def test_soil_comes_and_goes_with_the_tool(soil):
    """As many particles all the way; identities are unique for ever; the balance of energy is closed."""
    engine, _ = driven(field(soil), ticks=0)
    start, seen, counts, windows = engine.energy().total_joule, set(), {}, []
    for tick in range(3000):
        engine.advance(tick, bar(tick))
        if tick % 50 == 0:
            now = set(engine.particles().identity.tolist())
            assert len(now) == engine.particle_count
            new = now - seen
            assert not seen or not new or min(new) > max(seen - new)
            seen |= now
            windows.append(window_of(engine))
            rear, front = windows[-1]
            if rear > 0:
                counts.setdefault((front - rear), []).append(engine.particle_count)
    assert windows[-1][0] > 12
    assert max(len(of_one_window) for of_one_window in counts.values()) > 3
    for of_one_window in counts.values():
        assert np.ptp(of_one_window) < 0.15 * np.mean(of_one_window)  # the bar pushes a heap
    assert engine.lost_particles == ()
    book = engine.energy()
    assert abs(book.total_joule - start) < 0.02 * book.turned_over_joule
    x = engine.particles().position[:, 0]
    strip = engine.window.field.strip_m
    rear, front = window_of(engine)
    assert x.min() >= rear * strip
    assert x.max() <= front * strip


def test_the_plot_is_the_ground_turned(soil):
    """Every particle of the plot is a particle of the block, some whole edges away in the ground; the period
    closes on itself; nothing is there twice, and nothing is missing."""
    rng = np.random.default_rng(1)
    edge, width = 0.6, 0.5
    points = rng.uniform((0.0, -0.3, -0.1), (edge, 0.3, 0.0), (400, 3))
    bed = Bed(points, (0.0, -0.3, -0.1), (edge, 0.3), sides="endless")
    plot = field_period(bed, width, "held")
    assert plot.period_m == pytest.approx(edge * np.hypot(21, 8), rel=1e-12)
    ground = (plot.place_m[:, :2] + (0.0, 0.5 * width)) @ plot.turn  # back by the transposed
    away = (ground - (points[:, :2] + (0.0, 0.3))[plot.number]) / edge
    assert np.abs(away - np.round(away)).max() < 1e-9
    assert_array_equal(plot.place_m[:, 2], points[plot.number, 2])
    assert len(np.unique(np.column_stack((plot.number, np.round(away))), axis=0)) == len(plot.number)
    density, found = 400 / edge**2, len(plot.number) / (plot.period_m * width)
    assert found == pytest.approx(density, rel=0.01)
    assert np.unique(plot.number).size == 400
    offsets = np.unique(np.round(plot.turn[1] @ np.round(away).T * np.hypot(21, 8)).astype(int))
    assert_array_equal(np.diff(offsets), 1)  # rows of copies, 1/22 of the edge apart


@pytest.mark.full
@pytest.mark.parametrize("before", [True, False], ids=["before a shift", "after it"])
def test_a_restart_and_two_threads_give_the_same_bits(soil, before):
    """From a state just before and just after a shift."""
    scene = field(soil)
    first, _ = driven(scene, ticks=0)
    tick, window = 0, window_of(first)
    kept = {}
    while window_of(first) == window or tick < 300:
        window = window_of(first)
        if before:
            kept = {name: np.array(array) for name, array in first.state_arrays().items()}
        first.advance(tick, bar(tick))
        tick += 1
    at = tick - 1 if before else tick
    if not before:
        kept = {name: np.array(array) for name, array in first.state_arrays().items()}
    second = build_engine(scene, 2)
    second.restore(kept)
    if before:
        second.advance(at, bar(at))
    assert window_of(second) == window_of(first) != window
    assert second.whole_state().monitor.count == first.whole_state().monitor.count
    for later in range(tick, tick + 400):
        assert first.advance(later, bar(later)) == second.advance(later, bar(later))
    assert window_of(first) != window
    for name, array in first.state_arrays().items():
        assert_array_equal(array, second.state_arrays()[name], err_msg=name)


def test_a_field_may_have_walls_at_its_sides(soil):
    """Nothing is held there, and nothing stands in them; soil a few diameters away does not notice: it moves
    by less than a tenth of a radius while that at the walls settles."""
    engine = build_engine(field(soil, sides="walls"))
    engine.start(above(0.3))
    p = engine.particles()
    assert np.abs(p.position[:, 1]).max() <= 0.15 - SIZES["min_radius_m"]
    at_side = (np.abs(p.position[:, 1]) > 0.15 - 1.5 * LARGEST) & (p.position[:, 2] > -0.09)
    inside = (p.position[:, 0] > 0.3 - 0.05) & (p.position[:, 0] < 0.3 + 0.05)
    assert (at_side & inside).sum() > 5
    assert not p.held[at_side & inside].any()
    for tick in range(1500):
        engine.advance(tick, above(0.3 + 2e-4 * tick))
    assert engine.lost_particles == ()
    p = engine.particles()
    moved = np.linalg.norm(p.position - engine.window.field.laid_out_m(p.identity), axis=1)
    middle = np.abs(p.position[:, 1]) < 0.05
    assert np.percentile(moved[middle & ~p.held], 95.0) < 0.1 * ALIKE["radius_m"]


@pytest.mark.full
def test_a_field_may_slope(soil):
    """Cut out of the level block: the surface is the profile's to a radius, all along. One particle in a
    hundred rolls farther than a radius until it rests, and nothing is lost."""
    profile = {"x_m": [0.1, 0.6, 1.1], "z_m": [0.0, -0.04, -0.01]}
    engine = build_engine(field(soil, surface=profile))
    level = build_engine(field(soil))
    heights = {}
    for one in (engine, level):
        one.start(above(0.3))
        for tick in range(2000):
            one.advance(tick, above(min(0.3 + 2e-4 * tick, 0.7)))
        assert one.lost_particles == ()
        x, _, z = one.particles().position.T
        columns = np.arange(0.62, 0.76, 0.02)
        heights[one] = np.array([z[np.abs(x - column) < 0.02].max() for column in columns])
    found = heights[engine] - heights[level]
    assert found == pytest.approx(np.interp(columns, profile["x_m"], profile["z_m"]), abs=ALIKE["radius_m"])
    assert (np.linalg.norm(engine.displacements_m(), axis=1) > ALIKE["radius_m"]).mean() < 0.01


@pytest.mark.full
def test_both_ends_of_a_field_are_walls(soil):
    """A tool comes in at one, as into a bin, and nothing is held there, nor at the other; nothing is lost."""
    scene = field(soil, bin={"length_m": 0.4, "width_m": 0.3, "depth_m": 0.1, "sides": "held"})

    def through(tick):
        return (ToolMotion("tool", -0.1 + 1e-4 * (tick + 1), 0.0, -0.03, 0.0, 0.5, 0.0, 0.0),)

    def free_at(x_m):
        p = engine.particles()
        sides = np.abs(p.position[:, 1]) < 0.15 - (HELD_LAYER + 0.1) * LARGEST
        here = np.abs(p.position[:, 0] - x_m) < 1.2 * LARGEST
        return (~p.held)[here & sides & (p.position[:, 2] > -0.09)]

    engine = build_engine(scene)
    engine.start(through(-1))
    assert free_at(0.0).all()
    assert not free_at(engine.bed.upper_m[0]).all()
    forces = [engine.advance(tick, through(tick))[0].force_x_newton for tick in range(3900)]
    assert max(forces[:500]) == min(forces[:500]) == 0.0
    assert min(forces) < -1.0
    assert engine.lost_particles == ()
    assert window_of(engine)[1] == engine.window.field.count
    assert free_at(engine.bed.upper_m[0]).all()
    assert not free_at(engine.bed.lower_m[0]).any()


@pytest.mark.full
def test_a_tool_that_comes_back_is_refused(soil):
    """The soil behind the window is gone: the run stops instead of finding none."""
    engine, _ = driven(field(soil), ticks=2000)
    assert window_of(engine)[0] > 0

    def back():
        for tick in range(2000, 4000):
            engine.advance(tick, bar(3999 - tick))

    with pytest.raises(PhysicsError, match=r"tick 2...,? .*back at x = .* taken away; allowed is x > "):
        back()


BOX = {"length_m": 1.2, "width_m": 0.3, "depth_m": 0.1}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"window": {"ahead_m": 0.05, "behind_m": 0.1}}, r"window.ahead_m: 0.05 m is less than the bed"),
        ({"bed": {"kind": "dense_random"}}, r"window: is laid out from a tiled bed over a held floor, not"),
        ({"bed": {"kind": "tiled", "floor": "plane"}}, r"over a held floor, not from 'tiled', floor plane"),
        ({"window": None}, r"bin.sides: 'held' needs soil.window"),
        ({"bed": {"kind": "tiled", "tile_m": 0.05}}, r"soil.bed.tile_m: 0.05 m given; allowed is at least"),
        ({"bin": BOX | {"width_m": 0.1, "sides": "held"}}, r"and at most 0.1 m, the smaller of"),
    ],
)
def test_windows_that_cannot_be(soil, changes, told):
    """One message each, before anything runs."""
    from subsoil_ros.dem.packing.start import check_start

    with pytest.raises(SceneError, match=told):
        check_start(field(soil, **changes))


def test_a_tool_beyond_the_field_or_at_its_held_sides_is_refused(soil):
    """It would find no soil, or cut rock."""
    from subsoil_ros.dem.packing.start import check_start

    with pytest.raises(InputError, match=r"begin at x = 1.985 m, beyond the field, which ends at 1.214 m"):
        build_engine(field(soil)).start((ToolMotion("tool", 2.0, 0.0, -0.03, 0.0, 0.0, 0.0, 0.0),))
    wide = soil.scene(soil=field(soil).document["soil"], tools=one_tool(soil.box(0.03, 0.25, 0.08)))
    with pytest.raises(SceneError, match=r"tools.tool: reaches to y = 0.125 m; .*width_m at least"):
        check_start(wide)


def test_scenes_with_a_window_get_its_engine(soil):
    """And those without the plain one."""
    assert build_engine(field(soil)).window is not None
    assert build_engine(soil.scene()).window is None


def test_places_of_histories_are_those_of_the_kernels():
    """Within blocks of pairs, and from one to the next."""
    pairs = np.array([0, 1, 511, 512, 1300])
    places = history_places(pairs, 7)
    assert places[:, 0].tolist() == [history_place(pair, 7) for pair in pairs]
    assert_array_equal(np.diff(places, axis=1), 512)


CEMENT = {"youngs_modulus_pa": 1e6, "tensile_strength_pa": 5e3, "cohesion_pa": 1e4, "damping_ratio": 0.05}


def bonds_by_identity(engine):
    """Length without force of every whole bond, by the identities of its particles."""
    state = engine.whole_state()
    pairs, p = state.pairs, state.particles
    first = np.repeat(np.arange(p.count), np.diff(pairs.row_start))
    lengths = state.bonds.state[history_places(np.arange(len(first)), len(STATE + SHAPE))[:, 0]]
    ends = np.sort(np.stack((p.identity[first], p.identity[pairs.neighbour]), axis=1), axis=1)
    whole = lengths > 0.0
    return dict(zip(map(tuple, ends[whole].tolist()), lengths[whole].tolist(), strict=True))


@pytest.mark.full
@pytest.mark.parametrize("sides", ["held", "periodic"])
def test_bonds_of_a_window_are_those_of_the_whole_field(soil, sides):
    """Soil that was laid out strip by strip has the bonds that it has laid out at once, each once; those
    behind the window are gone and not counted as broken."""
    scene = field(soil, sides=sides, bonds=CEMENT)
    engine = build_engine(scene)
    engine.start(above(0.2))
    _, front = window_of(engine)
    for further in (2, 5):
        engine.shift(further, front + further)
    window = {"ahead_m": 0.15, "behind_m": 1.0}
    at_once = build_engine(field(soil, sides=sides, bonds=CEMENT, window=window))
    at_once.start(above(0.5))
    found, wanted = bonds_by_identity(engine), bonds_by_identity(at_once)
    within = {
        ends: length for ends, length in wanted.items() if set(ends) <= set(engine.particles().identity)
    }
    assert len(found) > 2.0 * engine.particle_count
    assert found == pytest.approx(within, abs=1e-12)
    assert engine.state("", 0, 0).broken_bond_count == 0


def test_bonded_soil_has_the_same_bits_on_threads_and_after_a_restart(soil):
    """Bonds break at the bar, before and after a shift of the window; their books close."""
    scene = field(soil, bonds=CEMENT)
    first, wrenches = driven(scene, ticks=500)
    assert first.state("", 0, 0).broken_bond_count > 20
    _, again = driven(scene, 2, ticks=500)
    assert wrenches == again
    half, _ = driven(scene, ticks=250)
    arrays = {name: np.array(array) for name, array in half.state_arrays().items()}
    resumed = build_engine(scene)
    resumed.restore(arrays)
    assert [resumed.advance(tick, bar(tick)) for tick in range(250, 500)] == wrenches[250:]
    for name, array in first.state_arrays().items():
        assert_array_equal(array, resumed.state_arrays()[name], err_msg=name)
    cloud = first.cloud(0, 0)
    p = first.particles()
    broken = np.asarray(cloud.broken_parts)
    near = np.abs(np.asarray(cloud.positions_m)[:, 0] - bar(499)[0].x_m) < 0.1
    assert broken[near].mean() > 3.0 * broken[~near].mean()
    assert len(broken) == p.count
    book = first.energy()
    assert book.sinks_joule["bond_breakage"] > 0.0


@pytest.mark.full
def test_a_tool_in_space_goes_through_a_bonded_field_as_a_planar_one(soil):
    """The same forces, the same bonds broken, before and after shifts of the window."""
    scene = field(soil, bonds=CEMENT)
    planar, wrenches = driven(scene, ticks=500)
    spatial = build_engine(scene)
    spatial.start(in_space(bar(-1)))
    found = [spatial.advance(tick, in_space(bar(tick)))[0] for tick in range(500)]
    assert window_of(spatial) == window_of(planar)
    assert spatial.state("", 0, 0).broken_bond_count == planar.state("", 0, 0).broken_bond_count
    forces = np.array([(w.force_x_newton, w.force_z_newton) for w in found])
    wanted = np.array([(w.force_x_newton, w.force_z_newton) for (w,) in wrenches])
    off = np.abs(forces - wanted).max(axis=1) / np.abs(wanted).max()
    assert off[:100].max() < 1e-9
    assert off.max() < 0.01  # round-off, which contacts and bonds multiply in 100 ms


def in_space(motions):
    """The same motions, of tools in space."""
    return tuple(
        SpatialMotion.of(m.tool, m.position_m, m.quaternion, m.velocity_m_per_s, m.spin_rad_per_s)
        for m in motions
    )


@pytest.mark.full
def test_a_tool_that_leaps_ahead_finds_soil(soil):
    """The window goes with it, and soil that it would overlap there is not laid out into it."""
    scene = field(soil)
    path = {"external": True, "may_leap": True, "start_x_m": START_M, "start_z_m": 0.2}
    tools = {"tool": scene.document["tools"]["tool"] | {"path": path}}
    engine = build_engine(soil.resolve(scene.document | {"tools": tools}))
    engine.start(bar(-1))
    for tick in range(5):
        engine.advance(tick, bar(tick))
    before = window_of(engine)
    ahead = [(dataclasses.replace(bar(tick)[0], x_m=bar(tick)[0].x_m + 0.5),) for tick in range(5, 80)]
    found = [engine.advance(tick, motions)[0] for tick, motions in enumerate(ahead, 5)]
    leaps, removed = engine.leaps
    assert leaps == 1
    assert removed > 5
    assert window_of(engine)[0] > before[0]
    assert max(abs(wrench.force_x_newton) for wrench in found[:5]) < 20.0
    assert max(abs(wrench.force_x_newton) for wrench in found) > 1.0


def test_a_surface_is_cut_at_its_height(soil):
    """Mean top 20 mm lower than that of the level field, to a fifth of a radius."""
    tops = []
    for height in (0.0, -0.02):
        engine = build_engine(field(soil, surface={"x_m": [0.0], "z_m": [height]}))
        engine.start(above(0.5))
        p = engine.particles()
        bed = dataclasses.replace(engine.bed, positions_m=np.array(p.position), radii_m=np.array(p.radius))
        top = top_surface_m(bed, 0.01)
        tops.append(float(top[top > -0.06].mean()))  # where there is soil
    assert tops[0] == pytest.approx(0.0, abs=1e-3)
    assert tops[1] - tops[0] == pytest.approx(-0.02, abs=2e-3)
