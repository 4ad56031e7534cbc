"""Interactive plots of a run for its page: one plotly figure for each quantity that a reader can pick."""

import base64
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
import plotly.graph_objects as go

from ..analysis.columns import DRAFT, TIME, Body, draft_parts, spring_element
from ..analysis.disturbance import Disturbance
from ..analysis.failure_cycles import SMOOTHED_S
from ..analysis.fatigue import LoadCycles
from ..analysis.metrics_window import metrics_window, tip_x_m, window_span_s
from ..analysis.series import Series, moving_mean
from ..analysis.spectra import Spectrum
from ..analysis.summarize import RunStatistics, compared_columns, failures_of
from ..analysis.summary import Summary
from ..loading.loader import ResolvedScene
from ..run_results import significance_words
from ..units import unit_of, words_of
from ..yaml_document import Document
from .plotting import COLOURS, CYCLE_BINS
from .run_figures import PART_COLOURS, reference_levels

LARGEST_SERIES_BYTES = 5e6
"""Size of all columns in the page. With plotly.js (4.8 MB) and pictures (5 MB), 9 of 24 MB are left for the
replay."""

NUMBER_BYTES = 4.0 * 4.0 / 3.0
"""Size of a float32 in base64."""

RESULTS, COLUMNS = "Results", "Columns of series.csv over time"

Figure = Document
"""A figure as plotly's JSON. Written directly: objects of plotly take seconds to check a hundred columns."""

_WINDOW = "#faf5e9"


@dataclass(frozen=True)
class RunData:
    """Data that the plots of a run are drawn from."""

    resolved: ResolvedScene
    series: Series
    statistics: RunStatistics
    summary: Summary

    @property
    def every(self) -> int:
        """Step between the rows of series.csv that the plots contain."""
        numbers = len(self.series) * len(self.series.columns)
        return math.ceil(numbers * NUMBER_BYTES / LARGEST_SERIES_BYTES)


def interactive_plots(run: RunData) -> list[Document]:
    """Every plot of a run: `group` and `name` to pick it by, and `figure` as plotly's JSON."""
    compared = [name for name in compared_columns(run.resolved.scene) if name in run.series]
    figures = [(RESULTS, title, figure) for title, figure in _results(run, compared)]
    figures += [(COLUMNS, name, _over_time(run, name)) for name in run.summary.series]
    return [{"group": group, "name": name, "figure": figure} for group, name, figure in figures]


def _results(run: RunData, compared: Sequence[str]) -> Iterator[tuple[str, Figure]]:
    found = run.statistics
    for name in compared:
        yield f"{_words(run, name)} over time", _over_time(run, name, compared=True)
    if tip_x_m(run.series, run.resolved.scene) is not None and run.resolved.scene.soil is not None:
        for name in compared:
            yield f"{_words(run, name)} over travel", _over_travel(run, name)
    for name, waves in found.spectra.items():
        yield f"Spectrum of {_words(run, name).lower()}", _spectrum(name, _words(run, name), waves)
    if found.cycles is not None and len(found.cycles.range_newton):
        yield "Load cycles of the spring", _load_cycles(found.cycles)
    if found.disturbance is not None:
        yield "Loosened section", _loosened(found.disturbance)
        yield "Lift of the surface", _lift(found.disturbance)


def _words(run: RunData, name: str) -> str:
    """Readable name of a compared column."""
    report = run.resolved.scene.report
    return {
        spring_element(report.spring).load: "Spring force",
        Body(report.shank).angle_rad: "Share angle",
        Body(report.shank).z_m: "Shank height",
    }.get(name, "Draft")


def _figure(traces: Sequence[Any], title: str, x: str, y: str) -> Figure:
    layout = {
        "hovermode": "x",
        "title": {"text": escape(title), "x": 0.0, "xref": "paper", "font": {"size": 15}},
        "font": {"size": 13},
        "margin": {"l": 80, "r": 20, "t": 60, "b": 100},
        "legend": {"orientation": "h", "y": -0.2},
        "xaxis": {"title": {"text": escape(x)}},
        "yaxis": {"title": {"text": escape(y)}, "exponentformat": "power"},
        "shapes": [],
        "annotations": [],
    }
    return {"data": list(traces), "layout": layout}


