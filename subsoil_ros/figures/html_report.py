"""A run as one self-contained web page: warnings, results, interactive plots, replay, tables."""

import base64
import re
from collections.abc import Sequence
from pathlib import Path

from plotly.offline import get_plotlyjs

from ..analysis.summarize import versions
from ..analysis.summary import Number, Summary
from ..errors import RecordingError
from ..loading.loader import ResolvedScene
from ..run_results import (
    HEADINGS,
    WORDS,
    heading_rows,
    reference_lines,
    reference_rows,
    results_of,
    summary_facts,
)
from .interactive_plots import RunData, interactive_plots
from .plotting import page_template
from .replay import replay
from .snapshots import Snapshots

LARGEST_LOG_LINES = 20
"""Number of warnings of the nodes' logs that are shown; the rest is counted."""

LARGEST_BYTES = 24_000_000
"""Largest size of the page: mail servers accept attachments of 25 MB."""

LARGEST_PICTURES_BYTES = 5_000_000
"""Largest size of the pictures in the page, in base64; the others stay in their folder."""

CAPTIONS = {"tool": "Tool", "soil_cut": "Cut through the soil along the mid-plane of the bin"}

_TROUBLE = re.compile(r"\[(WARN|ERROR|FATAL)\]|^warning:", re.IGNORECASE)
_WARNING = re.compile(r"(?:WARNING|NOTE): ")


def write_html(directory: Path, bag: Path, run: RunData, pictures: Sequence[Path]) -> Path:
    """Write report.html of the run in `directory`, with the pictures inside; return its path.

    Raises:
        OSError: it cannot be written; an older one is left as it was.
    """
    resolved, summary = run.resolved, run.summary
    facts = summary_facts(summary)
    reference, document = resolved.reference, summary.document()
    template = page_template("report.html.jinja")
    figures, left_out = _figures(pictures)
    content = {
        "name": resolved.scene.name,
        "description": resolved.scene.description,
        "heading": heading_rows(summary, resolved),
        "results": [result.cells() for result in results_of(summary, resolved)],
        "facts": [line for line in facts if not _WARNING.match(line)],
        "reference": reference,
        "reference_headings": HEADINGS,
        "reference_words": WORDS,
        "reference_rows": [row.cells() for row in reference_rows(reference, document)] if reference else [],
        "reference_lines": reference_lines(reference, document) if reference else [],
        "warnings": _warnings(directory, resolved, summary, facts),
        "plotlyjs": get_plotlyjs(),
        "plots": interactive_plots(run),
        "every": run.every,
        "row_count": len(run.series),
        "figures": figures,
        "left_out": left_out,
        "timings": _timings(summary),
        "versions": summary.run.versions or versions(),
        "versions_of": "the run" if summary.run.versions else "this report (the run did not record its own)",
        "quantities": _quantities(summary),
        "scene_text": resolved.path.read_text(encoding="utf-8"),
        "scene_hash": resolved.scene_hash,
        "run_id": summary.run.id,
        "replay": None,
        "replay_words": "",
    }
    room = LARGEST_BYTES - len(template.render(content).encode())
    try:
        figure, content["replay_words"] = replay(Snapshots(bag, resolved), resolved, room)
        content["replay"] = figure.to_dict()
    except RecordingError as error:
        content["replay_words"] = f"No replay: {error}."
    text = template.render(content)
    path = directory / "report.html"
    part = directory / "report.html.part"
    part.write_text(text, encoding="utf-8")
    part.replace(path)
    return path


def _figures(pictures: Sequence[Path]) -> tuple[list[dict[str, str]], int]:
    """Caption and data URI of the first pictures that fit in the page, and the number of the others."""
    found: list[dict[str, str]] = []
    room = LARGEST_PICTURES_BYTES
    for path in pictures:
        data = base64.b64encode(path.read_bytes()).decode("ascii")
        room -= len(data)
        if room < 0:
            break
        caption = CAPTIONS.get(path.stem, path.stem.replace("_", " ").capitalize())
        found.append({"caption": caption, "source": f"data:image/png;base64,{data}"})
    return found, len(pictures) - len(found)


def _warnings(directory: Path, resolved: ResolvedScene, summary: Summary, facts: Sequence[str]) -> list[str]:
    """Warnings that a reader needs to judge the numbers."""
    found = [_WARNING.sub("", line, count=1) for line in facts if _WARNING.match(line)]
    found += [note.removeprefix("warning: ") for note in resolved.notes]
    if not summary.run.complete:
        found.append("The run ended before its last tick: all numbers are of the part that was simulated.")
    if summary.run.failure:
        found.append(f"The run failed: {summary.run.failure}")
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
    run = summary.run
    rows = [
        ("simulated", f"{run.simulated_s:.6g} s"),
        ("ticks", f"{run.ticks:,}"),
        ("steps", f"{run.steps:,}"),
        ("particles", f"{summary.particles.count:,}"),
        ("wall time of the ticks", f"{run.wall_s:.4g} s"),
        ("real-time factor", f"{run.real_time_factor:.4g}"),
    ]
    if run.whole_wall_s is not None:
        rows.append(("wall time with start-up", f"{run.whole_wall_s:.4g} s"))
    rows += [("mode", run.mode)] if run.mode is not None else []
    rows += [("threads of the soil engine", str(run.threads))] if run.threads is not None else []
    return rows


def _quantities(summary: Summary) -> list[tuple[str, list[str]]]:
    """Every column of the series: mean, least and largest in the window, and of the whole run."""
    return [
        (name, [_number(value) for part in (found, found.run) for value in (part.mean, part.min, part.max)])
        for name, found in summary.series.items()
    ]


def _number(value: Number) -> str:
    return "" if value is None else f"{value:.6g}"
