"""What all figures share."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

COLOURS = {"main": "#1f4e79", "share": "#c55a11", "wheels": "#548235", "reference": "#7f7f7f"}
CYCLE = ("#1f4e79", "#c55a11", "#548235", "#7030a0", "#bf9000", "#a31515", "#008080", "#7f7f7f", "#4d4d4d")
"""One after the other, where there are many of a kind."""

_DPI = 130


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inch] that no display and no global state knows of."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    """Writes a PNG."""
    figure.savefig(path, dpi=_DPI)
    return path
