"""The ground as a height field of firm and loose soil, and the loose soil in a tool's cavity: cutting,
pushing, sliding. Volumes are of loose soil; none is lost (`spilled` is what left the bin).

Slopes: soil without cohesion slides where it is steeper than its friction angle. A bank of cohesive soil
stands up to Culmann's height, 4 c / gamma sin(beta) cos(phi) / (1 - cos(beta - phi)) at the slope
beta: K. Culmann, Die graphische Statik (1866); D.W. Taylor, Fundamentals of Soil Mechanics (1948).
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

UPRIGHT = 0.2
"""Cosine between a cavity's up and the vertical below which it holds nothing: 78 degrees."""

NEAREST = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
"""Columns that are tried in turn for soil that another view had beside a wall."""

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


class Cavity(NamedTuple):
    """Columns (a, b) of a View, and the loose soil in them; a tool that holds none has no column."""

    axes: Array
    corner_m: Array
    floor_m: Array
    walls_m: Array
    carried_m: Array  # (a, b) along up


@njit(cache=True, error_model="numpy")
def cell_of(ground, x, y):
    """Column under a point; (-1, -1) beside the bin."""
    i = math.floor((x - ground.corner_m[0]) / ground.cell_m)
    j = math.floor((y - ground.corner_m[1]) / ground.cell_m)
    if 0 <= i < ground.firm_m.shape[0] and 0 <= j < ground.firm_m.shape[1]:
        return i, j
    return -1, -1


@njit(cache=True, error_model="numpy")
def local_of(cavity, cell, pose, x, y, z):
    """Column (a, b), perhaps beyond the grid, and coordinate up of a world point."""
    m, e = pose.rotation, cavity.axes
    dx, dy, dz = x - pose.origin_m[0], y - pose.origin_m[1], z - pose.origin_m[2]
    q0 = m[0, 0] * dx + m[1, 0] * dy + m[2, 0] * dz
    q1 = m[0, 1] * dx + m[1, 1] * dy + m[2, 1] * dz
    q2 = m[0, 2] * dx + m[1, 2] * dy + m[2, 2] * dz
    a = math.floor((e[0, 0] * q0 + e[0, 1] * q1 + e[0, 2] * q2 - cavity.corner_m[0]) / cell)
    b = math.floor((e[1, 0] * q0 + e[1, 1] * q1 + e[1, 2] * q2 - cavity.corner_m[1]) / cell)
    return a, b, e[2, 0] * q0 + e[2, 1] * q1 + e[2, 2] * q2


@njit(cache=True, error_model="numpy")
def floor_at(cavity, a, b):
    """Floor of a column; NaN beyond the grid."""
    if 0 <= a < cavity.floor_m.shape[0] and 0 <= b < cavity.floor_m.shape[1]:
        return cavity.floor_m[a, b]
    return np.nan


@njit(cache=True, error_model="numpy")
def world_of(cavity, cell, pose, a, b, up):
    """World point at the height `up` of the tool's axes in the middle of a column; a, b may be fractions."""
    e, m, o = cavity.axes, pose.rotation, pose.origin_m
    along, across = cavity.corner_m[0] + cell * (a + 0.5), cavity.corner_m[1] + cell * (b + 0.5)
    q0 = e[0, 0] * along + e[1, 0] * across + e[2, 0] * up
    q1 = e[0, 1] * along + e[1, 1] * across + e[2, 1] * up
    q2 = e[0, 2] * along + e[1, 2] * across + e[2, 2] * up
    return (
        o[0] + m[0, 0] * q0 + m[0, 1] * q1 + m[0, 2] * q2,
        o[1] + m[1, 0] * q0 + m[1, 1] * q1 + m[1, 2] * q2,
        o[2] + m[2, 0] * q0 + m[2, 1] * q1 + m[2, 2] * q2,
    )


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
def cut(ground, cavity, pose, box, at_start):
    """Move the soil above the tool's lowest points into its cavity, or ahead of it; at the start, that is not
    heaped up but removed."""
    for i in range(box[0], box[2]):
        for j in range(box[1], box[3]):
            under = max(ground.under_m[i, j], ground.lowest_m)
            top = ground.firm_m[i, j] + ground.loose_m[i, j]
            if top <= under:
                continue
            x = ground.corner_m[0] + (i + 0.5) * ground.cell_m
            y = ground.corner_m[1] + (j + 0.5) * ground.cell_m
            z = 0.5 * (top + under)
            a, b, up = local_of(cavity, ground.cell_m, pose, x, y, z)
            floor = floor_at(cavity, a, b)
            if math.isnan(floor) and nearest(cavity, ground.cell_m, pose, x, y, z)[0] >= 0:
                continue  # just before a lip or beside a wall, which reaches the middle later
            loose = min(ground.loose_m[i, j], top - under)
            firm = max(top - under - loose, 0.0)
            ground.loose_m[i, j] -= loose
            ground.firm_m[i, j] -= firm
            volume = loose + ground.swell * firm
            if up >= floor:
                cavity.carried_m[a, b] += volume
            elif not at_start:
                _push(ground, pose, middle_of(ground, box), x, y, z, volume)


