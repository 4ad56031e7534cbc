"""Tools beside each other: their runs, and the quantities that decide between them with intervals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..analysis.columns import DRAFT, Body, PlanarTool, Wrench
from ..analysis.intervals import NO_SCATTER, difference_by_seed, error_by_seed
from ..analysis.summary import MEAN_DRAFT, flattened, path_of
from ..errors import InputError
from ..figures.comparison import SHARED, Difference, Source, differences, labels_of
from ..loading.loader import load_scene
from ..whole_files import write_whole
from ..yaml_document import Document, dump_yaml, read_document
from .run_cache import CachedRun
from .run_jobs import ExecutionOptions, Watcher, run_jobs
from .run_sweep import RUNS, open_folder
from .sweep_points import Point, jobs_of, one_soil

REQUEST = "compare.yaml"
UPWARD, ASIDE, POWER = "vertical_force_newton", "side_force_newton", "power_watt"
SECTION, PRESSURE = "loosened_section_m2", "draft_per_section_pa"
QUANTITIES = {
    DRAFT: ("draft [N]", 1.0),
    UPWARD: ("force upwards [N], % of draft", 1.0),
    ASIDE: ("force to the left [N], % of draft", 1.0),
    POWER: ("power [W]", 1.0),
    SECTION: ("loosened section [cm2]", 1e4),
    PRESSURE: ("draft per section [kPa]", 1e-3),
}
"""Name, then how it is printed and by which factor. Changes of the two forces, which may be near zero, are in
parts of the draft."""

OVER_FIELDS = "mean_over_fields"
"""Statistic of a mean over seeds, whose interval is Student's t of the differences of equal seeds."""

SIDE_PART = 0.03
"""Part of the draft below which no side force is shown: a tool alike on both sides has one from single
particles."""


@dataclass(frozen=True)
class Side:
    """One of the tools that are compared: its finished runs, by the seed of their field."""

    label: str
    runs: Mapping[int, CachedRun]

    @property
    def first(self) -> CachedRun:
        """Its run of the first seed."""
        return next(iter(self.runs.values()))


def run_scenes(
    scenes: Sequence[Path],
    overrides: Sequence[str],
    seeds: Sequence[int],
    out: Path,
    manner: ExecutionOptions,
    watcher: Watcher,
) -> tuple[list[Side], list[str], list[str]]:
    """Run what has not been run of each scene with each seed; return the sides, what failed, and the changes
    that gave them one soil.

    Without seeds each runs once, as it is written.

    Raises:
        InputError: scenes that cannot be compared, or as open_folder; nothing was run.
        SubsoilError: a scene failed with every seed, or no seed is left that all have.
    """
    labels = labels_of([path.with_suffix("") for path in scenes])
    alike = one_soil([load_scene(path, overrides) for path in scenes])
    each = [
        jobs_of(str(path), [*alike, *overrides], (Point({}, name=label),), seeds)
        for path, label in zip(scenes, labels, strict=True)
    ]
    for path, (job, *_) in zip(scenes, each, strict=True):
        if not job.scene.scene.tools or job.scene.scene.soil is None:
            raise InputError(f"{path}: has no tool in soil, so there is no draft to compare; give it both")
    if len({jobs[0].scene.scene_hash for jobs in each}) < len(each):
        raise InputError(f"{', '.join(map(str, scenes))}: two of them are the same scene; change one of them")
    open_folder(out, REQUEST)
    request = {"scenes": [str(path) for path in scenes], "set": [*alike, *overrides], "seeds": list(seeds)}
    if (out / REQUEST).is_file():
        before = read_document(out / REQUEST, str(out / REQUEST))
        if any(before.get(key) != request[key] for key in ("scenes", "set")):
            raise InputError(
                f"--out {out}: holds another comparison ({REQUEST}); more seeds may be added to it, but for "
                "other scenes or values name another folder"
            )
    write_whole(out / REQUEST, lambda part: part.write_text(dump_yaml(request), encoding="utf-8"))
    jobs = [job for of_seed in zip(*each, strict=True) for job in of_seed]  # so that pairs come first
    runs = dict(zip(((job.point.name, job.point.seed or 0) for job in jobs),
                    run_jobs(jobs, out / RUNS, manner, watcher), strict=True))  # fmt: skip
    failed = [f"{name}, seed {seed}: {run.failure}" for (name, seed), run in runs.items() if run.failure]
    good = set.intersection(
        *(
            {seed for (name, seed), run in runs.items() if name == label and not run.failure}
            for label in labels
        )
    )
    if not good:
        name, run = next((key[0], run) for key, run in runs.items() if run.failure)
        raise run.error(f"{name}: nothing is left to compare")
    sides = [Side(label, {seed: runs[label, seed] for seed in sorted(good)}) for label in labels]
    return sides, failed, alike


