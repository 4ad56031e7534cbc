"""Arguments that several verbs share."""

import argparse


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Declare `--set`, once for every verb that reads a scene; it becomes `overrides`."""
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change a value of the scene, as soil.bed.seed=3 or start=lowered; may be repeated",
    )
