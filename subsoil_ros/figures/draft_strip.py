"""The draft up to a moment, as a strip under the pictures of a film."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..analysis.series import Series, moving_mean
from .plotting import COLOURS, SMOOTHED_S

_DPI = 100


class DraftStrip:
    """Draws the draft of one run, pale as recorded and as a moving mean, with a mark at the moment."""

    def __init__(self, series: Series, size: tuple[int, int], first_s: float, last_s: float) -> None:
        """size: of a strip, pixels. Its axis goes from first_s to last_s [s]."""
        self._times_s = series["time_s"]
        shown = (self._times_s >= first_s) & (self._times_s <= last_s)
        self._curves = [series["draft_newton"], moving_mean(series, "draft_newton", SMOOTHED_S)]
        figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI, layout="constrained")
        self._canvas = FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        axes.set_xlim(first_s, last_s)
        axes.set_ylim(0.0, 1.05 * max(1.0, np.max(self._curves[0][shown], initial=0.0)))
        axes.set_xlabel("time [s]", fontsize=8)
        axes.set_ylabel("draft [N]", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
        self._lines = [
            axes.plot([], [], color=COLOURS["main"], alpha=alpha, linewidth=width)[0]
            for alpha, width in ((0.25, 0.8), (1.0, 1.6))
        ]
        (self._mark,) = axes.plot([], [], "o", color=COLOURS["share"], markersize=4)

    def draw(self, time_s: float) -> NDArray[np.uint8]:
        """The strip at a moment, (height, width, 3)."""
        past = self._times_s <= time_s
        for line, values in zip(self._lines, self._curves, strict=True):
            line.set_data(self._times_s[past], values[past])
        self._mark.set_data(self._times_s[past][-1:], self._curves[1][past][-1:])
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[:, :, :3]
