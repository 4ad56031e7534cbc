"""The table of a run's metrics, and the whole printed result."""

import sys
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..analysis.columns import (
    DRAFT,
    DRAFT_OF_SHARES,
    DRAFT_OF_WHEELS,
    Body,
    draft_of_tool,
    spring_element,
)
from ..analysis.summary import Summary
from ..loading.reference import Reference
from ..scene.scene import Scene
from .reference_table import print_reference
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
