"""Ranking of the points of a sweep by draft: saving beside the scatter of beds, and load of the spring."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import pandas as pd

from ..analysis.columns import spring_element
from ..analysis.intervals import Interval, difference_by_seed, error_by_seed, mean_interval
from ..analysis.summary import MEAN_DRAFT
from .sweep_points import Point

FATIGUE_WORDS = ("equivalent_range", "fatigue", "rainflow")
"""Words in the names of columns about a spring's load cycles; the first column found is used."""

CONTROL = "control"
"""Name of the runs that a saving is counted from."""


@dataclass(frozen=True)
class Ranked:
    """A point of a sweep over its seeds."""

    values: dict[str, object]
    draft_newton: Interval
    saving: Interval | None  # part of the control's draft; None without one
    behind_best: Interval  # draft above that of the best, same seeds
    load: dict[str, float]  # spring range and fatigue columns, means over the seeds
    failures: int
    shown: dict[str, Interval] = field(default_factory=dict)  # columns that were asked for

    @property
    def judged(self) -> Interval:
        """What a recommendation rests on: the saving, without a control the draft."""
        return self.draft_newton if self.saving is None else self.saving

    @property
    def level_with_best(self) -> bool:
        """Whether the seeds do not resolve that it draws more than the best."""
        return not self.behind_best.low > 0.0


def control_point(point: Point, control: Sequence[str]) -> Point:
    """Control of a point, from which its saving is counted: the point with the control's values.

    Values that the point varies in the same part of the scene are left as in the scene: the stiffness of a
    locked spring has no effect. So is one of a key that the control gives, or of a mapping around it.
    """
    given = [text.partition("=")[0].strip() for text in control]
    parts = tuple(f"{key.rpartition('.')[0]}." for key in given)
    values = {
        key: value
        for key, value in point.values.items()
        if not key.startswith(parts) and not any(f"{name}.".startswith(f"{key}.") for name in given)
    }
    return Point(values, point.seed, CONTROL, tuple(control))


def rank(
    points: Sequence[Point],
    runs: pd.DataFrame,
    control: Sequence[str],
    spring: str | None,
    confidence: float,
    shown: Sequence[str] = (),
) -> list[Ranked]:
    """Points by mean draft over the seeds that all have, least first; points without a draft are left out.

    runs: rows of the sweep, those of the controls among them, with columns of table_of.
    shown: further columns, given as mean with interval.
    """
    found = []
    for point in points:
        rows = _rows(runs, point)
        if MEAN_DRAFT not in rows:
            continue
        done = rows[(rows["failure"] == "") & rows[MEAN_DRAFT].notna()]
        if done.empty:
            continue
        drafts = _by_seed(done, MEAN_DRAFT)
        saving = None
        if control:
            saving = _saving(drafts, _rows(runs, control_point(point, control)), confidence)
        load = {name: float(done[name].mean()) for name in _load_columns(done)}
        name = f"series.{spring_element(spring).load}"
        if f"{name}.max" in done:
            load[f"{name}.range"] = float((done[f"{name}.max"] - done[f"{name}.min"]).mean())
        told = {name: mean_interval(done[name].dropna().tolist(), confidence) for name in shown}
        found.append((point, drafts, saving, load, len(rows) - len(done), told))
    common = set.intersection(*({*item[1]} for item in found)) if found else set()

    def mean_draft(drafts: dict[int, float]) -> float:
        counted = [draft for seed, draft in drafts.items() if seed in common or not common]
        return sum(counted) / len(counted)

    found.sort(key=lambda item: mean_draft(item[1]))
    return [
        Ranked(
            point.values,
            mean_interval(list(drafts.values()), confidence),
            saving,
            difference_by_seed(drafts, found[0][1], confidence),
            load,
            failures,
            told,
        )
        for point, drafts, saving, load, failures, told in found
    ]


def recommended(ranked: Sequence[Ranked]) -> Ranked | None:
    """Of the points whose difference from the best is not resolved, the one with the least fatigue load.

    None with a single seed, with seeds that change nothing, or if there is a control and the best is not
    resolved to save draft.
    """
    level = [item for item in ranked if item.level_with_best and not math.isnan(item.behind_best.half_width)]
    if (
        not level
        or not level[0].judged.scatters
        or (level[0].saving is not None and not level[0].saving.low > 0.0)
    ):
        return None
    column = next((name for word in FATIGUE_WORDS for name in level[0].load if word in name), None)
    if column is None:
        return level[0]
    return min(level, key=lambda item: item.load.get(column, math.inf))


def ranking_table(ranked: Sequence[Ranked], best: Ranked | None) -> pd.DataFrame:
    """The ranking as a table; half-widths are of the confidence intervals."""
    rows = []
    for item in ranked:
        row = {
            **item.values,
            "seeds": item.draft_newton.count,
            "failures": item.failures,
            MEAN_DRAFT: item.draft_newton.mean,
            f"{MEAN_DRAFT}_half_width": item.draft_newton.half_width,
        }
        if item.saving is not None:
            row |= {"saving": item.saving.mean, "saving_half_width": item.saving.half_width}
        row |= {"level_with_best": item.level_with_best, "recommended": item is best, **item.load}
        for name, interval in item.shown.items():
            row |= {name: interval.mean, f"{name}_half_width": interval.half_width}
        rows.append(row)
    return pd.DataFrame(rows)


def _rows(runs: pd.DataFrame, point: Point) -> pd.DataFrame:
    """Rows of a point, whatever their seed."""
    return runs[runs["point"] == point_key(point)]


def point_key(point: Point) -> str:
    """Key of a point, independent of its seed."""
    return repr((point.name, sorted((key, repr(value)) for key, value in point.values.items())))


def _by_seed(rows: pd.DataFrame, column: str) -> dict[int, float]:
    return {int(seed): float(value) for seed, value in zip(rows["seed"], rows[column], strict=True)}


def _saving(drafts: dict[int, float], control: pd.DataFrame, confidence: float) -> Interval | None:
    """1 - mean draft / mean draft of the control, over the seeds that both have (error_by_seed)."""
    done = control[control["failure"] == ""]
    if done.empty:
        return None
    return error_by_seed(drafts, _by_seed(done, MEAN_DRAFT), confidence).scaled(-1.0)


def _load_columns(rows: pd.DataFrame) -> list[str]:
    return [
        str(name)
        for name in rows.columns
        if any(word in str(name) for word in FATIGUE_WORDS) and rows[name].notna().any()
    ]