@njit(cache=True, error_model="numpy")
def middle_of(ground, box):
    """x and y of the middle of a box of columns."""
    cell, corner = ground.cell_m, ground.corner_m
    return corner[0] + 0.5 * cell * (box[0] + box[2]), corner[1] + 0.5 * cell * (box[1] + box[3])


@njit(cache=True, error_model="numpy")
def _push(ground, pose, middle, x, y, z, volume):
    """Lay soil on the first column without tool, where its motion drives it, or away from its middle; at the
    walls of the bin, on the last one before them."""
    v, w, o = pose.velocity_m_per_s, pose.spin_rad_per_s, pose.origin_m
    go_x = v[0] + w[1] * (z - o[2]) - w[2] * (y - o[1])
    go_y = v[1] + w[2] * (x - o[0]) - w[0] * (z - o[2])
    fall = v[2] + w[0] * (y - o[1]) - w[1] * (x - o[0])
    if math.hypot(go_x, go_y) <= 0.1 * abs(fall):
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


@njit(cache=True, error_model="numpy")
def settle(ground, cavity, pose, box):
    """Let the soil in a cavity slide once, in it, out of it and into it."""
    shape = cavity.floor_m.shape
    world = cavity.axes @ pose.rotation.T  # rows: the axes of the columns in the world
    ways = ground.cell_m * world[0], ground.cell_m * world[1]
    up = world[2, 2]
    for a in range(shape[0]):
        for b in range(shape[1]):
            if math.isnan(cavity.floor_m[a, b]):
                continue
            if up < UPRIGHT:
                _drop(ground, cavity, pose, box, a, b)
                continue
            for axis in range(2):
                for way in (-1, 1):
                    c, d = (a + way, b) if axis == 0 else (a, b + way)
                    wall = cavity.walls_m[axis, min(a, c), min(b, d)]
                    if math.isnan(cavity.floor_m[c, d]):
                        _over_rim(ground, cavity, pose, a, b, c, d, wall, up)
                    elif way > 0:
                        _between(ground, cavity, (ways[axis], world[2]), (a, b), (c, d), wall)


@njit(cache=True, error_model="numpy")
def regrid(ground, old, new, pose, box):
    """Move the soil of a cavity to the columns of another view; what is in none of them leaves the tool."""
    cell = ground.cell_m
    for a in range(old.floor_m.shape[0]):
        for b in range(old.floor_m.shape[1]):
            thick = old.carried_m[a, b]
            count = math.ceil(thick / cell)
            for k in range(count):
                x, y, z = world_of(old, cell, pose, a, b, old.floor_m[a, b] + (k + 0.5) * thick / count)
                c, d = nearest(new, cell, pose, x, y, z)
                if c >= 0:
                    new.carried_m[c, d] += thick / count
                else:
                    _push(ground, pose, middle_of(ground, box), x, y, z, thick / count)
            old.carried_m[a, b] = 0.0


@njit(cache=True, error_model="numpy")
def nearest(cavity, cell, pose, x, y, z):
    """The nearest column, a cell away at most, whose floor is not above a point; (-1, -1) without one."""
    a, b, up = local_of(cavity, cell, pose, x, y, z)
    for da, db in NEAREST:
        if up - floor_at(cavity, a + da, b + db) >= -0.5 * cell:  # not with NaN
            return a + da, b + db
    return -1, -1


@njit(cache=True, error_model="numpy")
def drift(cavity, cell, way):
    """Move soil in a cavity by a way [m] in the world's axes turned to the tool's, up to the next wall."""
    shape, carried = cavity.floor_m.shape, cavity.carried_m
    for axis in range(2):
        part = cavity.axes[axis] @ way / cell
        go = 1 if part > 0.0 else -1
        part = min(abs(part), 1.0)
        before = carried.copy()
        for a in range(shape[0]):
            for b in range(shape[1]):
                if before[a, b] == 0.0:
                    continue
                c, d = (a + go, b) if axis == 0 else (a, b + go)
                if math.isnan(cavity.floor_m[c, d]):
                    continue
                above = cavity.floor_m[a, b] + before[a, b] - cavity.walls_m[axis, min(a, c), min(b, d)]
                amount = part * min(max(above, 0.0), before[a, b])
                carried[a, b] -= amount
                carried[c, d] += amount


