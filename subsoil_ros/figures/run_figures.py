"""Figures of a run as PNG: over time, spectra, load cycles, disturbance."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ..analysis import failure_cycles
from ..analysis.columns import (
    DRAFT,
    DRAFT_OF_SHARES,
    DRAFT_OF_WHEELS,
    TIME,
    Body,
    draft_parts,
    spring_element,
)
from ..analysis.disturbance import Disturbance
from ..analysis.fatigue import LoadCycles
from ..analysis.metrics_window import Window, metrics_window, tip_x_m, window_span_s
from ..analysis.series import Series, moving_mean, read_series
from ..analysis.spectra import Spectrum
from ..analysis.summarize import MOVING, RunStatistics, failures_of
from ..loading.loader import ResolvedScene
from ..loading.reference import Reference
from ..run_results import significance_words
from ..scene.scene import Scene
from ..units import unit_of, words_of
from .plotting import COLOURS, CYCLE_BINS, SMOOTHED_S, new_figure, save_figure
from .soil_cut import draw_soil_cut
from .tool_picture import draw_tool

PART_COLOURS = {DRAFT_OF_SHARES: COLOURS["share"], DRAFT_OF_WHEELS: COLOURS["wheels"]}
"""Of columns of draft_parts."""


def draw_figures(
    bag: Path, resolved: ResolvedScene, directory: Path, series: Series | None = None
) -> list[Path]:
    """Draw the figures that the run has data for into `directory`; return their paths.

    series: of the bag, if it has been read already.

    Raises:
        InputError, RecordingError: as read_series.
    """
    scene = resolved.scene
    series = series if series is not None else read_series(bag, scene)
    window = metrics_window(series, resolved)
    span_s = window_span_s(series, window)
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for curve in _curves(series, resolved):
        figure = new_figure(9.0, 4.2)
        axes = figure.add_subplot()
        _paint(axes, series, resolved, curve)
        if not window.whole_run and scene.soil is not None:
            axes.axvspan(*span_s, color="#f2e6c9", zorder=0, label="metrics window (tip well inside the bin)")
        axes.set_xlabel("simulated time [s]")
        axes.set_xlim(0.0, series[TIME][-1])
        axes.grid(alpha=0.3)
        # below the curves, so that it covers none
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, frameon=False, fontsize=9)
        paths.append(save_figure(figure, directory / f"{curve.name}.png"))
    over_travel = _draw_over_travel(series, scene, window, directory / "over_travel.png")
    tool = draw_tool(bag, resolved, directory / "tool.png")
    cut = draw_soil_cut(bag, resolved, directory / "soil_cut.png", span_s)
    return [*paths, *(path for path in (over_travel, tool, cut) if path is not None)]


def _draw_over_travel(series: Series, scene: Scene, window: Window, path: Path) -> Path | None:
    """Draft, spring force and share angle over the travel of the tip, failures marked; None without a tip in
    soil."""
    tip = tip_x_m(series, scene)
    report = scene.report
    columns = {DRAFT: f"draft [N], mean over {1e3 * failure_cycles.SMOOTHED_S:.0f} ms"}
    columns[spring_element(report.spring).load] = "spring force [N], compression +"
    columns[Body(report.shank).angle_rad] = "share angle [rad]"
    columns = {name: label for name, label in columns.items() if name in series}
    if tip is None or scene.soil is None or not columns:
        return None
    figure = new_figure(9.0, 2.2 * len(columns) + 1.2)
    panels = figure.subplots(len(columns), 1, sharex=True, squeeze=False)[:, 0]
    failures = failures_of(series, scene, window)
    for axes, (name, label) in zip(panels, columns.items(), strict=True):
        smoothed = name == DRAFT
        values = moving_mean(series, name, failure_cycles.SMOOTHED_S) if smoothed else series[name]
        axes.plot(tip, values, color=COLOURS["main"], lw=1.2)
        axes.set_ylabel(label, fontsize=9)
        axes.grid(alpha=0.3)
        if failures is not None:
            at = np.flatnonzero(window.rows)[failures.failures]
            axes.plot(tip[at], values[at], "o", color=COLOURS["share"], ms=4, label="failure of the soil")
    if failures is not None:
        panels[0].legend(loc="upper left", fontsize=8)
    panels[-1].set_xlabel("travel of the tip, x [m]")
    figure.suptitle(f"Load cycles over travel\n{scene.name}", fontsize=11)
    return save_figure(figure, path)


class _Curve(NamedTuple):
    """A column over time, drawn as scale * (column - zero)."""

    name: str  # of the figure
    column: str
    title: str
    unit: str
    label: str
    scale: float = 1.0
    zero: float = 0.0


def _curves(series: Series, resolved: ResolvedScene) -> Iterator[_Curve]:
    """The curves that the run has."""
    scene, shank = resolved.scene, resolved.scene.report.shank
    if DRAFT in series:
        title = "Draft: forward pull that moves the tool, positive while soil resists"
        yield _Curve("draft", DRAFT, title, "pull along travel [N]", "draft")
    if (spring := spring_element(scene.report.spring).load) in series:
        title, label = "Force of the spring between frame and shank", f"spring {scene.report.spring}"
        yield _Curve("spring_force", spring, title, "force [N], compression positive", label)
    if shank is None or scene.mechanism is None:
        return
    body, zero = Body(shank), scene.mechanism.bodies[shank].angle_rad
    label, unit = "share, from its working pose", "entry angle [rad], negative: tip back"
    yield _Curve("share_angle", body.angle_rad, "Entry angle of the share", unit, label, zero=zero)
    title, unit = "Height of the shank's centre of mass", "height over the bed's surface [mm]"
    label = f"centre of mass: {1e3 * np.ptp(series[body.z_m]):.1f} mm from lowest to highest"
    yield _Curve("shank_height", body.z_m, title, unit, label, scale=1e3)


def _paint(axes: Axes, series: Series, resolved: ResolvedScene, curve: _Curve) -> None:
    shown = curve.scale * (series[curve.column] - curve.zero)
    if curve.column == DRAFT:
        _paint_draft(axes, series, resolved.scene)
    else:
        axes.plot(series[TIME], shown, color=COLOURS["main"], lw=1.2, label=curve.label)
    if curve.name == "spring_force":
        axes.axhline(0.0, color="black", lw=0.6)
    if (reference := resolved.reference) is not None:
        levels = reference_levels(reference, curve.column, shown, curve.scale, curve.zero)
        for level, label in zip(levels, (reference.name, *[None] * len(levels)), strict=False):
            axes.axhline(level, color=COLOURS["reference"], lw=1.0, ls="--", label=label)
    axes.set_ylabel(curve.unit)
    axes.set_title(f"{curve.title}\n{resolved.scene.name}", fontsize=11)


def _paint_draft(axes: Axes, series: Series, scene: Scene) -> None:
    """The draft as recorded and smoothed, with its parts."""
    times, smoothed = series[TIME], f"mean over {SMOOTHED_S:g} s"
    axes.plot(times, series[DRAFT], color=COLOURS["main"], lw=0.7, alpha=0.5, label="draft as recorded")

    def draw(name: str, label: str, **style: Any) -> None:
        if name in series:
            smooth = moving_mean(series, name, SMOOTHED_S)
            axes.plot(times, smooth, label=f"{label}, {smoothed}", **style)

    draw(DRAFT, "draft", color=COLOURS["main"], lw=1.8)
    for name, words in draft_parts(scene).items():
        colour = PART_COLOURS.get(name)  # None: of several shanks each has its own
        style = {"lw": 1.2, "color": colour} if colour else {"lw": 0.8, "ls": ":"}
        draw(name, words.strip(), **style)


def reference_levels(
    reference: Reference, column: str, shown: NDArray[np.float64], scale: float = 1.0, zero: float = 0.0
) -> list[float]:
    """Least, mean and largest value of a column in a reference; a range is placed about the middle of ours.

    shown: the curve (n,), scale * (column - zero).
    """
    levels = []
    for quantity, given in reference.values.items():
        of, _, measure = quantity.rpartition(".")
        if of.removesuffix(f".{MOVING}").removesuffix(".run") != f"series.{column}" or given.value is None:
            continue
        if measure == "range":
            middle, half = 0.5 * float(shown.max() + shown.min()), 0.5 * scale * given.value
            levels += [middle - half, middle + half]
        elif measure in ("mean", "min", "max"):
            levels.append(scale * (given.value - zero))
    return levels


def draw_load_figures(statistics: RunStatistics, title: str, directory: Path) -> list[Path]:
    """Draw the figures of the statistics that the run has into `directory`; return the paths."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    if statistics.spectra:
        paths.append(_draw_spectra(statistics.spectra, title, directory / "spectra.png"))
    if statistics.cycles is not None and len(statistics.cycles.range_newton):
        paths.append(_draw_cycles(statistics.cycles, title, directory / "load_cycles.png"))
    if statistics.disturbance is not None:
        paths.append(_draw_disturbance(statistics.disturbance, title, directory / "disturbance.png"))
    return paths


