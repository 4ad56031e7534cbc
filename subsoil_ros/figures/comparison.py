"""Runs side by side, and beside field measurements: curves, metrics, differences."""

import difflib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis.columns import DRAFT, TIME, Body, spring_element
from ..analysis.series import Column, moving_mean, read_table_csv
from ..analysis.stationarity import stationarity
from ..errors import InputError
from ..units import words_of
from ..yaml_document import read_document
from .plotting import CYCLE, SMOOTHED_S, new_figure, save_figure

APART = "rms_difference"
STATISTICS = ("mean", "min", "max")
SHARED = {"shared_mean": "mean, shared times", "shared_deviation": "deviation, shared times"}
"""Over the times that all have in their spans: mean at the times of the first, standard deviation about the
trend; and how they are printed."""

_MEASURED = "#000000"


@dataclass(frozen=True)
class Source:
    """A run, or a measurement: its columns over time, and the span its metrics are taken over."""

    label: str
    columns: dict[str, Column]
    span_s: tuple[float, float]
    measured: bool = False
    window_empty: bool = False  # a run without a row in its metrics window: the span is the whole run

    def at(self, name: str, times_s: Column) -> Column:
        """A column at times (n,) [s], linear between rows with a value; nan before the first and after the
        last of them, and without the column."""
        known = self.known_s(name)
        if not len(known):
            return np.full(len(times_s), math.nan)
        values = self.columns[name]
        return np.interp(times_s, known, values[np.isfinite(values)], left=math.nan, right=math.nan)

    def known_s(self, name: str) -> Column:
        """Times [s] of the rows in which a column has a value; none without the column."""
        if name not in self.columns:
            return np.array([])
        return np.asarray(self.columns[TIME][np.isfinite(self.columns[name])])

    def statistics(self, name: str) -> dict[str, float] | None:
        """Mean, least and largest of a column in the span; None without the column or a row there."""
        times = self.columns[TIME]
        if name not in self.columns:
            return None
        values = self.columns[name][(times >= self.span_s[0]) & (times <= self.span_s[1])]
        values = values[np.isfinite(values)]
        if not len(values):
            return None
        return {"mean": float(values.mean()), "min": float(values.min()), "max": float(values.max())}


@dataclass(frozen=True)
class Difference:
    """One statistic of one column, of every source; against the first source."""

    column: str
    statistic: str  # of STATISTICS or SHARED, or APART; of a quantity of tools another
    values: tuple[float, ...]  # one per source; nan where it has none
    half_widths: tuple[float, ...] = ()  # of SHARED, one per source: 95 % of the difference from the first
    part_half_widths: tuple[float, ...] = ()  # of the difference as a part of the first, itself uncertain
    whole: float | None = None  # what parts are of; None: the first value

    def against_first(self, place: int) -> tuple[float, float]:
        """(difference, part of the first) of the source at `place`."""
        difference = self.values[place] - self.values[0]
        whole = self.values[0] if self.whole is None else self.whole
        return difference, difference / abs(whole) if whole else math.nan


def read_run(folder: Path, label: str) -> Source:
    """Read a run's folder, made by `subsoil run` or by a sweep.

    Raises:
        InputError: it is no such folder, or has no series.csv and summary.json yet.
    """
    if not (folder / "scene.yaml").is_file():
        raise InputError(
            f"{folder}: no folder of a run (it has no scene.yaml); name one that `subsoil run` made"
        )
    for name in ("series.csv", "summary.json"):
        if not (folder / name).is_file():
            raise InputError(f"{folder}: has no {name}; `subsoil report {folder}` makes it from the bag")
    columns = read_table_csv(folder / "series.csv")
    try:
        window = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["window"]
        span_s = (float(window["start_s"]), float(window["end_s"]))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{folder / 'summary.json'}: is no summary of a run; `subsoil report {folder}` makes it anew"
        ) from error
    return Source(label, columns, span_s, window_empty=window.get("whole_run") is True)


