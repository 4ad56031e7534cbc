"""Errors of every preset of a study against its reference run, with intervals over the seeds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import pandas as pd

from ..analysis.intervals import (
    Interval,
    difference_by_seed,
    error_against_one,
    error_by_seed,
    mean_interval,
)
from .run_metrics import METRICS, Metric
from .study_design import REFERENCE, StudyDesign


@dataclass(frozen=True)
class Measurement:
    """One run: a preset with one seed."""

    preset: str
    seed: int
    wall_s: float
    cpu_s: float
    metrics: dict[str, float]
    half_widths: dict[str, float] = field(default_factory=dict)  # of 95 %, by the run's own record


@dataclass
class PresetResult:
    """A preset of a study."""

    name: str
    factors: dict[str, str]
    seeds: int
    failures: list[str]
    wall_s: Interval | None = None
    cpu_s: Interval | None = None
    speed_up: tuple[float, float, float] | None = None  # mean, low, high
    values: dict[str, Interval] = field(default_factory=dict)
    errors: dict[str, Interval] = field(default_factory=dict)  # against the reference
    errors_against: dict[str, dict[str, Interval]] = field(default_factory=dict)  # by reference
    bound: float = math.nan  # largest error of the metrics that are judged, at the far end of its interval
    pareto: bool = False

    def runs_with(self, metric: str) -> int:
        """How many of its runs have a metric."""
        return self.values[metric].count if metric in self.values else 0

    def verdict(self, metric: str) -> str:
        """In words, whether its difference from the reference is more than the scatter of the seeds."""
        error = self.errors.get(metric)
        if error is None:
            return ""
        if error.mean == 0.0 and error.half_width == 0.0:
            return "same"
        if math.isnan(error.half_width):
            return "one seed"
        return "resolved" if error.resolved else "within seed scatter"


def judge(
    design: StudyDesign,
    measured: Sequence[Measurement],
    failures: dict[str, list[str]],
) -> list[PresetResult]:
    """Every preset of the design, in its order; those that failed in every seed have no numbers.

    Errors are ratios of the means over the seeds that both have, less 1; intervals are Student's t of what is
    left seed by seed (intervals.py). Speed-ups are of logarithms, since times scale. A reference of one run
    has no scatter of its own: the reference's stands for it.
    """
    by_preset: dict[str, dict[int, Measurement]] = {}
    for item in measured:
        by_preset.setdefault(item.preset, {})[item.seed] = item
    reference = by_preset.get(REFERENCE, {})
    found = []
    for preset in design.all_presets():
        point = preset.point
        runs = by_preset.get(point.name, {})
        judged = PresetResult(point.name, preset.factors, len(runs), failures.get(point.name, []))
        if runs:
            _times(judged, runs, reference, design.confidence)
            for metric in METRICS:
                _errors(judged, metric, runs, reference, by_preset, design)
            known = [
                name for name in design.metrics if any(name in run.metrics for run in reference.values())
            ]
            judged.bound = _bound(judged, known, len(design.seeds))
        found.append(judged)
    _mark_pareto(found)
    return found


def _times(
    judged: PresetResult, runs: dict[int, Measurement], reference: dict[int, Measurement], confidence: float
) -> None:
    judged.wall_s = mean_interval([run.wall_s for run in runs.values()], confidence)
    judged.cpu_s = mean_interval([run.cpu_s for run in runs.values()], confidence)
    gains = difference_by_seed(
        {seed: math.log(run.cpu_s) for seed, run in reference.items()},
        {seed: math.log(run.cpu_s) for seed, run in runs.items()},
        confidence,
    )
    if gains.count:
        judged.speed_up = (math.exp(gains.mean), math.exp(gains.low), math.exp(gains.high))


def _errors(
    judged: PresetResult,
    metric: Metric,
    runs: dict[int, Measurement],
    reference: dict[int, Measurement],
    by_preset: dict[str, dict[int, Measurement]],
    design: StudyDesign,
) -> None:
    values, true = _of(runs, metric), _of(reference, metric)
    if not values:
        return
    if design.intervals == "records" and _errors_by_record(judged, metric, runs, reference):
        return
    judged.values[metric.name] = mean_interval(list(values.values()), design.confidence)
    if not true or (metric.relative and not any(true.values())):
        return  # nothing to be relative to
    compare = error_by_seed if metric.relative and not metric.part_of else difference_by_seed
    error = compare(values, true, design.confidence)
    if metric.part_of:
        error = error.scaled(
            1.0 / mean_interval([run.metrics[metric.part_of] for run in reference.values()]).mean
        )
    if error.count:
        judged.errors[metric.name] = _resolvable(error, metric, reference)
    scatter = float(pd.Series(true).std())  # nan with one
    for name in design.additional_references:
        other = list(_of(by_preset.get(name, {}), metric).values())
        if not metric.relative or metric.part_of or not any(other):
            continue
        centre = sum(other) / len(other)
        judged.errors_against.setdefault(name, {})[metric.name] = error_against_one(
            list(values.values()), centre, scatter / math.sqrt(len(other)), len(true), design.confidence
        )


def _errors_by_record(
    judged: PresetResult, metric: Metric, runs: dict[int, Measurement], reference: dict[int, Measurement]
) -> bool:
    """Value and error of a metric with the intervals of the runs' own records; False where one has none.

    Runs are independent, also on the same seed. Of the ratio x / y - 1 the half-width is
    sqrt(w_x^2 + (x / y)^2 w_y^2) / |y|, that of the mean of n runs sqrt(sum of w^2) / n.
    """
    value, true = _mean_by_record(runs, metric.name), _mean_by_record(reference, metric.name)
    unit = _mean_by_record(reference, metric.part_of) if metric.part_of else true
    if value is None or true is None or unit is None or not metric.relative or not unit.mean:
        return False
    judged.values[metric.name] = value
    if judged.name == REFERENCE:
        judged.errors[metric.name] = Interval(0.0, 0.0, true.count)
        return True
    ratio = 1.0 if metric.part_of else value.mean / true.mean
    width = math.hypot(value.half_width, ratio * true.half_width) / abs(unit.mean)
    judged.errors[metric.name] = Interval((value.mean - true.mean) / abs(unit.mean), width, value.count)
    return True


def _mean_by_record(runs: dict[int, Measurement], name: str) -> Interval | None:
    found = [(run.metrics[name], run.half_widths.get(name)) for run in runs.values() if name in run.metrics]
    widths = [width for _, width in found if width is not None]
    if not found or len(widths) < len(found):
        return None
    mean = sum(value for value, _ in found) / len(found)
    return Interval(mean, math.hypot(*widths) / len(found), len(found))


def _resolvable(error: Interval, metric: Metric, reference: dict[int, Measurement]) -> Interval:
    """No narrower than what a run can tell of the metric; runs with the same value stay the same."""
    if metric.resolution is None or error.mean == error.half_width == 0.0:
        return error
    told = max(
        run.metrics[metric.resolution] / run.metrics[metric.name]
        for run in reference.values()
        if metric.name in run.metrics
    )
    return Interval(error.mean, max(error.half_width, told), error.count)


def _of(runs: dict[int, Measurement], metric: Metric) -> dict[int, float]:
    return {seed: run.metrics[metric.name] for seed, run in runs.items() if metric.name in run.metrics}


def _bound(judged: PresetResult, names: Sequence[str], seeds: int) -> float:
    """Largest |error| that the intervals still hold; of errors without one where all have a single seed.

    Infinite where an error is not known: too few seeds are left, or the preset lost what is judged.
    """
    ends = []
    for name in names:
        error = judged.errors.get(name)
        if error is None or (seeds > 1 and math.isnan(error.half_width)):
            return math.inf
        ends.append(abs(error.mean) + (0.0 if math.isnan(error.half_width) else error.half_width))
    return max(ends, default=math.nan)


def _mark_pareto(found: Sequence[PresetResult]) -> None:
    """Marks every preset that no other beats in both CPU time and bound."""
    rated = [item for item in found if item.cpu_s is not None and math.isfinite(item.bound)]
    for item in rated:
        assert item.cpu_s is not None
        item.pareto = not any(
            other.cpu_s is not None
            and other.cpu_s.mean <= item.cpu_s.mean
            and other.bound <= item.bound
            and (other.cpu_s.mean < item.cpu_s.mean or other.bound < item.bound)
            for other in rated
        )
