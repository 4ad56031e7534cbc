"""subsoil bag info|recover FILE: describes a bag, or mends one whose writer was killed."""

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from ..recording.bag_reader import BagReader
from ..recording.recovery import recover

SUMMARY = "describe a bag, or mend one whose writer was killed"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `subsoil bag`."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    for name, text in (
        ("info", "print topics, types and message counts"),
        ("recover", "mend a bag in its place; the damaged file is kept as FILE.damaged"),
    ):
        action = actions.add_parser(name, help=text, description=text)
        action.add_argument("file", type=Path, help="bag folder, its .mcap file, or the folder of a run")


def run(args: argparse.Namespace) -> int:
    """Describe or mend the bag."""
    return _info(args.file) if args.action == "info" else _recover(args.file)


def _info(path: Path) -> int:
    reader = BagReader(path)
    topics = reader.topics()
    table = Table(title=str(reader.path), title_justify="left")
    table.add_column("topic", overflow="fold")
    table.add_column("type", overflow="fold")
    table.add_column("messages", justify="right")
    for topic in topics:
        table.add_row(topic.name, topic.message_type, str(topic.message_count))
    console = Console(width=None if sys.stdout.isatty() else 140)
    console.print(table)
    count = sum(topic.message_count for topic in topics)
    console.print(f"{count} messages up to {reader.end_time_ns * 1e-9:.9g} s of simulated time")
    return 0


def _recover(path: Path) -> int:
    result = recover(path)
    if result.damaged_path is None:
        print(f"{result.path}: is whole, {result.message_count} messages; nothing was changed")
    else:
        print(
            f"{result.path}: mended, {result.message_count} messages up to {result.end_time_ns * 1e-9:.9g} s "
            f"of simulated time; the damaged file is {result.damaged_path}"
        )
    return 0
