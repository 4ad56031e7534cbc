"""The fit of a wedge model to pulls through particles."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from ..loading.loader import ResolvedScene
from ..loading.soil_file import SoilFile, law_of
from ..messages import ToolMotion
from ..scene.tool_faces import CuttingFace, cutting_faces
from ..scene.tool_mesh import load_tool_mesh
from ..scene.wedge_soil import SoilRange, WedgeValues
from ..wedge.failure_wedge import Failure, Plate, failure
from ..wedge.wedge_engine import WedgeEngine
from ..wedge.wedge_forces import strength_of
from ..yaml_document import Document
from .fluctuation import Fluctuation, fit_wedges
from .pulls import START, Measured, numbers, pull, shortest_wave_m
from .wedge_design import Point, WedgeDesign

Bounds = dict[str, tuple[float, float, float]]

FITTED: Bounds = {
    "cohesion_pa": (1e4, 0.0, 2e5),
    "friction_angle_rad": (0.3, 0.01, 0.9),
    "adhesion_part": (0.3, 0.0, 1.0),
    "friction_part": (0.5, 0.0, 1.0),
    "shank_fraction": (0.5, 0.0, 5.0),
    "speed_factor": (1.0, 0.0, 50.0),
}
"""Start and bounds. friction_part is tan(delta) over tan(phi), adhesion_part c_a over c: both at most 1."""

FITTED_TOO: Bounds = {"rate_s_per_m": (0.05, 0.0, 1.0), "tip_m": (0.01, 0.0, 0.1)}
"""Further values fitted with theory perumpral. Its adhesion is 0, as of a material's particles on metal."""

STARTS = (0.1, 0.35, 0.6)
"""Friction angles [rad] that the fit starts from; the best result is used."""

WEIGHT = 0.03
"""Error of a mean force over the draft that has cost one: the scatter of beds is 3 to 4 %."""

UPWARD_WEIGHT = 3.0
"""Factor by which vertical forces have less weight, because the draft matters most to users of the model."""

STEADY_TICKS = 200
"""Most ticks until the forces of a steady pull are constant; each tick about halves their error."""

SEEDS = (0, 1, 2, 3)
"""Seeds of the wedge model at each point: its powers then have less scatter than those of one run."""

ROUNDS = 2
"""Rounds in which means and fluctuation are fitted in turn, because the drop lowers the mean."""


@dataclass(frozen=True)
class Compared:
    """Particles and wedge model at one point."""

    point: Point
    used: bool
    draft_newton: tuple[float, float]  # particles, wedge
    upward_newton: tuple[float, float]
    deviation_newton: tuple[float, float]
    variance_ratio: tuple[float, ...]  # wedge over particles, of means over each of MEAN_LENGTHS_M
    power_ratio: tuple[float, ...]  # wedge over particles, by octave of wave length
    ends_ratio: tuple[float, ...]  # wedge over particles, of ends_over_deviation
    scatter: tuple[float, float]  # of draft and deviation between replicates, relative
    replicates: int


@dataclass(frozen=True)
class WedgeFit:
    """A fitted soil and how it compares."""

    soil: SoilFile
    compared: tuple[Compared, ...]
    names: tuple[str, ...]  # fitted values that are not at a bound
    correlation: NDArray[np.float64]  # of these
    chi_squared: float
    freedoms: int


def fit_wedge(
    scene: ResolvedScene, design: WedgeDesign, density_kg_per_m3: float, measured: list[Measured]
) -> WedgeFit:
    """Fit strength to the mean forces of each group, and the variation of wedges to the fluctuation.

    Strength by least squares over share and shank along x and z; standard errors from the Jacobian, scaled by
    the residuals' own size.
    """
    used, shortest = [item for item in measured if item.used], shortest_wave_m(scene)
    engines = {id(item): WedgeEngine(item.scene) for item in measured}
    first = {"density_kg_per_m3": density_kg_per_m3, "drop": 0.1, "wheels": design.wheels}
    values = START.model_copy(update={**first, "theory": design.theory})
    best, soil = None, scene.scene.particle_soil
    assert soil is not None
    for _ in range(ROUNDS):
        best = _fit_means(values, used, engines, best)
        values = _fit_fluctuation(_with(values, best.x), used, design, shortest)
    best = _fit_means(values, used, engines, best)
    values = _with(values, best.x)
    compared = tuple(_compare(values, item, engines[id(item)], design, shortest) for item in measured)
    searched = searched_by(design.theory)
    names = tuple(name for name, bound in zip(searched, _at_bound(best, searched), strict=True) if not bound)
    free = [list(searched).index(name) for name in names]  # a value at its bound has no error of this kind
    freedoms = len(best.fun) - len(free)
    chi_squared = float(best.fun @ best.fun) / max(freedoms, 1)
    slopes = best.jac[:, free]
    covariance = np.linalg.pinv(slopes.T @ slopes) * chi_squared
    deviation = np.sqrt(np.diag(covariance))
    safe = np.where(deviation > 0.0, deviation, 1.0)
    fitted = SoilFile(
        model="wedge",
        fitted_law=law_of(soil),
        fitted_range=_range(used),
        values=values,
        errors={name: float(error) for name, error in zip(names, deviation, strict=True) if freedoms},
        report={
            "scene": scene.scene.name,
            "points": [_row(item) for item in compared],
            "chi_squared_per_freedom": chi_squared,
            "freedoms": freedoms,
        },
    )
    return WedgeFit(fitted, compared, names, covariance / np.outer(safe, safe), chi_squared, freedoms)