def read_measured(path: Path, runs: Sequence[Source]) -> Source:
    """Read a measured CSV: time_s in the time of the run, and columns named as those of the runs.

    Its metrics are over the span of the first run.

    Raises:
        InputError: no time_s, or no column that a run has.
    """
    columns = read_table_csv(path)
    if TIME not in columns:
        raise InputError(f"{path}: has no column 'time_s' (seconds, from the start of the run)")
    if not np.all(np.diff(columns[TIME]) > 0.0) or not np.isfinite(columns[TIME]).all():
        raise InputError(f"{path}: time_s does not grow from row to row; sort it, and give each row one time")
    known = list(dict.fromkeys(name for run in runs for name in run.columns if name != TIME))
    shared = [name for name in columns if name in known]
    if not shared:
        given = next((name for name in columns if name != TIME), "nothing")
        near = difflib.get_close_matches(given, known, n=3, cutoff=0.3)
        raise InputError(
            f"{path}: no column is one of the runs' (given {', '.join(columns)}); name them as series.csv "
            f"does, units in them{': perhaps ' + ', '.join(near) if near else ''}"
        )
    return Source(path.name, columns, runs[0].span_s, measured=True)


def labels_of(folders: Sequence[Path]) -> list[str]:
    """Folder names, each with as many of its parents as make the names unique."""
    parts = [folder.resolve().parts for folder in folders]
    for count in range(1, max(map(len, parts)) + 1):
        labels = ["/".join(item[-count:]) for item in parts]
        if len(set(labels)) == len(labels):
            return labels
    raise InputError(f"{folders[0]}: is named twice; name different ones")


def usual_columns(folders: Sequence[Path], sources: Sequence[Source]) -> list[str]:
    """Draft, spring force, angle and height of the shank, then all that was measured and a run has."""
    report = read_document(folders[0] / "scene.yaml", str(folders[0] / "scene.yaml")).get("report") or {}
    names = [DRAFT]
    names += [spring_element(report["spring"]).load] if report.get("spring") else []
    if report.get("shank"):
        names += [Body(report["shank"]).angle_rad, Body(report["shank"]).z_m]
    runs = [source for source in sources if not source.measured]
    names += [name for source in sources if source.measured for name in source.columns]
    return [
        name for name in dict.fromkeys(names) if name != TIME and any(name in run.columns for run in runs)
    ]


def differences(sources: Sequence[Source], columns: Sequence[str]) -> list[Difference]:
    """Statistics of each column, and the root mean square difference from the first curve."""
    found = []
    for name in columns:
        statistics = [source.statistics(name) for source in sources]
        for statistic in STATISTICS:
            values = tuple(math.nan if item is None else item[statistic] for item in statistics)
            found.append(Difference(name, statistic, values))
        found += _at_shared_times(sources, name)
        apart = tuple(_rms_difference(sources[0], source, name) for source in sources)
        found.append(Difference(name, APART, apart))
    return found


def shared_span_s(sources: Sequence[Source], name: str = TIME) -> tuple[float, float]:
    """Times in the spans of all that have a column, between their rows with a value; where there are none,
    the second is not larger."""
    known = [(source.span_s, source.known_s(name)) for source in sources]
    lows = [max(span[0], times[0]) for span, times in known if len(times)]
    highs = [min(span[1], times[-1]) for span, times in known if len(times)]
    return max(lows, default=0.0), min(highs, default=0.0)


