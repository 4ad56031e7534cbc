"""The command `subsoil`: one verb per file beside this one."""

import argparse
import ast
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType

from .._version import __version__
from ..errors import InterruptedRunError, SubsoilError

VERBS = (
    "check",
    "run",
    "report",
    "render",
    "compare",
    "sweep",
    "study",
    "soil-test",
    "calibrate",
    "bag",
    "bench",
    "new",
    "schema",
    "urdf",
)
"""Modules of this folder (a dash is an underscore there), each with SUMMARY, add_arguments(parser) and
run(args) -> exit status."""


def _module(verb: str) -> ModuleType:
    return import_module(f"{__package__}.{verb.replace('-', '_')}")


def _summary(verb: str) -> str:
    """SUMMARY of a verb as its source has it: to import all verbs, only to list them, would take seconds."""
    source = Path(__file__).with_name(f"{verb.replace('-', '_')}.py").read_text(encoding="utf-8")
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "SUMMARY":
            return str(ast.literal_eval(statement.value))
    raise AttributeError(f"{verb}: has no SUMMARY")


def _parser(given: str | None) -> argparse.ArgumentParser:
    """The parser; of a verb that was given with its arguments."""
    parser = argparse.ArgumentParser(
        prog="subsoil",
        description="Soil-tool co-simulation: discrete-element soil and a machine in lockstep.",
    )
    parser.add_argument("--version", action="version", version=f"subsoil {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for verb in VERBS:
        summary = _summary(verb)
        added = verbs.add_parser(verb, help=summary, description=summary)
        if verb == given:
            _module(verb).add_arguments(added)
    return parser


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The words of a command line, read. Raises SystemExit as argparse does."""
    return _parser(arguments[0] if arguments else None).parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one verb. Returns 0, 2 on bad input, 3 on a failed run, 128 + number for a signal."""
    args = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        return _module(args.verb).run(args)
    except SubsoilError as error:
        print(f"subsoil {args.verb}: {error}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        print(f"subsoil {args.verb}: interrupted", file=sys.stderr)
        return InterruptedRunError.exit_status


if __name__ == "__main__":
    raise SystemExit(main())
