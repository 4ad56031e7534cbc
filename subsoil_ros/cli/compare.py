"""subsoil compare A B: tools beside each other, by runs or scenes, and beside measured values."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape

from ..errors import InputError
from ..extras import require
from .arguments import add_manner, add_overrides, positive_count
from .output import print_line, stdout_console, table

if TYPE_CHECKING:
    from ..experiments.run_cache import CachedRun
    from ..experiments.tool_comparison import Side
    from ..figures.comparison import Difference, Source

LEAST_FIELDS, MOST_FIELDS = 3, 12
"""Fields of --until: two have an interval that no tool is judged by."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "items",
        nargs="+",
        type=Path,
        metavar="A",
        help="folders of runs, or scenes (.yaml, or shipped names), which run first; the first is the one "
        "compared with",
    )
    parser.add_argument(
        "--seeds",
        type=positive_count,
        metavar="N",
        help="run each scene in N fields, seeds 1 to N, and compare equal seeds (default: once, as written)",
    )
    parser.add_argument(
        "--until",
        type=_percent_of_draft,
        metavar="PERCENT",
        help="add fields, 3 at least and --seeds at most (default: 12), until the difference of draft is "
        "known to +- so many percent",
    )
    add_overrides(parser)
    add_manner(parser, workers=None)
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
        help="columns to compare (default: draft; of runs also spring force, angle and height of the shank, "
        "and what was measured)",
    )
    parser.add_argument(
        "--html",
        action="store_true",
        help="write comparison.html as well: one page with table, verdict, warnings and curves that needs no "
        "other file",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for figure and table; must not exist, or of scenes: new or begun before",
    )


def _percent_of_draft(text: str) -> float:
    try:
        percent = float(text)
    except ValueError:
        percent = math.nan
    if not 0.0 < percent < 100.0:
        raise argparse.ArgumentTypeError(f"'{text}' is no number between 0 and 100")
    return percent


def run(args: argparse.Namespace) -> int:
    """Write comparison.csv, .png and perhaps .html; print tables, warnings and verdict."""
    require("drawing", "matplotlib", *(("jinja2",) if args.html else ()))
    from ..analysis.columns import DRAFT
    from ..experiments.run_cache import CachedRun
    from ..experiments.tool_comparison import Side, quantities_of_runs, quantities_over_fields
    from ..experiments.verdict import cautions, meaning, quantity_rows, verdicts
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

    if len(args.items) < 2 and args.measured is None:
        raise InputError(f"{args.items[0]}: is one run; name a second one, or a measurement by --measured")
    scenes = _are_scenes(args)
    failed: list[str] = []
    alike: list[str] = []
    if scenes:
        sides, failed, alike = _run_scenes(args)
    elif args.out.exists():
        raise InputError(f"--out {args.out}: exists already; results are never written over, name another")
    else:
        named = zip(labels_of(args.items), args.items, strict=True)
        sides = [Side(label, {0: CachedRun(folder)}) for label, folder in named]
    fields, labels = len(sides[0].runs), [side.label for side in sides]
    found, quantities = [], []
    with working("reading the series"):
        sources = [read_run(run.folder, side.label) for side in sides for run in side.runs.values()]
        if args.measured is not None:
            sources.append(read_measured(args.measured, sources))
            labels.append(sources[-1].label)
        else:
            several = fields > 1
            quantities = quantities_over_fields(sides) if several else quantities_of_runs(sides, sources)
        columns = args.show or ([DRAFT] if scenes else usual_columns(args.items, sources))
        _refuse_unknown(columns, sources)
        if fields == 1:
            found = differences(sources, columns)
    told = list(verdicts(quantities or found, labels, fields))
    warnings = [*failed, *cautions(sides)]
    written = {(item.column, item.statistic): item for item in (*quantities, *found)}  # each once
    paths = [args.out / name for name in ("comparison.csv", "comparison.png")]
    table_of = quantity_rows(quantities, labels) if quantities else None
    try:
        args.out.mkdir(parents=True, exist_ok=scenes)
        write_differences_csv(list(written.values()), labels, paths[0])
        with working("drawing the curves"):
            draw_overlay(sources, columns, paths[1])
        (args.out / "comparison.html").unlink(missing_ok=True)  # one of an earlier call has other numbers
        if args.html:
            from ..figures.comparison_page import write_page

            paths.append(args.out / "comparison.html")
            tops = [_made_with(side.first) for side in sides]
            write_page(paths[2], labels, told, warnings, table_of, meaning(fields, alike), paths[1], tops)
    except OSError as error:
        raise InputError(f"--out {args.out}: cannot be written ({error.strerror}); name another") from error
    console = stdout_console()
    if table_of is not None:
        headings, rows = table_of
        quantity_table = table("the tools", map(escape, headings))
        for row in rows:
            quantity_table.add_row(*map(escape, row))
        console.print(quantity_table)
    if found and (not scenes or args.show):
        _print(found, sources)
    for line in (*(f"WARNING: {line}" for line in warnings), meaning(fields, alike), *told):
        print_line(console, line)
    for path in paths:
        print_line(console, f"written: {path}")
    return 0


