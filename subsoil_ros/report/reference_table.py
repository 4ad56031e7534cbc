"""The values of a reference file beside those of a run."""

import csv
import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..analysis.quantities import flattened
from ..loading.reference import Reference, ReferenceValue

HEADINGS = ("quantity", "unit", "ours", "reference", "band", "difference", "agrees", "source")
WORDS = ("quantity", "unit", "agrees", "source")
"""Headings of columns that hold no numbers."""


@dataclass(frozen=True)
class ReferenceRow:
    """One quantity of a reference and of a run."""

    quantity: str  # dotted path in summary.json
    ours: float | None  # None: the run has no such quantity
    given: ReferenceValue

    @property
    def difference(self) -> float | None:
        """Ours less the reference's value, over that value; None where one is missing or the value is 0."""
        if self.ours is None or not self.given.value:
            return None
        return (self.ours - self.given.value) / abs(self.given.value)

    @property
    def agrees(self) -> str:
        """`yes`, `below` or `above` the band; `` without a band or a value of ours."""
        if self.ours is None or self.given.band is None:
            return ""
        low, high = self.given.band
        return "below" if self.ours < low else "above" if self.ours > high else "yes"

    def cells(self) -> list[str]:
        """Texts of the row, in the order of HEADINGS."""
        band = "" if self.given.band is None else " to ".join(f"{value:.4g}" for value in self.given.band)
        difference = "" if self.difference is None else f"{100.0 * self.difference:+.0f} %"
        return [
            self.quantity, self.given.unit, _number(self.ours), _number(self.given.value), band, difference,
            self.agrees, self.given.source,
        ]  # fmt: skip


def reference_rows(reference: Reference, summary: Mapping[str, Any]) -> list[ReferenceRow]:
    """A row for each value of the reference; summary: as summary.json holds it."""

    found = flattened(summary)

    def ours(quantity: str) -> float | None:
        value = found.get(quantity)
        return float(value) if isinstance(value, int | float) else None

    return [ReferenceRow(quantity, ours(quantity), given) for quantity, given in reference.values.items()]


def reference_lines(reference: Reference, summary: Mapping[str, Any]) -> list[str]:
    """The notes of a reference, and which of its quantities the run lacks."""
    lines = list(reference.notes)
    for row in reference_rows(reference, summary):
        if row.ours is None:
            near = difflib.get_close_matches(row.quantity, flattened(summary), n=1, cutoff=0.8)
            lines.append(f"this run has no {row.quantity}" + (f"; the nearest is {near[0]}" if near else ""))
    return lines


def write_reference_csv(rows: list[ReferenceRow], path: Path) -> None:
    """One line for each row, numbers with all their digits."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(
            ("quantity", "unit", "ours", "value", "low", "high", "difference", "agrees", "source")
        )
        for row in rows:
            given, (low, high) = row.given, row.given.band or (None, None)
            writer.writerow(
                (row.quantity, given.unit, row.ours, given.value, low, high, row.difference, row.agrees,
                 given.source)
            )  # fmt: skip


def print_reference(reference: Reference, summary: Mapping[str, Any], console: Console) -> None:
    """The printed table, and the lines below it."""
    table = Table(title=f"beside {escape(reference.name)}", title_justify="left")
    for heading in HEADINGS:
        words = heading in WORDS
        table.add_column(heading, justify="left" if words else "right", no_wrap=heading == HEADINGS[0])
    for row in reference_rows(reference, summary):
        table.add_row(*map(escape, row.cells()))
    console.print(table)
    for line in reference_lines(reference, summary):
        console.print(line, soft_wrap=True, markup=False)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
