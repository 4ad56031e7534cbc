"""The box of a soil: where it was laid out, its walls, and where particles belong."""

import dataclasses
from typing import Protocol

import numpy as np
from numba import njit, prange

from .bed import Bed
from .particles import Particles
from .per_particle import of_particle
from .snapshot import bed_digest
from .walls import wall_planes


@njit(cache=True, parallel=True, nogil=True)
def outside(position, planes, radius, ceiling):
    """(n,) bool: centres more than a radius behind a plane, or above `ceiling` [m]; radius [m]: one, or (n,).

    A kernel, because the threads of numpy's matrix products stay awake and take a core from the next steps.
    """
    found = np.empty(position.shape[0], np.bool_)
    for i in prange(position.shape[0]):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        out = z > ceiling
        for k in range(planes.shape[0]):
            gap = planes[k, 3] - planes[k, 0] * x - planes[k, 1] * y - planes[k, 2] * z
            out = out or gap < -of_particle(radius, i)
        found[i] = out
    return found


class Origin(Protocol):
    """Where the particles of a soil come from."""

    @property
    def places_m(self) -> np.ndarray:
        """(n, 3) [m] places whose highest one is the top."""
        ...

    def laid_out_m(self, identity: np.ndarray) -> np.ndarray:
        """(n, 3) [m] where particles, given by identity (n,), were laid out."""
        ...

    def digest(self) -> np.ndarray:
        """(32,) uint8 of all that decides it."""
        ...


@dataclasses.dataclass(frozen=True)
class BedOrigin:
    """Particles in the box of a bed, by identity at `places_m` (n, 3)."""

    bed: Bed
    places_m: np.ndarray

    def laid_out_m(self, identity: np.ndarray) -> np.ndarray:
        """See Origin."""
        return self.places_m[identity]

    def digest(self) -> np.ndarray:
        """See Origin."""
        return bed_digest(self.bed, self.places_m)


class Domain:
    """Where particles belong: no centre a radius beyond a wall or the floor, none far above the bed.

    bed: the prepared bed; its box is that of the soil now. position_m (n, 3): from which the height counts.
    """

    def __init__(self, bed: Bed, position_m: np.ndarray, radius_m: float) -> None:
        self.bed, self._radius = bed, radius_m
        self.planes = self._limits = wall_planes(bed.lower_m, bed.upper_m, bed.sides)
        sides = (bed.upper_m[0] - bed.lower_m[0], bed.upper_m[1] - bed.lower_m[1], -bed.lower_m[2])
        self.ceiling_m = float(position_m[:, 2].max()) + max(sides)
        """Above the top of the bed by its longest side: soil that a tool throws does not rise so high."""

    def move_to(self, box: Bed, *, open_behind: bool) -> None:
        """Put the walls where those of `box` are; particles may leave by the near end if it is open."""
        self.bed = dataclasses.replace(self.bed, lower_m=box.lower_m, upper_m=box.upper_m)
        self.planes = wall_planes(box.lower_m, box.upper_m, box.sides)
        self._limits = self.planes.copy()
        if open_behind:
            self._limits[0, 3] = np.inf

    def outside(self, particles: Particles) -> np.ndarray:
        """(n,) bool: particles outside the domain."""
        radius = particles.radius if particles.unequal else self._radius
        return outside(particles.rows.place, self._limits, radius, self.ceiling_m)
