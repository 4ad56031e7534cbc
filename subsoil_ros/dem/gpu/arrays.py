"""Arrays of a soil on the GPU: rows of partners, of particles near walls, and of candidates of tools.

The named tuples go into kernels as they are.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from ..particles import ToolList
from ..tools.contacts import CONTACTS
from ..tools.facets import Facets
from ..tools.forces import ToolLoads
from ..walls import WALLS
from .device import WARP


class Rows(NamedTuple):
    """Partners of every particle."""

    count: Any
    slice_start: Any
    neighbour: Any
    history: Any  # (numbers, places): of the contact, then of the bond

    @classmethod
    def empty(cls, particles: int, room: int, numbers: int, kind: type) -> "Rows":
        """Rows with so many places; springs that a law does not have stay zero."""
        slices = -(-particles // WARP)
        return cls(
            cuda.device_array(particles, np.int32),
            cuda.device_array(slices + 1, np.int64),
            cuda.device_array(room, np.int32),
            cuda.to_device(np.zeros((numbers, room), kind)),
        )

    def taken(self, places: int) -> dict[str, np.ndarray]:
        """Copies of the arrays, cut to the places that are taken."""
        count, slice_start, neighbour, history = (array.copy_to_host() for array in self)
        return {
            "count": count,
            "slice_start": slice_start,
            "neighbour": neighbour[:places],
            "history": history[:, :places],
        }


class WallRows(NamedTuple):
    """Particles near walls."""

    row: Any  # (n + 1,) first row of a particle
    particle: Any
    active: Any  # a bit for each wall
    springs: Any  # (WALLS * components, rows)
    force: Any  # (WALLS * 3, rows)

    @classmethod
    def empty(cls, particles: int, room: int, components: int) -> "WallRows":
        """Rows with room for so many particles."""
        of_walls = len(WALLS)
        return cls(
            cuda.device_array(particles + 1, np.int64),
            cuda.device_array(room, np.int64),
            cuda.device_array(room, np.int32),
            cuda.to_device(np.zeros((of_walls * components, room))),
            cuda.to_device(np.zeros((of_walls * 3, room))),
        )

    def taken(self, rows: int) -> dict[str, np.ndarray]:
        """Copies of the arrays but `row`, cut to so many particles."""
        return {
            name: array.copy_to_host()[..., :rows] for name, array in self._asdict().items() if name != "row"
        }


class ToolRows(NamedTuple):
    """Candidates of one tool: dem.particles.ToolList."""

    row: Any
    particle: Any
    facet_start: Any
    facet: Any
    active: Any
    normal: Any
    shear: Any
    rolling: Any

    @classmethod
    def empty(cls, particles: int, room: int, facets: int, rolling_numbers: int) -> "ToolRows":
        """Rows with room for so many candidates and facets."""
        return cls(
            cuda.device_array(particles + 1, np.int64),
            cuda.device_array(room, np.int64),
            cuda.device_array(room + 1, np.int64),
            cuda.device_array(facets, np.int32),
            cuda.device_array((room, CONTACTS), np.bool_),
            *(cuda.device_array((room, CONTACTS, n), np.float64) for n in (3, 3, rolling_numbers)),
        )

    def taken(self, candidates: int, facets: int) -> ToolList:
        """A copy, cut to so many candidates and their facets."""
        arrays = {name: array.copy_to_host() for name, array in self._asdict().items() if name != "row"}
        starts, numbers = arrays.pop("facet_start"), arrays.pop("facet")
        return ToolList(
            **{name: array[:candidates] for name, array in arrays.items()},
            facet_start=starts[: candidates + 1] if candidates else np.zeros(1, np.int64),
            facet=numbers[:facets],
        )


class Surface(NamedTuple):
    """What the search of candidates takes of a tool, in its body frame [m]."""

    low: Any  # (3,) corner of its box
    high: Any
    corner: Any  # (m, 3, 3)
    centre: Any  # (m, 3) of a ball around each facet
    extent: Any  # (m,) its radius


class Tool:
    """Surface of a tool, and arrays for the loads of its candidates."""

    def __init__(self, facets: Facets, groups: int, sums: int, room: int) -> None:
        self.facets = Facets(*(cuda.to_device(array) for array in facets))
        self._groups, self._sums = groups, sums
        corner = facets.corner
        centre = corner.mean(axis=1)
        extent = np.linalg.norm(corner - centre[:, None], axis=2).max(axis=1)
        places = corner.reshape(-1, 3)
        low, high = places.min(axis=0), places.max(axis=0)
        self.surface = Surface(*(cuda.to_device(array) for array in (low, high, corner, centre, extent)))
        self.columns = 3 * groups + 3 + sums
        self.make_room(room)

    def make_room(self, room: int) -> None:
        """Allocate the arrays of the loads for `room` candidates."""
        self.room = room
        self.loads = ToolLoads(
            cuda.device_array((self._groups, 3, room), np.float64),
            cuda.device_array((3, room), np.float64),
            cuda.device_array((self._sums, room), np.float64),
        )