def _made_with(run: "CachedRun") -> list[tuple[str, str]]:
    """What a run was made with, in words."""
    from ..loading.loader import load_scene
    from ..run_results import heading_rows

    resolved = load_scene(run.folder / "scene.yaml")
    rows = dict(heading_rows(run.metrics, resolved)) | {"simulated": f"{resolved.scene.duration_s:g} s"}
    if (name := run.facts.get("soil")) is not None:
        rows["soil"] = name
    return list(rows.items())


def _are_scenes(args: argparse.Namespace) -> bool:
    """Whether scenes are given, not folders of runs.

    Raises:
        InputError: some of each, or options of the other kind.
    """
    from ..loading.files import shipped_scene

    kinds = {path.is_dir(): path for path in args.items}
    if len(kinds) > 1:
        raise InputError(
            f"{kinds[True]}: is a folder of a run, and {kinds[False]} is a scene; run the "
            f"scene first, or name {kinds[True] / 'scene.yaml'}, so that both run in the same fields"
        )
    if True in kinds:
        for flag, given in (
            ("--seeds", args.seeds),
            ("--until", args.until),
            ("--set, --preset", args.overrides),
        ):
            if given:
                raise InputError(
                    f"{flag}: given with folders of runs, which have been run; name scenes, as "
                    f"{kinds[True] / 'scene.yaml'}"
                )
        return False
    for path in args.items:
        if not shipped_scene(path).is_file():
            raise InputError(
                f"{path}: is no folder of a run and no scene; name what `subsoil run` made, or a scene"
            )
    if args.measured is not None and ((args.seeds or 1) > 1 or args.until):
        raise InputError(
            "--seeds or --until: given with --measured, which is compared with one run; leave out one of them"
        )
    return True


def _run_scenes(args: argparse.Namespace) -> "tuple[list[Side], list[str], list[str]]":
    require("a comparison of scenes", "dask", "distributed")
    from ..experiments.run_jobs import ExecutionOptions
    from ..experiments.tool_comparison import run_scenes, widest_of_draft
    from .progress import SweepProgress

    manner = ExecutionOptions(args.scheduler, args.workers, args.threads, args.retry_failed)
    counts = [args.seeds or 0]
    if args.until:
        counts = list(range(LEAST_FIELDS, (args.seeds or MOST_FIELDS) + 1))
        if not counts:
            raise InputError(f"--seeds {args.seeds}: --until begins with {LEAST_FIELDS} fields; give as many")
    for count in counts:
        seeds = range(1, count + 1)
        with SweepProgress("compare") as progress:
            found = run_scenes(args.items, args.overrides, seeds, args.out, manner, progress)
        if args.until and 100.0 * widest_of_draft(found[0]) <= args.until:
            break
    return found


def _refuse_unknown(columns: Sequence[str], sources: "Sequence[Source]") -> None:
    known = list(dict.fromkeys(name for source in sources for name in source.columns))
    for name in columns:
        if name not in known:
            from ..loading.validation import suggestion

            raise InputError(f"--show {name}: no such column in any of them; {suggestion(name, known)}")
    if not columns:
        raise InputError("--show: the runs share none of the usual columns; name the ones to compare")


def _print(found: "list[Difference]", sources: "list[Source]") -> None:
    """Print statistics of columns, run by run."""
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


def _span(span_s: tuple[float, float]) -> str:
    begin, end = span_s
    return f"shared: {begin:.4g} to {end:.4g} s" if begin < end else "no shared times"


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.5g}"


def _percent(part: float, half_width: float | None = None) -> str:
    width = "" if half_width is None else f" +- {100.0 * half_width:.1f}"
    return "-" if math.isnan(part) else f"{100.0 * part:+.1f}{width} %"
