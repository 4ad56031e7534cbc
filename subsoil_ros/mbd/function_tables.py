"""Time functions as tables a kernel can read: value, rate and integral, all in closed form.

A time function is a sum of chains; a chain is a row of segments, each a polynomial plus a sine. A separate
argument, the time `select`, chooses the segment, so that a step ending exactly at a breakpoint uses the
segment before, and the next step the segment after.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..scene.time_laws import (
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
from .kernel_options import inner_kernel, kernel

NO_FUNCTION = -1
"""Index of a function that is zero at all times."""

SEGMENT = np.dtype(
    [
        ("start", np.float64),  # [s] the segment holds from here to the start of the next
        ("reference", np.float64),  # [s]
        ("degree", np.int64),
        ("coefficients", np.float64, LARGEST_DEGREE + 1),  # of powers of t - reference [its unit / s^k]
        ("amplitude", np.float64),  # of the sine [unit of the function], 0 without
        ("angular_frequency", np.float64),  # [rad/s], 1 without a sine
        ("phase", np.float64),  # [rad]
        ("integral", np.float64),  # from t = 0 to the reference [unit s]
    ],
    align=True,
)


class FunctionTable(NamedTuple):
    """All time functions of a machine or of paths."""

    chains: np.ndarray  # (functions + 1,) int64: chains of function i are chains[i] to chains[i + 1]
    first: np.ndarray  # (chains + 1,) int64: segments of chain i are first[i] to first[i + 1]
    segments: np.ndarray  # (segments,) SEGMENT


class FunctionList:
    """Collects time functions and gives each its index."""

    def __init__(self) -> None:
        self.functions: list[Law] = []

    def add(self, function: Law | None) -> int:
        """Add a function and return its index; NO_FUNCTION for None."""
        if function is None:
            return NO_FUNCTION
        self.functions.append(function)
        return len(self.functions) - 1


def tabulate(functions: Sequence[Law]) -> tuple[FunctionTable, np.ndarray]:
    """Return the tables of functions, and the times t >= 0 [s], increasing, at which a slope jumps."""
    terms = [list(function.terms) if isinstance(function, SumLaw) else [function] for function in functions]
    chains = [_segments(term) for group in terms for term in group]
    first = np.cumsum([0, *(len(chain) for chain in chains)], dtype=np.int64)
    counts = np.cumsum([0, *(len(group) for group in terms)], dtype=np.int64)
    segments = np.concatenate([np.zeros(0, dtype=SEGMENT), *chains])
    starts = segments["start"]
    return FunctionTable(counts, first, segments), np.unique(starts[starts >= 0.0])


def _rows(function: SimpleLaw) -> list[tuple[float, float, Sequence[float], tuple[float, float, float]]]:
    """Segments of a time function: start, reference, coefficients, (amplitude, angular frequency, phase)."""
    still = (0.0, 1.0, 0.0)
    if isinstance(function, SineLaw):
        wave = (function.amplitude, 2.0 * math.pi * function.frequency_hz, function.phase_rad)
        return [(-math.inf, 0.0, [function.mean], wave)]
    if isinstance(function, HalfSineLaw):
        turn, end = math.pi / function.duration_s, function.start_s + function.duration_s
        knock = (function.peak, turn, -turn * function.start_s)
        rise = (function.start_s, function.start_s, [0.0], knock)
        return [(-math.inf, 0.0, [0.0], still), rise, (end, end, [0.0], still)]
    if isinstance(function, PolynomialLaw):
        start, stop = function.start_s, function.end_s
        rows = [
            (-math.inf, start, [function.coefficients[0]], still),
            (start, start, function.coefficients, still),
        ]
        if stop is not None:
            last = float(np.polynomial.polynomial.polyval(stop - start, function.coefficients))
            rows.append((stop, stop, [last], still))
        return rows
    if isinstance(function, ConstantLaw):
        return [(-math.inf, 0.0, [function.value], still)]
    if isinstance(function, TableLaw):
        times, values = function.times_s, function.values
    else:
        times, values = (function.start_s, function.end_s), (function.start_value, function.end_value)
    slopes = np.diff(values) / np.diff(times)
    inner = zip(times, values, slopes, strict=False)
    middle = [(time, time, [value, float(slope)], still) for time, value, slope in inner]
    return [(-math.inf, times[0], [values[0]], still), *middle, (times[-1], times[-1], [values[-1]], still)]


def _segments(function: SimpleLaw) -> np.ndarray:
    """The chain (segments,) SEGMENT of one function."""
    rows = _rows(function)
    segments = np.zeros(len(rows), dtype=SEGMENT)
    for segment, (start, reference, coefficients, wave) in zip(segments, rows, strict=True):
        segment["start"], segment["reference"] = start, reference
        segment["degree"] = len(coefficients) - 1
        segment["coefficients"][: len(coefficients)] = coefficients
        segment["amplitude"], segment["angular_frequency"], segment["phase"] = wave
    for before, segment in itertools.pairwise(segments):
        segment["integral"] = before["integral"] + _travel.py_func(before, segment["reference"])
    origin = segments[np.searchsorted(segments["start"], 0.0, side="right") - 1]
    segments["integral"] -= origin["integral"] + _travel.py_func(origin, 0.0)
    return segments


@inner_kernel
def _segment(functions, chain, select):
    """Index of the segment of `chain` that holds at the time `select` [s]."""
    segment = functions.first[chain + 1] - 1
    while functions.segments[segment]["start"] > select:
        segment -= 1
    return segment


@inner_kernel
def _travel(segment, time):
    """Integral of a segment from its reference to `time` [unit s]."""
    span = time - segment["reference"]
    total = 0.0
    for k in range(segment["degree"], -1, -1):
        total = total * span + segment["coefficients"][k] / (k + 1.0)
    total *= span
    if segment["amplitude"] != 0.0:
        frequency = segment["angular_frequency"]
        # cos(at the reference) - cos(at the time), without cancellation
        half = 0.5 * frequency * span
        swing = 2.0 * math.sin(half) * math.sin(frequency * segment["reference"] + half + segment["phase"])
        total += segment["amplitude"] / frequency * swing
    return total


@kernel
def function_value(functions, function, time, select):
    """Value of a function at `time` [s], on the segment that holds at `select` [s]."""
    total = 0.0
    if function < 0:
        return total
    for chain in range(functions.chains[function], functions.chains[function + 1]):
        segment = functions.segments[_segment(functions, chain, select)]
        span = time - segment["reference"]
        value = 0.0
        for k in range(segment["degree"], -1, -1):
            value = value * span + segment["coefficients"][k]
        if segment["amplitude"] != 0.0:
            value += segment["amplitude"] * math.sin(segment["angular_frequency"] * time + segment["phase"])
        total += value
    return total


@kernel
def function_rate(functions, function, time, select):
    """Time derivative of a function [unit/s]."""
    total = 0.0
    if function < 0:
        return total
    for chain in range(functions.chains[function], functions.chains[function + 1]):
        segment = functions.segments[_segment(functions, chain, select)]
        span = time - segment["reference"]
        rate = 0.0
        for k in range(segment["degree"], 0, -1):
            rate = rate * span + k * segment["coefficients"][k]
        if segment["amplitude"] != 0.0:
            frequency = segment["angular_frequency"]
            rate += segment["amplitude"] * frequency * math.cos(frequency * time + segment["phase"])
        total += rate
    return total


@kernel
def function_integral(functions, function, time, select):
    """Integral of a function from 0 to `time` [unit s]."""
    total = 0.0
    if function < 0:
        return total
    for chain in range(functions.chains[function], functions.chains[function + 1]):
        segment = functions.segments[_segment(functions, chain, select)]
        total += segment["integral"] + _travel(segment, time)
    return total
