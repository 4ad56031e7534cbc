"""The command `subsoil`: one verb per file beside this one."""

import argparse
import errno
import io
import sys
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType

from .._version import __version__
from ..errors import InputError, InterruptedRunError, SubsoilError
from ..numba_environment import check_numba_environment
from .interrupts import answered_interrupts

VERBS = {
    "check": "validate a scene and print what a run of it would cost",
    "run": "simulate a scene; DIR gets bag/, scene.yaml, series.csv, summary.json and log/",
    "follow": "soil under a machine that does not wait, by its poses over ROS; or by recorded ones",
    "report": "print the metrics of a run and draw its figures (PNG)",
    "render": "pictures or a film of soil and machine, or VTK files for ParaView",
    "compare": "compare tools by scenes or runs, in words; or runs with a measured CSV",
    "sweep": "run a scene with every combination of values; one table (CSV, Parquet), figure and ranking",
    "optimise": "search the values of keys that need the least of a quantity, as draft per loosened section",
    "study": "sweep the factors of a scene against a reference run: errors with intervals, and wall time",
    "soil-test": "test the soil of a scene: strength, stiffness, density, angle of repose",
    "calibrate": "fit particles to a laboratory's soil, or a wedge model to runs with particles",
    "workbench": "scenes, runs and comparisons in the browser",
    "bag": "describe a bag, or recover one whose writer was killed",
    "new": "write a commented scene to start from, with its meshes",
    "schema": "write the JSON Schema of scene files, for editors",
    "urdf": "write the machine of a scene as URDF (each body floats on `world`; /tf moves it)",
}
"""Description of each verb. Verbs are modules of this folder (a dash is an underscore there), each with
add_arguments(parser) and run(args) -> exit status; importing all of them for a list would take seconds. `run`
raises InputError before anything is written, and RunError or RecordingError where that fails later."""

CONTINUED = ("compare", "sweep", "optimise", "study")
"""Verbs of many runs, which continue where they were stopped."""


def _module(verb: str) -> ModuleType:
    return import_module(f"{__package__}.{verb.replace('-', '_')}")


def _parser(given: str | None) -> argparse.ArgumentParser:
    """Return the parser; the verb in `given` gets its arguments."""
    parser = argparse.ArgumentParser(
        prog="subsoil",
        description="Soil-tool co-simulation: discrete-element soil and a machine in lockstep.",
    )
    parser.add_argument("--version", action="version", version=f"subsoil {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for verb, summary in VERBS.items():
        added = verbs.add_parser(verb, help=summary, description=summary)
        if verb == given:
            _module(verb).add_arguments(added)
    return parser


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse a command line. Raises SystemExit as argparse does."""
    return _parser(arguments[0] if arguments else None).parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb. Returns 0, 2 on bad input, 3 on a failed run, 128 + number for a signal."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal may lack a character
            stream.reconfigure(errors="replace")
    args = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        with answered_interrupts(args.verb):
            check_numba_environment()
            return _module(args.verb).run(args)
    except SubsoilError as error:
        print(f"subsoil {args.verb}: {error}", file=sys.stderr)
        return error.exit_status
    except OSError as error:  # asking whether such a file exists fails, wherever it is done
        if error.errno != errno.ENAMETOOLONG:
            raise
        print(f"subsoil {args.verb}: {error.filename}: is longer than a file name can be", file=sys.stderr)
        return InputError.exit_status
    except KeyboardInterrupt:
        kept = "; finished runs are kept, and the same command continues" if args.verb in CONTINUED else ""
        print(f"subsoil {args.verb}: interrupted{kept}", file=sys.stderr)
        return InterruptedRunError.exit_status


if __name__ == "__main__":
    raise SystemExit(main())
