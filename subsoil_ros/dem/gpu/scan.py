"""Prefix sums of integers, and sums of many numbers in an order that does not change.

Written here because CuPy and cuda.cccl do not run in numba's simulator, in which every change is tested.
"""

from typing import Any

import numpy as np
from numba import cuda, float64, int64

from .device import SIMULATED, THREADS, Launches, blocks

_ITEMS = 16
_TILE = THREADS * _ITEMS

SUM_BLOCKS = 2 if SIMULATED else 512
"""Blocks that add up a column, whatever its length, so that the order of the sum is that of its length."""


@cuda.jit(cache=True)
def _scan_tiles(counts, length, before, tile_sum):
    partial = cuda.shared.array(THREADS, int64)
    t = cuda.threadIdx.x
    first = cuda.blockIdx.x * _TILE + t * _ITEMS
    total = 0
    for k in range(first, min(first + _ITEMS, length)):
        total += counts[k]
    partial[t] = total
    cuda.syncthreads()
    reach = 1
    while reach < THREADS:
        more = 0
        if t >= reach:
            more = partial[t - reach]
        cuda.syncthreads()
        partial[t] += more
        cuda.syncthreads()
        reach *= 2
    running = partial[t] - total
    for k in range(first, min(first + _ITEMS, length + 1)):
        before[k] = running
        if k < length:
            running += counts[k]
    if t == THREADS - 1:
        tile_sum[cuda.blockIdx.x] = partial[t]


@cuda.jit(cache=True)
def _add_tiles(before, length, before_tile):
    k = cuda.grid(1)
    if k <= length:
        before[k] += before_tile[k // _TILE]


def add_scan(launches: Launches, counts: Any, length: int, before: Any) -> None:
    """`before` (length + 1,) int64 gets the sum of `counts` (length,) before each, and of all at the end."""
    tiles = length // _TILE + 1
    tile_sum = cuda.device_array(tiles, np.int64)
    launches.add(_scan_tiles, tiles, counts, length, before, tile_sum)
    if tiles > 1:
        before_tile = cuda.device_array(tiles + 1, np.int64)
        add_scan(launches, tile_sum, tiles, before_tile)
        launches.add(_add_tiles, blocks(length + 1), before, length, before_tile)


@cuda.jit(device=True)
def block_total(value, shared):
    """Sum of `value` over the threads of a block, in thread 0. `shared` (THREADS,) float64."""
    t = cuda.threadIdx.x
    shared[t] = value
    cuda.syncthreads()
    half = THREADS // 2
    while half > 0:
        if t < half:
            shared[t] += shared[t + half]
        cuda.syncthreads()
        half //= 2
    total = shared[0]
    cuda.syncthreads()
    return total


@cuda.jit(device=True)
def block_largest(value, shared):
    """Largest `value` of the threads of a block."""
    t = cuda.threadIdx.x
    shared[t] = value
    cuda.syncthreads()
    half = THREADS // 2
    while half > 0:
        if t < half:
            shared[t] = max(shared[t], shared[t + half])
        cuda.syncthreads()
        half //= 2
    largest = shared[0]
    cuda.syncthreads()
    return largest


@cuda.jit(cache=True)
def column_sums(rows, partial):
    """`partial` (SUM_BLOCKS, columns) of `rows` (n, columns): each block adds up the rows of its threads."""
    shared = cuda.shared.array(THREADS, float64)
    for column in range(rows.shape[1]):
        total = 0.0
        for k in range(cuda.grid(1), rows.shape[0], SUM_BLOCKS * THREADS):
            total += rows[k, column]
        total = block_total(total, shared)
        if cuda.threadIdx.x == 0:
            partial[cuda.blockIdx.x, column] = total
