"""The metrics of a run: summary.json, and the printed table."""

import json
import math
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
from ..scene.model import Scene
from .reference_table import print_reference
from .run_statistics import RunStatistics, run_statistics
from .series import Series, read_series
from .summary_words import load_lines
from .window import metrics_window, window_span_s

Summary = dict[str, Any]

RUN_FACTS = (
    "mode", "threads", "whole_wall_s", "versions", "failure", "resumed_from", "checkpoint", "state_sha256",
)  # fmt: skip
"""What a summary has from the run itself, and a later report takes over."""


def summarize(
    bag: Path,
    resolved: ResolvedScene,
    run_info: Mapping[str, Any],
    series: Series | None = None,
    statistics: RunStatistics | None = None,
) -> Summary:
    """Metrics of a finished run, as summary.json holds them.

    NAME_mean, NAME_min, NAME_max of every column of the series over the metrics window, run.NAME_... over
    the whole run, what was found out about loads and soil (RunStatistics.metrics), and what the run was.

    run_info: what only the one who ran it knows, taken over as it is: keys of RUN_FACTS.
    series, statistics: of the bag, if they are known already.

    Raises:
        InputError, RecordingError: as read_series.
    """
    scene, timing = resolved.scene, resolved.timing
    series = series if series is not None else read_series(bag, scene)
    window = metrics_window(series, scene)
    statistics = statistics if statistics is not None else run_statistics(bag, resolved, series, window)
    start_s, end_s = window_span_s(series, window)
    simulated_s = float(series["time_s"][-1])
    tick_count = round(simulated_s / timing.communication_step_s)
    wall_s = series.wall_time_s  # of the ticks alone: without start-up and compilation
    summary: Summary = {
        "scene": scene.name,
        "scene_hash": resolved.scene_hash,
        "run_id": series.run_id,
        **run_info,
        "allow": list(scene.allow),
        "note": scene.report.note,
        "simulated_s": simulated_s,
        "complete": tick_count == timing.tick_count,
        "wall_s": wall_s,
        "real_time_factor": simulated_s / wall_s if wall_s > 0.0 else 0.0,
        "ticks": tick_count,
        "steps": tick_count * (timing.soil_steps or timing.mechanism_steps),
        "particle_count": int(series["soil.particle_count"][-1]) if "soil.particle_count" in series else 0,
        **_losses(series),
        "interface_residual_joule": float(series["coupling.residual_joule"][-1]),
        "interface_residual_ratio": float(series["coupling.residual_ratio"][-1]),
        "window": {
            "rule": window.rule,
            "whole_run": window.whole_run,
            "start_s": start_s,
            "end_s": end_s,
            "rows": int(window.rows.sum()),
        },
    }
    names = [name for name in series.columns if name != "time_s"]
    for name in names:
        summary.update(_statistics(name, series[name][window.rows]))
    for name in names:
        summary.update(_statistics(f"run.{name}", series[name]))
    summary.update(statistics.metrics())
    return summary


def summarize_unrecorded(resolved: ResolvedScene, run_info: Mapping[str, Any]) -> Summary:
    """What is known of a run without a bag."""
    return {
        "scene": resolved.scene.name,
        "scene_hash": resolved.scene_hash,
        **run_info,
        "allow": list(resolved.scene.allow),
        "note": resolved.scene.report.note,
        "recorded": False,
        "complete": "failure" not in run_info,
    }


def run_facts(document: Mapping[str, Any]) -> Summary:
    """The part of a summary, or of a run_info, that no bag tells."""
    return {key: document[key] for key in RUN_FACTS if key in document}


def write_summary(summary: Summary, path: Path) -> None:
    """summary.json; numbers with all their digits, null for what is not finite."""
    finite = {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in summary.items()
    }
    path.write_text(json.dumps(finite, indent=1, allow_nan=False) + "\n", encoding="utf-8")


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
    table = Table(title=f"{summary['scene']}: {summary['simulated_s']:.4g} s simulated", title_justify="left")
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
        cells = [_cell(summary, f"{name}_{key}", scale, digits) for key in ("mean", "min", "max")]
        low, high = summary[f"{name}_min"], summary[f"{name}_max"]
        cells.append(f"{(high - low) * scale:.{digits}f}")
        cells += [_cell(summary, f"run.{name}_{key}", scale, digits) for key in ("min", "max")]
        rows.append([label, *cells])
    return headings, rows


