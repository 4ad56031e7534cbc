"""G1 to G6: graded beds at the ends of their parameters."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from subsoil_ros.dem.beds.prepare import check_start, prepare_bed
from subsoil_ros.dem.blocks import history_places
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.window import FieldEngine
from subsoil_ros.limits.stable_steps import step_limits
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.scene.soil import Soil

from .cases import REFUSED, RIGHT, Cases, Outcome, must, refused, right
from .laboratory import GRAVITY, Document, Laboratory, advance
from .steps import DEFECT
from .windows import (
    CALM_MOVE,
    LARGEST,
    LOOSE,
    MOVE_S,
    RADIUS,
    SMALLEST,
    TICK_S,
    above,
    alike,
    driven,
    lost,
    same_draft,
    scene,
    started,
)

CASES = Cases()

BIN_M = (0.4, 0.36, 0.12)
CORE = {"beyond_m": 0.08, "below_m": 0.07}
COARSE: Document = {"times": 1.5, **CORE}
RATIO = 4.0
TOGETHER_S = 0.04
"""Time at 1 m/s over which two steps give the same forces; later chance decides which particle jams."""

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


@CASES.add("G1", RIGHT, long=True)
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
    off = alike(len(plain.positions_m), len(bed.positions_m), 0.02, "particles")
    for edge in (np.min, np.max):
        alike(float(edge(plain.radii_m)), float(edge(bed.radii_m)), 1e-3, "radii")
    return right(f"{len(plain.positions_m)} particles, graded {100.0 * off:+.2f} %")


def calm(resolved: ResolvedScene, part: float = CALM_MOVE, loose: float = 0.0) -> str:
    """Of the bed 19 particles in 20 move by less than `part` of a radius in MOVE_S when it is left alone, and
    all but a part of them, `loose`, by less than a radius."""
    alone = resolved.scene.model_copy(update={"tools": {}})
    engine = SoilEngine(dataclasses.replace(resolved, scene=alone), book=True)
    engine.start(())
    begun = engine.positions_m()
    advance(engine, round(MOVE_S / resolved.timing.communication_step_s))
    moved = np.linalg.norm(engine.positions_m() - begun, axis=1) / RADIUS
    most, largest = float(np.quantile(moved, 0.95)), float(moved.max())
    fell = int((moved >= 1.0).sum())
    must(
        most < part and fell <= loose * len(moved),
        f"19 in 20 of {len(moved)} move by less than {most} r, {fell} by more than r, up to {largest} r",
    )
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


@CASES.add("G3", RIGHT, long=True)
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


@CASES.add("G4", RIGHT, long=True)
def graded_at_the_limit(laboratory: Laboratory) -> Outcome:
    """Dragged tool in a graded bed at 0.9 and 0.45 of the limit of the step; 1.01 of it."""
    limit = limit_s(graded(laboratory))
    drags = []
    for part in (0.9, 0.45):
        step_ns = round(1e9 * part * limit)
        resolved = graded(laboratory, time_step_s=1e-9 * step_ns, tick_ns=step_ns)
        engine = started(SoilEngine(resolved, book=True), 0.1, 1.0)
        drags.append(driven(engine, 1e-9 * step_ns, TOGETHER_S, 0.1, 1.0))
    found = same_draft(*drags)
    over_ns = round(1.01e9 * limit)
    outcome = refused(
        lambda: graded(laboratory, time_step_s=1e-9 * over_ns, tick_ns=over_ns), "above the stable limit"
    )
    return right(f"{found}; {outcome.found.split(': ', 1)[1].split('(')[0].strip()}")


def weighed(laboratory: Laboratory, gravity: float) -> str:
    """A graded bed on a plane floor under this gravity [m/s2]."""
    resolved = graded(laboratory, size_m=(0.3, 0.36, 0.12), floor="plane", gravity=gravity)
    heavy = gravity > GRAVITY
    found = calm(resolved, CALM_MOVE * (gravity / GRAVITY if heavy else 1.0), LOOSE if heavy else 0.0)
    engine = SoilEngine(resolved, book=True)
    engine.start(above(0.15))
    coarse = soil_of(resolved).particles.coarse
    assert coarse is not None

    def from_core() -> np.ndarray:
        x = engine.positions_m()[engine.materials() == 0]
        return coarse.distance_m(x[:, 1], -x[:, 2])

    begun = np.maximum(from_core(), 0.0)
    forces = []
    for tick in range(round(MOVE_S / TICK_S)):
        engine.advance(tick, above(0.15))
        forces.append(float(engine.wall_force_newton[2]))
    out = float((from_core() - begun).max())
    must(out < coarse.times * SMALLEST, f"{gravity:g} m/s2: a small particle moved {out} m out of the core")
    weight = float(engine.particles().mass.sum()) * gravity
    carried = float(np.mean(forces))
    must(abs(carried - weight) <= 0.01 * weight + 1e-2, f"{gravity:g} m/s2: carried {carried} of {weight} N")
    return f"{gravity:g} m/s2: moves by {found}, carried {carried:.4g} of {weight:.4g} N"


@CASES.add("G5", RIGHT, long=True)
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
