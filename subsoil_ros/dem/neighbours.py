"""Neighbour search: cells, half list, walls. Histories are carried over from the lists before."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from .pairs import BLOCK, HISTORY, history_place
from .per_particle import of_particle
from .periodic import nearest_image


class CellGrid(NamedTuple):
    """Cells of edges >= the search reach over the bed, x-major, z fastest.

    Particles outside it belong to its outermost cells; that keeps neighbours in neighbouring cells. With a
    period, whole cells fill it in y, and the last one is beside the first.
    """

    origin_x: float  # [m]
    origin_y: float
    origin_z: float
    edge: float  # [m] along x and z
    edge_y: float  # [m]
    nx: int
    ny: int
    nz: int
    period: float  # [m] in y; infinite without


@njit(cache=True)
def _bounds(position):
    low, high = position[0].copy(), position[0].copy()
    for i in range(position.shape[0]):
        for a in range(3):
            low[a] = min(low[a], position[i, a])
            high[a] = max(high[a], position[i, a])
    return low, high


def cell_grid(
    position: np.ndarray, edge: float, low: np.ndarray, high: np.ndarray, period: float
) -> CellGrid:
    """Grid that covers the particles of `position` (n, 3) [m] between the corners `low` and `high` (3,) [m].

    period: in y [m], from low[1] on; infinite: none.
    """
    first, last = (np.clip(corner, low, high) for corner in _bounds(position))
    count = np.floor((last - first) / edge).astype(np.int64) + 1
    edge_y = edge
    if np.isfinite(period):
        first[1], count[1] = low[1], int(period / edge + 1e-9)
        edge_y = period / count[1]
    nx, ny, nz = count.tolist()
    return CellGrid(first[0], first[1], first[2], edge, edge_y, nx, ny, nz, period)


_RUNS = 6
"""Runs of _forward_range."""

_CHUNKS = 64
"""Parts of the particles that threads search one by one (chosen: enough to share them evenly)."""

_USUAL_PARTNERS = 16
"""Partners kept from count to list (chosen: equal spheres have 7, rarely 13); beyond, sought again."""


@njit(cache=True, inline="always")
def _axis_cell(value, origin, edge, count):
    return min(max(int((value - origin) / edge), 0), count - 1)


@njit(cache=True)
def sort_by_cell(position, grid):
    """Stable counting sort. Returns order (n,) and cell_start (cells + 1,)."""
    n = position.shape[0]
    cells = grid.nx * grid.ny * grid.nz
    cell = np.empty(n, np.int64)
    start = np.zeros(cells + 1, np.int64)
    for i in range(n):
        cx = _axis_cell(position[i, 0], grid.origin_x, grid.edge, grid.nx)
        cy = _axis_cell(position[i, 1], grid.origin_y, grid.edge_y, grid.ny)
        cz = _axis_cell(position[i, 2], grid.origin_z, grid.edge, grid.nz)
        cell[i] = (cx * grid.ny + cy) * grid.nz + cz
        start[cell[i] + 1] += 1
    for c in range(cells):
        start[c + 1] += start[c]
    place = start[:-1].copy()
    order = np.empty(n, np.int64)
    for i in range(n):
        order[place[cell[i]]] = i
        place[cell[i]] += 1
    return order, start


@njit(cache=True, parallel=True)
def take_rows(array, order):
    """Rows order[k] of `array` (n, m), in that order."""
    taken = np.empty((order.shape[0], array.shape[1]), array.dtype)
    for k in prange(order.shape[0]):
        for a in range(array.shape[1]):
            taken[k, a] = array[order[k], a]
    return taken


@njit(cache=True, inline="always")
def _forward_range(grid, cx, cy, cz, k, cell_start):
    """k-th of the six runs of particles that may follow a particle of cell (cx, cy, cz).

    Across the seam of a period the first row of cells looks back at the last one, so that the second of a
    pair always comes later in the order.
    """
    dx = 0 if k < 3 else 1
    dy = (0, 1, -1, -1, 0, 1)[k]
    x, y = cx + dx, cy + dy
    if k == 2 and y >= 0:
        return 0, 0
    if y < 0 or (y >= grid.ny and dx == 1):
        if grid.period == np.inf:
            return 0, 0
        y = y + grid.ny if y < 0 else 0
    if x >= grid.nx or y >= grid.ny:
        return 0, 0
    column = (x * grid.ny + y) * grid.nz
    low = max(cz - 1, 0) if k > 0 else cz
    high = min(cz + 1, grid.nz - 1)
    return cell_start[column + low], cell_start[column + high + 1]


@njit(cache=True)
def _row(i, position, grid, cell_start, reach, smaller, found):
    """Partners of particle i into found[:count]; returns the array, a longer one if need be, and the count.

    Every candidate is written and then kept or overwritten: no branch to guess wrongly.
    """
    px, py, pz = position[i, 0], position[i, 1], position[i, 2]
    cx = _axis_cell(px, grid.origin_x, grid.edge, grid.nx)
    cy = _axis_cell(py, grid.origin_y, grid.edge_y, grid.ny)
    cz = _axis_cell(pz, grid.origin_z, grid.edge, grid.nz)
    own_reach, count = reach - of_particle(smaller, i), 0
    for k in range(_RUNS):
        low, high = _forward_range(grid, cx, cy, cz, k, cell_start)
        low = max(low, i + 1)
        if count + high - low >= found.shape[0]:
            longer = np.empty(2 * (count + high - low), np.int32)
            longer[:count] = found[:count]
            found = longer
        for j in range(low, high):
            limit = own_reach - of_particle(smaller, j)
            dx, dy, dz = position[j, 0] - px, position[j, 1] - py, position[j, 2] - pz
            if grid.period != np.inf:
                dy = nearest_image(dy, grid.period)
            found[count] = j
            count += int(dx * dx + dy * dy + dz * dz < limit * limit)
    return found, count


@njit(cache=True)
def _find_rows(first, last, position, grid, cell_start, reach, smaller, count, partner):
    """Number of partners of the particles first <= i < last; the partners too where they fit into a row."""
    found = np.empty(256, np.int32)
    for i in range(first, last):
        found, number = _row(i, position, grid, cell_start, reach, smaller, found)
        count[i] = number
        if number <= partner.shape[1]:
            partner[i, :number] = found[:number]


@njit(cache=True)
def _fill_rows(first, last, position, grid, cell_start, reach, smaller, row_start, partner, neighbour):
    found = np.empty(256, np.int32)
    for i in range(first, last):
        begin, end = row_start[i], row_start[i + 1]
        if end - begin <= partner.shape[1]:
            neighbour[begin:end] = partner[i, : end - begin]
        else:
            found, number = _row(i, position, grid, cell_start, reach, smaller, found)
            neighbour[begin:end] = found[:number]


@njit(cache=True, parallel=True)
def half_list(position, grid, cell_start, reach, smaller):
    """Pairs i < j closer than `reach` [m] of particles sorted by cell: row_start (n + 1,), neighbour (p,).

    smaller [m]: how much less the radius of each particle is than that of the largest, (n,); zero for all
    where they are equal.
    """
    n = position.shape[0]
    count = np.empty(n, np.int64)
    partner = np.empty((n, _USUAL_PARTNERS), np.int32)
    for chunk in prange(_CHUNKS):
        _find_rows(
            chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS, position, grid, cell_start, reach, smaller,
            count, partner,
        )  # fmt: skip
    row_start = np.zeros(n + 1, np.int64)
    for i in range(n):
        row_start[i + 1] = row_start[i] + count[i]
    neighbour = np.empty(row_start[n], np.int32)
    for chunk in prange(_CHUNKS):
        _fill_rows(
            chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS, position, grid, cell_start, reach, smaller,
            row_start, partner, neighbour,
        )  # fmt: skip
    return row_start, neighbour


def slab_starts(cell_start: np.ndarray, grid: CellGrid, cells_per_slab: int) -> np.ndarray:
    """First particle of each slab of `cells_per_slab` cells along x, and the particle count."""
    planes = cell_start[:: grid.ny * grid.nz]
    starts = planes[:-1:cells_per_slab]
    return np.append(starts, cell_start[-1])


@njit(cache=True, parallel=True)
def carry_pairs(order, old_row, old_neighbour, old_history, row_start, neighbour, history):
    """Fills `history` with that of the pairs that were in the lists before the particles were put in `order`.

    A pair whose particles changed places sees its springs from the other side: the sign turns.
    """
    for i in prange(order.shape[0]):
        _carry_row(i, order, old_row, old_neighbour, old_history, row_start, neighbour, history)


@njit(cache=True)
def _carry_row(i, order, old_row, old_neighbour, old_history, row_start, neighbour, history):
    for k in range(row_start[i], row_start[i + 1]):
        first, second = order[i], order[neighbour[k]]
        turned = first > second
        if turned:
            first, second = second, first
        for m in range(old_row[first], old_row[first + 1]):
            if old_neighbour[m] == second:
                to, here = history_place(k), history_place(m)
                for a in range(HISTORY):
                    kept = old_history[here + a * BLOCK]
                    history[to + a * BLOCK] = -kept if turned else kept
                break


def carry_rows(
    order: np.ndarray, old_particle: np.ndarray, particle: np.ndarray, old: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, ...]:
    """Rows of per-particle histories for `particle`, taken from the rows of `old_particle` (before `order`).

    Each array of `old` has one row per old particle; a particle that was not there gets zeros.
    """
    row_of = np.full(len(order), -1, np.int64)
    row_of[old_particle] = np.arange(len(old_particle))
    rows = row_of[order[particle]]
    known = rows >= 0
    carried = []
    for array in old:
        new = np.zeros((len(particle), *array.shape[1:]), array.dtype)
        new[known] = array[rows[known]]
        carried.append(new)
    return tuple(carried)
