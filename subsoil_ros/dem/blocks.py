"""Layout of the numbers of pairs in memory: histories in blocks, and scratch rows beside them.

A block holds BLOCK numbers of each component, one after the other, so that a law that runs along
them compiles to vector instructions.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ..contact_laws.base import SPRINGS
from .compiled import inner_kernel

BLOCK = 512
"""Pairs computed at a time (measured, 128 to 1024: one component of the histories is then a page, and a bed
larger than the cache streams a fifth faster than with 128)."""

_LINE_BYTES = 64
"""Bytes of a cache line and of the widest vector: a vector that crosses two lines costs twice as much."""

ROW = BLOCK + 16
"""Length of a scratch row: whole lines, but no power of two, so that the rows do not compete for the same
lines of the cache."""


def history_blocks(pairs: int, kind: type, components: int = SPRINGS) -> np.ndarray:
    """Array for `components` numbers of each of `pairs` pairs, starting on a cache line; uninitialised, but a
    last block that is not full is zero. Component c of pair k stands at history_place(k) + c * BLOCK."""
    size = BLOCK * components
    count, spare = -(-pairs // BLOCK) * size, _LINE_BYTES // np.dtype(kind).itemsize
    numbers: np.ndarray = np.empty(count + spare, kind)
    first = _first_on_line(numbers)
    numbers[first + pairs // BLOCK * size :] = 0.0
    return numbers[first : first + count]


@register_jitable
def _first_on_line(numbers):
    """Index of the first number of an array that starts a cache line."""
    return -numbers.ctypes.data % _LINE_BYTES // numbers.itemsize


@njit(cache=True, forceinline=True)
def history_place(pair, components=SPRINGS):
    """Place of the first of `components` numbers of a pair's history."""
    return pair // BLOCK * (BLOCK * components) + pair % BLOCK


def line_rows(count: int, width: int, kind: type) -> np.ndarray:
    """(count, width) zeros from the start of a cache line on, so that no row crosses two lines; other numbers
    follow (rows_from)."""
    spare: np.ndarray = np.zeros(count * width + _LINE_BYTES, kind)
    first = _first_on_line(spare)
    return spare[first : first + count * width].reshape(count, width)


def rows_from(rows: np.ndarray, first: int) -> np.ndarray:
    """What stands from number `first` of each of line_rows on, as rows of the same width, also without gaps:
    each ends with the numbers that the next one begins with."""
    if len(rows) == 0:
        return rows
    return np.lib.stride_tricks.as_strided(rows[:, first:], rows.shape, rows.strides)


def history_places(pair: np.ndarray, components: int) -> np.ndarray:
    """(p, components) places of the histories of pairs (p,) in an array of history_blocks."""
    first = pair // BLOCK * (BLOCK * components) + pair % BLOCK  # history_place
    return np.asarray(first[:, None] + BLOCK * np.arange(components))


@inner_kernel(forceinline=True)
def scratch_rows(count, kind):
    """`count` rows of ROW numbers, one after the other from the start of a cache line on; uninitialised."""
    spare = np.empty((count + 1) * ROW, kind)
    first = _first_on_line(spare)
    return spare[first : first + count * ROW]
