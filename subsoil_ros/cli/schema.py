"""subsoil schema: the JSON Schema of scene files, with which editors complete and check keys."""

import argparse
import json
from pathlib import Path

from ._shared.arguments import write_out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `subsoil schema`."""
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="file to write, an older one is replaced (default: standard output); the first line "
        "`# yaml-language-server: $schema=FILE` in a scene names it to an editor",
    )


def run(args: argparse.Namespace) -> int:
    """Write the schema."""
    from ..loading.schema import scene_schema

    write_out(json.dumps(scene_schema(), indent=1) + "\n", args.out)
    return 0
