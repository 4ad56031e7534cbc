"""W1 to W7 and G1 to G6: windows of soil and graded beds at the ends of their parameters."""

import dataclasses
import math
import re
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import trimesh

from subsoil_ros.dem.beds.prepare import check_start, prepare_bed
from subsoil_ros.dem.blocks import history_places
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.periodic import HELD_LAYER
from subsoil_ros.dem.window import FieldEngine
from subsoil_ros.errors import InputError
from subsoil_ros.limits.stable_steps import step_limits
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.messages import ToolMotion
from subsoil_ros.scene.soil import Soil
from subsoil_ros.scene.window import rupture_distance_m

from .cases import REFUSED, RIGHT, STOPPED, Cases, Outcome, must, refused, right, right_or_stopped, stopped
from .laboratory import GRAVITY, Document, Drag, Laboratory, advance, linear, tool_at
from .steps import DEFECT, SAME

CASES = Cases()

Engine = TypeVar("Engine", bound=SoilEngine)

SMALLEST, LARGEST, DENSITY = 0.0085, 0.0115, 2500.0
SIZES = {"kind": "uniform", "min_radius_m": SMALLEST, "max_radius_m": LARGEST}
RADIUS = 0.01
"""About the mean, for the part of a radius that a particle may move."""
LAW = linear(
    1e5, tangential_stiffness_newton_per_m=8e4, damping_newton_s_per_m=5.0,
    tangential_damping_newton_s_per_m=5.0, static_friction=0.5, sliding_friction=0.4, rolling_friction=0.1,
)  # fmt: skip
ALIKE_M = 0.05
"""Travel after which motions in two windows are no longer correlated."""
STEP_S, TICK_NS = 5e-5, 200_000
TICK_S = 1e-9 * TICK_NS

FIELD_M = (1.2, 0.3, 0.1)
TOOL_M = (0.03, 0.04, 0.08)
TOOL_Z_M = -0.03  # 70 mm deep
CALM_MOVE = 0.005
"""Part of a radius by which 19 in 20 particles of a bed may move in MOVE_S; loose ones roll."""
MOVE_S = 0.05
CALM_M_PER_S = 1e-3
"""Of soil about a tool that has come to rest, as in S9c and S11a."""
LOST_ONE_IN = 1000
"""soil.max_lost_particles, if the scene gives none (docs/packing.md)."""


def scene(
    laboratory: Laboratory,
    size_m: Sequence[float],
    tool_m: tuple[float, float, float] = TOOL_M,
    tick_ns: int = TICK_NS,
    gravity: float = GRAVITY,
    sides: str = "walls",
    coarse: Document | None = None,
    mesh: str | None = None,
    **soil: Any,
) -> ResolvedScene:
    """A bar in dry random soil, or the tool of `mesh`; `soil` has further keys of it."""
    length, width, depth = size_m
    particles: Document = {"sizes": SIZES, "density_kg_per_m3": DENSITY}
    mesh = mesh or laboratory.box(*tool_m)
    document: Document = {
        "name": "extreme",
        "duration_s": 1000.0,
        "gravity_m_per_s2": gravity,
        "coupling": {"communication_step_ns": tick_ns, "force": "tick_mean"},
        "tools": {"tool": {"path": {}, "groups": {"all": {"mesh": mesh}}}},
        "soil": {
            "bin": {"length_m": length, "width_m": width, "depth_m": depth, "sides": sides},
            "particles": particles if coarse is None else particles | {"coarse": coarse},
            "law": LAW,
            "time_step_s": STEP_S,
            **soil,
        },
    }
    return laboratory.resolve(document)


def field_scene(
    laboratory: Laboratory,
    size_m: Sequence[float] = FIELD_M,
    window_m: tuple[float, float] = (0.12, 0.1),
    tile_m: float | None = 0.15,
    sides: str = "held",
    **changes: Any,
) -> ResolvedScene:
    """The bar in a field; `window_m`: ahead and behind."""
    window = {"ahead_m": window_m[0], "behind_m": window_m[1]}
    bed = {"kind": "tiled", "tile_m": tile_m}
    return scene(laboratory, size_m, sides=sides, window=window, bed=bed, **changes)


