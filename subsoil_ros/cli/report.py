"""subsoil report DIR: metrics and figures of a run, from its bag and scene."""

import argparse
import json
from pathlib import Path
from typing import Any

from ..analysis.figures import draw_figures
from ..analysis.series import read_series, write_series_csv
from ..analysis.summary import print_summary, run_facts, summarize, write_summary
from ..errors import InputError
from ..recording.joined import mend_earlier
from ..scene.loader import load_scene

SUMMARY = "print the metrics of a run and draw its figures (PNG)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `subsoil report`."""
    parser.add_argument("directory", type=Path, help="folder of a run, as given to `subsoil run --out`")


def run(args: argparse.Namespace) -> int:
    """Write series.csv, summary.json and figures/ anew from the bag, and print the summary."""
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
    summary = summarize(bag, resolved, _known_facts(directory / "summary.json"), series)
    try:
        write_series_csv(series, directory / "series.csv")
        write_summary(summary, directory / "summary.json")
        draw_figures(bag, resolved, directory / "figures", series)
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written ({error.strerror})") from error
    print_summary(summary, resolved.scene, directory)
    return 0


def _known_facts(path: Path) -> dict[str, Any]:
    """What the run itself wrote down and no bag tells; nothing if it never came to it."""
    try:
        return run_facts(json.loads(path.read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError):
        return {}
