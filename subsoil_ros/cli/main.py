"""The command `subsoil`: one verb per file beside this one."""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType

from .. import __version__
from ..errors import InterruptedRunError, SubsoilError

VERBS = (
    "check", "run", "report", "compare", "sweep", "study", "soil-test", "calibrate", "bag", "bench", "urdf",
)  # fmt: skip
"""Modules of this folder (a dash is an underscore there), each with SUMMARY, add_arguments(parser) and
run(args) -> exit status."""


def _module(verb: str) -> ModuleType:
    return import_module(f"{__package__}.{verb.replace('-', '_')}")


def _parser(wanted: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of these verbs; each imports what it needs, and plotting, say, takes a second."""
    parser = argparse.ArgumentParser(
        prog="subsoil",
        description="Soil-tool co-simulation: discrete-element soil and a machine in lockstep.",
    )
    parser.add_argument("--version", action="version", version=f"subsoil {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for verb in wanted:
        module = _module(verb)
        module.add_arguments(verbs.add_parser(verb, help=module.SUMMARY, description=module.SUMMARY))
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one verb. Returns 0, 2 on bad input, 3 on a failed run, 128 + number for a signal."""
    arguments = sys.argv[1:] if arguments is None else arguments
    given = arguments[:1]
    args = _parser(given if given and given[0] in VERBS else VERBS).parse_args(arguments)
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