def field(laboratory: Laboratory, **changes: Any) -> FieldEngine:
    """The engine of `field_scene`, energy booked."""
    return FieldEngine(field_scene(laboratory, **changes), book=True)


def strips_of(engine: FieldEngine) -> tuple[int, int]:
    """First strip of the window, and the one after its last."""
    rear, front = engine.state_arrays()["window"].tolist()[:2]
    return rear, front


def strip_m(engine: FieldEngine) -> float:
    """Length of a strip [m]."""
    return (engine.bed.upper_m[0] - engine.bed.lower_m[0]) / np.diff(strips_of(engine)).item()


def above(x_m: float) -> tuple[ToolMotion, ...]:
    """The tool above the soil, where the window still follows it."""
    return tool_at(x_m, 0.1)


def started(engine: Engine, x_m: float, speed: float) -> Engine:
    """The engine with the tool in the soil at `x_m`, at this speed [m/s]."""
    engine.start(tool_at(x_m, TOOL_Z_M, speed))
    return engine


def driven(engine: SoilEngine, tick_s: float, duration_s: float, x_m: float, speed: float) -> Drag:
    """The tool of an engine that started at `x_m`, on at constant speed [m/s]; energy booked."""
    begin, largest, forces = engine.energy(), 0.0, []
    for tick in range(round(duration_s / tick_s)):
        at = tool_at(x_m + speed * tick_s * (tick + 1), TOOL_Z_M, speed)
        forces.append(engine.advance(tick, at)[0].force_x_newton)
        if tick % 50 == 0:
            largest = max(largest, engine.energy().kinetic_joule)
    end = engine.energy()
    exchanged = end.turned_over_joule + max(largest, end.kinetic_joule)
    return Drag(engine, forces, abs(end.total_joule - begin.total_joule) / exchanged if exchanged else 0.0)


def lost(engine: SoilEngine) -> int:
    """Particles that have left the domain."""
    return engine.state("", 0, 0).lost_particle_count


def alike(first: float, second: float, part: float, what: str) -> float:
    """Difference over the first, which must be within `part`."""
    off = second / first - 1.0
    must(abs(off) < part, f"{what}: {first} and {second}")
    return off


def same_draft(first: Drag, second: Drag) -> str:
    """Mean forces of the whole way within SAME, books within DEFECT."""
    must(max(first.defect, second.defect) < DEFECT, f"defects {first.defect}, {second.defect}")
    means = [float(np.mean(drag.forces_newton)) for drag in (first, second)]
    off = alike(means[0], means[1], SAME, "mean forces")
    return (
        f"{-means[0]:.1f} and {-means[1]:.1f} N ({100.0 * off:+.1f} %), defects {first.defect:.2g} and "
        f"{second.defect:.2g}"
    )


@CASES.add("W1", RIGHT)
def longer_than_the_field(laboratory: Laboratory) -> Outcome:
    """Window longer than the whole field, against that of the rupture distance."""
    usual_m = rupture_distance_m(FIELD_M[2], 30.0)
    firsts = []
    for ends_m in (usual_m, FIELD_M[0]):
        window_m = (ends_m, ends_m)
        engine = started(field(laboratory, size_m=(0.8, 0.2, 0.1), window_m=window_m), 0.25, 1.0)
        begun = strips_of(engine)
        moved = driven(engine, TICK_S, 0.2, 0.25, 1.0)
        shifted = strips_of(engine) != begun
        must(shifted == (ends_m == usual_m), f"window {ends_m} m: {begun}, then {strips_of(engine)}")
        must(lost(engine) == 0, f"window {ends_m} m: {lost(engine)} lost")
        must(moved.defect < DEFECT, f"window {ends_m} m: defect {moved.defect}")
        firsts.append(float(np.mean(moved.forces_newton[: round(ALIKE_M / TICK_S)])))
    off = alike(firsts[0], firsts[1], SAME, f"mean forces of {ALIKE_M} m")
    return right(f"first {1e3 * ALIKE_M:g} mm: {-firsts[0]:.1f} N, whole field {100.0 * off:+.1f} %")


