"""Blocks that a wedge fails in: how many, how large, and what each bears in its cycle."""

import math


def bearing(phase: float, drop: float, gradual: bool) -> float:
    """Part of its strength that a block bears at a phase of its cycle, 0 to 1; it fails at 1."""
    return 1.0 - drop * (4.0 * phase * (1.0 - phase) if gradual else 1.0 - phase)


def mean_bearing(drop: float, gradual: bool) -> float:
    """`bearing` on average over the cycle."""
    return 1.0 - drop * (2.0 / 3.0 if gradual else 0.5)


def block_number(depth_m: float, size_m: float | None) -> float:
    """Blocks in a wedge of this depth. They have one size, so their number goes as the depth squared; up to
    the depth `size_m`, or without one, there is one."""
    return 1.0 if size_m is None else max(depth_m / size_m, 1.0) ** 2


def block_sizes(blocks: float) -> list[float]:
    """Part of the wedge that each block is; the last one may be a fraction of a block."""
    return [min(blocks - number, 1.0) / blocks for number in range(math.ceil(blocks))]