def quantities_of_runs(sides: Sequence[Side], sources: Sequence[Source]) -> list[Difference]:
    """The quantities of one run each. sources: the series of the sides, in their order.

    Forces and power are means over the times that all share, with intervals of the differences of the curves;
    the loosened section is that of each run's window, with an interval from its slices along the bed.
    """
    runs = [side.first for side in sides]
    numbers, widths = [_numbers(run) for run in runs], [_own_widths(run) for run in runs]
    curves = [_with_forces(source, run) for source, run in zip(sources, runs, strict=True)]
    found = []
    for name in QUANTITIES:
        if not all(name in item for item in numbers):
            continue
        item = next((
            item for item in differences(curves, [name])
            if item.statistic == next(iter(SHARED)) and not np.isnan(item.values).any()
        ), None)  # fmt: skip
        if item is None:
            values = tuple(item[name] for item in numbers)
            half = [own.get(name, math.nan) for own in widths]
            ratios = [value / values[0] if values[0] else math.nan for value in values]
            plain = tuple(math.hypot(half[0], width) for width in half)
            parts = tuple(math.hypot(ratio * half[0], width) / abs(values[0] or math.nan)
                          for ratio, width in zip(ratios, half, strict=True))  # fmt: skip
            item = Difference(name, "mean_of_window", values, plain, parts)
        found.append(item)
    return _told(found)


def quantities_over_fields(sides: Sequence[Side]) -> list[Difference]:
    """The quantities as means over the seeds, which are those of all sides; by the windows of the runs."""
    numbers = [{seed: _numbers(run) for seed, run in side.runs.items()} for side in sides]
    found = []
    for name in QUANTITIES:
        columns = [{seed: item[name] for seed, item in side.items() if name in item} for side in numbers]
        seeds = set.intersection(*map(set, columns))
        if not seeds:
            continue
        columns = [{seed: column[seed] for seed in sorted(seeds)} for column in columns]
        values = tuple(float(np.mean(list(column.values()))) for column in columns)
        plain = tuple(difference_by_seed(column, columns[0]).half_width for column in columns)
        parts = tuple(
            error_by_seed(column, columns[0]).half_width if values[0] else math.nan for column in columns
        )
        found.append(Difference(name, OVER_FIELDS, values, plain, parts))
    return _told(found)


def widest_of_draft(sides: Sequence[Side]) -> float:
    """Largest half-width of the differences of draft from the first side, a part of its draft; infinite where
    it is not known."""
    found = next((item for item in quantities_over_fields(sides) if item.column == DRAFT), None)
    widths = found.part_half_widths[1:] if found is not None else ()
    return max((math.inf if math.isnan(width) else width for width in widths), default=math.inf)


