"""subsoil schema: the JSON Schema of scene files, with which editors check keys, or of summary.json."""

import argparse
import json
from pathlib import Path

from .output import write_out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="file to write, an older one is replaced (default: standard output); the first line "
        "`# yaml-language-server: $schema=FILE` in a scene names it to an editor",
    )
    parser.add_argument("--summary", action="store_true", help="the schema of summary.json instead")


def run(args: argparse.Namespace) -> int:
    """Write the schema."""
    from ..analysis.summary import summary_schema
    from ..loading.scene_schema import scene_schema

    schema = summary_schema() if args.summary else scene_schema()
    write_out(json.dumps(schema, indent=1) + "\n", args.out)
    return 0
