"""Neighbour search: cells, half list, and histories carried over from the previous lists."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from scipy.spatial import cKDTree

from .bed import Bed
from .blocks import BLOCK, history_place
from .compiled import inner_kernel
from .per_particle import PARTS, of_particle
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
    low_x, low_y, low_z = position[0, 0], position[0, 1], position[0, 2]
    high_x, high_y, high_z = low_x, low_y, low_z
    for i in range(1, position.shape[0]):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
        high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
    return np.array([low_x, low_y, low_z]), np.array([high_x, high_y, high_z])


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

_LANES = 8
"""Candidates tested together: one vector of float64."""

_USUAL_PARTNERS = 16
"""Partners per particle that the first search has room for: equal spheres have 7, rarely 13. Parts of the bed
that have more are searched again."""


@njit(cache=True, inline="always")
def axis_cell(value, origin, edge, count):
    return min(max(int((value - origin) / edge), 0), count - 1)


@njit(cache=True)
def sort_by_cell(position, grid):
    """Stable counting sort. Returns order (n,) and cell_start (cells + 1,)."""
    n = position.shape[0]
    cells = grid.nx * grid.ny * grid.nz
    cell = np.empty(n, np.int64)
    start = np.zeros(cells + 1, np.int64)
    for i in range(n):
        cx = axis_cell(position[i, 0], grid.origin_x, grid.edge, grid.nx)
        cy = axis_cell(position[i, 1], grid.origin_y, grid.edge_y, grid.ny)
        cz = axis_cell(position[i, 2], grid.origin_z, grid.edge, grid.nz)
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
def take_rows(array, order, taken_out):
    """Puts rows order[k] of `array` (n, m) into `taken_out`, in that order."""
    for k in prange(order.shape[0]):
        for a in range(array.shape[1]):
            taken_out[k, a] = array[order[k], a]


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


@inner_kernel(fastmath={"contract"})
def _find_pairs(cells, position, grid, cell_start, reach, smaller, room_out, count_out):
    """Partners of the particles of cells[0] <= cell < cells[1], one after the other, into found[begin:end],
    which are `room_out`, as long as there is room; `count_out` receives their number by particle. Returns the
    number of all, and the most candidates that a particle had.

    The candidates of a cell are gathered once. Each is written and then kept or overwritten, without a
    branch that could be mispredicted.
    """
    found, begin, end = room_out
    room = 64
    index, places, excess = np.empty(room, np.int32), np.empty((4, room)), np.empty(room)
    pairs, most, lows, highs = 0, 0, np.empty(_RUNS, np.int64), np.empty(_RUNS, np.int64)
    for cell in range(cells[0], cells[1]):
        first, last = cell_start[cell], cell_start[cell + 1]
        if first == last:
            continue
        column, cz = cell // grid.nz, cell % grid.nz
        candidates = 0
        for k in range(_RUNS):
            lows[k], highs[k] = _forward_range(grid, column // grid.ny, column % grid.ny, cz, k, cell_start)
            candidates += highs[k] - lows[k]
        most = max(most, candidates)
        if candidates + _LANES > room:
            room = 2 * candidates + _LANES
            index, places, excess = np.empty(room, np.int32), np.empty((4, room)), np.empty(room)
        x, y, z, limit = places[0], places[1], places[2], places[3]
        m = 0
        for k in range(_RUNS):
            for j in range(lows[k], highs[k]):
                index[m] = j
                x[m], y[m], z[m] = position[j, 0], position[j, 1], position[j, 2]
                limit[m] = reach - of_particle(smaller, j)
                m += 1
        for i in range(first, last):
            px, py, pz, less = position[i, 0], position[i, 1], position[i, 2], of_particle(smaller, i)
            after = i + 1 - first  # the first run begins with the cell itself
            for group in range(after, candidates, _LANES):
                for m in range(group, group + _LANES):
                    dx, dy, dz = x[m] - px, y[m] - py, z[m] - pz
                    if grid.period != np.inf:
                        dy = nearest_image(dy, grid.period)
                    allowed = limit[m] - less
                    excess[m] = dx * dx + dy * dy + dz * dz - allowed * allowed
            number = 0
            if begin + pairs + candidates <= end:
                for m in range(after, candidates):
                    found[begin + pairs + number] = index[m]
                    number += int(excess[m] < 0.0)
            else:
                for m in range(after, candidates):
                    number += int(excess[m] < 0.0)
            count_out[i] = number
            pairs += number
    return pairs, most


@njit(cache=True, parallel=True)
def half_list(position, grid, cell_start, reach, smaller):
    """Pairs i < j closer than `reach` [m] of particles sorted by cell: row_start (n + 1,), neighbour (p,).

    smaller [m]: the largest radius less that of each particle, (n,); zero for all if they are equal.
    """
    n = position.shape[0]
    first_cell = np.searchsorted(cell_start, np.arange(PARTS + 1) * n // PARTS)
    first_cell[PARTS] = cell_start.shape[0] - 1
    count = np.empty(n, np.int64)
    found = np.empty(n * _USUAL_PARTNERS, np.int32)
    most = np.zeros(PARTS, np.int64)
    for chunk in prange(PARTS):
        cells = first_cell[chunk], first_cell[chunk + 1]
        begin, end = cell_start[cells[0]] * _USUAL_PARTNERS, cell_start[cells[1]] * _USUAL_PARTNERS
        most[chunk] = _find_pairs(
            cells, position, grid, cell_start, reach, smaller, (found, begin, end), count
        )[1]
    row_start = np.zeros(n + 1, np.int64)
    for i in range(n):
        row_start[i + 1] = row_start[i] + count[i]
    neighbour = np.empty(row_start[n], np.int32)
    for chunk in prange(PARTS):
        cells = first_cell[chunk], first_cell[chunk + 1]
        first, last = cell_start[cells[0]], cell_start[cells[1]]
        pairs, begin = row_start[last] - row_start[first], first * _USUAL_PARTNERS
        if begin + pairs + most[chunk] <= last * _USUAL_PARTNERS:
            neighbour[row_start[first] : row_start[last]] = found[begin : begin + pairs]
        else:
            own = np.empty(pairs + most[chunk], np.int32)
            room = own, np.int64(0), own.shape[0]
            _find_pairs(cells, position, grid, cell_start, reach, smaller, room, count)
            neighbour[row_start[first] : row_start[last]] = own[:pairs]
    return row_start, neighbour


def endless_list(
    bed: Bed, position: np.ndarray, reach: float, smaller: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """The result of half_list, for an endless bed. Slower; for the preparation of beds."""
    low, size = np.array(bed.lower_m), np.array(bed.periods_m)
    inside = np.minimum(position - low, np.nextafter(size, 0.0))
    pair = cKDTree(inside, boxsize=size).query_pairs(reach, output_type="ndarray").astype(np.int32)
    apart = np.abs(inside[pair[:, 0]] - inside[pair[:, 1]])
    distance = np.linalg.norm(np.minimum(apart, size - apart), axis=1)
    own = np.broadcast_to(smaller, len(position))
    pair = pair[distance < reach - own[pair[:, 0]] - own[pair[:, 1]]]
    pair = pair[np.lexsort((pair[:, 1], pair[:, 0]))]
    row_start = np.searchsorted(pair[:, 0], np.arange(len(position) + 1)).astype(np.int64)
    return row_start, np.ascontiguousarray(pair[:, 1])


def slab_starts(cell_start: np.ndarray, grid: CellGrid, cells_per_slab: int) -> np.ndarray:
    """First particle of each slab of `cells_per_slab` cells along x, and the particle count."""
    planes = cell_start[:: grid.ny * grid.nz]
    starts = planes[:-1:cells_per_slab]
    return np.append(starts, cell_start[-1])


@njit(cache=True, parallel=True)
def carry_pairs(order, old_row, old_neighbour, old_history, row_start, neighbour, history, parity):
    """Fills `history` from the lists before the particles were put in `order`, and with zeros for new pairs.

    A pair whose particles changed places sees its contact from the other side: component a becomes parity[a]
    (components,) times what it was.
    """
    for i in prange(order.shape[0]):
        _carry_row(
            np.int64(i), order, old_row, old_neighbour, old_history, row_start, neighbour, history, parity
        )


@inner_kernel()
def _carry_row(i, order, old_row, old_neighbour, old_history, row_start, neighbour, history, parity):
    components = parity.shape[0]
    for k in range(row_start[i], row_start[i + 1]):
        first, second = order[i], order[neighbour[k]]
        turned = first > second
        if turned:
            first, second = second, first
        to = history_place(k, components)
        for a in range(components):
            history[to + a * BLOCK] = 0.0
        for m in range(old_row[first], old_row[first + 1]):
            if old_neighbour[m] == second:
                here = history_place(m, components)
                for a in range(components):
                    kept = old_history[here + a * BLOCK]
                    history[to + a * BLOCK] = parity[a] * kept if turned else kept
                break


def carry_rows(
    order: np.ndarray, old_particle: np.ndarray, particle: np.ndarray, old: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, ...]:
    """Rows of per-particle histories for `particle`, taken from the rows of `old_particle` (before `order`).

    Each array of `old` has one row per old particle; a particle that was not there gets zeros.
    """
    most = max(order.max(initial=0), old_particle.max(initial=0))
    row_of = np.full(most + 1, -1, np.int64)
    row_of[old_particle] = np.arange(len(old_particle))
    rows = row_of[order[particle]]
    known = rows >= 0
    carried = []
    for array in old:
        new = np.zeros((len(particle), *array.shape[1:]), array.dtype)
        new[known] = array[rows[known]]
        carried.append(new)
    return tuple(carried)