def _bag_words(bag: Path) -> str:
    files = [bag] if bag.is_file() else bag.glob("*.mcap")
    size_bytes = sum(path.stat().st_size for path in files)
    return f"bag: {bag}, {size_bytes / 1e6:.3g} MB (`subsoil bag info {bag}` says what takes the room)"


def _losses(series: Series) -> Summary:
    """How many particles left the domain, and the time of the first row that counts one."""
    if "soil.lost_particle_count" not in series:
        return {"lost_particle_count": 0, "first_lost_s": None}
    count = series["soil.lost_particle_count"]
    first = float(series["time_s"][np.argmax(count > 0)]) if count[-1] > 0 else None
    return {"lost_particle_count": int(count[-1]), "first_lost_s": first}


def _statistics(name: str, values: np.ndarray) -> Summary:
    return {
        f"{name}_mean": float(np.mean(values)),
        f"{name}_min": values.min().item(),
        f"{name}_max": values.max().item(),
    }


def _cell(summary: Summary, key: str, scale: float, digits: int) -> str:
    return f"{summary[key] * scale:.{digits}f}"


def _lines(scene: Scene, summary: Summary) -> list[tuple[str, str, float, int]]:
    """(label, column, scale, digits) of the table, without what the run does not have."""
    shank, spring = scene.report.shank, scene.report.spring
    lines: list[tuple[str, str, float, int]] = [
        ("draft [N]", "draft_newton", 1.0, 1),
        ("  of it share [N]", "draft.share_newton", 1.0, 1),
        *((f"    of it {tool} [N]", f"draft.tool.{tool}_newton", 1.0, 1) for tool in scene.tools),
        ("  of it wheels [N]", "draft.wheels_newton", 1.0, 1),
        ("spring force, compression + [N]", f"spring.{spring}.force_newton", 1.0, 1),
        ("share angle [rad]", f"body.{shank}.angle_rad", 1.0, 4),
        ("shank centre of mass, height [mm]", f"body.{shank}.z_m", 1e3, 2),
    ]
    return [line for line in lines if f"{line[1]}_mean" in summary]


def _soil_words(summary: Summary) -> str:
    count = summary["particle_count"]
    return f"{count} particles" if count else "no particles"


def summary_facts(summary: Summary) -> list[str]:
    """What else is to be said of a run, line by line; a warning begins with WARNING or NOTE."""
    window = summary["window"]
    if window["whole_run"]:
        span = f"the whole run, because no row of it lies in the window ({window['rule']})"
    else:
        span = f"{window['start_s']:.4g} to {window['end_s']:.4g} s ({window['rule']})"
    whole = f" ({summary['whole_wall_s']:.1f} s with start-up)" if "whole_wall_s" in summary else ""
    lines = [
        f"mean, min, max, range: {span}; run min, run max: everything recorded",
        f"{_soil_words(summary)}, {summary['steps']} steps, {summary['wall_s']:.1f} s wall "
        f"time{whole}, real-time factor {summary['real_time_factor']:.3g}",
        f"interface energy residual {summary['interface_residual_joule']:.3g} J, "
        f"{100.0 * summary['interface_residual_ratio']:.3g} % of the work done there",
    ]
    lines += load_lines(summary)
    if summary["lost_particle_count"]:
        lines.append(
            f"WARNING: {summary['lost_particle_count']} particles left the domain, the first before "
            f"{summary['first_lost_s']:.4g} s; which ones, the soil's log says"
        )
    if summary.get("resumed_from"):
        lines.append(
            f"went on from {summary['resumed_from']['checkpoint']}, whose record is in these numbers"
        )
    if summary.get("checkpoint"):
        newest = summary["checkpoint"]
        lines.append(
            f"newest checkpoint: {newest['path']}, at {newest['time_s']:.6g} s, "
            f"{newest['size_bytes'] / 1e6:.3g} MB, written in {newest['write_s']:.2g} s"
        )
    if not summary["complete"]:
        lines.append("The run ended before its last tick.")
    if summary["allow"]:
        lines.append(f"WARNING: the scene overrides refusals, allow: {', '.join(summary['allow'])}")
    if summary["note"]:
        lines.append(f"NOTE: {summary['note']}")
    return lines
