"""Tables of the results of a run: its metrics, beside the values of a reference; all that is printed."""

import csv
import difflib
import sys
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..analysis.columns import DRAFT, DRAFT_OF_SHARES, DRAFT_OF_WHEELS, Body, draft_of_tool, spring_element
from ..analysis.summary import Summary, flattened
from ..loading.reference import Reference, ReferenceValue
from ..scene.scene import Scene
from ..yaml_document import Document
from .sentences import summary_facts


def print_summary(
    summary: Summary,
    scene: Scene,
    directory: Path,
    console: Console | None = None,
    bag: Path | None = None,
    reference: Reference | None = None,
) -> None:
    """The printed tables: metrics, the values of a reference beside them, and where all is.

    bag: folder or .mcap file (default: `bag` in `directory`).
    """
    console = console or Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    headings, rows = metrics_table(summary, scene)
    table = Table(title=f"{scene.name}: {summary.run.simulated_s:.4g} s simulated", title_justify="left")
    for heading in headings:
        words = heading == "quantity"
        table.add_column(heading, justify="left" if words else "right", no_wrap=words)
    for row in rows:
        table.add_row(escape(row[0]), *row[1:])
    if table.row_count:
        console.print(table)
    if reference is not None:
        print_reference(reference, summary.document(), console)
    for line in summary_facts(summary):
        console.print(line, soft_wrap=True, markup=False)
    console.print(_bag_words(bag or directory / "bag"), soft_wrap=True, markup=False)
    figures = directory / "figures"
    if figures.is_dir():
        console.print(f"figures: {figures}", soft_wrap=True, markup=False)
    else:
        console.print(
            f"figures: none yet, `subsoil report {directory}` draws them", soft_wrap=True, markup=False
        )


def metrics_table(summary: Summary, scene: Scene) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the metrics, as text."""
    headings = ["quantity", "mean", "min", "max", "range", "run min", "run max"]
    rows = []
    for label, name, scale, digits in _lines(scene, summary):
        found = summary.series[name]
        low, high = found.min, found.max
        spread = None if low is None or high is None else high - low
        values = [found.mean, low, high, spread, found.run.min, found.run.max]
        rows.append([label, *("" if value is None else f"{value * scale:.{digits}f}" for value in values)])
    return headings, rows


def _bag_words(bag: Path) -> str:
    files = [bag] if bag.is_file() else bag.glob("*.mcap")
    size_bytes = sum(path.stat().st_size for path in files)
    return f"bag: {bag}, {size_bytes / 1e6:.3g} MB (`subsoil bag info {bag}` says what takes the room)"


def _lines(scene: Scene, summary: Summary) -> list[tuple[str, str, float, int]]:
    """(label, column, scale, digits) of each row of the table whose column the run has."""
    shank, spring = scene.report.shank, scene.report.spring
    lines: list[tuple[str, str, float, int]] = [
        ("draft [N]", DRAFT, 1.0, 1),
        ("  of it share [N]", DRAFT_OF_SHARES, 1.0, 1),
        *((f"    of it {tool} [N]", draft_of_tool(tool), 1.0, 1) for tool in scene.tools),
        ("  of it wheels [N]", DRAFT_OF_WHEELS, 1.0, 1),
        ("spring force, compression + [N]", spring_element(spring).load, 1.0, 1),
        ("share angle [rad]", Body(shank).angle_rad, 1.0, 4),
        ("shank centre of mass, height [mm]", Body(shank).z_m, 1e3, 2),
    ]
    return [line for line in lines if line[1] in summary.series]


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


def reference_rows(reference: Reference, summary: Document) -> list[ReferenceRow]:
    """A row for each value of the reference; summary: as summary.json holds it."""

    found = flattened(summary)

    def ours(quantity: str) -> float | None:
        value = found.get(quantity)
        return float(value) if isinstance(value, int | float) else None

    return [ReferenceRow(quantity, ours(quantity), given) for quantity, given in reference.values.items()]


def reference_lines(reference: Reference, summary: Document) -> list[str]:
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


def print_reference(reference: Reference, summary: Document, console: Console) -> None:
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
