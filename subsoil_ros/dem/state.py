"""What changes in the soil: particles and the histories of their contacts."""

from dataclasses import dataclass

import numpy as np

from .periodic import wrapped


@dataclass
class Particles:
    """All spheres, sorted by cell. World axes, SI, float64, shape (n, 3) unless said."""

    position: np.ndarray  # [m]
    velocity: np.ndarray  # [m/s]
    spin: np.ndarray  # [rad/s]
    force: np.ndarray  # [N]
    torque: np.ndarray  # [N m]
    built_position: np.ndarray  # [m] where the neighbour lists were built
    identity: np.ndarray  # (n,) int64: place in the bed as prepared
    image: np.ndarray  # (n,) int64: periods by which it was moved back into the box, in y

    @classmethod
    def at_rest(cls, position: np.ndarray, identity: np.ndarray) -> "Particles":
        """Particles that do not move, at `position` (n, 3) [m]."""
        zeros = np.zeros_like(position)
        rest = (zeros, zeros.copy(), zeros.copy(), zeros.copy(), position.copy())
        return cls(position, *rest, identity, np.zeros(len(position), np.int64))

    def wrap(self, low_m: float, period_m: float) -> None:
        """Put everybody into low <= y < low + period [m], and keep count."""
        self.position[:, 1], turns = wrapped(self.position[:, 1], low_m, period_m)
        self.image += turns

    def reorder(self, order: np.ndarray) -> None:
        """Put particle order[k] in place k."""
        for name in ("position", "velocity", "spin", "force", "torque", "identity", "image"):
            setattr(self, name, getattr(self, name)[order])
        self.built_position = self.position.copy()

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.position)


@dataclass
class PairList:
    """Half neighbour list in compressed rows: pairs (i, neighbour[k]), row_start[i] <= k < row_start[i+1].

    `slab_start` cuts the particles into slabs wider than the reach: a slab's pairs touch only itself
    and the next one, so even slabs can run side by side, then odd ones, in an order that does not
    depend on the number of threads.
    """

    row_start: np.ndarray  # (n + 1,) int64
    neighbour: np.ndarray  # (p,) int32
    shear: np.ndarray  # (p, 3) [m] tangential spring, i against j
    roll: np.ndarray  # (p, 3) [rad] rolling spring, i against j
    slab_start: np.ndarray  # (slabs + 1,) int64


@dataclass
class WallList:
    """Particles that may touch a wall. Slots are the five planes of dem.walls."""

    particle: np.ndarray  # (w,) int64, increasing
    shear: np.ndarray  # (w, 5, 3) [m]
    roll: np.ndarray  # (w, 5, 3) [rad]


@dataclass
class ToolList:
    """Particles that may touch one tool, and which of its facets.

    A contact is remembered by its normal, in the tool's frame, where shear and roll live too: they
    turn with the tool and pass from facet to facet.
    """

    particle: np.ndarray  # (c,) int64, increasing
    facet_start: np.ndarray  # (c + 1,) int64
    facet: np.ndarray  # (q,) int32
    active: np.ndarray  # (c, CONTACTS) bool
    normal: np.ndarray  # (c, CONTACTS, 3)
    shear: np.ndarray  # (c, CONTACTS, 3) [m]
    roll: np.ndarray  # (c, CONTACTS, 3) [rad]
