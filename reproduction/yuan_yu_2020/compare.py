"""The paper's printed results beside a run: window and rest, both readings, and contradictions.

    python -m reproduction.yuan_yu_2020.compare RUN

RUN is a folder that `subsoil run` made, or its bag. Prints the table and leaves reproduction.csv, .json, .md
and .png in the folder.
"""

import argparse
import csv
import json
import sys
from pathlib import Path

from matplotlib.axes import Axes
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from subsoil_ros.analysis.metrics_window import metrics_window
from subsoil_ros.analysis.series import read_series
from subsoil_ros.analysis.summarize import run_statistics
from subsoil_ros.api.read import recorded_run
from subsoil_ros.figures.plotting import COLOURS, new_figure, save_figure

from . import printed
from .comparison import TARGET, Reproduction, Row, reproduction
from .consistency import Statement

_BAR_ROWS = ("draft, cycle", "spring force", "share entry angle", "height of the shank's centre of mass")
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
        *printed.REFERENCE.notes,
    ]
    return "\n".join(lines) + "\n"


def statement_lines(found: tuple[Statement, ...], bullet: str = "") -> list[str]:
    """One line for each statement."""
    return [
        f"{bullet}{'Possible' if item.holds else 'Impossible'}: {item.claim}: {item.finding}."
        for item in found
    ]


def print_reproduction(table: Reproduction, console: Console | None = None) -> None:
    """The printed table, and the statements below it."""
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


def draw_reproduction(table: Reproduction, path: Path) -> Path:
    """Ours over the printed value, row by row; the band of the target in grey."""
    rows = [row for row in table.rows if row.quantity in _BAR_ROWS and row.published]
    figure = new_figure(9.0, 0.5 * len(rows) + 1.8)
    axes = figure.add_subplot()
    axes.axvspan(0.75, 1.25, color="#f2e6c9", zorder=0, label="within 25 %")
    axes.axvline(1.0, color=COLOURS["reference"], lw=1.0, ls="--", label="paper")
    for place, row in enumerate(rows):
        _mark(axes, place, row)
    axes.set_yticks(range(len(rows)), [f"{row.quantity}, {row.measure}" for row in rows], fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("ours over the printed value")
    axes.grid(alpha=0.3, axis="x")
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, -0.14), ncols=4, frameon=False, fontsize=8)
    axes.set_title(f"Results beside the paper's\n{table.scene}", fontsize=11)
    return save_figure(figure, path)


def _mark(axes: Axes, place: int, row: Row) -> None:
    assert row.published
    parts = (("window", row.inside, "o", "main"), ("outside the window", row.outside, "s", "share"))
    for label, value, marker, colour in parts:
        if value is not None:
            shown = label if place == 0 else None
            axes.plot(value / row.published, place, marker, color=COLOURS[colour], label=shown, ms=6)


def main() -> None:
    """Compares one run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    args = parser.parse_args()
    with recorded_run(args.run) as recorded:
        bag, resolved = recorded.bag, recorded.resolved
        series = read_series(bag, resolved.scene)
        window = metrics_window(series, resolved)
        statistics = run_statistics(bag, resolved, series, window)
        table = reproduction(resolved.scene, resolved.scene_hash, series, window, statistics)
        recorded.make_directory()
        write_reproduction(table, recorded.directory)
        draw_reproduction(table, recorded.directory / "reproduction.png")
        print_reproduction(table)


if __name__ == "__main__":
    main()
