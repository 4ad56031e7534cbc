"""The metrics of a run: summary.json, and the printed table."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..loading.loader import ResolvedScene
from ..loading.reference import Reference
from ..messages import Command, Grant, LostParticle, SoilState
from ..recording.bag_reader import BagReader
from ..recording.joined import open_record
from ..scene.model import Scene
from ..ticks import tick_end_s
from .columns import (
    COUPLING,
    DRAFT,
    DRAFT_OF_SHARES,
    DRAFT_OF_WHEELS,
    SOIL,
    TIME,
    Body,
    draft_of_tool,
    spring_element,
)
from .quantities import finite
from .reference_table import print_reference
from .run_statistics import RunStatistics, run_statistics
from .series import Series, read_series
from .summary_words import load_lines
from .window import metrics_window, window_span_s

Summary = dict[str, Any]

SCHEMA_VERSION = 2
"""Version of config/summary.schema.json; raised when a quantity moves or changes its meaning."""

RUN_FACTS = (
    "mode", "threads", "whole_wall_s", "versions", "failure", "resumed_from", "checkpoint", "state_sha256",
    "stop_when",
)  # fmt: skip
"""Keys of `run` that are not in a bag; a later report copies them from the earlier summary."""


def summarize(
    bag: Path,
    resolved: ResolvedScene,
    run_info: Mapping[str, Any],
    series: Series | None = None,
    statistics: RunStatistics | None = None,
) -> Summary:
    """Metrics of a finished run, as summary.json holds them (config/summary.schema.json).

    run_info: facts that are not in the bag, copied into `run`: keys of RUN_FACTS.
    series, statistics: of the bag, if they are known already.

    Raises:
        InputError, RecordingError: as read_series.
    """
    scene, timing = resolved.scene, resolved.timing
    series = series if series is not None else read_series(bag, scene)
    window = metrics_window(series, scene)
    statistics = statistics if statistics is not None else run_statistics(bag, resolved, series, window)
    start_s, end_s = window_span_s(series, window)
    simulated_s = float(series[TIME][-1])
    tick_count = round(simulated_s / timing.communication_step_s)
    wall_s = series.wall_time_s  # of the ticks alone: without start-up and compilation
    columns = statistics.column_metrics()
    return finite(
        {
            **_heading(resolved),
            "run": {
                "id": series.run_id,
                **run_info,
                "recorded": True,
                "complete": tick_count == timing.tick_count or _ended_early(bag, scene),
                "simulated_s": simulated_s,
                "ticks": tick_count,
                "steps": tick_count * (timing.soil_steps or timing.mechanism_steps),
                "wall_s": wall_s,
                "real_time_factor": simulated_s / wall_s if wall_s > 0.0 else 0.0,
            },
            "particles": _particles(series, bag, timing.communication_step_ns),
            "energy": {
                "residual_joule": float(series[COUPLING.residual_joule][-1]),
                "residual_ratio": float(series[COUPLING.residual_ratio][-1]),
            },
            "window": {
                "rule": window.rule,
                "whole_run": window.whole_run,
                "start_s": start_s,
                "end_s": end_s,
                "rows": int(window.rows.sum()),
            },
            "series": {
                name: _of_column(values, window.rows, columns.get(name, {}))
                for name, values in series.columns.items()
                if name != TIME
            },
            **statistics.metrics(),
        }
    )


def _ended_early(bag: Path, scene: Scene) -> bool:
    """Whether a run with stop_when has its END, which the last grant of the record carries."""
    if scene.stop_when is None:
        return False
    end_ns = BagReader(bag).end_time_ns
    grants = BagReader(bag).records(Grant, at=lambda time_ns: time_ns == end_ns)
    return any(grant.command is Command.END for grant in grants)


def summarize_unrecorded(resolved: ResolvedScene, run_info: Mapping[str, Any]) -> Summary:
    """Summary of a run without a bag: what is known without its record."""
    run = {**run_info, "recorded": False, "complete": "failure" not in run_info}
    return finite({**_heading(resolved), "run": run})


def _heading(resolved: ResolvedScene) -> Summary:
    scene = resolved.scene
    return {
        "schema_version": SCHEMA_VERSION,
        "scene": {
            "name": scene.name,
            "hash": resolved.scene_hash,
            "allow": list(scene.allow),
            "note": scene.report.note,
        },
    }


def run_facts(summary: Mapping[str, Any]) -> Summary:
    """The part of a summary's `run` that no bag holds."""
    run = summary.get("run", {})
    return {key: run[key] for key in RUN_FACTS if key in run}


