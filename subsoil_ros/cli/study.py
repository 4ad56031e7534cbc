"""subsoil study SCENE: errors and times of a scene's presets, measured over several beds."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from ..extras import require
from .arguments import add_manner, add_overrides
from .output import print_line, stdout_console

if TYPE_CHECKING:
    from ..experiments.study_design import StudyDesign


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="scene file (.yaml)")
    parser.add_argument(
        "--design",
        type=Path,
        metavar="FILE",
        help="factors, values, seeds and the reference run (default: studies/NAME.yaml beside the scenes)",
    )
    add_overrides(parser)
    add_manner(parser, workers=1)
    parser.add_argument(
        "--list", action="store_true", help="print the runs with their sizes, and run nothing"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the results, new or begun before")


def run(args: argparse.Namespace) -> int:
    """Run what has not been run, write tables and figure, print the table."""
    require("a study", "dask", "distributed", "matplotlib", "pyarrow")
    from ..errors import InputError
    from ..experiments.run_jobs import ExecutionOptions
    from ..experiments.run_study import run_study
    from ..experiments.study_design import design_of, read_design
    from ..loading.files import shipped_scene
    from .progress import SweepProgress

    design = read_design(args.design or design_of(shipped_scene(Path(args.scene))))
    console = stdout_console(200)
    if args.list:
        _list(args, design, console)
        return 0
    if args.out is None:
        raise InputError("--out: is missing; name a folder for the results, or --list to see the runs")
    manner = ExecutionOptions(args.scheduler, args.workers, args.threads, args.retry_failed, timed=True)
    with SweepProgress("study") as progress:
        outcome = run_study(args.scene, args.overrides, design, args.out, manner, progress)
    print_line(console, outcome.text)
    for label, message in outcome.failed:
        print_line(console, f"failed: {label}: {message}")
    for path in outcome.paths:
        print_line(console, f"written: {path}")
    return 0


def _list(args: argparse.Namespace, design: "StudyDesign", console: Console) -> None:
    """Every preset with its particles and steps."""
    from ..api.check_scene import start_count
    from ..experiments.run_study import study_jobs
    from .output import table

    headings = ("preset", "particles", "soil steps", "particle-steps")
    sizes = table(f"{len(design.seeds)} seeds each", headings)
    one_seed = design.model_copy(update={"seeds": design.seeds[:1]})
    for job in study_jobs(args.scene, args.overrides, one_seed):
        timing = job.scene.timing
        count, steps = start_count(job.scene), timing.soil_steps * timing.tick_count
        sizes.add_row(job.point.name, f"{count:,}", f"{steps:,}", f"{count * steps:.2g}")
    console.print(sizes)
