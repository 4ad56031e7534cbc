"""Lists of the GPU to the form of the CPU's, and back, for checkpoints."""

import numpy as np

from ...contact_laws.base import SPRINGS
from ..blocks import BLOCK, history_blocks
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


def _block_places(pairs: int) -> np.ndarray:
    """dem.blocks.history_place of every pair."""
    k = np.arange(pairs)
    return k // BLOCK * (BLOCK * SPRINGS) + k % BLOCK


def half_rows(lists: dict[str, np.ndarray], kind: type) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """row_start, neighbour and history of dem.state.PairList."""
    row, place = _places(lists["count"], lists["slice_start"])
    listed = lists["neighbour"][place]
    held = listed >= 0
    partner = np.where(held, listed, ~listed)
    half = partner > row
    row, place, held, partner = row[half], place[half], held[half], partner[half]
    history = history_blocks(len(row), kind)
    to = _block_places(len(row))
    for a in range(SPRINGS):
        history[to + a * BLOCK] = np.where(held, lists["history"][a, place], 0)
    row_start = np.zeros(len(lists["count"]) + 1, np.int64)
    np.cumsum(np.bincount(row, minlength=len(lists["count"])), out=row_start[1:])
    return row_start, partner.astype(np.int32), history


def full_rows(pairs: PairList, kind: type) -> dict[str, np.ndarray]:
    """count, slice_start, neighbour and history (SPRINGS, places) of a half list.

    Pairs whose springs are all zero count as out of reach, which leaves them as they are.
    """
    n = len(pairs.row_start) - 1
    first = np.repeat(np.arange(n), np.diff(pairs.row_start))
    second = pairs.neighbour.astype(np.int64)
    of_pair = _block_places(len(first))
    springs = np.stack([pairs.history[of_pair + a * BLOCK] for a in range(SPRINGS)])
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
    held = (springs[:, pair] != 0.0).any(axis=0)
    neighbour[place] = np.where(held, partner[order], ~partner[order])
    history: np.ndarray = np.zeros((SPRINGS, len(neighbour)), kind)
    history[:, place] = springs[:, pair]
    return {"count": count, "slice_start": slice_start, "neighbour": neighbour, "history": history}


def wall_pairs(
    walls: dict[str, np.ndarray], planes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """particle, wall and history of dem.state.WallList, and the force of each pair (w, 3) [N].

    Every particle near a wall is listed with all walls, but not with periodic sides.
    """
    near, there = len(walls["particle"]), np.flatnonzero(np.isfinite(planes[:, 3]))
    particle, wall = np.repeat(walls["particle"], len(there)), np.tile(there, near)
    held = (walls["held"][:, None] >> there) & 1 == 1
    springs = walls["springs"].reshape(_WALLS, SPRINGS, near)[there]
    history: np.ndarray = history_blocks(len(particle), np.float64)
    to = _block_places(len(particle))
    for a in range(SPRINGS):
        history[to + a * BLOCK] = np.where(held, springs[:, a].T, 0.0).ravel()
    force = walls["force"].reshape(_WALLS, 3, near)[there].transpose(2, 0, 1).reshape(-1, 3)
    return particle, wall, history, np.ascontiguousarray(force)


def wall_rows(walls: WallList, force: np.ndarray, particles: int) -> dict[str, np.ndarray]:
    """Rows of near particles, and the first row of every particle, from pairs and their forces (w, 3)."""
    particle, to = np.unique(walls.particle, return_inverse=True)
    of_pair = _block_places(len(to))
    near = len(particle)
    springs = np.zeros((_WALLS, SPRINGS, near))
    forces = np.zeros((_WALLS, 3, near))
    held = np.zeros(near, np.int32)
    for a in range(SPRINGS):
        springs[walls.wall, a, to] = walls.history[of_pair + a * BLOCK]
    for a in range(3):
        forces[walls.wall, a, to] = force[:, a]
    for wall in range(_WALLS):
        held |= (springs[wall] != 0.0).any(axis=0).astype(np.int32) << wall
    row = np.searchsorted(particle, np.arange(particles + 1)).astype(np.int64)
    return {
        "row": row,
        "particle": particle,
        "held": held,
        "springs": springs.reshape(_WALLS * SPRINGS, near),
        "force": forces.reshape(_WALLS * 3, near),
    }