def _draw_spectra(spectra: dict[str, Spectrum], title: str, path: Path) -> Path:
    figure = new_figure(9.0, 2.6 * len(spectra) + 0.8)
    panels = figure.subplots(len(spectra), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, found) in zip(panels, spectra.items(), strict=True):
        rows = slice(1, None)
        frequency = found.frequency_hz[rows]
        axes.fill_between(
            frequency, found.low[rows], found.high[rows], color=COLOURS["main"], alpha=0.25, lw=0.0,
            label="95 % (chi-square)",
        )  # fmt: skip
        axes.loglog(frequency, found.density[rows], color=COLOURS["main"], lw=1.2, label="Welch")
        axes.loglog(
            frequency,
            found.level[rows],
            color=COLOURS["reference"],
            lw=1.0,
            ls="--",
            label="red noise, 95 % anywhere",
        )
        axes.axvline(
            found.dominant_hz,
            color=COLOURS["share"],
            lw=1.0,
            label=f"{found.dominant_hz:.2f} Hz, {significance_words(found)}",
        )
        axes.set_title(words_of(name), fontsize=9, loc="left")
        axes.set_ylabel(f"density [{unit_of(name)}$^2$/Hz]")
        axes.minorticks_off()  # of 300 ticks most would have neither label nor room
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    panels[-1].set_xlabel("frequency [Hz]")
    figure.suptitle(f"Spectra over the metrics window\n{title}", fontsize=11)
    return save_figure(figure, path)


