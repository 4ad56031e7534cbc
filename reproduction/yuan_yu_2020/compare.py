"""The reproduction table as CSV, JSON, Markdown, and on the screen."""

import csv
import json
import sys
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from . import paper
from .impossible import Statement
from .reproduction import TARGET, Reproduction, Row

COLUMNS = (
    "quantity", "measure", "unit", "published", "in the window", "difference", "outside of it", "difference",
    "raw, window", "raw, outside", "agrees", "remark",
)  # fmt: skip


def cells(row: Row) -> tuple[str, ...]:
    """A row as texts, in the order of COLUMNS."""

    def number(value: float | None) -> str:
        return "" if value is None else f"{value:.4g}"

    def percent(value: float | None) -> str:
        return "" if value is None else f"{100.0 * value:+.0f} %"

    return (
        row.quantity, row.measure, row.unit, number(row.published), number(row.inside),
        percent(row.difference_inside), number(row.outside), percent(row.difference_outside),
        number(row.raw_inside), number(row.raw_outside), row.agrees, row.remark,
    )  # fmt: skip


def write_reproduction(table: Reproduction, directory: Path) -> None:
    """Writes reproduction.csv, .json and .md."""
    with (directory / "reproduction.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        documents = table.document()["rows"]
        writer.writerow(documents[0])
        writer.writerows(["" if value is None else value for value in item.values()] for item in documents)
    text = json.dumps(table.document(), indent=1, allow_nan=False)
    (directory / "reproduction.json").write_text(text + "\n", encoding="utf-8")
    (directory / "reproduction.md").write_text(markdown(table), encoding="utf-8")


def markdown(table: Reproduction) -> str:
    """The table and the statements as Markdown."""
    lines = [
        f"# {table.scene} beside the paper",
        "",
        f"Scene hash `{table.scene_hash[:16]}`. Extremes and peak to peak: 10 ms moving mean. Agrees: within "
        f"{100.0 * TARGET:.0f} % of the printed value.",
        "",
        f"| {' | '.join(COLUMNS)} |",
        f"|{'---|' * len(COLUMNS)}",
        *(f"| {' | '.join(cells(row))} |" for row in table.rows),
        "",
        "## What cannot hold",
        "",
        *statement_lines(table.statements, "- "),
        "",
        f"{paper.CONTRADICTIONS}",
    ]
    return "\n".join(lines) + "\n"


def statement_lines(found: tuple[Statement, ...], bullet: str = "") -> list[str]:
    """One line for each statement."""
    return [
        f"{bullet}{'Possible' if item.holds else 'Impossible'}: {item.claim}: {item.finding}."
        for item in found
    ]


def print_reproduction(table: Reproduction, console: Console | None = None) -> None:
    """The table for people, and the statements below it."""
    console = console or Console(width=None if sys.stdout.isatty() else 180, highlight=False)
    shown = Table(title=f"{table.scene} beside the paper (10 ms moving mean)", title_justify="left")
    for heading in COLUMNS[:-1]:
        shown.add_column(heading, justify="left" if heading in ("quantity", "measure", "unit") else "right")
    for row in table.rows:
        shown.add_row(*(escape(cell) for cell in cells(row)[:-1]))
    console.print(shown)
    for row in table.rows:
        if row.remark:
            words = f"{row.quantity}, {row.measure}: {row.remark}"
            console.print(words, soft_wrap=True, markup=False)
    for line in statement_lines(table.statements):
        console.print(line, soft_wrap=True, markup=False)