def _array(values: Any) -> dict[str, str]:
    """Numbers (n,) as plotly.js reads them, in float32."""
    return {"dtype": "f4", "bdata": base64.b64encode(np.asarray(values, "<f4").tobytes()).decode("ascii")}


def _upright(x: float, **line: Any) -> Document:
    """A line over the whole height of a figure."""
    return {"type": "line", "x0": x, "x1": x, "y0": 0, "y1": 1, "xref": "x", "yref": "y domain", "line": line}


def _line(x: Any, y: Any, name: str, **style: Any) -> Document:
    """A curve; even times travel as start and step, without an uneven last one."""
    line = {"width": 1.5, "color": COLOURS["main"]} | style
    places: Document = {"x": _array(x)}
    steps = np.diff(x)
    even = np.abs(steps - steps[:1]) < 1e-6 * steps[:1]
    if len(even) > 1 and even[:-1].all():
        places, y = {"x0": float(x[0]), "dx": float(steps[0])}, y[: len(y) - int(not even[-1])]
    return {"type": "scatter", **places, "y": _array(y), "mode": "lines", "name": escape(name), "line": line}


def _over_time(run: RunData, name: str, compared: bool = False) -> Figure:
    """A column over time with its mean; a compared one also smoothed, with its parts and its reference."""
    series, every, found = run.series, slice(None, None, run.every), run.summary.series[name]
    times = series[TIME][every]
    colour = "#8fb0d3" if compared else COLOURS["main"]
    traces = [_line(times, series[name][every], "as recorded", color=colour)]
    statistics = {"mean": found.mean, "min": found.min, "max": found.max}
    title = f"{_words(run, name) if compared else name}: " + ", ".join(
        f"{kind} {value:.6g}" for kind, value in statistics.items() if value is not None
    )
    if compared:
        parts = draft_parts(run.resolved.scene) if name == DRAFT else {}
        colours = {name: COLOURS["main"]} | {
            part: PART_COLOURS[part] for part in parts if part in PART_COLOURS
        }
        for part, colour in colours.items():
            if part not in series:
                continue
            words = f"{parts.get(part, _words(run, name).lower())}, mean over {SMOOTHED_S:g} s"
            traces.append(_line(times, moving_mean(series, part, SMOOTHED_S)[every], words, color=colour))
    figure = _figure(traces, f"{title} in the window", "simulated time [s]", words_of(name))
    window = metrics_window(series, run.resolved)
    start, end = window_span_s(series, window)
    shapes, notes = figure["layout"]["shapes"], figure["layout"]["annotations"]
    window_shape = {"type": "rect", "x0": start, "x1": end, "y0": 0, "y1": 1, "xref": "x", "yref": "y domain"}
    shapes.append({**window_shape, "fillcolor": _WINDOW, "line": {"width": 0}, "layer": "below"})
    if (mean := found.mean) is not None:
        dashed = {"dash": "dash", "width": 1}
        shapes.append({"type": "line", "x0": start, "x1": end, "y0": mean, "y1": mean, "line": dashed})
    if compared and run.resolved.reference is not None:
        across = {"type": "line", "x0": 0, "x1": 1, "xref": "x domain", "yref": "y"}
        label = {"text": escape(run.resolved.reference.name), "font": {"size": 10}, "showarrow": False}
        label |= {"x": 1, "xref": "x domain", "yref": "y", "xanchor": "right", "yanchor": "bottom"}
        for level in reference_levels(run.resolved.reference, name, series[name]):
            dotted = {"dash": "dot", "color": COLOURS["reference"]}
            shapes.append({**across, "y0": level, "y1": level, "line": dotted})
            notes.append({**label, "y": level})
    return figure


