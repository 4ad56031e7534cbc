"""Arguments that several verbs share."""

import argparse

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