def write_summary(summary: Summary, path: Path) -> None:
    """Write summary.json; numbers with all their digits."""
    path.write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def print_summary(
    summary: Summary,
    scene: Scene,
    directory: Path,
    console: Console | None = None,
    bag: Path | None = None,
    reference: Reference | None = None,
) -> None:
    """The printed tables: metrics, the values of a reference beside them, and where all is.

    bag: folder or .mcap file (default: `bag` in `directory`).
    """
    console = console or Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    headings, rows = metrics_table(summary, scene)
    table = Table(
        title=f"{scene.name}: {summary['run']['simulated_s']:.4g} s simulated", title_justify="left"
    )
    for heading in headings:
        words = heading == "quantity"
        table.add_column(heading, justify="left" if words else "right", no_wrap=words)
    for row in rows:
        table.add_row(escape(row[0]), *row[1:])
    if table.row_count:
        console.print(table)
    if reference is not None:
        print_reference(reference, summary, console)
    for line in summary_facts(summary):
        console.print(line, soft_wrap=True, markup=False)
    console.print(_bag_words(bag or directory / "bag"), soft_wrap=True, markup=False)
    figures = directory / "figures"
    if figures.is_dir():
        console.print(f"figures: {figures}", soft_wrap=True, markup=False)
    else:
        console.print(
            f"figures: none yet, `subsoil report {directory}` draws them", soft_wrap=True, markup=False
        )


def metrics_table(summary: Summary, scene: Scene) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the metrics, as text."""
    headings = ["quantity", "mean", "min", "max", "range", "run min", "run max"]
    rows = []
    for label, name, scale, digits in _lines(scene, summary):
        found = summary["series"][name]
        low, high = found["min"], found["max"]
        spread = None if low is None or high is None else high - low
        values = [found["mean"], low, high, spread, found["run"]["min"], found["run"]["max"]]
        rows.append([label, *("" if value is None else f"{value * scale:.{digits}f}" for value in values)])
    return headings, rows


def _bag_words(bag: Path) -> str:
    files = [bag] if bag.is_file() else bag.glob("*.mcap")
    size_bytes = sum(path.stat().st_size for path in files)
    return f"bag: {bag}, {size_bytes / 1e6:.3g} MB (`subsoil bag info {bag}` says what takes the room)"


def _particles(series: Series, bag: Path, communication_step_ns: int) -> Summary:
    """Numbers of particles present and lost; the first row with a lost one, and their identities."""
    if SOIL.lost_particle_count not in series:
        return {"count": 0, "lost_count": 0, "first_lost_s": None, "first_lost": []}
    lost = series[SOIL.lost_particle_count]
    first = float(series[TIME][np.argmax(lost > 0)]) if lost[-1] > 0 else None
    named: tuple[LostParticle, ...] = ()
    if first is not None:
        last_ns = round(1e9 * float(series[TIME][-1]))
        for state in open_record(bag).records(SoilState, at=lambda time_ns: time_ns == last_ns):
            named = state.lost_particles
    return {
        "count": int(series[SOIL.particle_count][-1]),
        "lost_count": int(lost[-1]),
        "first_lost_s": first,
        "first_lost": [
            {
                "identity": item.identity,
                "position_m": [item.x_m, item.y_m, item.z_m],
                "time_s": tick_end_s(item.tick, communication_step_ns),
            }
            for item in named
        ],
    }


def _of_column(values: np.ndarray, rows: np.ndarray, more: Summary) -> Summary:
    """Statistics of a column (n,) over the window, `rows`, and under `run` over all of it."""
    run = {**_statistics(values), **more.get("run", {})}
    return {**_statistics(values[rows]), **more, "run": run}


def _statistics(values: np.ndarray) -> Summary:
    return {
        "mean": float(np.mean(values)),
        "min": values.min().item(),
        "max": values.max().item(),
        "std": float(np.std(values)),
    }


def _lines(scene: Scene, summary: Summary) -> list[tuple[str, str, float, int]]:
    """(label, column, scale, digits) of each row of the table whose column the run has."""
    shank, spring = scene.report.shank, scene.report.spring
    lines: list[tuple[str, str, float, int]] = [
        ("draft [N]", DRAFT, 1.0, 1),
        ("  of it share [N]", DRAFT_OF_SHARES, 1.0, 1),
        *((f"    of it {tool} [N]", draft_of_tool(tool), 1.0, 1) for tool in scene.tools),
        ("  of it wheels [N]", DRAFT_OF_WHEELS, 1.0, 1),
        ("spring force, compression + [N]", spring_element(spring).load, 1.0, 1),
        ("share angle [rad]", Body(shank).angle_rad, 1.0, 4),
        ("shank centre of mass, height [mm]", Body(shank).z_m, 1e3, 2),
    ]
    return [line for line in lines if line[1] in summary["series"]]


def mean_words(result: Mapping[str, Any]) -> str:
    """What a check of stop_when found, in a few words."""
    mean, half_width = result["mean"], result["half_width"]
    if mean is None or half_width is None:
        return f"{result['metric']}: {result['verdict']}"
    interval = f"+- {100.0 * half_width / abs(mean):.3g} %" if mean else f"+- {half_width:.4g}"
    return f"{result['metric']} {mean:.5g} {interval}, {result['verdict']}"


def stop_words(result: Mapping[str, Any]) -> str:
    """Whether a run with stop_when has reached it, as a line."""
    wanted = f"{100.0 * result['relative_interval']:g} % at a confidence of {result['confidence']:g}"
    word = "reached" if result["reached"] else "WARNING: not reached"
    return (
        f"stop_when: {word} after {result['travel_m']:.4g} m of travel: {mean_words(result)}; asked for are "
        f"{wanted} and no drift seen"
    )


def _soil_words(summary: Summary) -> str:
    count = summary["particles"]["count"]
    return f"{count} particles" if count else "no particles"


def _mechanism_lines(summary: Summary) -> list[str]:
    """Residual of the machine's energy balance, and the number of parts of steps."""
    series = summary["series"]
    residual = series.get("mechanism.energy_residual_joule", {}).get("run", {})
    if residual.get("min") is None:
        return []
    largest = max(abs(residual["min"]), abs(residual["max"]))
    count = series["mechanism.part_count"]["run"]["max"]
    parts = f"; {count} parts of steps, for mechanism.tolerance" if count else ""
    return [f"mechanism: balance of energy open by {largest:.3g} J at most{parts}"]


