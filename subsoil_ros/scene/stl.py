"""STL files, binary or ASCII, as surfaces whose facets share vertices.

numpy does it here, because importing a library of meshes takes every process of a run a second.
"""

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

_MERGED = 1e8
"""Vertices that agree in this many parts of a unit are one: far below the float32 of a file of metres."""

_HEADER_BYTES = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.IGNORECASE | re.MULTILINE)


@dataclass(frozen=True)
class Surface:
    """Triangles in the units of their file.

    vertices: (n, 3) float64; facets: (m, 3) int64, counter-clockwise seen from outside.
    """

    vertices: NDArray[np.float64]
    facets: NDArray[np.int64]

    @property
    def triangles(self) -> NDArray[np.float64]:
        """Corners of the facets, (m, 3, 3)."""
        return self.vertices[self.facets]

    @property
    def twice_areas(self) -> NDArray[np.float64]:
        """Twice the area of each facet, (m,)."""
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        return np.linalg.norm(np.cross(b - a, c - a), axis=1)

    @property
    def edge_count(self) -> int:
        """Number of edges, each counted once."""
        return len(self._edge_uses)

    @property
    def open_edge_count(self) -> int:
        """Number of edges that only one facet has."""
        return int((self._edge_uses == 1).sum())

    @property
    def is_closed(self) -> bool:
        """Whether exactly two facets share each edge."""
        return bool((self._edge_uses == 2).all())

    @property
    def turns_one_way(self) -> bool:
        """Whether no two facets run along an edge in the same direction."""
        return len(_distinct(self._edges)[1]) == len(self._edges)

    def piece_volumes(self) -> NDArray[np.float64]:
        """Volume of each connected piece of a closed surface, (pieces,), negative inside out."""
        order = np.argsort(self._edge_of, kind="stable")
        one, other = (order // 3).reshape(-1, 2).T  # the two facets of each edge
        piece = np.arange(len(self.facets))
        while True:
            least = np.minimum(piece[one], piece[other])
            joined = piece.copy()
            np.minimum.at(joined, one, least)
            np.minimum.at(joined, other, least)
            joined = joined[joined]
            if (joined == piece).all():
                break
            piece = joined
        corners = self.triangles - self.vertices.mean(axis=0)
        sixfold = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        return np.bincount(np.unique(piece, return_inverse=True)[1], weights=sixfold) / 6.0

    @property
    def _edges(self) -> NDArray[np.int64]:
        """The three edges of each facet, from vertex to vertex, (3 m, 2)."""
        return np.stack([self.facets, np.roll(self.facets, -1, axis=1)], axis=2).reshape(-1, 2)

    @cached_property
    def _edge_of(self) -> NDArray[np.int64]:
        """Number of the edge, whatever its direction, of each row of _edges."""
        return _distinct(np.sort(self._edges, axis=1))[0]

    @property
    def _edge_uses(self) -> NDArray[np.int64]:
        """Number of facets that have each edge."""
        return np.bincount(self._edge_of)


def _distinct(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of the distinct row that each of rows (n, columns) is, (n,), and the first place of each."""
    number, first = np.unique(rows[:, 0], return_inverse=True)[1], np.empty(0, np.int64)
    for column in rows.T[1:]:
        values, value = np.unique(column, return_inverse=True)
        _, first, number = np.unique(number * len(values) + value, return_index=True, return_inverse=True)
    return number, first


def read_stl(content: bytes) -> Surface:
    """Surface in an STL file; equal vertices are merged, in the order in which they first come.

    Raises:
        ValueError: it is neither binary nor ASCII, holds no facet, or a coordinate is not finite.
    """
    corners = _binary(content)
    if corners is None:
        corners = _ascii(content)
    if len(corners) == 0:
        raise ValueError("holds no facets; it is empty or no STL file")
    if not np.isfinite(corners).all():
        raise ValueError("has coordinates that are not finite; export it again")
    rounded = (corners * _MERGED).round().astype(np.int64)
    same, first = _distinct(rounded)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return Surface(corners[first[order]], place[same].reshape(-1, 3))


def _binary(content: bytes) -> NDArray[np.float64] | None:
    """Corners of the facets (3 m, 3); None where the length is not that of the facets that it counts."""
    if len(content) < _HEADER_BYTES:
        return None
    count = int.from_bytes(content[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")
    if len(content) != _HEADER_BYTES + count * _FACET.itemsize:
        return None
    facets = np.frombuffer(content, _FACET, offset=_HEADER_BYTES)
    return facets["corners"].reshape(-1, 3).astype(np.float64)


def _ascii(content: bytes) -> NDArray[np.float64]:
    """Corners of the facets (3 m, 3)."""
    if not content.lstrip()[:5].lower() == b"solid":
        raise ValueError("holds no facets; it is empty or no STL file")
    try:
        corners = np.array(_VERTEX.findall(content), dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise ValueError(f"cannot be read as STL: {error}") from error
    if len(corners) % 3:
        raise ValueError(f"cannot be read as STL: has {len(corners)} vertices, which are no whole triangles")
    return corners
