"""Arguments that several verbs share."""

import argparse
import sys
from pathlib import Path

from ...errors import InputError

RECORD_HELP = (
    "folder of a run, as given to `subsoil run --out`; or a bag folder or .mcap file alone: results go to "
    "NAME_report beside it"
)


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Declare `--set` and `--preset`, once for every verb that reads a scene; both become `overrides`."""
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change a value of the scene, as soil.bed.seed=3 or initial_condition=lowered; may be repeated",
    )
    parser.add_argument(
        "--preset",
        dest="overrides",
        action="append",
        type=lambda name: f"preset={name}",
        metavar="NAME",
        help="a preset of the scene, as coarse, standard or fine (default: the scene as it is written)",
    )


def positive_count(text: str) -> int:
    """Parse a whole number of 1 or more, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no whole number of 1 or more")
    return int(text)


def write_out(text: str, out: Path | None) -> None:
    """Write the output of a verb to the file of its `--out`, or to standard output.

    Raises:
        InputError: the file cannot be written.
    """
    if out is None:
        sys.stdout.write(text)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be written ({error.strerror}); name a file that can"
        ) from error
    print(f"written to {out}")
