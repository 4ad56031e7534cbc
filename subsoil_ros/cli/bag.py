"""subsoil bag info|recover FILE: describes a bag, or recovers one whose writer was killed."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from .output import print_line, stdout_console, table

if TYPE_CHECKING:
    from ..recording.bag_info import BagFacts
    from ..yaml_document import Document


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    for name, text in (
        ("info", "print topics with counts, rates and sizes, types, compression, and what is thinned"),
        ("recover", "recover a bag in its place; the damaged file is kept as FILE.damaged"),
    ):
        action = actions.add_parser(name, help=text, description=text)
        action.add_argument("file", type=Path, help="bag folder, its .mcap file, or the folder of a run")
        if name == "info":
            action.add_argument("--json", action="store_true", help="print it as JSON")


def run(args: argparse.Namespace) -> int:
    """Describe or recover the bag."""
    return _info(args.file, args.json) if args.action == "info" else _recover(args.file)


def _info(path: Path, as_json: bool) -> int:
    from ..recording.bag_info import describe

    with _bar(path, "reading") as on_progress:
        facts = describe(path, on_progress)
    if as_json:
        print(json.dumps(_document(facts), indent=1))
        return 0
    console = stdout_console()
    console.print(_topic_table(facts))
    console.print(_type_table(facts))
    for line in _lines(facts):
        print_line(console, line)
    return 0


@contextmanager
def _bar(path: Path, text: str) -> Iterator[Callable[[int], None]]:
    """Show a bar on a terminal while the bag at `path` is read; yields a callback for the bytes read."""
    from ..recording.bag_folder import mcap_file

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    size_bytes = mcap_file(path).stat().st_size
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(text, total=size_bytes)
        yield lambda done_bytes: progress.update(task, completed=done_bytes)


def _topic_table(facts: BagFacts) -> Table:
    topics = table(str(facts.path), ("topic", "type", "messages", "per s", "MB", "bytes each"), words=2)
    for topic in facts.topics:
        each = f"{topic.size_bytes / topic.message_count:.0f}" if topic.message_count else ""
        rate = f"{topic.rate_hz:.5g}" if topic.rate_hz else ""
        size = f"{topic.size_bytes / 1e6:.3f}"
        topics.add_row(topic.name, topic.message_type, str(topic.message_count), rate, size, each)
    return topics


def _type_table(facts: BagFacts) -> Table:
    types = table("", ("type", "hash"), words=2)
    for name, type_hash in sorted({topic.message_type: topic.type_hash for topic in facts.topics}.items()):
        types.add_row(name, type_hash)
    return types


def _lines(facts: BagFacts) -> Iterator[str]:
    start_ns, end_ns = facts.span_ns
    span = f"{start_ns * 1e-9:.9g} to {end_ns * 1e-9:.9g} s of simulated time"
    yield f"{facts.message_count} messages from {span}"
    packing = facts.chunk_bytes / facts.packed_bytes if facts.packed_bytes else 1.0
    yield (
        f"{facts.file_bytes / 1e6:.3f} MB, {facts.chunk_count} chunks, {facts.compression} "
        f"({packing:.2f} times smaller than before), profile '{facts.profile}', written by {facts.library}"
    )
    if facts.run_id:
        end = "to its end" if facts.complete else "cut: its last grant is not END"
        yield f"run {facts.run_id}, {end}"
    for name, text in facts.notes.items():
        yield f"{name}: {text}"
    if facts.attachments:
        size_bytes = sum(facts.attachments.values())
        yield f"attached: {', '.join(facts.attachments)} ({size_bytes / 1e3:.1f} kB)"


def _document(facts: BagFacts) -> Document:
    document = asdict(facts) | {"path": str(facts.path), "message_count": facts.message_count}
    for topic, entry in zip(facts.topics, document["topics"], strict=True):
        entry["rate_hz"] = topic.rate_hz
    return document


def _recover(path: Path) -> int:
    from ..recording.recovery import recover

    with _bar(path, "recovering") as on_progress:
        result = recover(path, on_progress)
    if result.damaged_path is None:
        print(f"{result.path}: is complete, {result.message_count} messages; nothing was changed")
    else:
        print(
            f"{result.path}: recovered, {result.message_count} messages up to "
            f"{result.end_time_ns * 1e-9:.9g} s of simulated time; the damaged file is {result.damaged_path}"
        )
    return 0
