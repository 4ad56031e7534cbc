"""subsoil compare A B: runs beside each other, and beside measured values."""

import argparse
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..extras import require
from .output import print_line, stdout_console, table

if TYPE_CHECKING:
    from ..figures.comparison import Difference, Source


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs",
        nargs="+",
        type=Path,
        metavar="RUN",
        help="folders of runs; the first is the one compared with",
    )
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="FILE",
        help="CSV with time_s and columns named as in series.csv, such as draft_newton",
    )
    parser.add_argument(
        "--show",
        action="append",
        default=[],
        metavar="COLUMN",
        help="columns to compare (default: draft, spring force, angle and height of the shank, and what was "
        "measured)",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for figure and table; must not exist"
    )


def run(args: argparse.Namespace) -> int:
    """Write comparison.csv and comparison.png, and print the table."""
    require("drawing", "matplotlib")
    from ..figures.comparison import (
        differences,
        draw_overlay,
        labels_of,
        read_measured,
        read_run,
        usual_columns,
        write_differences_csv,
    )
    from .progress import working

    if len(args.runs) < 2 and args.measured is None:
        raise InputError(f"{args.runs[0]}: is one run; name a second one, or a measurement by --measured")
    if args.out.exists():
        raise InputError(f"--out {args.out}: exists already; results are never written over, name another")
    with working("reading the series"):
        sources = [read_run(*item) for item in zip(args.runs, labels_of(args.runs), strict=True)]
        if args.measured is not None:
            sources.append(read_measured(args.measured, sources))
        columns = args.show or usual_columns(args.runs, sources)
        _refuse_unknown(columns, sources)
        found = differences(sources, columns)
    try:
        args.out.mkdir(parents=True)
        write_differences_csv(found, sources, args.out / "comparison.csv")
        with working("drawing the curves"):
            draw_overlay(sources, columns, args.out / "comparison.png")
    except OSError as error:
        raise InputError(f"--out {args.out}: cannot be written ({error.strerror}); name another") from error
    _print(found, sources, args.out)
    return 0


def _refuse_unknown(columns: Sequence[str], sources: "Sequence[Source]") -> None:
    known = list(dict.fromkeys(name for source in sources for name in source.columns))
    for name in columns:
        if name not in known:
            from ..loading.validation import suggestion

            raise InputError(f"--show {name}: no such column in any of them; {suggestion(name, known)}")
    if not columns:
        raise InputError("--show: the runs share none of the usual columns; name the ones to compare")


def _print(found: "list[Difference]", sources: "list[Source]", out: Path) -> None:
    from ..figures.comparison import APART, SHARED, shared_span_s

    console = stdout_console()
    low, high = sources[0].span_s
    title = f"runs over their metrics windows; {sources[0].label}: {low:.4g} to {high:.4g} s"
    shared = {item.column: _span(shared_span_s(sources, item.column)) for item in found}
    alike = len(set(shared.values())) == 1
    title += f"; {next(iter(shared.values()))}" if alike else "; shared times by column: below"
    labels = [source.label for source in sources]
    headings = ("quantity", "", *labels, *(f"{label} - first" for label in labels[1:]))
    rows = table(title, headings, words=2)
    for item in found:
        rms = item.statistic == APART
        cells = ["" if rms and not k else _number(value) for k, value in enumerate(item.values)]
        for place in range(1, len(sources)):
            difference, part = item.against_first(place)
            change = f"{_number(difference)} ({_percent(part)})"
            if item.half_widths and not math.isnan(difference):
                width, of_part = item.half_widths[place], item.part_half_widths[place]
                change = f"{_number(difference)} +- {width:.4g} ({_percent(part, of_part)})"
            cells.append("" if rms else change)
        name = item.column if item.statistic == "mean" else ""
        rows.add_row(name, SHARED.get(item.statistic, "rms apart" if rms else item.statistic), *cells)
    console.print(rows)
    if not alike:
        for name, words in shared.items():
            print_line(console, f"{name}: {words}")
    for line in verdicts(found, labels):
        print_line(console, line)
    for source in sources:
        if source.window_empty:
            print_line(
                console,
                f"WARNING: {source.label}: no row lies in its metrics window, so its mean, min and max are "
                "of the whole run (the rule of the window: its summary.json)",
            )
    for path in ("comparison.csv", "comparison.png"):
        print_line(console, f"written: {out / path}")


RESOLVED = 0.03
"""Part of the first mean that a verdict is asked to resolve: less decides no choice between two tools."""


def verdicts(found: "Sequence[Difference]", labels: Sequence[str]) -> Iterator[str]:
    """What the intervals of the draft's means say about each further source, in words."""
    from ..analysis.columns import DRAFT

    for item in found:
        if (item.column, item.statistic) != (DRAFT, "shared_mean") or not item.part_half_widths:
            continue
        for place in range(1, len(labels)):
            part, half = item.against_first(place)[1], item.part_half_widths[place]
            if math.isnan(part) or math.isnan(half):
                continue
            low, high = 100.0 * (abs(part) - half), 100.0 * (abs(part) + half)
            who, first = labels[place], labels[0]
            if low > 0.0:
                word = "less" if part < 0.0 else "more"
                told = f"{who} needs {low:.1f} to {high:.1f} % {word} draft than {first}: shown"
            elif half <= RESOLVED:
                told = f"{who} and {first} need the same draft to {high:.1f} %: shown"
            else:
                ends = f"{100.0 * (part - half):+.1f} to {100.0 * (part + half):+.1f} % of draft"
                longer = f"{(half / RESOLVED) ** 2:.1f} times as long"
                told = f"{who} against {first}: not resolved, {ends}; runs {longer} would resolve "
                told += f"{100.0 * RESOLVED:.0f} %"
            yield f"{told} (95 %, on this sample of soil; another soil.bed.seed is another sample)"


def _span(span_s: tuple[float, float]) -> str:
    begin, end = span_s
    return f"shared: {begin:.4g} to {end:.4g} s" if begin < end else "no shared times"


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.5g}"


def _percent(part: float, half_width: float | None = None) -> str:
    width = "" if half_width is None else f" +- {100.0 * half_width:.1f}"
    return "-" if math.isnan(part) else f"{100.0 * part:+.1f}{width} %"
