"""subsoil optimise SCENE --vary KEY=LEAST,LARGEST: the values that need the least of a quantity."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..extras import require
from .arguments import add_manner, add_overrides, positive_count
from .output import print_line, stdout_console, table

if TYPE_CHECKING:
    from ..experiments.optimisation import SearchResult

SHOWN_ROWS = 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="scene file (.yaml)")
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="KEY=LEAST,LARGEST",
        help="range of a key, as tools.tine.blade.rake_deg=30,70; may be repeated",
    )
    parser.add_argument(
        "--least",
        default="series.draft_newton.mean",
        metavar="COLUMN",
        help="a column of trials.csv (default: %(default)s); loads.specific.draft_pa is the draft over the "
        "loosened section",
    )
    parser.add_argument("--trials", type=positive_count, default=24, metavar="N", help="points (default: 24)")
    parser.add_argument("--seeds", metavar="A,B,C", help="bed seeds; every point runs with each")
    add_overrides(parser)
    add_manner(parser, workers=None)
    parser.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="folder of the results, new or begun before"
    )


def run(args: argparse.Namespace) -> int:
    """Run what has not been run; print the trials with the least and how to confirm the best."""
    require("a search", "dask", "distributed", "optuna", "pyarrow")
    from ..experiments.optimisation import Search, parse_ranges, search
    from ..experiments.run_jobs import ExecutionOptions
    from ..experiments.sweep_points import parse_variations
    from .progress import SweepProgress
    from .sweep import parse_seeds

    if not args.vary:
        raise InputError("--vary: is missing; name a key and its range, as tools.tine.blade.rake_deg=30,70")
    ranges = parse_ranges(parse_variations(args.vary, "--vary"))
    wanted = Search(
        args.scene, tuple(args.overrides), ranges, args.least, args.trials, parse_seeds(args.seeds)
    )
    manner = ExecutionOptions(args.scheduler, args.workers, args.threads, args.retry_failed)
    with SweepProgress("optimise") as progress:
        result = search(wanted, args.out, manner, progress)
    _print(result, args)
    return 0


def _print(result: "SearchResult", args: argparse.Namespace) -> None:
    from ..analysis.summary import short_name
    from ..experiments.optimisation import in_every_run

    console = stdout_console()
    best = result.trials[0]
    keys = list(best.values)
    rows = table(f"least {args.least} first", (*map(short_name, keys), args.least, ""))
    for trial in result.trials[:SHOWN_ROWS]:
        behind = trial.behind(best)
        words = "best" if trial is best else "" if behind.resolved else "as good, within the seeds"
        known = best.result.count > 1
        cells = [f"{trial.values[key]:.4g}" for key in keys]
        rows.add_row(*cells, trial.result.text(".4g"), words if known or trial is best else "")
    console.print(rows)
    for label, message in result.failed:
        print_line(console, f"failed: {label}: {message}")
    if best.result.count < 2:
        print_line(console, "one bed seed: the beds' scatter is not known; add --seeds 0,1,2")
    own = [text for text in args.overrides if not text.startswith("preset=")]
    also = f" {in_every_run(own)}" if own else ""
    confirm = (
        f"{args.scene} {result.best_scene} --preset standard{also} --seeds 3 --out {args.out / 'confirmed'}"
    )
    print_line(
        console, "the best of many is partly luck; confirm it in other fields and with finer particles:"
    )
    print_line(console, f"  subsoil compare {confirm}")
    for path in result.paths:
        print_line(console, f"written: {path}")
