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
        help="a preset of the scene, as coarse, standard or fine (default: the scene as it is written; "
        "of a scene in short standard)",
    )


def positive_count(text: str) -> int:
    """Parse a whole number of 1 or more, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no whole number of 1 or more")
    return int(text)


def add_manner(parser: argparse.ArgumentParser, workers: int | None) -> None:
    """Declare how the runs of `subsoil sweep` and `subsoil study` are executed; workers: the default."""
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster, as tcp://host:8786 (default: this machine)"
    )
    parser.add_argument(
        "--workers",
        type=positive_count,
        default=workers,
        metavar="N",
        help="runs at once on this machine (default: "
        + ("one for every core, or for every --threads cores)" if workers is None else f"{workers})"),
    )
    parser.add_argument(
        "--threads",
        type=positive_count,
        default=1,
        metavar="N",
        help="of each run's soil engine (default: 1)",
    )
    parser.add_argument(
        "--retry-failed", action="store_true", help="run again what failed before; the rest is kept"
    )
