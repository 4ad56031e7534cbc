"""What all figures share."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

COLOURS = {"main": "#1f4e79", "share": "#c55a11", "wheels": "#548235", "reference": "#7f7f7f"}
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
