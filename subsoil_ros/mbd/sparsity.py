"""Entries of Phi_q that can differ from zero, and an order of coordinates and constraints with a narrow band.

The order is the reverse Cuthill-McKee order of the graph whose nodes are bodies and joints (George & Liu
1981, Computer Solution of Large Sparse Positive Definite Systems). A chain of any length has a band of a few
diagonals, and its equations are solved at a cost proportional to its length.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from .joints import kind_of
from .machine_arrays import Sparsity


def sparsity_of(joints: np.ndarray, body_count: int) -> Sparsity:
    """Structure of a machine; `joints` (joints,) JOINT with their rows numbered."""
    coordinates = 3 * body_count
    rows = [[c for c in row if c < coordinates] for joint in joints for row in kind_of(joint).columns(joint)]
    first = np.cumsum([0, *(len(row) for row in rows)], dtype=np.int64)
    columns = np.array([c for row in rows for c in row], dtype=np.int64)
    order = _graph_order(joints, body_count)
    row_order: list[int] = []
    column_order: list[int] = []
    both: list[int] = []  # coordinates, and rows after them
    for node in order:
        if node < body_count:
            mine = [3 * node, 3 * node + 1, 3 * node + 2]
            column_order += mine
            both += mine
        else:
            joint = joints[node - body_count]
            numbers = [int(joint["row"]) + i for i in range(len(kind_of(joint).columns(joint)))]
            row_order += numbers
            both += [coordinates + number for number in numbers]
    place = np.zeros(len(both), dtype=np.int64)
    place[both] = np.arange(len(both))
    rows_of_entries = np.repeat(np.arange(len(rows)), np.diff(first))
    spans = np.abs(place[coordinates + rows_of_entries] - place[columns])
    return Sparsity(
        first=first,
        columns=columns,
        row_order=np.array(row_order, dtype=np.int64),
        column_order=np.array(column_order, dtype=np.int64),
        place=place,
        band=int(spans.max(initial=0)),
    )


def _graph_order(joints: np.ndarray, body_count: int) -> list[int]:
    """Bodies, and joints numbered after them, in reverse Cuthill-McKee order; the ground is no node."""
    count = body_count + len(joints)
    edges = {
        (int(joint[key]), body_count + i) for i, joint in enumerate(joints) for key in ("body_a", "body_b")
    }
    pairs = np.array(sorted(edge for edge in edges if edge[0] < body_count), dtype=np.int64).reshape(-1, 2)
    ends = (np.concatenate([pairs[:, 0], pairs[:, 1]]), np.concatenate([pairs[:, 1], pairs[:, 0]]))
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(count, count)).tocsr()
    return [int(node) for node in reverse_cuthill_mckee(graph, symmetric_mode=True)]
