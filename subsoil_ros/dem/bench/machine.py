"""Upper bounds of this machine, one core: memory bandwidth and floating-point rate."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

TRIAD_DOUBLES = 60_000_000
"""Length of each of three arrays: 1.4 GB in all, beyond any cache."""

FLOP_ROUNDS = 2_000_000
CHAINS = 64
"""Independent sums: enough to fill every vector unit and its latency."""


@njit
def _triad(a, b, c, factor):
    for i in range(a.shape[0]):
        a[i] = b[i] + factor * c[i]


@njit(fastmath={"contract"})
def _multiply_add(sums, factor, rounds):
    for _ in range(rounds):
        for k in range(CHAINS):
            sums[k] = sums[k] * factor + factor


def triad_bytes_per_s() -> float:
    """Bandwidth of a = b + s c [bytes/s], three passes counted as in STREAM: best of five."""
    a, b, c = (np.ones(TRIAD_DOUBLES) for _ in range(3))
    return 24.0 * TRIAD_DOUBLES / _best(lambda: _triad(a, b, c, 0.5))


def flops_per_s() -> float:
    """Double-precision multiply-adds in vectors [flop/s], two operations each: best of five."""
    sums = np.ones(CHAINS)
    return 2.0 * CHAINS * FLOP_ROUNDS / _best(lambda: _multiply_add(sums, 0.5, FLOP_ROUNDS))


def _best(work: Callable[[], Any]) -> float:
    """Least CPU time of five calls [s], after one that compiles."""
    work()
    times = []
    for _ in range(5):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)
