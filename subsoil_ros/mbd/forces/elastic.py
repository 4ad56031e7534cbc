"""Parts common to springs: the elastic part with its damper, the stops, and the modes of both.

mode = stop + STOPS * segment. Stop 0: free; 1: pressed at the lower end; 2: there, but with its force, which
would pull, set to zero; 3 and 4: the same at the upper end. Segment: 0 or 1 (off, on) with `acts_in`, or the
segment of the table.
"""

import math

import numpy as np

from ...scene.mechanism import RotationStops, TranslationStops
from ..kernel_options import inner_kernel
from .force_table import Builder

STOPS = 5
"""Number of states of a spring's stops."""


@inner_kernel
def _segment(model, force, stretch):
    """The segment of the table that holds at `stretch`."""
    segment = 0
    while segment < force.curve_count - 2 and model.curves[force.curve + segment + 1, 0] <= stretch:
        segment += 1
    return segment


@inner_kernel
def spring_push(model, force, mode, stretch, rate):
    """Push, its elastic part and the energy stored, `stretch` growing at `rate`; without the stops.

    A one-way spring stores energy only while it acts and its elastic part has the sign of its direction.
    """
    if force.curve_count > 0:
        row = force.curve + mode // STOPS
        place, start, energy = model.curves[row, 0], model.curves[row, 1], model.curves[row, 2]
        slope = (model.curves[row + 1, 1] - start) / (model.curves[row + 1, 0] - place)
        span = stretch - place
        elastic = start + slope * span
        stored = energy + span * (start + 0.5 * slope * span) + force.preload * stretch
        return elastic + force.preload + force.damping * rate, elastic + force.preload, stored
    elastic = force.stiffness * stretch
    total = elastic + force.preload + force.damping * rate
    stored = (0.5 * elastic + force.preload) * stretch
    if force.acts_in == 0:
        return total, elastic + force.preload, stored
    if mode // STOPS == 0:
        return 0.0, 0.0, 0.0
    if force.acts_in * elastic < 0.0:
        return total, 0.0, 0.0
    return total, elastic, stored


@inner_kernel
def _stop_push(force, mode, value, rate):
    """Push of the stops, its elastic part and the energy stored."""
    stop = mode % STOPS
    if stop == 0:
        return 0.0, 0.0, 0.0
    side = 1.0 if stop <= 2 else -1.0
    depth = force.lower - value if stop <= 2 else value - force.upper
    elastic = force.stop_stiffness * depth
    total = elastic - side * force.stop_damping * rate
    if stop == 2 or stop == 4:
        total = 0.0
    return side * total, side * elastic, 0.5 * elastic * depth


@inner_kernel
def push_at(model, force, mode, value, rate):
    """The same of spring and stops together, at a length or angle `value` that grows at `rate`."""
    push, elastic, stored = spring_push(model, force, mode, force.length - value, -rate)
    stop, stop_elastic, stop_stored = _stop_push(force, mode, value, rate)
    return push + stop, elastic + stop_elastic, stored + stop_stored


@inner_kernel
def spring_mode(model, force, stretch, rate, value, value_rate):
    """The mode of a spring and its stops."""
    segment, stop = 0, 0
    if force.curve_count > 0:
        segment = _segment(model, force, stretch)
    elif force.acts_in != 0:
        push = force.stiffness * stretch + force.damping * rate
        segment = 1 if force.acts_in * push > 0.0 else 0
    if value < force.lower:
        push = force.stop_stiffness * (force.lower - value) - force.stop_damping * value_rate
        stop = 1 if push > 0.0 else 2
    elif value > force.upper:
        push = force.stop_stiffness * (value - force.upper) + force.stop_damping * value_rate
        stop = 3 if push > 0.0 else 4
    return stop + STOPS * segment


@inner_kernel
def has_modes(force):
    """Whether a spring with stops has more than one mode."""
    return force.acts_in != 0 or force.curve_count > 0 or force.lower > -np.inf or force.upper < np.inf


def engaged_mode(force: np.void, curves: np.ndarray, mode: int) -> int:
    """Return the mode in which a stop and a one-way spring act, and a table is on its steepest segment."""
    segment, count = mode // STOPS, int(force["curve_count"])
    if count > 0:
        curve = curves[force["curve"] : force["curve"] + count]
        segment = int(np.abs(np.diff(curve[:, 1]) / np.diff(curve[:, 0])).argmax())
    elif force["acts_in"] != 0:
        segment = 1
    stop = 1 if math.isfinite(force["lower"]) else (3 if math.isfinite(force["upper"]) else 0)
    return stop + STOPS * segment


def fill_elastic(
    builder: Builder,
    row: np.ndarray,
    stiffness: float | None,
    preload: float,
    rest: float,
    table: tuple[tuple[float, ...], tuple[float, ...]] | None,
) -> None:
    """Fill in the elastic part; the preload of a linear spring becomes a longer free length."""
    row["stiffness"], row["preload"], row["length"] = stiffness or 0.0, preload, rest
    if table is not None:
        row["curve"], row["curve_count"] = len(builder.curves), len(table[0])
        builder.curves += _with_energy(*table)
    elif stiffness:
        row["length"], row["preload"] = rest + preload / stiffness, 0.0


def _with_energy(places: tuple[float, ...], forces: tuple[float, ...]) -> list[tuple[float, float, float]]:
    """(compression, force, energy) of every point; the energy is zero at zero compression."""
    x, f = np.array(places), np.array(forces)
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(x))])
    segment = int(np.clip(np.searchsorted(x, 0.0, side="right") - 1, 0, len(x) - 2))
    slope = (f[segment + 1] - f[segment]) / (x[segment + 1] - x[segment])
    span = 0.0 - x[segment]
    energy -= energy[segment] + span * (f[segment] + 0.5 * slope * span)
    return [(float(a), float(b), float(c)) for a, b, c in zip(x, f, energy, strict=True)]


def fill_stops(row: np.ndarray, stops: TranslationStops | RotationStops | None) -> None:
    """Fill in the stops of a spring or of a joint."""
    if stops is None:
        return
    if isinstance(stops, TranslationStops):
        lower, upper = stops.lower_m, stops.upper_m
        row["stop_stiffness"] = stops.stiffness_newton_per_m
        row["stop_damping"] = stops.damping_newton_s_per_m
    else:
        lower, upper = stops.lower_rad, stops.upper_rad
        row["stop_stiffness"] = stops.stiffness_newton_m_per_rad
        row["stop_damping"] = stops.damping_newton_m_s_per_rad
    row["lower"] = -math.inf if lower is None else lower
    row["upper"] = math.inf if upper is None else upper
