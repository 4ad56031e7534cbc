"""Figures of many runs: the response to what a sweep varies; errors of a study against CPU time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from ..analysis.intervals import mean_interval
from ..analysis.summary import short_name
from .plotting import CYCLE, new_figure, save_figure

WIDE = 10.0
"""Ratio of the largest to the least value of a key from which its axis is logarithmic."""

LINES = 6
"""Most lines in a panel, so that they stay distinct; more values of a second key are drawn as one mean."""


def draw_response(
    table: pd.DataFrame, keys: Sequence[str], columns: Sequence[str], path: Path
) -> Path | None:
    """Draws `columns` over each of `keys`; every run is a dot, the line is their mean.

    With two keys, one line per value of the other. Bars are 95 % intervals over the seeds, where dots at one
    place differ only by the seed. Returns None if there is nothing to draw.

    table: a row per run, with `seed`, the keys and the columns.
    """
    shown = [key for key in keys if key in table and table[key].nunique() > 1]
    columns = [name for name in columns if name in table and table[name].notna().any()]
    if not shown or not columns:
        return None
    figure = new_figure(max(6.0, 4.6 * len(shown)), max(3.4, 2.9 * len(columns)))
    grid = figure.subplots(len(columns), len(shown), squeeze=False)
    for i, name in enumerate(columns):
        for j, key in enumerate(shown):
            axes = grid[i][j]
            other = shown[1 - j] if len(shown) == 2 and table[shown[1 - j]].nunique() <= LINES else None
            _panel(axes, table, key, name, other, bars=len(shown) == 1 or other is not None)
            axes.set_ylabel(name if j == 0 else "", fontsize=8)
            axes.set_xlabel(key if i == len(columns) - 1 else "", fontsize=8)
            axes.tick_params(labelsize=8)
            axes.grid(alpha=0.3)
            if _is_wide(table[key]):
                axes.set_xscale("log")
            if other is not None and i == 0:
                axes.legend(title=short_name(other), fontsize=7, title_fontsize=7, frameon=False)
    return save_figure(figure, path)


def _panel(axes: Axes, table: pd.DataFrame, key: str, name: str, other: str | None, bars: bool) -> None:
    groups = [("", table)] if other is None else list(table.groupby(other, sort=True))
    places = _places(axes, table[key])
    for (value, rows), colour in zip(groups, CYCLE, strict=False):
        at = [places[item] for item in rows[key]]
        axes.plot(at, rows[name], ".", color=colour, alpha=0.35, ms=5)
        means = []
        for x, found in sorted(
            ((places[item], part[name].dropna()) for item, part in rows.groupby(key)),
            key=lambda pair: pair[0],
        ):
            if len(found):
                interval = mean_interval(found.tolist())
                means.append((x, interval.mean, interval.half_width))
        if not means:  # no run of this line has the quantity
            continue
        places_x, mean, half = (np.array(column) for column in zip(*means, strict=True))
        axes.plot(places_x, mean, "-", color=colour, lw=1.4, label=f"{value}")
        if bars and np.isfinite(half).any():
            axes.errorbar(places_x, mean, np.nan_to_num(half), fmt="none", ecolor=colour, capsize=3, lw=1.0)


def _is_wide(values: pd.Series) -> bool:
    return bool(
        pd.api.types.is_numeric_dtype(values) and values.min() > 0 and values.max() >= WIDE * values.min()
    )


def _places(axes: Axes, values: pd.Series) -> dict[Any, float]:
    """Positions of values on the x axis: numbers as they are, words one after the other."""
    if pd.api.types.is_numeric_dtype(values):
        return {value: float(value) for value in values.unique()}
    words = sorted(values.unique())
    axes.set_xticks(range(len(words)), [str(word)[:24] for word in words], rotation=20, ha="right")
    return {word: float(k) for k, word in enumerate(words)}


@dataclass(frozen=True)
class Dot:
    """A preset in one panel."""

    number: int  # in the legend
    group: str  # factor
    cpu_s: float
    error: float
    half_width: float  # nan: not known
    resolved: bool


@dataclass(frozen=True)
class Panel:
    """One metric."""

    title: str
    unit: str
    dots: tuple[Dot, ...]


def draw_study(
    panels: Sequence[Panel], names: Sequence[str], pareto: Sequence[int], title: str, path: Path
) -> Path:
    """Draw the panels, and beside them the names of the presets by number.

    Filled: the difference is more than the scatter of the seeds; hollow: it is not. pareto: numbers of the
    presets for which no other has less time and less error, in bold.
    """
    columns = 2
    rows = math.ceil(len(panels) / columns)
    figure = new_figure(13.0, 1.0 + 3.3 * rows)
    grid = figure.add_gridspec(rows, columns + 1, width_ratios=[1.0, 1.0, 0.62])
    groups = list(dict.fromkeys(dot.group for panel in panels for dot in panel.dots))
    colours = {group: CYCLE[k % len(CYCLE)] for k, group in enumerate(groups)}
    for k, panel in enumerate(panels):
        _paint(figure.add_subplot(grid[k // columns, k % columns]), panel, colours)
    legend = figure.add_subplot(grid[:, columns])
    legend.axis("off")
    step = min(0.035, 0.97 / max(1, len(names)))
    for number, name in enumerate(names):
        weight = "bold" if number in pareto else "normal"
        legend.text(0.0, 1.0 - step * number, f"{number}  {name[:44]}", fontsize=7, weight=weight, va="top")
    figure.suptitle(title, fontsize=10)
    return save_figure(figure, path)


def _paint(axes: Axes, panel: Panel, colours: dict[str, str]) -> None:
    axes.set_xscale("log")
    for dot in panel.dots:
        colour = colours[dot.group]
        half = 0.0 if math.isnan(dot.half_width) else dot.half_width
        axes.errorbar(
            dot.cpu_s, dot.error, half, fmt="o", ms=5, color=colour, capsize=2, lw=0.9,
            mfc=colour if dot.resolved else "white",
        )  # fmt: skip
        axes.annotate(
            str(dot.number), (dot.cpu_s, dot.error), xytext=(4, 3), textcoords="offset points", fontsize=7
        )
    axes.axhline(0.0, color="black", lw=0.6)
    axes.set_title(panel.title, fontsize=9)
    axes.set_ylabel(panel.unit, fontsize=8)
    axes.set_xlabel("CPU time of the ticks [s]", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.3, which="both")
