"""subsoil report DIR: metrics and figures of a run, from its bag and scene."""

import argparse
import json
from pathlib import Path
from typing import Any

from ..analysis.disturbance import write_height_map_csv
from ..analysis.fatigue import write_cycles_csv
from ..analysis.figures import draw_figures
from ..analysis.findings import Findings, find_out
from ..analysis.load_figures import draw_load_figures
from ..analysis.reproduction import Reproduction, reproduction
from ..analysis.reproduction_table import print_reproduction, write_reproduction
from ..analysis.series import read_series, write_series_csv
from ..analysis.spectra import write_spectra_csv
from ..analysis.summary import print_summary, run_facts, summarize, write_summary
from ..analysis.window import metrics_window
from ..errors import InputError
from ..recording.joined import mend_earlier
from ..scene.loader import load_scene

SUMMARY = "print the metrics of a run and draw its figures (PNG)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `subsoil report`."""
    parser.add_argument("directory", type=Path, help="folder of a run, as given to `subsoil run --out`")


def run(args: argparse.Namespace) -> int:
    """Write series.csv, summary.json, tables and figures/ anew from the bag, and print the summary.

    spectra.csv, load_cycles.csv, height_map.csv where the run has them; reproduction.csv, .json and .md where
    the scene is the paper's.
    """
    directory: Path = args.directory
    scene_file = directory / "scene.yaml"
    if not scene_file.is_file():
        raise InputError(
            f"{directory}: no folder of a run (it has no scene.yaml); name one that `subsoil run` made"
        )
    resolved = load_scene(scene_file)
    mend_earlier(directory)
    bag = directory / "bag"
    series = read_series(bag, resolved.scene)
    window = metrics_window(series, resolved.scene)
    findings = find_out(bag, resolved, series, window)
    facts = _known_facts(directory / "summary.json")
    summary = summarize(bag, resolved, facts, series, findings)
    table = None
    if resolved.scene.report.paper:
        table = reproduction(resolved.scene, resolved.scene_hash, series, window, findings)
    try:
        write_series_csv(series, directory / "series.csv")
        write_summary(summary, directory / "summary.json")
        _write_tables(findings, table, directory)
        draw_figures(bag, resolved, directory / "figures", series)
        draw_load_figures(findings, resolved.scene.name, directory / "figures", table)
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written ({error.strerror})") from error
    print_summary(summary, resolved.scene, directory)
    if table is not None:
        print_reproduction(table)
    return 0


def _write_tables(findings: Findings, table: Reproduction | None, directory: Path) -> None:
    if findings.spectra:
        write_spectra_csv(findings.spectra, directory / "spectra.csv")
    if findings.cycles is not None:
        write_cycles_csv(findings.cycles, directory / "load_cycles.csv")
    if findings.disturbance is not None:
        write_height_map_csv(findings.disturbance.lift, directory / "height_map.csv")
    if table is not None:
        write_reproduction(table, directory)


def _known_facts(path: Path) -> dict[str, Any]:
    """What the run itself wrote down and no bag tells; nothing if it never came to it."""
    try:
        return run_facts(json.loads(path.read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError):
        return {}