def searched_by(theory: str) -> Bounds:
    """Start, lower and upper bound of each number that is fitted with this theory."""
    if theory == "perumpral":
        return {name: bounds for name, bounds in FITTED.items() if name != "adhesion_part"} | FITTED_TOO
    return FITTED


def _at_bound(end: OptimizeResult, searched: Bounds) -> list[bool]:
    """Which values are at a bound, to 1e-3 of their scale."""
    return [
        value - low < 1e-3 * start or high - value < 1e-3 * start
        for value, (start, low, high) in zip(end.x, searched.values(), strict=True)
    ]


def _with(values: WedgeValues, found: NDArray[np.float64]) -> WedgeValues:
    change: dict[str, float] = dict(zip(searched_by(values.theory), found.tolist(), strict=True))
    part, sticks = change.pop("friction_part"), change.pop("adhesion_part", 0.0)
    change["adhesion_pa"] = sticks * change["cohesion_pa"]
    change["tool_friction_angle_rad"] = math.atan(part * math.tan(change["friction_angle_rad"]))
    return WedgeValues.model_validate({**values.model_dump(), **change})


def _fit_means(
    values: WedgeValues, used: list[Measured], engines: dict[int, WedgeEngine], before: OptimizeResult | None
) -> OptimizeResult:
    """Least squares over the mean forces; from several starts the first time."""
    scale, lower, upper = np.array(list(searched_by(values.theory).values())).T

    def residuals(found: NDArray[np.float64]) -> NDArray[np.float64]:
        soil = _with(values, found)
        rows = []
        for item in used:
            x, z = steady(engines[id(item)].with_values(soil), item)
            weight = WEIGHT * item.mean("draft_newton")
            rows.append((x - item.mean("mean_x_newton")) / weight)
            rows.append((z - item.mean("mean_z_newton")) / (UPWARD_WEIGHT * weight))
        return np.concatenate(rows)

    if before is not None:
        starts = [np.clip(before.x, lower + 1e-9, upper - 1e-9)]
    else:
        first = scale.copy()
        starts = [np.concatenate([first[:1], [phi], first[2:]]) for phi in STARTS]
    ends = [
        least_squares(residuals, start, bounds=(lower, upper), x_scale=scale, loss="linear", diff_step=1e-4)
        for start in starts
    ]
    return min(ends, key=lambda end: end.cost)