def _told(found: Sequence[Difference]) -> list[Difference]:
    """Forces in parts of the draft, no side force that is noise, no interval of zero."""
    draft = next((item.values for item in found if item.column == DRAFT), None)
    shown = []
    for item in found:
        if item.column in (UPWARD, ASIDE):
            if draft is None:
                continue
            sizes = [
                abs(value) / abs(whole or math.nan) for value, whole in zip(item.values, draft, strict=True)
            ]
            if item.column == ASIDE and not max(sizes) >= SIDE_PART:
                continue
            parts = tuple(width / abs(draft[0] or math.nan) for width in item.half_widths)
            item = replace(item, part_half_widths=parts, whole=draft[0])
        least = NO_SCATTER * max(map(abs, item.values))
        plain, parts = (
            tuple(
                width if known > least else math.nan
                for width, known in zip(widths, item.half_widths, strict=True)
            )
            for widths in (item.half_widths, item.part_half_widths)
        )
        shown.append(replace(item, half_widths=plain, part_half_widths=parts))
    return shown


def _force_columns(run: CachedRun) -> dict[str, list[str]]:
    """Columns of the soil's force on each tillage tool, by the quantity that is their sum."""
    tools: dict[str, Document] = run.scene.get("tools") or {}
    loads = [Wrench(name) for name, tool in tools.items() if tool.get("role") != "wheel"]
    return {
        UPWARD: [load.force_z_newton for load in loads],
        ASIDE: [load.force_y_newton for load in loads],
    }


def _numbers(run: CachedRun) -> dict[str, float]:
    """The quantities that a run has, over its metrics window."""
    summary = flattened(run.summary)
    paths = {
        DRAFT: [MEAN_DRAFT],
        POWER: ["loads.power.draft_watt.mean"],
        SECTION: ["disturbance.area_m2"],
        PRESSURE: ["loads.specific.draft_pa"],
    } | {
        name: [path_of(column, "mean") for column in columns] for name, columns in _force_columns(run).items()
    }
    found = {}
    for name, of_one in paths.items():
        values = [summary.get(path) for path in of_one]
        numbers = [float(value) for value in values if isinstance(value, int | float)]
        if numbers and len(numbers) == len(values):
            found[name] = sum(numbers)
    return found


def _own_widths(run: CachedRun) -> dict[str, float]:
    """Half-widths of the loosened section and of the draft over it, taken as independent of each other."""
    summary, numbers = flattened(run.summary), _numbers(run)
    found = {}
    half = summary.get("disturbance.area_half_width_m2")
    if isinstance(half, int | float) and SECTION in numbers:
        found[SECTION] = float(half)
        of_draft = summary.get(path_of(DRAFT, "stationarity", "mean_half_width"))
        if (
            isinstance(of_draft, int | float)
            and numbers.get(DRAFT)
            and numbers[SECTION]
            and PRESSURE in numbers
        ):
            part = math.hypot(half / numbers[SECTION], of_draft / numbers[DRAFT])
            found[PRESSURE] = part * abs(numbers[PRESSURE])
    return found


def _with_forces(source: Source, run: CachedRun) -> Source:
    """A run's series with the forces on all its tillage tools and the power of the draft."""
    columns, scene = dict(source.columns), run.scene
    for name, parts in _force_columns(run).items():
        if parts and all(part in columns for part in parts):
            columns[name] = np.sum([columns[part] for part in parts], axis=0)
    mechanism, tools = scene.get("mechanism"), scene.get("tools")
    pulls: list[tuple[str, str, float]] = []  # columns of force and speed; sign of a draft in the force
    if mechanism and mechanism.get("draft_driver"):
        body = Body(mechanism["joints"][mechanism["draft_driver"]]["body"])
        pulls = [(DRAFT, body.velocity_x_m_per_s, 1.0)]
    elif not mechanism:
        names = tools or {}
        pulls = [(Wrench(name).force_x_newton, PlanarTool(name).velocity_x_m_per_s, -1.0) for name in names]
    if pulls and all(force in columns and speed in columns for force, speed, _ in pulls):
        columns[POWER] = np.sum(
            [sign * columns[force] * columns[speed] for force, speed, sign in pulls], axis=0
        )
    return replace(source, columns=columns)
