"""subsoil sweep SCENE --vary KEY=A,B,C: many runs of one scene, one table."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from ..errors import InputError, RunError
from ..extras import require
from .arguments import add_manner, add_overrides
from .output import print_line, stdout_console, table

if TYPE_CHECKING:
    from ..experiments.run_sweep import Outcome
    from ..experiments.sweep_ranking import Ranked

SHOWN_ROWS = 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="scene file (.yaml)")
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="KEY=A,B,C",
        help="values of a key, as mechanism.forces.H9_spring.stiffness_newton_per_m=1e5,2e5; several keys: "
        "every combination",
    )
    parser.add_argument(
        "--pair",
        action="append",
        default=[],
        metavar="KEY=A,B,C",
        help="values that go together with those of the other --pair keys, first with first",
    )
    parser.add_argument("--seeds", metavar="A,B,C", help="bed seeds; every combination runs with each")
    parser.add_argument(
        "--control",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="the run that savings of draft are counted from, as mechanism.forces.H9_spring.locked=true",
    )
    add_overrides(parser)
    parser.add_argument(
        "--show",
        action="append",
        default=[],
        metavar="COLUMN",
        help="a column of sweep.csv to draw and to add to ranking.csv; may be repeated",
    )
    add_manner(parser, workers=None)
    parser.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="folder of the results, new or begun before"
    )


def run(args: argparse.Namespace) -> int:
    """Run what has not been run, write the tables, print the ranking."""
    require("a sweep", "dask", "distributed", "matplotlib", "pyarrow")
    from ..experiments.run_jobs import ExecutionOptions
    from ..experiments.run_sweep import Sweep, run_sweep
    from ..experiments.sweep_points import parse_variations
    from .progress import SweepProgress

    if not args.vary and not args.pair:
        raise InputError("--vary: is missing; name a key and its values, or use `subsoil run` for one run")
    sweep = Sweep(
        args.scene,
        tuple(args.overrides),
        parse_variations(args.vary, "--vary"),
        parse_variations(args.pair, "--pair"),
        parse_seeds(args.seeds),
        tuple(args.control),
    )
    manner = ExecutionOptions(args.scheduler, args.workers, args.threads, args.retry_failed)
    with SweepProgress("sweep") as progress:
        outcome = run_sweep(sweep, args.out, manner, progress, args.show)
    _print(outcome, sweep.keys)
    if len(outcome.failed) == len(outcome.table):
        raise RunError(f"every run failed, the first: {outcome.failed[0][1]}")
    return 0


def parse_seeds(text: str | None) -> tuple[int, ...]:
    """Parse "0,1,2". Raises InputError for other texts."""
    if text is None:
        return ()
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() for part in parts) or len(set(parts)) < len(parts):
        raise InputError(f"--seeds {text}: must be different whole numbers, as 0,1,2")
    return tuple(int(part) for part in parts)


def _print(outcome: "Outcome", keys: list[str]) -> None:
    console = stdout_console()
    if outcome.ranked:
        console.print(_ranking(outcome.ranked, outcome.best, keys))
        console.print(_advice(outcome))
    for label, message in outcome.failed:
        print_line(console, f"failed: {label}: {message}")
    if outcome.failed:
        console.print(
            f"{len(outcome.failed)} of {len(outcome.table)} runs failed; --retry-failed runs them again"
        )
    if outcome.extrapolated:
        console.print(
            f"WARNING: {outcome.extrapolated} of {len(outcome.table)} runs left the range in which their "
            "wedge model was fitted (columns loads.extrapolated of sweep.csv)",
            soft_wrap=True,
        )
    if outcome.empty_windows:
        console.print(
            f"WARNING: {outcome.empty_windows} of {len(outcome.table)} runs have no row in their metrics "
            "window, so their means are of the whole run (the rule of the window: their summary.json)",
            soft_wrap=True,
        )
    for path in outcome.paths:
        print_line(console, f"written: {path}")


def _ranking(ranked: "list[Ranked]", best: "Ranked | None", keys: list[str]) -> Table:
    from ..analysis.summary import short_name

    savings = any(item.saving is not None for item in ranked)
    loads = list(dict.fromkeys(name for item in ranked for name in item.load))
    numbers = ("mean draft N", *(("saving %",) if savings else ()), *loads)
    rows = table("least mean draft first", (*map(short_name, keys), *numbers), words=len(keys))
    rows.add_column("")
    for item in ranked[:SHOWN_ROWS]:
        cells = [str(item.values.get(key, "")) for key in keys]
        cells.append(item.draft_newton.text(".1f"))
        if savings:
            cells.append("" if item.saving is None else item.saving.scaled(100.0).text(".2f"))
        cells += [f"{item.load[name]:.5g}" if name in item.load else "" for name in loads]
        word = "recommended" if item is best else "as good, within the seeds" if item.level_with_best else ""
        rows.add_row(*cells, word if item.draft_newton.count > 1 else "")
    if len(ranked) > SHOWN_ROWS:
        rows.caption = f"{len(ranked) - SHOWN_ROWS} more in ranking.csv"
    return rows


def _advice(outcome: "Outcome") -> str:
    if outcome.best is not None:
        return "+-: 95 % intervals over the seeds (Student's t; savings on pairs of the same seed)"
    first = outcome.ranked[0]
    if outcome.empty_windows:
        return "nothing is recommended: runs have no row in their metrics window"
    if first.draft_newton.count < 2:
        return "one bed seed: the beds' scatter is not known, so nothing is recommended; add --seeds 0,1,2"
    if first.judged.mean and not first.judged.scatters:
        return "the seeds change nothing here, so they are one sample, and nothing is recommended"
    if first.saving is not None:
        return "no point saves more draft than the beds scatter (95 %, Student's t on pairs of the same seed)"
    if any(label.startswith("control") for label, _ in outcome.failed):
        return "the control failed, so no saving is known and nothing is recommended"
    return "there is one point only, so nothing to recommend"