@CASES.add("W2", RIGHT)
def standing_in_a_field(laboratory: Laboratory) -> Outcome:
    """Tool at rest in a field."""
    engine = started(field(laboratory), 0.5, 0.0)
    begun = strips_of(engine)
    driven(engine, TICK_S, 0.4, 0.5, 0.0)
    must(strips_of(engine) == begun, f"window {begun}, then {strips_of(engine)}")
    work, state = engine.energy().tool_work_joule, engine.state("", 0, 0)
    moved = float(np.linalg.norm(engine.displacements_m(), axis=1).max())
    must(work == 0.0, f"work {work} J")
    must(state.rms_speed_m_per_s < CALM_M_PER_S, f"{state.rms_speed_m_per_s} m/s")
    must(moved < 2.0 * LARGEST, f"a particle moved by {moved} m")
    return right(
        f"no shift, no work; a particle moves by {moved / RADIUS:.2g} r at most, rms speed 0.4 s after the "
        f"start {state.rms_speed_m_per_s:.2g} m/s"
    )


def long_ticks(laboratory: Laboratory, speed: float, long_ns: int) -> str:
    """Two ticks of `long_ns` against short ones at this speed [m/s]."""
    drags = []
    for tick_ns in (TICK_NS, long_ns):
        engine = started(field(laboratory, tick_ns=tick_ns, window_m=(0.3, 0.1)), 0.2, speed)
        drags.append(driven(engine, 1e-9 * tick_ns, 2e-9 * long_ns, 0.2, speed))
    return same_draft(*drags)


@CASES.add("W3a", RIGHT)
def ticks_of_two_strips(laboratory: Laboratory) -> Outcome:
    """Ticks in which the tool crosses two strips, against short ones."""
    return right(long_ticks(laboratory, 8.0, 10_000_000))


@CASES.add("W3b", RIGHT, STOPPED)
def ticks_beyond_the_window(laboratory: Laboratory) -> Outcome:
    """Ticks in which the tool goes farther than the window reaches ahead, against short ones."""
    return right_or_stopped(
        lambda: long_ticks(laboratory, 20.0, 16_000_000), r"soil.window.ahead_m|tool tool"
    )


@CASES.add("W4", STOPPED)
def backwards(laboratory: Laboratory) -> Outcome:
    """Tool goes back by less than what stands behind it, then by more."""
    engine = started(field(laboratory), 0.15, 1.0)
    ahead = driven(engine, TICK_S, 0.25, 0.15, 1.0)
    begun, turned = engine.energy(), strips_of(engine)
    must(turned[0] > 0, f"window {turned}")
    forces: list[float] = []
    x = [0.4]

    def back(way_m: float) -> None:
        for _ in range(round(way_m / TICK_S)):
            x[0] -= TICK_S
            at = tool_at(x[0], TOOL_Z_M, -1.0)
            forces.append(engine.advance(1250 + len(forces), at)[0].force_x_newton)

    back(0.06)
    book = engine.energy()
    defect = abs(book.total_joule - begun.total_joule) / book.turned_over_joule
    mean = float(np.mean(forces))
    must(max(ahead.defect, defect) < DEFECT, f"defects {ahead.defect}, {defect}")
    must(ahead.mean_newton < 0.0 < mean, f"{ahead.mean_newton} N ahead, {mean} N back")
    must(strips_of(engine) == turned, f"window {turned}, then {strips_of(engine)}")
    outcome = stopped(lambda: back(0.2), r"back at x = .* taken away; .*soil.window.behind_m")
    rear_m = turned[0] * strip_m(engine) + HELD_LAYER * LARGEST
    must(x[0] - 0.5 * TOOL_M[0] > rear_m, f"the tool was at {x[0]} m, soil held up to {rear_m} m")
    return Outcome(
        STOPPED,
        f"{ahead.mean_newton:.1f} N ahead, {mean:.1f} N back, defects {ahead.defect:.2g}, {defect:.2g}; "
        f"then {outcome.found.split(':')[1].strip()}",
    )


def edge(laboratory: Laboratory) -> str:
    """A square bar as wide as the usual one that goes on its corner."""
    side_m = TOOL_M[1] / math.sqrt(2.0)
    bar = trimesh.creation.box((side_m, side_m, TOOL_M[2]))
    bar.apply_transform(trimesh.transformations.rotation_matrix(0.25 * math.pi, (0.0, 0.0, 1.0)))
    path = laboratory.folder / "edge.stl"
    bar.export(path)
    return str(path)


