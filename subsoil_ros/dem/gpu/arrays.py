"""Arrays of a soil on the GPU: rows of partners, of particles near walls, and of candidates of tools."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import cuda

from ...contact_laws.base import SPRINGS
from ..particles import ToolList
from ..tools.facets import Facets
from ..tools.forces import CONTACTS
from ..walls import WALLS
from .device import WARP
from .forces import TOOL_SUMS


@dataclass
class Rows:
    """Partners of every particle."""

    count: Any
    slice_start: Any
    neighbour: Any
    history: Any

    @classmethod
    def empty(cls, particles: int, room: int, kind: type) -> "Rows":
        slices = -(-particles // WARP)
        return cls(
            cuda.device_array(particles, np.int32),
            cuda.device_array(slices + 1, np.int64),
            cuda.device_array(room, np.int32),
            cuda.to_device(np.zeros((SPRINGS, room), kind)),  # springs that a law does not have stay zero
        )

    def taken(self, places: int) -> dict[str, np.ndarray]:
        """Copies of the arrays, cut to the places that are taken."""
        count, slice_start, neighbour, history = (array.copy_to_host() for array in vars(self).values())
        return {
            "count": count,
            "slice_start": slice_start,
            "neighbour": neighbour[:places],
            "history": history[:, :places],
        }


@dataclass
class WallRows:
    """Particles near walls."""

    row: Any  # (n + 1,) first row of a particle
    particle: Any
    held: Any
    springs: Any
    force: Any

    @classmethod
    def empty(cls, particles: int, room: int) -> "WallRows":
        of_walls = len(WALLS)
        return cls(
            cuda.device_array(particles + 1, np.int64),
            cuda.device_array(room, np.int64),
            cuda.device_array(room, np.int32),
            cuda.device_array((of_walls * SPRINGS, room), np.float64),
            cuda.to_device(np.zeros((of_walls * 3, room))),
        )

    def taken(self, rows: int) -> dict[str, np.ndarray]:
        """Copies of the arrays but `row`, cut to so many particles."""
        return {name: array.copy_to_host()[..., :rows] for name, array in vars(self).items() if name != "row"}


@dataclass
class ToolRows:
    """Candidates of one tool: dem.state.ToolList."""

    row: Any
    particle: Any
    facet_start: Any
    facet: Any
    active: Any
    normal: Any
    shear: Any
    roll: Any

    @classmethod
    def empty(cls, particles: int, room: int, facets: int) -> "ToolRows":
        return cls(
            cuda.device_array(particles + 1, np.int64),
            cuda.device_array(room, np.int64),
            cuda.device_array(room + 1, np.int64),
            cuda.device_array(facets, np.int32),
            cuda.device_array((room, CONTACTS), np.bool_),
            *(cuda.device_array((room, CONTACTS, 3), np.float64) for _ in range(3)),
        )

    def taken(self, candidates: int, facets: int) -> ToolList:
        """A copy, cut to so many candidates and their facets."""
        arrays = {name: array.copy_to_host() for name, array in vars(self).items() if name != "row"}
        starts, numbers = arrays.pop("facet_start"), arrays.pop("facet")
        return ToolList(
            **{name: array[:candidates] for name, array in arrays.items()},
            facet_start=starts[: candidates + 1] if candidates else np.zeros(1, np.int64),
            facet=numbers[:facets],
        )


class Tool:
    """Surface of a tool, and arrays for the loads of its candidates."""

    def __init__(self, facets: Facets, groups: int, room: int) -> None:
        self.facets = Facets(*(cuda.to_device(array) for array in facets))
        self.groups = groups
        corner = facets.corner
        centre = corner.mean(axis=1)
        extent = np.linalg.norm(corner - centre[:, None], axis=2).max(axis=1)
        places = corner.reshape(-1, 3)
        low, high = places.min(axis=0), places.max(axis=0)
        self.near = [cuda.to_device(array) for array in (low, high, facets.corner, centre, extent)]
        self.columns = 3 * groups + TOOL_SUMS
        self.make_room(room)

    def make_room(self, room: int) -> None:
        """Allocate the arrays of the loads for `room` candidates."""
        self.group_force = cuda.device_array((self.groups, 3, room), np.float64)
        self.moment = cuda.device_array((3, room), np.float64)
        self.sums = cuda.device_array((7, room), np.float64)