def _draw_cycles(cycles: LoadCycles, title: str, path: Path) -> Path:
    figure = new_figure(9.0, 4.2)
    axes = figure.add_subplot()
    edges = np.linspace(0.0, cycles.max_range_newton, CYCLE_BINS + 1)
    axes.hist(cycles.range_newton, bins=edges.tolist(), weights=cycles.count, color=COLOURS["main"])
    equivalent = cycles.equivalent_range_newton()
    axes.axvline(equivalent, color=COLOURS["share"], label=f"same damage as {equivalent:.0f} N once a second")
    axes.set_yscale("log")
    axes.set_xlabel("range of the spring force [N]")
    axes.set_ylabel("cycles")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9)
    axes.set_title(f"Load cycles of the spring (rainflow, ASTM E1049)\n{title}", fontsize=11)
    return save_figure(figure, path)


def _draw_disturbance(found: Disturbance, title: str, path: Path) -> Path:
    figure = new_figure(10.0, 9.5)
    section, surface, along = figure.subplots(3, 1)
    rows, columns = found.moved_map.shape
    y_low, z_low = found.origin_m
    extent = (y_low, y_low + columns * found.cell_m, z_low, 0.0)
    image = section.imshow(
        found.moved_map, origin="lower", extent=extent, cmap="viridis", vmin=0.0, vmax=1.0, aspect="equal"
    )
    figure.colorbar(image, ax=section, label="part moved by more than a radius")
    section.set_xlabel("across travel, y [m]")
    section.set_ylabel("height before [m]")
    section.set_title(
        f"loosened {1e4 * found.area_m2:.0f} cm$^2$, surface {1e3 * found.surface_width_m:.0f} mm wide",
        fontsize=10, loc="left",
    )  # fmt: skip
    lift = found.lift
    (x, y), (rows, columns) = lift.origin_m, lift.height_m.shape
    largest = max(1e-3, float(np.nanmax(np.abs(lift.height_m))))
    image = surface.imshow(
        1e3 * lift.height_m, origin="lower", cmap="RdBu_r", vmin=-1e3 * largest, vmax=1e3 * largest,
        extent=(x, x + columns * lift.cell_m, y, y + rows * lift.cell_m), aspect="equal",
    )  # fmt: skip
    figure.colorbar(image, ax=surface, label="lift [mm]")
    surface.set_xlabel("along travel, x [m]")
    surface.set_ylabel("across travel, y [m]")
    surface.set_title("height of the surface, after less before", fontsize=10, loc="left")
    along.plot(found.slices_m, 1e4 * found.slice_m2, drawstyle="steps-mid")
    along.set_xlabel("along travel, x [m]")
    along.set_ylabel("loosened section [cm$^2$]")
    along.set_ylim(bottom=0.0)
    along.grid(alpha=0.3)
    figure.suptitle(f"Disturbance of the soil behind the tool\n{title}", fontsize=11)
    return save_figure(figure, path)