def at_the_end(laboratory: Laboratory, mesh: str | None, **soil: Any) -> FieldEngine:
    """An engine with a tool in a field of 0.5 m."""
    return started(field(laboratory, size_m=(0.5, 0.3, 0.1), mesh=mesh, **soil), 0.3, 1.0)


@CASES.add("W5", RIGHT)
def out_through_the_end(laboratory: Laboratory) -> Outcome:
    """Tool leaves through the end of the field: an edge, and a flat bar."""
    mesh = edge(laboratory)
    inside = driven(at_the_end(laboratory, mesh), TICK_S, 0.13, 0.3, 1.0)
    must(inside.defect < DEFECT, f"defect before the wall {inside.defect}")
    moved = driven(at_the_end(laboratory, mesh), TICK_S, 0.5, 0.3, 1.0)
    after, count, gone = moved.forces_newton[-500:], moved.engine.particle_count, lost(moved.engine)
    must(min(after) == max(after) == 0.0, f"forces {min(after)} to {max(after)} N in the last 0.1 m")
    must(gone <= max(1, count // LOST_ONE_IN), f"{gone} lost of {count}")
    monitored = at_the_end(laboratory, mesh, monitors={"max_energy_defect": DEFECT})
    stopped(lambda: driven(monitored, TICK_S, 0.5, 0.3, 1.0), "the energy book is off")
    flat = stopped(
        lambda: driven(at_the_end(laboratory, None), TICK_S, 0.5, 0.3, 1.0),
        "presses soil against the wall at the end of the field",
    )
    return right(
        f"edge: {-min(inside.forces_newton):.0f} N at most before the wall, defect {inside.defect:.2g}; "
        f"{-min(moved.forces_newton):.0f} N at it, then 0, {gone} lost, defect {moved.defect:.2g}; "
        f"flat bar stopped: {flat.found.split(';')[1].strip()}"
    )


def named(action: Callable[[], object], words: str) -> float:
    """The number in a refusal that `words` (a regular expression with one group) finds."""
    try:
        action()
    except InputError as error:
        found = re.search(words, str(error))
        must(found, f"refused with another cause: {error}")
        assert found is not None
        return float(found[1])
    must(False, f"must be refused ({words})")
    raise AssertionError


def least_width_m(laboratory: Laboratory) -> float:
    """Least width of a field, as the refusal of a narrower one names it."""
    return named(
        lambda: check_start(field_scene(laboratory, size_m=(0.6, 0.05, 0.1), tile_m=None)),
        r"is narrower than the smallest tile, ([\d.]+) m",
    )


def through(engine: FieldEngine) -> str:
    """The tool over 75 mm at 0.25 m/s: the book closes."""
    moved = driven(started(engine, 0.1, 0.25), TICK_S, 0.3, 0.1, 0.25)
    must(moved.defect < DEFECT and lost(engine) <= 1, f"defect {moved.defect}, {lost(engine)} lost")
    must(moved.mean_newton < -1.0, f"force {moved.mean_newton} N")
    return f"{moved.mean_newton:.1f} N, {lost(engine)} lost, defect {moved.defect:.2g}"


@CASES.add("W6a", RIGHT)
def narrow_and_periodic(laboratory: Laboratory) -> Outcome:
    """Periodic sides at the least width, blade of infinite width."""
    width = least_width_m(laboratory)
    engine = field(
        laboratory, size_m=(0.6, width, 0.1), tile_m=width, sides="periodic", tool_m=(0.03, 0.3, 0.08)
    )
    return right(f"{width:g} m wide: {through(engine)}")


@CASES.add("W6b", RIGHT)
def narrow_and_held(laboratory: Laboratory) -> Outcome:
    """Narrower; held sides as narrow, and of the width that their refusal names."""
    width, tool_m = least_width_m(laboratory), (0.03, 0.0333, 0.08)

    def held(width_m: float) -> ResolvedScene:
        return field_scene(laboratory, size_m=(0.6, width_m, 0.1), tile_m=width, tool_m=tool_m)

    wide = named(lambda: check_start(held(width)), r"make soil.bin.width_m at least ([\d.]+) m")
    resolved = held(wide)
    check_start(resolved)
    return right(f"{wide:g} m wide: {through(FieldEngine(resolved, book=True))}")


def thrown(laboratory: Laboratory, direction: float) -> str:
    """A particle lifted off the surface beside the tool, thrown at 10 m/s along x."""
    engine = field(laboratory)
    engine.start(above(0.5))
    p = engine.particles()
    beside = direction * (p.position[:, 0] - 0.5)  # of the tool, under which it would be caught
    near = np.flatnonzero(~p.held & (beside > 0.03) & (beside < 0.06))
    k = near[np.argmax(p.position[near, 2])]
    identity = int(p.identity[k])
    p.position[k, 2] += 4.0 * LARGEST
    p.velocity[k] = (10.0 * direction, 0.0, 0.0)
    begun = engine.energy()
    reached, first = 0.0, strips_of(engine)
    for tick in range(750):  # a shift comes while it flies
        engine.advance(tick, above(0.5 + TICK_S * (tick + 1)))
        p = engine.particles()
        at = np.flatnonzero(p.identity == identity)
        if len(at) == 1:
            reached = max(reached, direction * (p.position[at[0], 0] - 0.5))
    must(strips_of(engine)[0] > first[0] > 0, f"window {first}, then {strips_of(engine)}")
    ends_m = np.array(first) * strip_m(engine) - 0.5
    must(reached > abs(ends_m[int(direction > 0.0)]) - 3.0 * LARGEST, f"flew {reached} m, ends at {ends_m} m")
    x, low, high = engine.positions_m()[:, 0], engine.bed.lower_m[0], engine.bed.upper_m[0]
    outside = int(((x < low - LARGEST) | (x > high + LARGEST)).sum())
    must(outside <= lost(engine), f"{outside} outside, {lost(engine)} lost")
    end = engine.energy()
    defect = abs(end.total_joule - begun.total_joule) / (end.turned_over_joule + begun.kinetic_joule)
    must(defect < DEFECT, f"defect {defect}")
    return f"flew {reached:.2f} m, {lost(engine)} lost, defect {defect:.2g}"


@CASES.add("W7", RIGHT)
def thrown_out(laboratory: Laboratory) -> Outcome:
    """Particle thrown at 10 m/s out of the open front, and out of the open rear."""
    return right(f"front: {thrown(laboratory, 1.0)}; rear: {thrown(laboratory, -1.0)}")


BIN_M = (0.4, 0.36, 0.12)
CORE = {"beyond_m": 0.08, "below_m": 0.07}
COARSE: Document = {"times": 1.5, **CORE}
RATIO = 4.0
LARGEST_TIMES = RATIO * SMALLEST / LARGEST


def graded(
    laboratory: Laboratory,
    coarse: Document | None = COARSE,
    size_m: Sequence[float] = BIN_M,
    tile_m: float | None = 0.24,
    floor: str = "held",
    **changes: Any,
) -> ResolvedScene:
    """The bar in a graded bed; without `coarse` in one of one size."""
    bed: Document = {"kind": "tiled", "floor": floor} | ({} if tile_m is None else {"tile_m": tile_m})
    return scene(laboratory, size_m, coarse=coarse, bed=bed, **changes)


def soil_of(resolved: ResolvedScene) -> Soil:
    """The soil of a scene."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    return soil


def limit_s(resolved: ResolvedScene) -> float:
    """Stable limit of the step of a scene [s]."""
    return step_limits(soil_of(resolved))[0].limit_s


@CASES.add("G1", RIGHT)
def hardly_graded(laboratory: Laboratory) -> Outcome:
    """`times` 1.0001 and the next number above 1."""
    uniform = graded(laboratory, None)
    plain = prepare_bed(uniform, SoilEngine)
    assert plain.radii_m is not None
    for times in (1.0001, math.nextafter(1.0, 2.0)):
        resolved = graded(laboratory, {"times": times, **CORE})
        largest = soil_of(resolved).particles.bounds_m[1]
        alike(LARGEST, largest, 1e-3, "largest radius")
        alike(check_start(uniform), check_start(resolved), 0.01, "particles expected")
        alike(limit_s(uniform), limit_s(resolved), 1e-3, "limit of the step")
    bed = prepare_bed(graded(laboratory, {"times": 1.0001, **CORE}), SoilEngine)
    assert bed.radii_m is not None
    off = alike(len(plain.positions_m), len(bed.positions_m), 0.01, "particles")
    for edge in (np.min, np.max):
        alike(float(edge(plain.radii_m)), float(edge(bed.radii_m)), 1e-3, "radii")
    return right(f"{len(plain.positions_m)} particles, graded {100.0 * off:+.2f} %")


def calm(resolved: ResolvedScene, part: float = CALM_MOVE) -> str:
    """Of the bed 19 particles in 20 move by less than `part` of a radius in MOVE_S when it is left alone."""
    alone = resolved.scene.model_copy(update={"tools": {}})
    engine = SoilEngine(dataclasses.replace(resolved, scene=alone))
    engine.start(())
    begun = engine.positions_m()
    advance(engine, round(MOVE_S / resolved.timing.communication_step_s))
    moved = np.linalg.norm(engine.positions_m() - begun, axis=1) / RADIUS
    most, largest = float(np.quantile(moved, 0.95)), float(moved.max())
    must(most < part and largest < 1.0, f"19 in 20 move by less than {most} r, all by less than {largest} r")
    return f"{most:.2g} r (19 in 20), {largest:.2g} r (all)"


@CASES.add("G2", REFUSED)
def wider_than_allowed(laboratory: Laboratory) -> Outcome:
    """`times` at the largest allowed, and 1.001 times it."""
    particles = soil_of(graded(laboratory, {"times": LARGEST_TIMES, **CORE})).particles
    alike(RATIO * SMALLEST, particles.bounds_m[1], 1e-9, "largest radius")
    must(len(particles.grades) == 4, f"{len(particles.grades)} sizes")
    return refused(
        lambda: graded(laboratory, {"times": 1.001 * LARGEST_TIMES, **CORE}),
        r"coarse.times: .* times the smallest radius, .*; allowed is up to 4 times",
    )


@CASES.add("G2", RIGHT, long=True)
def as_wide_as_allowed(laboratory: Laboratory) -> Outcome:
    """`times` at the largest allowed: four sizes beside each other, at rest."""
    coarse = {"times": LARGEST_TIMES, "beyond_m": 0.04, "below_m": 0.3}
    resolved = graded(laboratory, coarse, (0.6, 0.9, 0.2), None, sides="periodic")
    bed = prepare_bed(resolved, SoilEngine)
    assert bed.materials is not None
    counts = np.bincount(bed.materials).tolist()
    must(len(counts) == 4 and min(counts) > 0, f"particles of the sizes {counts}")
    return right(f"{', '.join(map(str, counts))} particles; moves by {calm(resolved)} in {MOVE_S:g} s")


@CASES.add("G3", RIGHT)
def core_larger_than_the_bed(laboratory: Laboratory) -> Outcome:
    """Core larger than the bin, and core that leaves 1 mm of it."""
    _, width, depth = BIN_M
    refused(
        lambda: graded(laboratory, {"times": 1.5, "beyond_m": 0.5 * width, "below_m": depth}),
        "the core, 0.36 m wide and 0.12 m deep, fills the bin",
    )
    plain = prepare_bed(graded(laboratory, None), SoilEngine)
    coarse = {"times": 1.5, "beyond_m": 0.5 * width - 1e-3, "below_m": 2.0 * depth}
    resolved = graded(laboratory, coarse)
    bed = prepare_bed(resolved, SoilEngine)
    assert bed.materials is not None
    assert bed.held is not None
    assert plain.held is not None
    must(not bed.materials.any(), f"{int((bed.materials > 0).sum())} coarse")
    off = alike(int((~plain.held).sum()), int((~bed.held).sum()), 0.02, "free particles")
    return right(f"{int((~bed.held).sum())} free particles, {100.0 * off:+.2f} %; moves by {calm(resolved)}")


@CASES.add("G4", RIGHT)
def graded_at_the_limit(laboratory: Laboratory) -> Outcome:
    """Dragged tool in a graded bed at 0.9 and 0.45 of the limit of the step; 1.01 of it."""
    limit = limit_s(graded(laboratory))
    drags = []
    for part in (0.9, 0.45):
        step_ns = round(1e9 * part * limit)
        resolved = graded(laboratory, time_step_s=1e-9 * step_ns, tick_ns=step_ns)
        engine = started(SoilEngine(resolved, book=True), 0.1, 1.0)
        drags.append(driven(engine, 1e-9 * step_ns, 0.1, 0.1, 1.0))
    found = same_draft(*drags)
    over_ns = round(1.01e9 * limit)
    outcome = refused(
        lambda: graded(laboratory, time_step_s=1e-9 * over_ns, tick_ns=over_ns), "above the stable limit"
    )
    return right(f"{found}; {outcome.found.split(': ', 1)[1].split('(')[0].strip()}")


def weighed(laboratory: Laboratory, gravity: float) -> str:
    """A graded bed on a plane floor under this gravity [m/s2]."""
    resolved = graded(laboratory, size_m=(0.3, 0.36, 0.12), floor="plane", gravity=gravity)
    found = calm(resolved, CALM_MOVE * max(1.0, gravity / GRAVITY))
    engine = SoilEngine(resolved)
    engine.start(above(0.15))
    coarse = soil_of(resolved).particles.coarse
    assert coarse is not None

    def from_core() -> np.ndarray:
        x = engine.positions_m()[engine.materials() == 0]
        return coarse.distance_m(x[:, 1], -x[:, 2])

    begun = np.maximum(from_core(), 0.0)
    for tick in range(round(MOVE_S / TICK_S)):
        engine.advance(tick, above(0.15))
    out = float((from_core() - begun).max())
    must(out < coarse.times * SMALLEST, f"{gravity:g} m/s2: a small particle moved {out} m out of the core")
    weight = float(engine.particles().mass.sum()) * gravity
    carried = float(engine.wall_force_newton[2])
    must(abs(carried - weight) <= 0.01 * weight + 1e-2, f"{gravity:g} m/s2: carried {carried} of {weight} N")
    return f"{gravity:g} m/s2: moves by {found}, carried {carried:.4g} of {weight:.4g} N"


@CASES.add("G5", RIGHT)
def graded_without_and_with_much_gravity(laboratory: Laboratory) -> Outcome:
    """Graded bed under gravity of 0 and 100 m/s2."""
    return right(f"{weighed(laboratory, 0.0)}; {weighed(laboratory, 100.0)}")


CEMENT = {"youngs_modulus_pa": 1e6, "tensile_strength_pa": 5e3, "cohesion_pa": 1e4, "damping_ratio": 0.05}


def bonds_of_two_sizes(engine: SoilEngine) -> int:
    """Whole bonds between particles of two sizes."""
    pairs, p = engine._pairs, engine.particles()
    assert engine._bonds is not None
    first = np.repeat(np.arange(p.count), np.diff(pairs.row_start))
    places = history_places(np.arange(len(first)), len(engine._bonds._parity))[:, 0]
    whole = engine._bonds.state[places] > 0.0
    return int((whole & (p.material[first] != p.material[pairs.neighbour])).sum())


@CASES.add("G6", RIGHT)
def graded_bonded_and_periodic(laboratory: Laboratory) -> Outcome:
    """Graded bed with bonds and periodic sides in a window; dragged on 1 and 2 threads."""
    resolved = graded(
        laboratory, size_m=(0.9, *BIN_M[1:]), sides="periodic", window={"ahead_m": 0.14, "behind_m": 0.12},
        bonds=CEMENT,
    )  # fmt: skip
    engines = [started(FieldEngine(resolved, threads, book=True), 0.1, 1.0) for threads in (1, 2)]
    begun = bonds_of_two_sizes(engines[0])
    first, second = (driven(engine, TICK_S, 0.1, 0.1, 1.0) for engine in engines)
    must(first.forces_newton == second.forces_newton, "forces differ on 2 threads")
    for name, array in engines[0].state_arrays().items():
        must(np.array_equal(array, engines[1].state_arrays()[name], equal_nan=True), f"{name}: bits differ")
    broken = engines[0].state("", 0, 0).broken_bond_count
    must(begun > 100 and broken > 0, f"{begun} bonds of two sizes, {broken} broken")
    must(first.defect < DEFECT and lost(engines[0]) == 0, f"defect {first.defect}, {lost(engines[0])} lost")
    return right(
        f"{begun} bonds of two sizes, {broken} of all broken; {first.mean_newton:.1f} N, defect "
        f"{first.defect:.2g}, the same bits on 2 threads"
    )
