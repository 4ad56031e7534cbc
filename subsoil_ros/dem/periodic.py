"""Periodic sides: the bin as one slice of a bed that repeats itself in y.

Positions are put back into the box when the neighbour lists are built, and each particle keeps count of the
periods it was moved by. In between it may be outside by half a skin; pairs always take the nearest image.
"""

import math

import numpy as np
from numba import njit

from ..contact_laws.base import NO
from ..contact_laws.features import is_endless, is_periodic
from ..errors import SceneError
from ..scene.pair_laws import layer_soils, pair_values
from ..scene.soil import Soil
from .bed import Bed

SMALLEST_CELLS = 3
"""Cells across a period, so that two particles have one nearest image and two cells one border."""


TOOL_SKIN = 2.0
"""Skin of the tool search over that of pairs: tools are faster, and their short lists cost little."""


@njit(cache=True, inline="always")
def nearest_image(difference, period):
    """`difference` [m] of two places of one box to the nearest image; an infinite period changes nothing."""
    half = 0.5 * period
    if difference > half:
        return difference - period
    if difference < -half:
        return difference + period
    return difference


@njit(cache=True, inline="always")
def nearest_images(dx, dy, dz, features):
    """The differences of two places [m] to the nearest image."""
    if is_periodic(features):
        dy = nearest_image(dy, features.periodic.flat[0])
    if is_endless(features):
        dx = nearest_image(dx, features.periodic.flat[0])
        dy = nearest_image(dy, features.periodic.flat[1])
        dz = nearest_image(dz, features.periodic.flat[2])
    return dx, dy, dz


def periods(bed: Bed) -> np.ndarray:
    """Features.periodic of a bed."""
    if bed.sides == "endless":
        return np.array(bed.periods_m).reshape(1, 1, 3)
    return NO if bed.period_m is None else np.full((1, 1), bed.period_m)


def wrapped(y_m: np.ndarray, low_m: float, period_m: float) -> tuple[np.ndarray, np.ndarray]:
    """`y_m` (n,) moved into low <= y < low + period, and by how many periods, (n,) int64."""
    turns = np.floor((y_m - low_m) / period_m)
    inside = y_m - turns * period_m
    above = inside >= low_m + period_m  # where rounding put a place just below the lower border
    return np.where(above, low_m, inside), turns.astype(np.int64) + above


def up_to_mm(length_m: float) -> float:
    """`length_m` rounded up to whole millimetres, so that a limit in a message suffices as it is printed."""
    return math.ceil(1e3 * length_m - 1e-6) / 1e3  # a millionth of a millimetre is round-off


def refuse_narrow_period(bed: Bed, soil: Soil) -> None:
    """A period must hold SMALLEST_CELLS cells of the neighbour search.

    Raises:
        SceneError: it does not; the message has the smallest period.
    """
    if bed.period_m is None:
        return
    reach = max(pair_values(layer)[0].reach for layer in layer_soils(soil))
    smallest = SMALLEST_CELLS * (2.0 * soil.particles.bounds_m[1] + reach + soil.skin_m)
    if bed.period_m < smallest:
        raise SceneError(
            f"soil.bin.width_m: {soil.bin.width_m:g} m gives a bed with a period of {bed.period_m:.4g} m, "
            f"sides: periodic needs at least {up_to_mm(smallest):g} m, {SMALLEST_CELLS} times the reach of a "
            "particle with soil.skin_m; make the bin wider"
        )


def refuse_tool_at_seam(name: str, vertices_m: np.ndarray, bed: Bed, soil: Soil) -> None:
    """A tool must stay off periodic sides, or reach through both with one section: particles beyond the seam
    would not feel it.

    A planar tool never moves in y, so what holds at the start holds during the run; one that moves in space
    is checked in every soil step.

    Args:
        vertices_m: (v, 3) of the tool, y as in the world.

    Raises:
        SceneError: it ends nearer to the seam than the reach of a particle, or on one side beyond it.
    """
    if bed.period_m is None:
        return
    reach = tool_search_reach_m(soil)
    low, high = float(vertices_m[:, 1].min()), float(vertices_m[:, 1].max())
    right, left = (vertices_m[side] for side in _beyond(vertices_m[:, 1], bed, reach))
    if len(right) + len(left) == len(vertices_m) and _sections(right) == _sections(left):
        return
    if low - reach < bed.lower_m[1] or high + reach > bed.upper_m[1]:
        raise SceneError(
            f"tools.{name}: is from y = {low:.4g} to {high:.4g} m; with soil.bin.sides periodic it must stay "
            f"between {bed.lower_m[1] + reach:.4g} and {bed.upper_m[1] - reach:.4g} m, off the seam "
            "by the reach of a particle with the skin of its search, or go through both sides by that, with "
            "one section; widen soil.bin.width_m, use walls, or make the tool longer"
        )


HELD_LAYER = 2.0
"""Thickness of held soil over the largest radius: no particle passes it."""


def refuse_tool_at_held_side(name: str, vertices_m: np.ndarray, soil: Soil) -> None:
    """A tool must stay off soil that is held at the sides of a field, which cannot give way.

    Args:
        vertices_m: (v, 3) of the tool, y as in the world.

    Raises:
        SceneError: it comes nearer than a diameter of the largest particle.
    """
    if soil.bin.sides != "held":
        return
    largest = soil.particles.bounds_m[1]
    free = 0.5 * soil.bin.width_m - (HELD_LAYER + 2.0) * largest
    outermost = float(np.abs(vertices_m[:, 1]).max())
    if outermost > free:
        room = f"allowed is up to {free:.4g} m" if free > 0.0 else "no width is left for tools"
        raise SceneError(
            f"tools.{name}: reaches to y = {outermost:.4g} m; with soil.bin.sides held, {room}, a particle "
            "before the soil that is held: make soil.bin.width_m at least "
            f"{up_to_mm(soil.bin.width_m + 2.0 * (outermost - free)):g} m, or its sides periodic"
        )


def _beyond(y_m: np.ndarray, bed: Bed, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """(v,) bool each: which places are beyond the right and the left side by a reach."""
    return y_m <= bed.lower_m[1] - reach_m, y_m >= bed.upper_m[1] + reach_m


def _sections(vertices_m: np.ndarray) -> set[tuple[float, float]]:
    """x and z of the corners at one end of a prism, to 1 um."""
    return set(map(tuple, np.round(vertices_m[:, [0, 2]], 6).tolist()))


def tool_search_reach_m(soil: Soil) -> float:
    """Largest distance from a tool at which candidates are searched: radius, reach of the law, skin."""
    reach = max(pair_values(layer)[1].reach for layer in layer_soils(soil))
    return soil.particles.bounds_m[1] + reach + TOOL_SKIN * soil.skin_m