def _at_shared_times(sources: Sequence[Source], name: str) -> list[Difference]:
    """Mean and deviation, with intervals of their differences from the first; of 2 WAVES rows or more each.

    That of the mean is of the difference of the curves, in which what they share cancels. That of the
    deviation takes the two runs as independent. For y / x - 1 the first is scaled by y / x.
    """
    low, high = shared_span_s(sources, name)
    known = [source.known_s(name) for source in sources]
    rows = [times[(times >= low) & (times <= high)] for times in known]
    common = next((times for times in rows if len(times)), rows[0])
    curves = [source.at(name, common) for source in sources]
    own = [_steady(times, source.at(name, times)) for source, times in zip(sources, rows, strict=True)]
    deviations = tuple(item[2] for item in own)
    means = tuple(
        math.nan if math.isnan(item[0]) else _steady(common, curve)[0]
        for item, curve in zip(own, curves, strict=True)
    )

    def of_mean(place: int, ratio: float) -> float:
        return _steady(common, curves[place] - ratio * curves[0])[1]

    def of_deviation(place: int, ratio: float) -> float:
        return math.hypot(own[place][3], ratio * own[0][3])

    found = []
    for statistic, values, width in zip(SHARED, (means, deviations), (of_mean, of_deviation), strict=True):
        ratios = [value / values[0] if values[0] else math.nan for value in values]
        plain = tuple(width(place, 1.0) for place in range(len(sources)))
        parts = tuple(width(place, ratio) / abs(values[0] or math.nan) for place, ratio in enumerate(ratios))
        found.append(Difference(name, statistic, values, plain, parts))
    return found


def _steady(times_s: Column, values: Column) -> tuple[float, float, float, float]:
    """Mean, deviation about the trend, each with the half-width of its 95 % interval (stationarity.py)."""
    found = stationarity(times_s, values) if np.isfinite(values).all() else None
    if found is None:
        return (math.nan,) * 4
    return found.mean, found.mean_half_width, found.deviation, found.deviation_half_width


def _rms_difference(first: Source, other: Source, name: str) -> float:
    """RMS difference of two curves in the span of the first, where both have times; linear between rows."""
    if name not in first.columns or name not in other.columns:
        return math.nan
    times = first.known_s(name)
    times = times[(times >= first.span_s[0]) & (times <= first.span_s[1])]
    apart = other.at(name, times) - first.at(name, times)
    apart = apart[np.isfinite(apart)]
    return float(np.sqrt(np.mean(apart**2))) if len(apart) else math.nan


def write_differences_csv(found: Sequence[Difference], labels: Sequence[str], path: Path) -> None:
    """Write a row per column and statistic: values of the sources, then difference from the first and the
    difference as a part of the first, each with its half-width of 95 %. labels: of the sources."""
    import pandas as pd

    heads = [
        f"{kind} {label}"
        for label in labels[1:]
        for kind in ("difference", "half-width", "part", "part half-width")
    ]
    rows = []
    for item in found:
        row: list[Any] = [item.column, item.statistic, *item.values]
        for place in range(1, len(labels)):
            width = item.half_widths[place] if item.half_widths else math.nan
            of_part = item.part_half_widths[place] if item.part_half_widths else math.nan
            difference, part = item.against_first(place)
            row += (difference, width, part, of_part) if item.statistic != APART else (math.nan,) * 4
        rows.append(row)
    table = pd.DataFrame(rows, columns=["column", "statistic", *labels, *heads])
    table.to_csv(path, index=False, na_rep="nan")


def draw_overlay(sources: Sequence[Source], columns: Sequence[str], path: Path) -> Path:
    """Draw a panel per column with all sources, those of one label alike; the metrics span of the first is
    shaded."""
    labels = list(dict.fromkeys(source.label for source in sources))
    figure = new_figure(9.0, 0.8 + 2.6 * len(columns))
    panels = figure.subplots(len(columns), 1, sharex=True, squeeze=False)[:, 0]
    for axes, name in zip(panels, columns, strict=True):
        axes.axvspan(*sources[0].span_s, color="#f2e6c9", zorder=0)
        named: set[str] = set()
        for source in sources:
            if name not in source.columns:
                continue
            colour = _MEASURED if source.measured else CYCLE[labels.index(source.label) % len(CYCLE)]
            times, values = source.columns[TIME], source.columns[name]
            axes.plot(times, values, color=colour, lw=0.6, alpha=0.35)
            smooth = moving_mean(source.columns, name, SMOOTHED_S)
            axes.plot(
                times, smooth, color=colour, lw=1.5, label=None if source.label in named else source.label
            )
            named.add(source.label)
        axes.set_ylabel(words_of(name), fontsize=8)
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=8, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    panels[-1].set_xlabel("time [s]", fontsize=9)
    return save_figure(figure, path)
