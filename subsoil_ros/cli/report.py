"""subsoil report RECORD: metrics and figures of a run, from its bag and scene."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..extras import require
from .arguments import RECORD_HELP

if TYPE_CHECKING:
    from ..api.read import RecordedRun
    from ..yaml_document import Document


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("record", type=Path, help=RECORD_HELP)
    parser.add_argument(
        "--html",
        action="store_true",
        help="write report.html as well: one page, below 25 MB, with interactive plots and a 3-D replay that "
        "needs no other file and no network; the replay needs a browser with WebGL",
    )


def run(args: argparse.Namespace) -> int:
    """Write series.csv, summary.json, results.csv, tables and figures/ anew, and print the summary.

    spectra.csv, load_cycles.csv, height_map.csv where the run has them; reference.csv where the scene names a
    reference.
    """
    require("drawing", "matplotlib")
    if args.html:
        require("--html", "jinja2", "plotly")
    from ..api.read import recorded_run

    with recorded_run(args.record) as recorded:
        return _report(recorded, args.html)


def _report(recorded: RecordedRun, html: bool) -> int:
    from ..analysis.metrics_window import metrics_window
    from ..analysis.series import read_series, write_series_csv
    from ..analysis.summarize import run_statistics, summarize
    from ..figures.run_figures import draw_figures, draw_load_figures
    from ..run_results import (
        print_summary,
        reference_rows,
        results_of,
        write_reference_csv,
        write_results_csv,
    )
    from .progress import reading_bag, working

    directory, bag, resolved = recorded.directory, recorded.bag, recorded.resolved
    with reading_bag(resolved.timing) as on_time:
        series = read_series(bag, resolved.scene, on_time)
    window = metrics_window(series, resolved)
    with working("reading the clouds"):
        statistics = run_statistics(bag, resolved, series, window)
    summary = summarize(bag, resolved, _known_facts(directory), series, statistics)
    recorded.make_directory()
    try:
        write_series_csv(series, directory / "series.csv")
        summary.write(directory / "summary.json")
        write_results_csv(results_of(summary, resolved), directory / "results.csv")
        statistics.write_tables(directory)
        if resolved.reference is not None:
            rows = reference_rows(resolved.reference, summary.document())
            write_reference_csv(rows, directory / "reference.csv")
        with working("drawing the figures"):
            figures = draw_figures(bag, resolved, directory / "figures", series)
            figures += draw_load_figures(statistics, resolved.scene.name, directory / "figures")
        if html:
            from ..figures.html_report import write_html
            from ..figures.interactive_plots import RunData

            pictures = [path for path in figures if path.stem in ("tool", "soil_cut")]
            pictures += sorted((directory / "pictures").glob("*.png"))
            with working("writing the page"):
                page = write_html(directory, bag, RunData(resolved, series, statistics, summary), pictures)
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written ({error.strerror})") from error
    print_summary(summary, resolved.scene, directory, bag=bag, reference=resolved.reference)
    if html:
        print(f"page: {page}")
    return 0


def _known_facts(directory: Path) -> Document:
    """Facts that are not in the bag: from the run's summary, or, under ros2 launch, from its folder."""
    from ..analysis.summary import run_facts
    from ..api.resume import checkpoint_facts

    facts = checkpoint_facts(directory, None)
    try:
        return facts | run_facts(json.loads((directory / "summary.json").read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError):
        return facts