def _over_travel(run: RunData, name: str) -> Figure:
    """A column, smoothed, over the travel of the tip, with the failures of the soil."""
    series, scene = run.series, run.resolved.scene
    tip, values = tip_x_m(series, scene), moving_mean(series, name, SMOOTHED_S)
    assert tip is not None
    every = slice(None, None, run.every)
    traces = [_line(tip[every], values[every], f"mean over {SMOOTHED_S:g} s")]
    window = metrics_window(series, run.resolved)
    failures = failures_of(series, scene, window)
    if failures is not None:
        at = np.flatnonzero(window.rows)[failures.failures]
        marker = {"size": 9, "color": COLOURS["share"]}
        places = {"x": _array(tip[at]), "y": _array(values[at])}
        traces.append(
            {"type": "scatter", **places, "mode": "markers", "name": "failure of the soil", "marker": marker}
        )
    title = f"{_words(run, name)} over the travel of the tip"
    return _figure(traces, title, "travel of the tip, x [m]", words_of(name))


def _spectrum(name: str, words: str, found: Spectrum) -> Figure:
    x = found.frequency_hz[1:]
    traces = [
        _line(x, found.high[1:], "95 % (chi-square), high", width=0.5),
        _line(x, found.low[1:], "95 % (chi-square), low", width=0.5) | {"fill": "tonexty"},
        _line(x, found.density[1:], "density (Welch)"),
        _line(x, found.level[1:], "red noise, 95 % anywhere", color=COLOURS["reference"], dash="dash"),
    ]
    title = (
        f"Spectrum of {words.lower()}: strongest at {found.dominant_hz:.3g} Hz, {significance_words(found)}"
    )
    figure = _figure(traces, title, "frequency [Hz]", f"density [{unit_of(name)}²/Hz]")
    figure["layout"]["xaxis"]["type"] = figure["layout"]["yaxis"]["type"] = "log"
    return figure


def _load_cycles(cycles: LoadCycles) -> Figure:
    edges = np.linspace(0.0, cycles.max_range_newton, CYCLE_BINS + 1)
    counts, _ = np.histogram(cycles.range_newton, edges, weights=cycles.count)
    places = {"x": _array(0.5 * (edges[1:] + edges[:-1])), "y": _array(counts)}
    bars = {"type": "bar", **places, "marker": {"color": COLOURS["main"]}}
    equivalent = cycles.equivalent_range_newton()
    title = f"Load cycles of the spring (rainflow): as harmful as {equivalent:.0f} N once a second"
    figure = _figure([bars], title, "range of the spring force [N]", "cycles")
    figure["layout"]["yaxis"]["type"] = "log"
    figure["layout"]["shapes"].append(_upright(equivalent, color=COLOURS["share"]))
    return figure


def _loosened(found: Disturbance) -> Figure:
    corner = {"x0": found.origin_m[0] + 0.5 * found.cell_m, "y0": found.origin_m[1] + 0.5 * found.cell_m}
    bar = {"title": "moved part"}
    moved = np.asarray(found.moved_map, np.float32)
    steps = {"dx": found.cell_m, "dy": found.cell_m}
    image = go.Heatmap(z=moved, **corner, **steps, zmin=0, zmax=1, colorscale="Viridis", colorbar=bar)
    title = (
        f"Loosened section: {1e4 * found.area_m2:.0f} cm², {1e3 * found.surface_width_m:.0f} mm wide on top"
    )
    return _map(image, title, "across travel, y [m]", "height before [m]")


def _lift(found: Disturbance) -> Figure:
    x, y = found.lift.centres_m()
    lift_mm = np.asarray(1e3 * found.lift.height_m, np.float32)
    bar = {"title": "lift [mm]"}
    image = go.Heatmap(x=x, y=y, z=lift_mm, zmid=0, colorscale="RdBu", reversescale=True, colorbar=bar)
    title = f"Lift of the surface behind the tool: {1e3 * found.max_lift_m:.0f} mm at the highest particle"
    return _map(image, title, "along travel, x [m]", "across travel, y [m]")


def _map(image: go.Heatmap, title: str, x: str, y: str) -> Figure:
    """A picture of two lengths to one scale."""
    figure = _figure(go.Figure([image]).to_dict()["data"], title, x, y)
    figure["layout"]["yaxis"]["scaleanchor"] = "x"
    figure["layout"]["hovermode"] = "closest"
    return figure