def summary_facts(summary: Summary) -> list[str]:
    """Notes on a run, line by line; a warning begins with WARNING or NOTE."""
    window, run, energy = summary["window"], summary["run"], summary["energy"]
    if window["whole_run"]:
        span = f"the whole run, because no row of it lies in the window ({window['rule']})"
    else:
        span = f"{window['start_s']:.4g} to {window['end_s']:.4g} s ({window['rule']})"
    whole = f" ({run['whole_wall_s']:.1f} s with start-up)" if "whole_wall_s" in run else ""
    lines = [
        f"mean, min, max, range: {span}; run min, run max: everything recorded",
        f"{_soil_words(summary)}, {run['steps']} steps, {run['wall_s']:.1f} s wall "
        f"time{whole}, real-time factor {run['real_time_factor']:.3g}",
        f"interface energy residual {energy['residual_joule']:.3g} J, "
        f"{100.0 * energy['residual_ratio']:.3g} % of the work done there",
    ]
    lines += _mechanism_lines(summary)
    lines += load_lines(summary)
    particles = summary["particles"]
    if particles["lost_count"]:
        named = "; ".join(
            f"particle {lost['identity']} at ({', '.join(f'{x:.3f}' for x in lost['position_m'])}) m, "
            f"{lost['time_s']:.4g} s"
            for lost in particles["first_lost"]
        )
        lines.append(
            f"WARNING: {particles['lost_count']} particles left the domain, the first before "
            f"{particles['first_lost_s']:.4g} s{f': {named}' if named else ''}"
        )
    if run.get("resumed_from"):
        lines.append(f"went on from {run['resumed_from']['checkpoint']}, whose record is in these numbers")
    if run.get("checkpoint"):
        newest = run["checkpoint"]
        lines.append(
            f"newest checkpoint: {newest['path']}, at {newest['time_s']:.6g} s, "
            f"{newest['size_bytes'] / 1e6:.3g} MB, written in {newest['write_s']:.2g} s"
        )
    if run.get("stop_when"):
        lines.append(stop_words(run["stop_when"]))
    if not run["complete"]:
        lines.append("The run ended before its last tick.")
    scene = summary["scene"]
    if scene["allow"]:
        lines.append(f"WARNING: the scene overrides refusals, allow: {', '.join(scene['allow'])}")
    if scene["note"]:
        lines.append(f"NOTE: {scene['note']}")
    return lines
