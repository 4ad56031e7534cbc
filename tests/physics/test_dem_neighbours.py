"""The half list holds every pair in reach, once, whatever the crowd, the sizes and the sides; contacts keep
their histories from list to list."""

from typing import ClassVar

import numpy as np
import pytest

from subsoil_ros.contact_laws.base import SPRINGS
from subsoil_ros.contact_laws.linear.law import LinearLaw
from subsoil_ros.dem.blocks import BLOCK, history_blocks, history_place
from subsoil_ros.dem.contact import history_parity
from subsoil_ros.dem.neighbours import carry_pairs, cell_grid, half_list, sort_by_cell

REACH_M = 0.022
LOW, HIGH = np.array([0.0, 0.0, -0.1]), np.array([0.2, 0.1, 0.0])


def all_pairs(position: np.ndarray, limit: np.ndarray, period: float) -> set[tuple[int, int]]:
    """Pairs i < j closer than limit (n, n) [m], looked at one by one."""
    found = set()
    for i in range(len(position)):
        apart = position[i + 1 :] - position[i]
        if np.isfinite(period):
            apart[:, 1] -= period * np.round(apart[:, 1] / period)
        near = np.linalg.norm(apart, axis=1) < limit[i, i + 1 :]
        found |= {(i, int(j)) for j in i + 1 + np.flatnonzero(near)}
    return found


@pytest.mark.parametrize("sizes", [False, True], ids=["equal", "sizes"])
@pytest.mark.parametrize("period", [np.inf, 0.1], ids=["walls", "periodic"])
@pytest.mark.parametrize("count", [1, 70, 400, 4000])
def test_half_list_is_that_of_all_pairs(count: int, period: float, sizes: bool) -> None:
    """From one particle to 200 partners each: more than there is room for at first."""
    generator = np.random.default_rng(count)
    position = LOW + (HIGH - LOW) * generator.random((count, 3))
    position[count // 2 :, 0] *= 0.5  # denser on one side
    grid = cell_grid(position, REACH_M, LOW, HIGH, period)
    order, cell_start = sort_by_cell(position, grid)
    position = np.ascontiguousarray(position[order])
    smaller = 0.008 * generator.random(count) if sizes else np.zeros(count)
    row_start, neighbour = half_list(position, grid, cell_start, REACH_M, smaller if sizes else 0.0)
    listed = [(int(i), int(j)) for i in range(count) for j in neighbour[row_start[i] : row_start[i + 1]]]
    assert len(set(listed)) == len(listed)
    assert set(listed) == all_pairs(position, REACH_M - smaller[:, None] - smaller, period)


class OfBothParities(LinearLaw):
    """A law that keeps two numbers of a contact; the second changes its sign seen from the other sphere."""

    kept: ClassVar = {"even": 1, "odd": -1}


def half_rows(partners: list[list[int]]) -> tuple[np.ndarray, np.ndarray]:
    """A half list, from the partners of each particle."""
    row_start = np.cumsum([0, *map(len, partners)])
    return row_start, np.array([j for row in partners for j in row], np.int32)


def test_a_pair_whose_particles_change_places_turns_what_is_odd() -> None:
    """The springs and odd numbers change their sign, even ones stay; a new pair begins with zeros."""
    components = SPRINGS + 2
    kept = np.arange(1.0, components + 1)
    old = history_blocks(2, float, components)
    for pair, values in enumerate((kept, 10.0 * kept)):  # of 0 and 1, of 1 and 2
        old[history_place(pair, components) :: BLOCK] = values
    new = history_blocks(3, float, components)
    order = np.array([1, 0, 2])  # the first two change places
    carry_pairs(
        order,
        *half_rows([[1], [2], []]),
        old,
        *half_rows([[1, 2], [2], []]),
        new,
        history_parity(OfBothParities),
    )
    turned = np.array([-1.0] * SPRINGS + [1.0, -1.0]) * kept
    for pair, values in enumerate((turned, 10.0 * kept, 0.0 * kept)):
        np.testing.assert_array_equal(new[history_place(pair, components) :: BLOCK], values)
