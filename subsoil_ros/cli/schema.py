"""subsoil schema: the JSON Schema of scene files, by which editors complete and check keys."""

import argparse
import json
import sys
from pathlib import Path

from ..errors import InputError

SUMMARY = "write the JSON Schema of scene files, for editors"


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
    from ..scene.schema import scene_schema

    text = json.dumps(scene_schema(), indent=1) + "\n"
    if args.out is None:
        sys.stdout.write(text)
        return 0
    try:
        args.out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"--out {args.out}: cannot be written ({error.strerror}); name a file that can"
        ) from error
    print(f"written to {args.out}")
    return 0
