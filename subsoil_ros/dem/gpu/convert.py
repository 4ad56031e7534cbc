"""Lists of the GPU to the form of the CPU's, and back, for checkpoints and whatever is computed there."""

import numpy as np

from ..blocks import history_blocks, history_places
from ..particles import PairList, WallList
from ..walls import WALLS
from .device import WARP

_WALLS = len(WALLS)


def _places(count: np.ndarray, slice_start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Particle and place in the slices of every listed partner, row by row."""
    row = np.repeat(np.arange(len(count)), count)
    before = np.cumsum(count, dtype=np.int64) - count
    number = np.arange(len(row)) - before[row]
    return row, slice_start[row // WARP] + WARP * number + row % WARP


def _in_blocks(numbers: np.ndarray, kind: type) -> np.ndarray:
    """history_blocks of numbers (pairs, components)."""
    blocks = history_blocks(len(numbers), kind, numbers.shape[1])
    blocks[history_places(np.arange(len(numbers)), numbers.shape[1])] = numbers
    return blocks


def _from_blocks(blocks: np.ndarray, pairs: int, components: int) -> np.ndarray:
    """The numbers (pairs, components) of history_blocks."""
    return np.asarray(blocks[history_places(np.arange(pairs), components)])


def half_rows(
    lists: dict[str, np.ndarray], components: int, kind: type
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """row_start, neighbour and history of PairList, and the state of its bonds, in blocks too."""
    row, place = _places(lists["count"], lists["slice_start"])
    listed = lists["neighbour"][place]
    active = listed >= 0
    partner = np.where(active, listed, ~listed)
    half = partner > row
    row, place, active, partner = row[half], place[half], active[half], partner[half]
    numbers = lists["history"][:, place].T
    history = _in_blocks(np.where(active[:, None], numbers[:, :components], 0), kind)
    row_start = np.zeros(len(lists["count"]) + 1, np.int64)
    np.cumsum(np.bincount(row, minlength=len(lists["count"])), out=row_start[1:])
    return row_start, partner.astype(np.int32), history, _in_blocks(numbers[:, components:], kind)


def full_rows(
    pairs: PairList, components: int, bonds: np.ndarray | None, bond_numbers: int, kind: type
) -> dict[str, np.ndarray]:
    """The arrays of Rows, of a half list and its bonds.

    Pairs whose springs are all zero count as out of reach, which leaves them as they are.
    """
    n = len(pairs.row_start) - 1
    first = np.repeat(np.arange(n), np.diff(pairs.row_start))
    second = pairs.neighbour.astype(np.int64)
    numbers = _from_blocks(pairs.history, len(first), components).T
    touch = (numbers != 0.0).any(axis=0)
    if bonds is not None:
        numbers = np.concatenate((numbers, _from_blocks(bonds, len(first), bond_numbers).T))
    row, partner = np.concatenate((first, second)), np.concatenate((second, first))
    order = np.lexsort((partner, row))
    count = np.bincount(row, minlength=n).astype(np.int32)
    padded = np.zeros(-(-n // WARP) * WARP, np.int32)
    padded[:n] = count
    width = WARP * padded.reshape(-1, WARP).max(axis=1).astype(np.int64)
    slice_start = np.concatenate(([0], np.cumsum(width)))
    _, place = _places(count, slice_start)
    pair = order % len(first) if len(first) else order
    neighbour = np.zeros(slice_start[-1], np.int32)
    neighbour[place] = np.where(touch[pair], partner[order], ~partner[order])
    history: np.ndarray = np.zeros((len(numbers), len(neighbour)), kind)
    history[:, place] = numbers[:, pair]
    return {"count": count, "slice_start": slice_start, "neighbour": neighbour, "history": history}


def wall_pairs(
    walls: dict[str, np.ndarray], planes: np.ndarray, components: int
) -> tuple[WallList, np.ndarray]:
    """Pairs of particles and walls, and the force of each (w, 3) [N].

    Every particle near a wall is listed with all walls, but not with periodic sides.
    """
    near, there = len(walls["particle"]), np.flatnonzero(np.isfinite(planes[:, 3]))
    particle, wall = np.repeat(walls["particle"], len(there)), np.tile(there, near)
    active = (walls["active"][:, None] >> there) & 1 == 1
    springs = walls["springs"].reshape(_WALLS, components, near)[there].transpose(2, 0, 1)
    numbers = np.where(active[:, :, None], springs, 0.0).reshape(-1, components)
    force = walls["force"].reshape(_WALLS, 3, near)[there].transpose(2, 0, 1).reshape(-1, 3)
    return WallList(particle, wall, _in_blocks(numbers, np.float64)), np.ascontiguousarray(force)


def wall_rows(walls: WallList, force: np.ndarray, particles: int, components: int) -> dict[str, np.ndarray]:
    """The arrays of WallRows, from pairs and their forces (w, 3)."""
    particle, to = np.unique(walls.particle, return_inverse=True)
    near = len(particle)
    springs = np.zeros((_WALLS, components, near))
    forces = np.zeros((_WALLS, 3, near))
    active = np.zeros(near, np.int32)
    springs[walls.wall, :, to] = _from_blocks(walls.history, len(to), components)
    forces[walls.wall, :, to] = force
    for wall in range(_WALLS):
        active |= (springs[wall] != 0.0).any(axis=0).astype(np.int32) << wall
    row = np.searchsorted(particle, np.arange(particles + 1)).astype(np.int64)
    return {
        "row": row,
        "particle": particle,
        "active": active,
        "springs": springs.reshape(_WALLS * components, near),
        "force": forces.reshape(_WALLS * 3, near),
    }
