"""Bounds on the speed of a particle-step, from the bytes it moves and the operations it does.

Counted in the sources of subsoil_ros/dem/pairs.py, contact.py and integration.py (README.md shows the count);
whoever changes what a kernel reads, writes or computes counts anew.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from benchmarks.throughput import Throughput

PARTICLE_BYTES = {"float64": 564, "mixed": 340}
"""float64: kick_drift 332 (both half kicks and the drift; reads rows of 32, 64 and 64 bytes and a vector of
float32, writes the rows), pair_forces 232 (reads the rows, writes one of 64; one row start). mixed: the rows
of 64 half as long, 204 + 136."""

LISTED_PAIR_BYTES = {"float64": 104, "mixed": 56}
"""Numbers of both particles 8, shear and roll read and written 96 or 48. The other particle's rows are in a
cache."""

PAIR_FLOPS = 200
"""Operations of a listed pair, in reach or not: geometry 38, normal 15, tangential 57, rolling 43, forces and
torques on both 35, zero where it is out of reach 12. Root, quotient and maximum count as one each,
also where a root is found by Newton steps."""

LANES = {"float64": 1.0, "mixed": 2.0}
"""Operations of one vector instruction, over those in float64."""

PARTICLE_FLOPS = 40
"""Both half kicks, the drift and the distance moved."""


@dataclass(frozen=True)
class Roofline:
    """Bounds of one case on one core."""

    name: str
    bytes_per_particle_step: float
    flops_per_particle_step: float
    bandwidth_bound_per_s: float  # particle-steps, every byte from memory
    arithmetic_bound_per_s: float  # particle-steps, every operation part of a vector multiply-add
    part_reached: float  # of the lower bound


def roofline(line: Throughput, bandwidth_bytes_per_s: float, flops_per_s: float) -> Roofline:
    """Bounds from the pairs of a measured case."""
    listed, kind = line.listed_pairs_per_particle, line.precision
    moved = PARTICLE_BYTES[kind] + LISTED_PAIR_BYTES[kind] * listed
    done = PARTICLE_FLOPS + PAIR_FLOPS * listed
    by_bytes, by_flops = bandwidth_bytes_per_s / moved, LANES[kind] * flops_per_s / done
    reached = line.particle_steps_per_cpu_s / min(by_bytes, by_flops)
    return Roofline(line.name, moved, done, by_bytes, by_flops, reached)


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
