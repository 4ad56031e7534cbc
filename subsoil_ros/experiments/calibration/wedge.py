"""The fit of a wedge model to pulls through particles."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ...errors import RunError
from ...loading.loader import ResolvedScene, load_scene
from ...loading.soil_file import SoilFile
from ...messages import ToolMotion
from ...scene.meshes import load_tool_mesh
from ...scene.tool_faces import cutting_faces
from ...scene.wedge import SoilRange, WedgeValues
from ...wedge.engine import WedgeEngine
from .design import Point, WedgeDesign, fitted_law, point_overrides, tip_of
from .runs import PullNumbers, RunProgress, dominant_period_m, kept_pull, numbers, pull

FITTED = {
    "cohesion_pa": (1e4, 0.0, 2e5),
    "friction_angle_rad": (0.3, 0.01, 0.9),
    "adhesion_part": (0.3, 0.0, 1.0),
    "friction_part": (0.5, 0.0, 1.0),
    "shank_fraction": (0.5, 0.0, 5.0),
    "speed_factor": (1.0, 0.0, 50.0),
}
"""Start and bounds. friction_part is tan(delta) over tan(phi), adhesion_part c_a over c: both at most 1."""

STARTS = (0.1, 0.35, 0.6)
"""Friction angles [rad] that the fit starts from; the best end is taken."""

WEIGHT = 0.03
"""Part of the draft that a mean force may miss by at cost one (chosen: as beds scatter, 3 to 4 %)."""

UPWARD_WEIGHT = 3.0
"""How much more a mean vertical force may miss by (chosen: the draft is what is asked for)."""

ROUNDS = 3
"""Means and fluctuation are fitted in turn: the drop lowers the mean."""


@dataclass(frozen=True)
class Measured:
    """A point of the design and its runs."""

    point: Point
    scene: ResolvedScene  # on the wedge model
    tip_x_m: float
    numbers: list[PullNumbers]  # one per replicate
    used: bool  # in the fit

    def mean(self, name: str) -> Any:
        """Of a number over the replicates."""
        return np.mean([getattr(item, name) for item in self.numbers], axis=0)

    def scatter(self, name: str) -> float:
        """Largest relative departure of a replicate from their mean; 0 with one."""
        values = np.array([getattr(item, name) for item in self.numbers])
        return float(np.max(np.abs(values / values.mean() - 1.0)))


@dataclass(frozen=True)
class Compared:
    """Particles and wedge model at one point."""

    point: Point
    used: bool
    draft_newton: tuple[float, float]  # particles, wedge
    deviation_newton: tuple[float, float]
    period_m: tuple[float, float]
    scatter: tuple[float, float, float]  # of draft, deviation and period between replicates, relative
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


def measure(
    scene: ResolvedScene, design: WedgeDesign, folder: Path, threads: int, progress: RunProgress
) -> list[Measured]:
    """Runs what has not been run yet. Raises RunError as kept_pull does."""
    found = []
    name, _ = tip_of(scene)
    for used, points in ((True, design.fit), (False, design.check)):
        for point in points:
            runs = []
            for replicate in range(point.replicates):
                resolved = load_scene(scene.path, point_overrides(scene, design, point, replicate))
                label = f"{point.name}, run {replicate + 1} of {point.replicates}"
                tip_x = _tip_x_m(scene, point)
                runs.append(
                    numbers(kept_pull(resolved, folder, label, threads, progress), tip_x, design.window_m)
                )
            wedge = load_scene(scene.path, (*point_overrides(scene, design, point, 0), *_WEDGE))
            found.append(Measured(point, wedge, _tip_x_m(scene, point), runs, used))
    groups = scene.scene.tools[name].groups
    if any(len(item.numbers[0].mean_x_newton) != len(groups) for item in found):
        raise RunError(f"{folder}: a cached run has other groups than {', '.join(groups)}; remove the folder")
    return found


_START = WedgeValues(
    density_kg_per_m3=1500.0,
    cohesion_pa=1e4,
    friction_angle_rad=0.3,
    adhesion_pa=1e3,
    tool_friction_angle_rad=0.2,
)
_WEDGE = (
    "soil={model: wedge, values: " + _START.model_dump_json(exclude_none=True) + "}",
    "allow=[]",  # what the scene allows concerns its particles
)


def _tip_x_m(scene: ResolvedScene, point: Point) -> float:
    _, (x, z) = tip_of(scene)
    return math.cos(point.tilt_rad) * x - math.sin(point.tilt_rad) * z


def fit_wedge(
    scene: ResolvedScene, design: WedgeDesign, density_kg_per_m3: float, measured: list[Measured]
) -> WedgeFit:
    """Fits strength to the mean forces of each group, then drop, variation and period to the fluctuation.

    Strength by least squares over share and shank along x and z; standard errors from the Jacobian, scaled by
    the residuals' own size. drop and period by running the wedge engine on the same paths.
    """
    used = [item for item in measured if item.used]
    engines = {id(item): WedgeEngine(item.scene) for item in measured}
    values = _START.model_copy(
        update={"density_kg_per_m3": density_kg_per_m3, "drop": 0.1, "wheels": design.wheels}
    )
    best = None
    for _ in range(ROUNDS):
        best = _fit_means(values, used, engines, best)
        values = _with(values, best.x)
        values = _fit_fluctuation(values, used, engines, design)
    best = _fit_means(values, used, engines, best)
    values = _with(values, best.x)
    compared = tuple(_compare(values, item, engines[id(item)], design) for item in measured)
    names = tuple(name for name, bound in zip(FITTED, _at_bound(best), strict=True) if not bound)
    free = [list(FITTED).index(name) for name in names]  # a value at its bound has no error of this kind
    freedoms = len(best.fun) - len(free)
    chi_squared = float(best.fun @ best.fun) / max(freedoms, 1)
    slopes = best.jac[:, free]
    covariance = np.linalg.pinv(slopes.T @ slopes) * chi_squared
    deviation = np.sqrt(np.diag(covariance))
    safe = np.where(deviation > 0.0, deviation, 1.0)
    soil = SoilFile(
        model="wedge",
        fitted_law=fitted_law(scene),
        fitted_range=_range(scene, used),
        values=values,
        errors={name: float(error) for name, error in zip(names, deviation, strict=True)},
        report={
            "scene": scene.scene.name,
            "points": [_row(item) for item in compared],
            "chi_squared_per_freedom": chi_squared,
            "freedoms": freedoms,
        },
    )
    return WedgeFit(soil, compared, names, covariance / np.outer(safe, safe), chi_squared, freedoms)


def _at_bound(end: Any) -> list[bool]:
    """Which values stand at a bound, to 1e-3 of their scale."""
    return [
        value - low < 1e-3 * start or high - value < 1e-3 * start
        for value, (start, low, high) in zip(end.x, FITTED.values(), strict=True)
    ]


def _with(values: WedgeValues, found: NDArray[np.float64]) -> WedgeValues:
    change = dict(zip(FITTED, found.tolist(), strict=True))
    part, sticks = change.pop("friction_part"), change.pop("adhesion_part")
    change["adhesion_pa"] = sticks * change["cohesion_pa"]
    change["tool_friction_angle_rad"] = math.atan(part * math.tan(change["friction_angle_rad"]))
    return WedgeValues.model_validate({**values.model_dump(), **change})


def _fit_means(
    values: WedgeValues, used: list[Measured], engines: dict[int, WedgeEngine], before: Any
) -> Any:
    """Least squares over the mean forces; from several starts the first time."""
    lower = np.array([low for _, low, _ in FITTED.values()])
    upper = np.array([high for _, _, high in FITTED.values()])
    scale = np.array([start for start, _, _ in FITTED.values()])

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
    """Mean forces (groups,) along x and z of a steady pull: springs full, half way through the cycle."""
    tool, path = next((name, tool.path) for name, tool in item.scene.scene.tools.items() if tool.path)
    step = item.point.speed_m_per_s * item.scene.timing.communication_step_s
    start = 0.5 * item.scene.scene.soil.bin.length_m - item.tip_x_m  # type: ignore[union-attr]

    def at(x: float) -> tuple[ToolMotion, ...]:
        return (ToolMotion(tool, x, 0.0, path.start_z_m, path.start_angle_rad, 0.0, 0.0, 0.0),)

    engine.start(at(start))
    memory = engine.memory.tools[0]
    memory.normal_newton = [math.inf for _ in memory.normal_newton]
    memory.phase, memory.strength = 0.5, 1.0
    groups = engine.advance(0, at(start + step))[0].groups
    return (
        np.array([group.force_x_newton for group in groups]),
        np.array([group.force_z_newton for group in groups]),
    )


def _wedge_numbers(
    values: WedgeValues, item: Measured, engine: WedgeEngine, design: WedgeDesign
) -> PullNumbers:
    return numbers(pull(item.scene, engine.with_values(values)), item.tip_x_m, design.window_m)


def _fit_fluctuation(
    values: WedgeValues,
    used: list[Measured],
    engines: dict[int, WedgeEngine],
    design: WedgeDesign,
) -> WedgeValues:
    """drop (with a variation of its own size), and the period: as a length, or over the wedge's length.

    Of both the one whose numbers scatter less from point to point. A cycle from 1 - drop to 1 deviates by
    drop / sqrt(12); wedges that vary by as much double the variance.
    """
    periods = np.array([dominant_period_m(item.numbers) for item in used])
    lengths = np.array([_wedge_length_m(values, item) for item in used])
    constant, relative = np.median(periods), np.median(periods / lengths)
    spread = float(np.std(np.log(periods))), float(np.std(np.log(periods / lengths)))
    follows = spread[1] < spread[0]
    change: dict[str, Any] = {
        "period_m": None if follows else float(constant),
        "period_factor": float(relative),
    }
    drop = values.drop
    for _ in range(4):
        change |= {"drop": drop, "variation": drop / math.sqrt(12.0)}
        soil = WedgeValues.model_validate({**values.model_dump(), **change})
        ratio, late = [], []
        for item, period in zip(used, periods, strict=True):
            got = _wedge_numbers(soil, item, engines[id(item)], design)
            ratio.append(item.mean("deviation_newton") / got.deviation_newton)
            late.append(period / dominant_period_m([got]))
        drop = float(np.clip(drop * np.exp(np.mean(np.log(ratio))), 1e-3, 0.9))
        if not follows:
            change["period_m"] *= float(np.clip(np.median(late), 0.8, 1.25))
        change["period_factor"] *= float(np.clip(np.median(late), 0.8, 1.25))
    change |= {"drop": drop, "variation": drop / math.sqrt(12.0)}
    return WedgeValues.model_validate({**values.model_dump(), **change})


def _wedge_length_m(values: WedgeValues, item: Measured) -> float:
    from ...wedge.layers import mean_strength
    from ...wedge.wedge import Plate, failure

    name = next(iter(item.scene.scene.tools))
    face = cutting_faces(load_tool_mesh(item.scene.directory, item.scene.scene, name), name)[0]
    depth, rake = item.point.depth_m, face.rake_rad - item.point.tilt_rad
    height = min(depth, math.dist(face.tip_m, face.top_m) * math.sin(rake))
    strength = mean_strength(((math.inf, values),), depth, height, item.scene.scene.gravity_m_per_s2)
    return float(failure(Plate(face.width_m, rake, depth, height), strength, item.point.speed_m_per_s)[2])


def _compare(values: WedgeValues, item: Measured, engine: WedgeEngine, design: WedgeDesign) -> Compared:
    got = _wedge_numbers(values, item, engine, design)
    periods = [dominant_period_m([one]) for one in item.numbers]
    return Compared(
        point=item.point,
        used=item.used,
        draft_newton=(float(item.mean("draft_newton")), got.draft_newton),
        deviation_newton=(float(item.mean("deviation_newton")), got.deviation_newton),
        period_m=(dominant_period_m(item.numbers), dominant_period_m([got])),
        scatter=(
            item.scatter("draft_newton"),
            item.scatter("deviation_newton"),
            float(np.ptp(periods) / 2.0 / np.mean(periods)),
        ),
        replicates=len(item.numbers),
    )


def _row(item: Compared) -> dict[str, Any]:
    return {
        "depth_m": item.point.depth_m,
        "speed_m_per_s": item.point.speed_m_per_s,
        "tilt_rad": item.point.tilt_rad,
        "used_in_fit": item.used,
        "replicates": item.replicates,
        "draft_newton": [round(value, 1) for value in item.draft_newton],
        "deviation_newton": [round(value, 1) for value in item.deviation_newton],
        "period_m": [round(value, 5) for value in item.period_m],
        "scatter": [round(value, 4) for value in item.scatter],
    }


def _range(scene: ResolvedScene, used: list[Measured]) -> SoilRange:
    name, _ = tip_of(scene)
    rake = cutting_faces(load_tool_mesh(scene.directory, scene.scene, name), name)[0].rake_rad
    depths = [item.point.depth_m for item in used]
    speeds = [item.point.speed_m_per_s for item in used]
    rakes = [rake - item.point.tilt_rad for item in used]
    return SoilRange(
        depth_m=(min(depths), max(depths)),
        speed_m_per_s=(min(speeds), max(speeds)),
        rake_rad=(min(rakes), max(rakes)),
    )
