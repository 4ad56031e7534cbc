"""The loose soil in a tool's cavity: how it comes in from the ground, slides, and leaves."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .terrain_field import BANK_CELLS, Array, cell_of, middle_of, push, stands

UPRIGHT = 0.2
"""Cosine between a cavity's up and the vertical below which it holds nothing: 78 degrees."""

SLACK_CELLS = 0.5
"""By how much a floor may be above soil that lies on it, in cells: a view shows a slope in steps."""

NEAREST = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
"""Columns that are tried in turn for soil that another view had beside a wall."""


class Cavity(NamedTuple):
    """Columns (a, b) of a View, and the loose soil in them; a tool that holds none has no column."""

    axes: Array
    corner_m: Array
    floor_m: Array
    walls_m: Array
    carried_m: Array  # (a, b) along up


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
def nearest(cavity, cell, pose, x, y, z):
    """The nearest column, a cell away at most, whose floor is not above a point but for SLACK_CELLS; (-1, -1)
    without one."""
    a, b, up = local_of(cavity, cell, pose, x, y, z)
    for da, db in NEAREST:
        if up - floor_at(cavity, a + da, b + db) >= -SLACK_CELLS * cell:  # not with NaN
            return a + da, b + db
    return -1, -1


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
                push(ground, pose, middle_of(ground, box), x, y, z, volume)


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
                    push(ground, pose, middle_of(ground, box), x, y, z, thick / count)
            old.carried_m[a, b] = 0.0


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
    push(ground, pose, middle_of(ground, box), x, y, z, cavity.carried_m[a, b])
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
