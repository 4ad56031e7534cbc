"""One period of a field: copies of a block, which is periodic along x and y, cut to the field's width.

The copies tile the ground as squares do. A field lies across them at an angle, so that a tool
meets each copy at another place of its width and the draft does not repeat itself from block to block. With
periodic sides it lies along them, as its own period must be one of the ground.
"""

import math
from typing import NamedTuple

import numpy as np

from ..contact_laws.base import SPRINGS
from .bed import Bed

ALONG, ACROSS = ((1, 0), (0, 1)), ((21, 8), (13, 5))
"""Blocks along the ground's x and y from a copy to the next one in its row, and to one in the row beside.
Rows go along the field. With numbers of Fibonacci, the places where a tool cuts through the copies of a
period are spread evenly over the block: 8/22 of its edge from one to the next, 1/22 between the nearest."""


class Plot(NamedTuple):
    """Particles of one period of a field, sorted by x."""

    period_m: float
    half_width_m: float
    blocks: float  # lengths of a block in the period
    place_m: np.ndarray  # (n, 3), 0 <= x < period_m
    number: np.ndarray  # (n,) of the particle in the block
    turn: np.ndarray  # (2, 2), rotation of x and y of vectors from the block to the field

    def turned(self, history: np.ndarray) -> np.ndarray:
        """(p, components) histories of the block's contacts in the field: springs turn, a law's own numbers
        do not."""
        found = history.copy()
        for x in range(0, SPRINGS, 3):
            found[:, x : x + 2] = history[:, x : x + 2] @ self.turn.T
        return found


def plot_of(bed: Bed, width_m: float, sides: str) -> Plot:
    """The plot of a field of this width over a block, whose square has its corner at the bed's lower x and y.

    With periodic sides the width is rounded to whole blocks.
    """
    edge = bed.periods_m[0]
    half_width = 0.5 * (edge * max(1, round(width_m / edge)) if sides == "periodic" else width_m)
    next_in_row, beside = np.array(ALONG if sides == "periodic" else ACROSS)
    blocks = math.hypot(*next_in_row)
    turn = np.array((next_in_row, (-next_in_row[1], next_in_row[0]))) / blocks
    shift, apart = edge * (turn @ beside)
    period = edge * blocks
    first = (bed.positions_m[:, :2] - bed.lower_m[:2]) @ turn.T - (0.0, half_width)
    lowest = math.floor((-half_width - first[:, 1].max()) / apart)
    highest = math.ceil((half_width - first[:, 1].min()) / apart)
    copies = []
    for row in range(lowest, highest + 1):
        x, y = first[:, 0] + row * shift, first[:, 1] + row * apart
        inside = np.flatnonzero((y >= -half_width) & (y < half_width))
        x = x[inside] % period
        x[x >= period] = 0.0  # rounded up from just below zero
        place = np.column_stack((x, y[inside], bed.positions_m[inside, 2]))
        copies.append((place, inside))
    place, number = (np.concatenate(parts) for parts in zip(*copies, strict=True))
    order = np.argsort(place[:, 0], kind="stable")
    return Plot(period, half_width, blocks, place[order], number[order], turn)
