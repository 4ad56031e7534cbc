"""A run as one web page that needs nothing else: table, figures, scene, versions, timings, warnings."""

import base64
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ..analysis.reference_table import HEADINGS, WORDS, reference_lines, reference_rows
from ..analysis.summary import Summary, metrics_table, summary_facts
from ..analysis.versions import versions
from ..loading.loader import ResolvedScene

LARGEST_LOG_LINES = 20
"""Warnings of the nodes' logs that are shown; the rest is counted."""

CAPTIONS = {
    "draft": "Draft over time",
    "spring_force": "Force of the spring over time",
    "share_angle": "Entry angle of the share over time",
    "shank_height": "Height of the shank over time",
    "over_travel": "Draft, spring force and share angle over the travel of the tip",
    "soil_cut": "Cut through the soil along the mid-plane of the bin",
}

_TROUBLE = re.compile(r"\[(WARN|ERROR|FATAL)\]|^warning:", re.IGNORECASE)
_WARNING = re.compile(r"(?:WARNING|NOTE): ")


def write_html(directory: Path, resolved: ResolvedScene, summary: Summary, figures: Sequence[Path]) -> Path:
    """Writes report.html of the run in `directory`, its figures inside the page; returns its path.

    Raises:
        OSError: it cannot be written; an older one is left as it was.
    """
    headings, rows = metrics_table(summary, resolved.scene)
    facts = summary_facts(summary)
    reference = resolved.reference
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = environment.get_template("report.html.jinja").render(
        name=resolved.scene.name,
        description=resolved.scene.description,
        headings=headings,
        rows=rows,
        facts=[line for line in facts if not _WARNING.match(line)],
        reference=reference,
        reference_headings=HEADINGS,
        reference_words=WORDS,
        reference_rows=[] if reference is None else [r.cells() for r in reference_rows(reference, summary)],
        reference_lines=[] if reference is None else reference_lines(reference, summary),
        warnings=_warnings(directory, resolved, summary, facts),
        figures=[_figure(path) for path in figures],
        timings=_timings(summary),
        versions=summary["run"].get("versions") or versions(),
        versions_of="the run"
        if summary["run"].get("versions")
        else "this report (the run did not record its own)",
        quantities=_quantities(summary),
        scene_text=resolved.path.read_text(encoding="utf-8"),
        scene_hash=resolved.scene_hash,
        run_id=summary["run"]["id"],
    )
    path = directory / "report.html"
    part = directory / "report.html.part"
    part.write_text(text, encoding="utf-8")
    part.replace(path)
    return path


def _figure(path: Path) -> dict[str, str]:
    caption = CAPTIONS.get(path.stem, path.stem.replace("_", " ").capitalize())
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return {"caption": caption, "source": f"data:image/png;base64,{data}"}


def _warnings(directory: Path, resolved: ResolvedScene, summary: Summary, facts: Sequence[str]) -> list[str]:
    """All that a reader must know before he trusts the numbers."""
    found = [_WARNING.sub("", line, count=1) for line in facts if _WARNING.match(line)]
    found += [note.removeprefix("warning: ") for note in resolved.notes]
    if not summary["run"]["complete"]:
        found.append("The run ended before its last tick: all numbers are of the part that was simulated.")
    if summary["run"].get("failure"):
        found.append(f"The run failed: {summary['run']['failure']}")
    logged = [
        f"{path.stem}: {line.strip()}"
        for path in sorted((directory / "log").glob("*.log"))
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines()
        if _TROUBLE.search(line)
    ]
    found += logged[:LARGEST_LOG_LINES]
    if len(logged) > LARGEST_LOG_LINES:
        found.append(f"and {len(logged) - LARGEST_LOG_LINES} more lines in {directory.name}/log")
    return found


def _timings(summary: Summary) -> list[tuple[str, str]]:
    run = summary["run"]
    rows = [
        ("simulated", f"{run['simulated_s']:.6g} s"),
        ("ticks", f"{run['ticks']:,}"),
        ("steps", f"{run['steps']:,}"),
        ("particles", f"{summary['particles']['count']:,}"),
        ("wall time of the ticks", f"{run['wall_s']:.4g} s"),
        ("real-time factor", f"{run['real_time_factor']:.4g}"),
    ]
    for label, key, unit in (
        ("wall time with start-up", "whole_wall_s", " s"),
        ("mode", "mode", ""),
        ("threads of the soil engine", "threads", ""),
    ):
        if key in run:
            value = run[key]
            rows.append((label, f"{value:.4g}{unit}" if isinstance(value, float) else f"{value}{unit}"))
    return rows


def _quantities(summary: Summary) -> list[tuple[str, list[str]]]:
    """Every column of the series: mean, least and largest in the window, and of the whole run."""
    return [
        (name, [_number(part[kind]) for part in (found, found["run"]) for kind in ("mean", "min", "max")])
        for name, found in summary["series"].items()
    ]


def _number(value: Any) -> str:
    return "" if value is None else f"{value:.6g}"
