"""W1 to W7: windows of soil at the ends of their parameters."""

import math
import re
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import trimesh

from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.packing.start import check_start
from subsoil_ros.dem.periodic import HELD_LAYER
from subsoil_ros.errors import InputError
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.messages import ToolMotion
from subsoil_ros.scene.soil import rupture_distance_m

from .cases import RIGHT, STOPPED, Cases, Outcome, must, right, right_or_stopped, stopped
from .laboratory import GRAVITY, Document, Drag, Laboratory, linear, tool_at
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
ALIKE_M = 0.02
"""Travel over which motions in two windows are alike; later chance decides which particle jams."""
ALIKE, HELD_FRONT = 0.02, 0.1
"""Largest relative difference of the force: ALIKE for a window FAR times the rupture distance, HELD_FRONT for
the rupture distance itself, where soil would still move at the held front."""
FAR = 1.5  # the rupture distance of a friction angle of 48 degrees, beyond any dry soil's
STEP_S, TICK_NS = 5e-5, 200_000
TICK_S = 1e-9 * TICK_NS

FIELD_M = (1.2, 0.3, 0.1)
TOOL_M = (0.03, 0.04, 0.08)
TOOL_Z_M = -0.03  # 70 mm deep
CALM_M_PER_S = 1e-3
"""Of soil about a tool that has come to rest, as in S9c and S11a."""
BESIDE = int(2.0 * sum(TOOL_M[:2]) * (0.5 * TOOL_M[2] - TOOL_Z_M) / (2.0 * RADIUS) ** 2)
"""Number of particles in one layer on the sides of the buried part of the tool. Only these can fall into gaps
where the tool removed particles."""
WALL = "presses soil against the wall at the end of the field|have left the domain"
"""How a run that presses soil against the end of a field is stopped."""


def scene(
    laboratory: Laboratory,
    size_m: Sequence[float],
    tool_m: tuple[float, float, float] = TOOL_M,
    tick_ns: int = TICK_NS,
    gravity: float = GRAVITY,
    sides: str = "walls",
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
            "particles": particles,
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


def field(laboratory: Laboratory, **changes: Any) -> SoilEngine:
    """The engine of `field_scene`, energy booked."""
    return build_engine(field_scene(laboratory, **changes), book=True)


def strips_of(engine: SoilEngine) -> tuple[int, int]:
    """First strip of the window, and the one after its last."""
    rear, front = engine.state_arrays()["window"].tolist()[:2]
    return rear, front


def strip_m(engine: SoilEngine) -> float:
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
    """Window longer than the whole field, against shorter ones."""
    usual_m = rupture_distance_m(FIELD_M[2], 30.0)
    firsts = []
    for ends_m in (usual_m, FAR * usual_m, FIELD_M[0]):
        window_m = (ends_m, ends_m)
        engine = started(field(laboratory, size_m=(0.8, 0.2, 0.1), window_m=window_m), 0.25, 1.0)
        begun = strips_of(engine)
        moved = driven(engine, TICK_S, 0.1, 0.25, 1.0)
        shifted = strips_of(engine) != begun
        must(shifted == (ends_m < FIELD_M[0]), f"window {ends_m} m: {begun}, then {strips_of(engine)}")
        must(moved.defect < DEFECT, f"window {ends_m} m: defect {moved.defect}")
        firsts.append(float(np.mean(moved.forces_newton[: round(ALIKE_M / TICK_S)])))
    usual, far, whole = firsts
    off = alike(whole, far, ALIKE, f"mean forces of {ALIKE_M} m")
    near = alike(whole, usual, HELD_FRONT, f"mean forces of {ALIKE_M} m")
    return right(
        f"first {1e3 * ALIKE_M:g} mm: {-whole:.1f} N in the whole field, {100.0 * near:+.1f} % with the "
        f"rupture distance, {100.0 * off:+.2f} % with {FAR:g} times it"
    )


@CASES.add("W2", RIGHT)
def standing_in_a_field(laboratory: Laboratory) -> Outcome:
    """Tool at rest in a field."""
    engine = started(field(laboratory), 0.5, 0.0)
    begun = strips_of(engine)
    driven(engine, TICK_S, 0.4, 0.5, 0.0)
    must(strips_of(engine) == begun, f"window {begun}, then {strips_of(engine)}")
    work = engine.energy().tool_work_joule
    particles = engine.particles()
    free = ~particles.held[np.argsort(particles.identity)]
    moved = np.linalg.norm(engine.displacements_m()[free], axis=1) / RADIUS
    fell, largest = int((moved >= 1.0).sum()), float(moved.max())
    speed = float(np.quantile(np.linalg.norm(engine.velocities_m_per_s()[free], axis=1), 0.9))
    must(work == 0.0, f"work {work} J")
    must(speed < CALM_M_PER_S, f"9 in 10 are slower than {speed} m/s")
    must(fell <= BESIDE, f"{fell} of {len(moved)} moved by more than r, up to {largest} r")
    return right(
        f"no shift, no work; {fell} of {len(moved)} particles move by more than r, up to {largest:.2g} r; "
        f"0.4 s after the start 9 in 10 are slower than {speed:.2g} m/s"
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


def at_the_end(laboratory: Laboratory, mesh: str | None, **soil: Any) -> SoilEngine:
    """An engine with a tool in a field of 0.5 m."""
    return started(field(laboratory, size_m=(0.5, 0.3, 0.1), mesh=mesh, **soil), 0.3, 1.0)


@CASES.add("W5", RIGHT, STOPPED)
def out_through_the_end(laboratory: Laboratory) -> Outcome:
    """Tool leaves through the end of the field: an edge, and a flat bar."""
    mesh = edge(laboratory)
    inside = driven(at_the_end(laboratory, mesh), TICK_S, 0.13, 0.3, 1.0)
    must(inside.defect < DEFECT, f"defect before the wall {inside.defect}")

    def out() -> str:
        engine = at_the_end(laboratory, mesh, monitors={"max_energy_defect": DEFECT})
        moved = driven(engine, TICK_S, 0.5, 0.3, 1.0)
        after = moved.forces_newton[-500:]
        must(min(after) == max(after) == 0.0, f"forces {min(after)} to {max(after)} N in the last 0.1 m")
        return f"{-min(moved.forces_newton):.0f} N at it, then 0, {lost(engine)} lost"

    left = right_or_stopped(out, f"the energy book is off|{WALL}")
    flat = stopped(lambda: driven(at_the_end(laboratory, None), TICK_S, 0.5, 0.3, 1.0), WALL)
    return Outcome(
        left.ending,
        f"edge: {-min(inside.forces_newton):.0f} N at most before the wall, defect {inside.defect:.2g}; "
        f"{left.ending} at it: {left.found.split(': ', 1)[-1]}; "
        f"flat bar stopped: {flat.found.split(':')[1].strip()}",
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


def through(engine: SoilEngine) -> str:
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
    return right(f"{wide:g} m wide: {through(build_engine(resolved, book=True))}")


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