@njit(cache=True, error_model="numpy")
def _drop(ground, cavity, pose, box, a, b):
    """Let all soil of a column fall."""
    x, y, z = world_of(cavity, ground.cell_m, pose, a, b, cavity.floor_m[a, b])
    _push(ground, pose, middle_of(ground, box), x, y, z, cavity.carried_m[a, b])
    cavity.carried_m[a, b] = 0.0


@njit(cache=True, error_model="numpy")
def _apart(ways, count, rise):
    """Level distance and height to a point some columns and, along up, a rise [m] away; `ways`: those of a
    column and of 1 m up, in the world."""
    one, up = ways
    x, y = count * one[0] + rise * up[0], count * one[1] + rise * up[1]
    return math.hypot(x, y), count * one[2] + rise * up[2]


@njit(cache=True, error_model="numpy")
def _between(ground, cavity, ways, here, there, wall):
    """Let soil slide between two columns of the cavity, over the wall between."""
    floor, carried = cavity.floor_m, cavity.carried_m
    if carried[here] == 0.0 and carried[there] == 0.0:
        return
    one, other = floor[here] + carried[here], floor[there] + carried[there]
    run, rise = _apart(ways, 1, other - one)
    excess = abs(rise) - math.tan(ground.loose_friction_rad) * run
    if excess <= 0.0:
        return
    high, low, top, way = (here, there, one, 1) if rise < 0.0 else (there, here, other, -1)
    amount = min(0.5 * excess / ways[1][2], carried[high], max(top - wall, 0.0))
    if amount > 0.0 and not _heap_stands(ground, cavity, ways, way, high, low):
        carried[high] -= amount
        carried[low] += amount


@njit(cache=True, error_model="numpy")
def _heap_stands(ground, cavity, ways, way, high, low):
    """Whether the soil of a column stands over those that follow in one direction, up to the rim."""
    if ground.loose_cohesion_height_m == 0.0:
        return False
    top = cavity.floor_m[high] + cavity.carried_m[high]
    for n in BANK_CELLS:
        c, d = high[0] + n * (low[0] - high[0]), high[1] + n * (low[1] - high[1])
        floor = floor_at(cavity, c, d)
        if math.isnan(floor):
            return True
        run, rise = _apart(ways, way * n, floor + cavity.carried_m[c, d] - top)
        if not stands(ground.loose_cohesion_height_m, ground.loose_friction_rad, -rise, run):
            return False
    return True


@njit(cache=True, error_model="numpy")
def _over_rim(ground, cavity, pose, a, b, c, d, wall, up):
    """Let soil slide between a column of the cavity and the ground beside it."""
    top = cavity.floor_m[a, b] + cavity.carried_m[a, b]
    x, y, z = world_of(cavity, ground.cell_m, pose, a, b, top)
    u, v, w = world_of(cavity, ground.cell_m, pose, a + 1.5 * (c - a), b + 1.5 * (d - b), top)
    i, j = cell_of(ground, u, v)
    ground_top = -np.inf
    if i >= 0:
        ground_top = ground.firm_m[i, j] + ground.loose_m[i, j]
    run = math.hypot(x - u, y - v)
    limit = run * math.tan(ground.loose_friction_rad)
    if z - ground_top > limit:
        rim = w + up * (max(wall, cavity.floor_m[a, b]) - top)  # the heap stands on it, whatever is below
        if stands(ground.loose_cohesion_height_m, ground.loose_friction_rad, z - max(ground_top, rim), run):
            return
        amount = min(0.5 * (z - ground_top - limit) / up, cavity.carried_m[a, b], max(top - wall, 0.0))
        cavity.carried_m[a, b] -= amount
        if i >= 0:
            ground.loose_m[i, j] += amount
        else:
            ground.spilled_m[0] += amount
    elif ground_top - z > limit and ground.under_m[i, j] == np.inf:
        if ground.loose_cohesion_height_m > 0.0:
            return
        _, _, over = world_of(cavity, ground.cell_m, pose, a, b, max(wall, top))
        amount = min(0.5 * (ground_top - z - limit), ground_top - over)
        if amount > 0.0:
            loose = min(ground.loose_m[i, j], amount)
            firm = 0.0
            if ground.cohesion_height_m == 0.0:
                firm = min((amount - loose) / ground.swell, ground.firm_m[i, j] - ground.lowest_m)
            ground.loose_m[i, j] -= loose
            ground.firm_m[i, j] -= firm
            cavity.carried_m[a, b] += loose + ground.swell * firm
