"""The ground as a height field of firm and loose soil: what a tool touches, pushing, sliding.

Volumes are of loose soil; none is lost (`spilled` is what left the bin). Soil without cohesion slides where
it is steeper than its friction angle. A bank of cohesive soil stands up to Culmann's height,
4 c / gamma sin(beta) cos(phi) / (1 - cos(beta - phi)) at the slope beta: K. Culmann, Die graphische Statik
(1866); D.W. Taylor, Fundamentals of Soil Mechanics (1948).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

BANK_CELLS = (1, 2, 4, 8)
"""Lengths over which the slope of a bank is taken, in cells."""

RING_CELLS = 4
"""Width of the ring around a tool whose mean height is that of the soil around it, in cells."""

FALLING = 0.1
"""Level speed over the speed up or down below which soil gives way to all sides instead of ahead."""

_STRAIGHT = ((1, 0), (0, 1), (1, 1), (1, -1))


class Ground(NamedTuple):
    """Columns (i, j) of the ground, x and y from the corner."""

    firm_m: Array  # (i, j) height of the firm soil's top
    loose_m: Array  # (i, j) loose soil on it
    under_m: Array  # (i, j) lowest point of the tool that is being moved; infinity where it is not
    spilled_m: Array  # (1,) height of a column that left the bin
    corner_m: tuple[float, float]
    cell_m: float
    lowest_m: float  # floor of the bin
    loose_friction_rad: float
    friction_rad: float
    swell: float  # volume of loose soil over that of the same soil when firm
    cohesion_height_m: float  # c over the unit weight
    loose_cohesion_height_m: float


class Pose(NamedTuple):
    """Where a tool is, and how it moves."""

    rotation: Array  # (3, 3)
    origin_m: Array  # (3,)
    velocity_m_per_s: Array  # (3,)
    spin_rad_per_s: Array  # (3,)


@njit(cache=True, error_model="numpy")
def cell_of(ground, x, y):
    """Column under a point; (-1, -1) beside the bin."""
    i = math.floor((x - ground.corner_m[0]) / ground.cell_m)
    j = math.floor((y - ground.corner_m[1]) / ground.cell_m)
    if 0 <= i < ground.firm_m.shape[0] and 0 <= j < ground.firm_m.shape[1]:
        return i, j
    return -1, -1


@njit(cache=True, error_model="numpy")
def turned(vectors, rotation):
    """Vectors (n, 3) turned; by BLAS it would take other cores."""
    found = np.empty_like(vectors)
    for k in range(len(vectors)):
        x, y, z = vectors[k, 0], vectors[k, 1], vectors[k, 2]
        for d in range(3):
            found[k, d] = rotation[d, 0] * x + rotation[d, 1] * y + rotation[d, 2] * z
    return found


@njit(cache=True, error_model="numpy")
def touch(ground, arms, origin, box):
    """Set `under_m` of the columns that a tool touches, in place of the old ones, in `box` (i, j, i, j).

    arms (n, 3): of the points of its surface, in world axes. Returns the mean height of the soil in the ring
    around, and whether the tool is within a cell of soil; NaN where all of it is beside the bin.
    """
    ground.under_m[box[0] : box[2], box[1] : box[3]] = np.inf
    box[0], box[1], box[2], box[3] = ground.firm_m.shape[0], ground.firm_m.shape[1], 0, 0
    per_cell, (rows, columns) = 1.0 / ground.cell_m, ground.firm_m.shape
    from_x, from_y = origin[0] - ground.corner_m[0], origin[1] - ground.corner_m[1]
    for k in range(arms.shape[0]):
        x, y = (from_x + arms[k, 0]) * per_cell, (from_y + arms[k, 1]) * per_cell
        if 0.0 <= x < rows and 0.0 <= y < columns:
            i, j = int(x), int(y)
            ground.under_m[i, j] = min(ground.under_m[i, j], origin[2] + arms[k, 2])
            box[0], box[1] = min(box[0], i), min(box[1], j)
            box[2], box[3] = max(box[2], i + 1), max(box[3], j + 1)
    total, count, close = 0.0, 0, False
    for i in range(max(box[0] - RING_CELLS, 0), min(box[2] + RING_CELLS, ground.firm_m.shape[0])):
        for j in range(max(box[1] - RING_CELLS, 0), min(box[3] + RING_CELLS, ground.firm_m.shape[1])):
            top = ground.firm_m[i, j] + ground.loose_m[i, j]
            if ground.under_m[i, j] == np.inf:
                total += top
                count += 1
            elif ground.under_m[i, j] < top + ground.cell_m:
                close = True
    if count == 0 and box[2] > box[0]:  # a tool as large as the bin
        return np.mean(ground.firm_m + ground.loose_m), close
    return (total / count if count > 0 else np.nan), close


@njit(cache=True, error_model="numpy")
def middle_of(ground, box):
    """x and y of the middle of a box of columns."""
    cell, corner = ground.cell_m, ground.corner_m
    return corner[0] + 0.5 * cell * (box[0] + box[2]), corner[1] + 0.5 * cell * (box[1] + box[3])


@njit(cache=True, error_model="numpy")
def push(ground, pose, middle, x, y, z, volume):
    """Lay soil on the first column without tool, where its motion drives it, or away from its middle; at the
    walls of the bin, on the last one before them."""
    v, w, o = pose.velocity_m_per_s, pose.spin_rad_per_s, pose.origin_m
    go_x = v[0] + w[1] * (z - o[2]) - w[2] * (y - o[1])
    go_y = v[1] + w[2] * (x - o[0]) - w[0] * (z - o[2])
    fall = v[2] + w[0] * (y - o[1]) - w[1] * (x - o[0])
    if math.hypot(go_x, go_y) <= FALLING * abs(fall):
        go_x, go_y = x - middle[0], y - middle[1]
    size = math.hypot(go_x, go_y)
    go_x, go_y = (go_x / size, go_y / size) if size > 0.0 else (1.0, 0.0)
    last, (rows, columns) = cell_of(ground, x, y), ground.firm_m.shape
    for k in range(1, 2 * (rows + columns)):
        i, j = cell_of(ground, x + 0.5 * k * ground.cell_m * go_x, y + 0.5 * k * ground.cell_m * go_y)
        if i < 0:
            break
        last = i, j
        if ground.under_m[i, j] == np.inf:
            ground.loose_m[i, j] += volume
            return
    if last[0] < 0:  # above a place beside the bin
        ground.spilled_m[0] += volume
    else:
        ground.loose_m[last] += volume


@njit(cache=True, error_model="numpy")
def stands(cohesion_height, friction, tall, run):
    """Whether a bank of this height over this length stands."""
    slope = math.atan2(tall, run)
    if slope <= friction:
        return True
    most = 4.0 * cohesion_height * math.sin(slope) * math.cos(friction)
    return tall * (1.0 - math.cos(slope - friction)) <= most


@njit(cache=True, error_model="numpy")
def slide(ground, box, found):
    """Let the soil in a box slide once; `found`: box of the columns that changed. Returns the largest amount
    that slid [m]."""
    nx, ny = ground.firm_m.shape
    found[0], found[1], found[2], found[3] = nx, ny, 0, 0
    worst, tangent = 0.0, math.tan(ground.loose_friction_rad)
    for i in range(max(box[0], 0), min(box[2], nx)):
        for j in range(max(box[1], 0), min(box[3], ny)):
            for di, dj in _STRAIGHT:
                k, m = i + di, j + dj
                if k >= nx or m < 0 or m >= ny:
                    continue
                steep = ground.cell_m * math.hypot(di, dj) * tangent
                step = ground.firm_m[i, j] + ground.loose_m[i, j] - ground.firm_m[k, m] - ground.loose_m[k, m]
                if abs(step) <= steep:
                    continue
                high, low = ((i, j), (k, m)) if step > 0.0 else ((k, m), (i, j))
                amount = _slid(ground, high, low, abs(step) - steep)
                if amount > 0.0:
                    worst = max(worst, amount)
                    found[0], found[1] = min(found[0], i), min(found[1], min(j, m))
                    found[2], found[3] = max(found[2], k + 1), max(found[3], max(j, m) + 1)
    return worst


@njit(cache=True, error_model="numpy")
def _slid(ground, high, low, excess):
    """Move soil from one column to a lower one; `excess` [m] over the slope. Returns how much moved."""
    amount = 0.5 * excess
    under = ground.under_m[low]
    if under < np.inf:  # soil slides under the tool up to it
        amount = min(amount, max(under - ground.firm_m[low] - ground.loose_m[low], 0.0))
    loose = 0.0
    if ground.loose_m[high] > 0.0:
        if not _bank_fails(ground, high, low, ground.loose_cohesion_height_m, ground.loose_friction_rad):
            return 0.0
        loose = min(ground.loose_m[high], amount)
    firm = 0.0
    if loose < amount and _bank_fails(ground, high, low, ground.cohesion_height_m, ground.friction_rad):
        firm = min((amount - loose) / ground.swell, ground.firm_m[high] - ground.lowest_m)
    ground.loose_m[high] -= loose
    ground.firm_m[high] -= firm
    ground.loose_m[low] += loose + ground.swell * firm
    return loose + firm


@njit(cache=True, error_model="numpy")
def _bank_fails(ground, high, low, cohesion_height, friction):
    """Whether soil at the crest of a bank fails, over one of BANK_CELLS."""
    di, dj = low[0] - high[0], low[1] - high[1]
    crest = ground.firm_m[high] + ground.loose_m[high]
    for n in BANK_CELLS:
        i, j = high[0] + n * di, high[1] + n * dj
        if not (0 <= i < ground.firm_m.shape[0] and 0 <= j < ground.firm_m.shape[1]):
            return False
        tall = crest - ground.firm_m[i, j] - ground.loose_m[i, j]
        if not stands(cohesion_height, friction, tall, n * ground.cell_m * math.hypot(di, dj)):
            return True
    return False
