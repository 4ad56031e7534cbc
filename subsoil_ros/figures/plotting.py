"""Code that all figures share."""

from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from jinja2 import Template

COLOURS = {"main": "#1f4e79", "share": "#c55a11", "wheels": "#548235", "reference": "#7f7f7f"}
CYCLE = ("#1f4e79", "#c55a11", "#548235", "#7030a0", "#bf9000", "#a31515", "#008080", "#7f7f7f", "#4d4d4d")
"""Colours of the curves of one kind, in order."""

SMOOTHED_S = 0.05
"""Curves are drawn pale as recorded, and as moving means over this: over the noise of single contacts and
well below a cycle."""

CYCLE_BINS = 24
"""Bars of the load cycles of a spring."""

_DPI = 130


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure [inch], independent of a display and of global state."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a PNG."""
    figure.savefig(path, dpi=_DPI)
    return path


def page_template(name: str) -> "Template":
    """A template of this folder for a web page; what it is given is escaped, and must be complete."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # of an extra that not all figures need

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)
