"""The figure of a study: error of every metric against CPU time, a dot per preset."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes

from .plotting import CYCLE, new_figure, save_figure


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
