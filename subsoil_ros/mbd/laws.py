"""Laws of time as tables a kernel can read: value, rate and integral, all in closed form.

A law is a chain of linear pieces plus one sine. Which piece holds is chosen by a time of its own, so
that a step ending exactly at a corner uses the piece before it, and the next step the piece after.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..scene.laws import ConstantLaw, Law, RampLaw, SineLaw, TableLaw
from .compiled import inner_kernel, kernel

NO_LAW = -1
"""Index of a law that is zero at all times."""

PIECE = np.dtype(
    [
        ("start", np.float64),  # [s] the piece holds from here to the start of the next
        ("reference", np.float64),  # [s]
        ("value", np.float64),  # at the reference [unit of the law]
        ("slope", np.float64),  # [unit/s]
        ("integral", np.float64),  # from t = 0 to the reference [unit s]
    ],
    align=True,
)


class LawTable(NamedTuple):
    """All laws of a machine or of paths."""

    first: np.ndarray  # (laws + 1,) int64: pieces of law i are first[i] to first[i + 1]
    pieces: np.ndarray  # (pieces,) PIECE
    amplitude: np.ndarray  # (laws,) float64 [unit of the law], 0 without a sine
    angular_frequency: np.ndarray  # (laws,) float64 [rad/s], 1 without a sine
    phase: np.ndarray  # (laws,) float64 [rad]


def tabulate(laws: Sequence[Law]) -> tuple[LawTable, np.ndarray]:
    """Tables of the laws, and the times t >= 0 [s] at which the slope of any law jumps, increasing."""
    chains = [_pieces(law) for law in laws]
    first = np.zeros(len(laws) + 1, dtype=np.int64)
    first[1:] = np.cumsum([len(chain) for chain in chains])
    pieces = np.concatenate([np.zeros(0, dtype=PIECE), *chains])
    sines = [
        (law.amplitude, 2.0 * math.pi * law.frequency_hz, law.phase_rad)
        if isinstance(law, SineLaw)
        else (0.0, 1.0, 0.0)
        for law in laws
    ]
    amplitude, angular_frequency, phase = np.array(sines, dtype=np.float64).reshape(-1, 3).T.copy()
    starts = pieces["start"]
    corners = np.unique(starts[starts >= 0.0])
    return LawTable(first, pieces, amplitude, angular_frequency, phase), corners


def _pieces(law: Law) -> np.ndarray:
    """The linear pieces (n,) PIECE of one law."""
    if isinstance(law, TableLaw):
        times, values = law.times_s, law.values
    elif isinstance(law, RampLaw):
        times, values = (law.start_s, law.end_s), (law.start_value, law.end_value)
    else:
        times, values = (0.0,), (law.value if isinstance(law, ConstantLaw) else law.mean,)
    rows = [(-math.inf, times[0], values[0], 0.0)]
    for i in range(len(times) - 1):
        rows.append((times[i], times[i], values[i], (values[i + 1] - values[i]) / (times[i + 1] - times[i])))
    if len(times) > 1:
        rows.append((times[-1], times[-1], values[-1], 0.0))
    pieces = np.zeros(len(rows), dtype=PIECE)
    for name, column in zip(("start", "reference", "value", "slope"), zip(*rows, strict=True), strict=True):
        pieces[name] = column
    spans = np.diff(pieces["reference"])
    means = pieces["value"][:-1] + 0.5 * pieces["slope"][:-1] * spans
    pieces["integral"][1:] = np.cumsum(spans * means)
    origin = pieces[np.searchsorted(pieces["start"], 0.0, side="right") - 1]
    back = 0.0 - origin["reference"]
    pieces["integral"] -= origin["integral"] + back * (origin["value"] + 0.5 * origin["slope"] * back)
    return pieces


@inner_kernel
def _piece(laws, law, select):
    """Index of the piece of `law` that holds at the time `select` [s]."""
    piece = laws.first[law + 1] - 1
    while laws.pieces[piece].start > select:
        piece -= 1
    return piece


@kernel
def law_value(laws, law, time, select):
    """Value of a law at `time` [s], on the piece that holds at `select` [s]."""
    if law < 0:
        return 0.0
    piece = laws.pieces[_piece(laws, law, select)]
    turn = laws.angular_frequency[law] * time + laws.phase[law]
    return piece.value + piece.slope * (time - piece.reference) + laws.amplitude[law] * math.sin(turn)


@kernel
def law_rate(laws, law, time, select):
    """Time derivative of a law [unit/s]."""
    if law < 0:
        return 0.0
    frequency = laws.angular_frequency[law]
    turn = frequency * time + laws.phase[law]
    return laws.pieces[_piece(laws, law, select)].slope + laws.amplitude[law] * frequency * math.cos(turn)


@kernel
def law_integral(laws, law, time, select):
    """Integral of a law from 0 to `time` [unit s]."""
    if law < 0:
        return 0.0
    piece = laws.pieces[_piece(laws, law, select)]
    span = time - piece.reference
    half = 0.5 * laws.angular_frequency[law] * time
    # cos(phase) - cos(2 half + phase), without cancellation
    swing = 2.0 * math.sin(half) * math.sin(half + laws.phase[law])
    wave = laws.amplitude[law] / laws.angular_frequency[law] * swing
    return piece.integral + span * (piece.value + 0.5 * piece.slope * span) + wave
