"""Time functions as tables a kernel can read: value, rate and integral, all in closed form.

A law is a sum of chains; a chain is a row of pieces, each a polynomial plus a sine. Which piece holds is
chosen by a time of its own, so that a step ending exactly at a corner uses the piece before it, and the
next step the piece after.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..scene.time_functions import (
    LARGEST_DEGREE,
    ConstantLaw,
    HalfSineLaw,
    Law,
    PolynomialLaw,
    SimpleLaw,
    SineLaw,
    SumLaw,
    TableLaw,
)
from .compiled import inner_kernel, kernel

NO_LAW = -1
"""Index of a law that is zero at all times."""

PIECE = np.dtype(
    [
        ("start", np.float64),  # [s] the piece holds from here to the start of the next
        ("reference", np.float64),  # [s]
        ("degree", np.int64),
        (
            "coefficients",
            np.float64,
            LARGEST_DEGREE + 1,
        ),  # of powers of t - reference [unit of the law / s^k]
        ("amplitude", np.float64),  # of the sine [unit of the law], 0 without
        ("angular_frequency", np.float64),  # [rad/s], 1 without a sine
        ("phase", np.float64),  # [rad]
        ("integral", np.float64),  # from t = 0 to the reference [unit s]
    ],
    align=True,
)


class LawTable(NamedTuple):
    """All laws of a machine or of paths."""

    chains: np.ndarray  # (laws + 1,) int64: chains of law i are chains[i] to chains[i + 1]
    first: np.ndarray  # (chains + 1,) int64: pieces of chain i are first[i] to first[i + 1]
    pieces: np.ndarray  # (pieces,) PIECE


def tabulate(laws: Sequence[Law]) -> tuple[LawTable, np.ndarray]:
    """Tables of the laws, and the times t >= 0 [s] at which the slope of any law jumps, increasing."""
    terms = [list(law.terms) if isinstance(law, SumLaw) else [law] for law in laws]
    chains = [_pieces(term) for group in terms for term in group]
    first = np.cumsum([0, *(len(chain) for chain in chains)], dtype=np.int64)
    counts = np.cumsum([0, *(len(group) for group in terms)], dtype=np.int64)
    pieces = np.concatenate([np.zeros(0, dtype=PIECE), *chains])
    starts = pieces["start"]
    return LawTable(counts, first, pieces), np.unique(starts[starts >= 0.0])


def _rows(law: SimpleLaw) -> list[tuple[float, float, Sequence[float], tuple[float, float, float]]]:
    """Pieces of a law: start, reference, coefficients, (amplitude, angular frequency, phase)."""
    still = (0.0, 1.0, 0.0)
    if isinstance(law, SineLaw):
        wave = (law.amplitude, 2.0 * math.pi * law.frequency_hz, law.phase_rad)
        return [(-math.inf, 0.0, [law.mean], wave)]
    if isinstance(law, HalfSineLaw):
        turn, end = math.pi / law.duration_s, law.start_s + law.duration_s
        knock = (law.peak, turn, -turn * law.start_s)
        rise = (law.start_s, law.start_s, [0.0], knock)
        return [(-math.inf, 0.0, [0.0], still), rise, (end, end, [0.0], still)]
    if isinstance(law, PolynomialLaw):
        start, stop = law.start_s, law.end_s
        rows = [(-math.inf, start, [law.coefficients[0]], still), (start, start, law.coefficients, still)]
        if stop is not None:
            last = float(np.polynomial.polynomial.polyval(stop - start, law.coefficients))
            rows.append((stop, stop, [last], still))
        return rows
    if isinstance(law, ConstantLaw):
        return [(-math.inf, 0.0, [law.value], still)]
    if isinstance(law, TableLaw):
        times, values = law.times_s, law.values
    else:
        times, values = (law.start_s, law.end_s), (law.start_value, law.end_value)
    slopes = np.diff(values) / np.diff(times)
    inner = zip(times, values, slopes, strict=False)
    middle = [(time, time, [value, float(slope)], still) for time, value, slope in inner]
    return [(-math.inf, times[0], [values[0]], still), *middle, (times[-1], times[-1], [values[-1]], still)]


def _pieces(law: SimpleLaw) -> np.ndarray:
    """The chain (pieces,) PIECE of one law."""
    rows = _rows(law)
    pieces = np.zeros(len(rows), dtype=PIECE)
    for piece, (start, reference, coefficients, wave) in zip(pieces, rows, strict=True):
        piece["start"], piece["reference"] = start, reference
        piece["degree"] = len(coefficients) - 1
        piece["coefficients"][: len(coefficients)] = coefficients
        piece["amplitude"], piece["angular_frequency"], piece["phase"] = wave
    for before, piece in itertools.pairwise(pieces):
        piece["integral"] = before["integral"] + _travel.py_func(before, piece["reference"])
    origin = pieces[np.searchsorted(pieces["start"], 0.0, side="right") - 1]
    pieces["integral"] -= origin["integral"] + _travel.py_func(origin, 0.0)
    return pieces


@inner_kernel
def _piece(laws, chain, select):
    """Index of the piece of `chain` that holds at the time `select` [s]."""
    piece = laws.first[chain + 1] - 1
    while laws.pieces[piece]["start"] > select:
        piece -= 1
    return piece


@inner_kernel
def _travel(piece, time):
    """Integral of a piece from its reference to `time` [unit s]."""
    span = time - piece["reference"]
    total = 0.0
    for k in range(piece["degree"], -1, -1):
        total = total * span + piece["coefficients"][k] / (k + 1.0)
    total *= span
    if piece["amplitude"] != 0.0:
        frequency = piece["angular_frequency"]
        # cos(at the reference) - cos(at the time), without cancellation
        half = 0.5 * frequency * span
        swing = 2.0 * math.sin(half) * math.sin(frequency * piece["reference"] + half + piece["phase"])
        total += piece["amplitude"] / frequency * swing
    return total


@kernel
def law_value(laws, law, time, select):
    """Value of a law at `time` [s], on the piece that holds at `select` [s]."""
    total = 0.0
    if law < 0:
        return total
    for chain in range(laws.chains[law], laws.chains[law + 1]):
        piece = laws.pieces[_piece(laws, chain, select)]
        span = time - piece["reference"]
        value = 0.0
        for k in range(piece["degree"], -1, -1):
            value = value * span + piece["coefficients"][k]
        if piece["amplitude"] != 0.0:
            value += piece["amplitude"] * math.sin(piece["angular_frequency"] * time + piece["phase"])
        total += value
    return total


@kernel
def law_rate(laws, law, time, select):
    """Time derivative of a law [unit/s]."""
    total = 0.0
    if law < 0:
        return total
    for chain in range(laws.chains[law], laws.chains[law + 1]):
        piece = laws.pieces[_piece(laws, chain, select)]
        span = time - piece["reference"]
        rate = 0.0
        for k in range(piece["degree"], 0, -1):
            rate = rate * span + k * piece["coefficients"][k]
        if piece["amplitude"] != 0.0:
            frequency = piece["angular_frequency"]
            rate += piece["amplitude"] * frequency * math.cos(frequency * time + piece["phase"])
        total += rate
    return total


@kernel
def law_integral(laws, law, time, select):
    """Integral of a law from 0 to `time` [unit s]."""
    total = 0.0
    if law < 0:
        return total
    for chain in range(laws.chains[law], laws.chains[law + 1]):
        piece = laws.pieces[_piece(laws, chain, select)]
        total += piece["integral"] + _travel(piece, time)
    return total