def steady(engine: WedgeEngine, item: Measured) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean forces (groups,) along x and z of a steady pull: springs full, blocks held at their mean."""
    tool, path = next((name, tool.path) for name, tool in item.scene.scene.tools.items() if tool.path)
    step = item.point.speed_m_per_s * item.scene.timing.communication_step_s
    soil = item.scene.scene.soil
    assert soil is not None
    start = 0.5 * soil.bin.length_m - item.tip_x_m

    def at(x: float) -> tuple[ToolMotion, ...]:
        return (ToolMotion(tool, x, 0.0, path.start_z_m, path.start_angle_rad, 0.0, 0.0, 0.0),)

    engine.start(at(start))
    memory = engine.memory.tools[0]
    memory.normal_newton = (10.0 * np.abs(item.mean("mean_x_newton"))).tolist()  # above its strength
    phase = 0.5 + 0.5 / math.sqrt(3.0) if engine.values.failure == "gradual" else 0.5  # of mean_bearing
    for tick in range(STEADY_TICKS):
        count, before = len(memory.phase), memory.normal_newton.copy()
        memory.phase, memory.strength, memory.length = [phase] * count, [1.0] * count, [math.inf] * count
        groups = engine.advance(tick, at(start + (tick + 1) * step))[0].groups
        if np.allclose(memory.normal_newton, before, rtol=1e-6, atol=0.0):
            break
    return (
        np.array([group.force_x_newton for group in groups]),
        np.array([group.force_z_newton for group in groups]),
    )


def _fit_fluctuation(
    values: WedgeValues, used: list[Measured], design: WedgeDesign, shortest_wave_m: float
) -> WedgeValues:
    """failure, drop, block_depth_m and the lengths of a wedge, by the power of the draft by octave of wave
    length and by the ends of its range.

    Failure is sudden or gradual; the mean length is a travel, or a multiple of the length of the theory's
    wedge. Of these four variants, the best fit is returned.
    """
    failures = [_failure(values, item) for item in used]
    window_m = design.window_m[1] - design.window_m[0]
    pulls = [
        Fluctuation(
            depth_m=item.point.depth_m,
            power=item.mean("octave_power") / item.mean("draft_newton") ** 2,
            ends_over_deviation=item.mean("ends_over_deviation"),
            inertia=_inertia(values, item, failed),
            replicates=len(item.numbers),
        )
        for item, failed in zip(used, failures, strict=True)
    ]
    lengths = {
        "period_m": [1.0] * len(used),
        "period_factor": [failed.length for failed in failures],
    }
    found = [
        (key, *fit_wedges(pulls, gradual, scale, shortest_wave_m, window_m))
        for key, scale in lengths.items()
        for gradual in (False, True)
    ]
    key, wedges, size, _ = min(found, key=lambda item: item[3])
    change = {
        "failure": "gradual" if wedges.gradual else "sudden",
        "drop": wedges.drop,
        "block_depth_m": size,
        "variation": 0.0,
        "length_variation": wedges.length_variation,
        "period_m": None,
    }
    return WedgeValues.model_validate({**values.model_dump(), **change, key: wedges.length_m})


def _share(item: Measured) -> CuttingFace:
    name = next(iter(item.scene.scene.tools))
    return cutting_faces(load_tool_mesh(item.scene.directory, item.scene.scene, name), name)[0]


def _failure(values: WedgeValues, item: Measured) -> Failure:
    """Failure in front of the share of a pull."""
    face = _share(item)
    depth, rake = item.point.depth_m, face.rake_rad - item.point.tilt_rad
    height = min(depth, math.dist(face.tip_m, face.top_m) * math.sin(rake))
    strength = strength_of(values, item.scene.scene.gravity_m_per_s2)
    failed: Failure = failure(Plate(face.width_m, rake, depth, height), strength, item.point.speed_m_per_s)
    return failed


def _inertia(values: WedgeValues, item: Measured, failed: Failure) -> float:
    """Inertia of the soil in front of a tool, over what its blocks bear together just before they fail."""
    face = _share(item)
    into = item.point.speed_m_per_s * math.sin(face.rake_rad - item.point.tilt_rad)
    of_share = failed.by_inertia / ((1.0 - failed.by_inertia) * (1.0 + values.rate_s_per_m * into))
    if values.theory == "mckyes_ali":
        return of_share
    drafts = item.mean("mean_x_newton")  # shanks have no inertia, and fluctuate
    return float(of_share * drafts[face.group] / drafts.sum())


def _compare(
    values: WedgeValues, item: Measured, engine: WedgeEngine, design: WedgeDesign, shortest_wave_m: float
) -> Compared:
    of_soil, window_m = engine.with_values(values), design.window_m
    pulls = [pull(item.scene, of_soil.with_seed(seed)) for seed in SEEDS]
    got = [numbers(found, item.tip_x_m, window_m, shortest_wave_m) for found in pulls]

    def of_wedge(name: str) -> NDArray[np.float64]:
        return np.mean([getattr(one, name) for one in got], axis=0)

    def both(name: str) -> tuple[float, float]:
        return float(np.sum(item.mean(name))), float(np.sum(of_wedge(name)))

    def ratio(name: str) -> tuple[float, ...]:
        return tuple((of_wedge(name) / np.maximum(item.mean(name), 1e-9)).tolist())

    return Compared(
        point=item.point,
        used=item.used,
        draft_newton=both("draft_newton"),
        upward_newton=both("mean_z_newton"),
        deviation_newton=both("deviation_newton"),
        variance_ratio=ratio("variance_of_means"),
        power_ratio=ratio("octave_power"),
        ends_ratio=ratio("ends_over_deviation"),
        scatter=(item.scatter("draft_newton"), item.scatter("deviation_newton")),
        replicates=len(item.numbers),
    )


def _row(item: Compared) -> Document:
    def rounded(name: str, digits: int) -> list[float]:
        return [round(value, digits) for value in getattr(item, name)]

    return {
        "depth_m": item.point.depth_m,
        "speed_m_per_s": item.point.speed_m_per_s,
        "tilt_rad": item.point.tilt_rad,
        "used_in_fit": item.used,
        "replicates": item.replicates,
        **{name: rounded(name, 1) for name in ("draft_newton", "upward_newton", "deviation_newton")},
        **{name: rounded(name, 3) for name in ("variance_ratio", "power_ratio", "ends_ratio")},
        "scatter": rounded("scatter", 4),
    }


def _range(used: list[Measured]) -> SoilRange:
    def ends(values: Iterable[float]) -> tuple[float, float]:
        found = list(values)
        return min(found), max(found)

    return SoilRange(
        depth_m=ends(item.point.depth_m for item in used),
        speed_m_per_s=ends(item.point.speed_m_per_s for item in used),
        rake_rad=ends(_share(item).rake_rad - item.point.tilt_rad for item in used),
    )
