"""State of the soil: particles and the histories of their contacts."""

from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from .blocks import line_rows, rows_from
from .neighbours import take_rows
from .periodic import wrapped


class Kinematics(NamedTuple):
    """Places and velocities of particles, as kernels take them: the first three numbers of rows, world axes.

    The rows have no gaps: of (n, 3) views numba would compile other code for n < 2 than for n > 1.
    """

    position: np.ndarray  # [m]
    velocity: np.ndarray  # [m/s]
    angular_velocity: np.ndarray  # [rad/s]


class Loads(NamedTuple):
    """Forces and torques on particles, as kernels take them: see Kinematics."""

    force: np.ndarray  # [N]
    torque: np.ndarray  # [N m]


class ParticleRows(NamedTuple):
    """Vectors of particles as the kernel of pairs takes them, beside one another and none across two lines of
    the cache."""

    place: np.ndarray  # (n, 4) float64: position [m], nothing
    motion: np.ndarray  # (n, 8): velocity [m/s], angular velocity [rad/s], and if unequal radius and mass
    load: np.ndarray  # (n, 8): force [N], torque [N m], nothing


class Masses(NamedTuple):
    """Of every particle, or arrays (n,)."""

    mass: float | np.ndarray  # [kg]
    inertia: float | np.ndarray  # [kg m2]


_VECTORS = (*Kinematics._fields, *Loads._fields)


@dataclass
class Particles:
    """All spheres, sorted by cell. World axes, SI, shape (n, 3) unless said.

    The first five are copied into `rows`, and are views of them: write into them, none can be replaced.

    Positions are float64. The rest is float32 in mixed precision: a float32 position would lose slow
    motion, 0.1 um at 2 m, but a velocity or force loses only 1e-7 of itself.
    """

    position: np.ndarray  # [m]
    velocity: np.ndarray  # [m/s]
    angular_velocity: np.ndarray  # [rad/s]
    force: np.ndarray  # [N]
    torque: np.ndarray  # [N m]
    built_position: np.ndarray  # [m] where the neighbour lists were built; float32 resolves half a skin
    identity: np.ndarray  # (n,) int32: place in the bed as prepared
    image: np.ndarray  # (n,) int32: periods by which it was moved back into the box, in y
    held: np.ndarray  # (n,) bool: stays where it is, whatever acts on it
    # Of length 0 where all particles are equal:
    radius: np.ndarray  # (n,) [m]
    mass: np.ndarray  # (n,) [kg]
    inertia: np.ndarray  # (n,) [kg m2]
    material: np.ndarray  # (n,) int64: number of the layer it came from

    def __post_init__(self) -> None:
        kind, count = self.velocity.dtype.type, len(self.position)
        rows = ParticleRows(
            line_rows(count, 4, np.float64), line_rows(count, 8, kind), line_rows(count, 8, kind)
        )
        vectors = [getattr(self, name) for name in _VECTORS]
        self._use(rows)
        for name, vector in zip(_VECTORS, vectors, strict=True):
            getattr(self, name)[:] = vector
        self._put_sizes()

    def _use(self, rows: ParticleRows) -> None:
        self.rows = rows
        vars(self).update(
            position=rows.place[:, :3], velocity=rows.motion[:, :3], angular_velocity=rows.motion[:, 3:6],
            force=rows.load[:, :3], torque=rows.load[:, 3:6],
        )  # fmt: skip

    def __setattr__(self, name: str, value: object) -> None:
        if name in _VECTORS and "rows" in vars(self):
            raise AttributeError(f"{name}: is a view of rows; write into it")
        super().__setattr__(name, value)

    def __reduce__(self) -> Any:  # a copy of views and rows apart would not hang together
        return Particles, tuple(getattr(self, item.name) for item in fields(self))

    def _put_sizes(self) -> None:
        if self.unequal:
            self.rows.motion[:, 6], self.rows.motion[:, 7] = self.radius, self.mass

    @classmethod
    def at_rest(
        cls, position: np.ndarray, identity: np.ndarray, kind: type, held: np.ndarray | None = None
    ) -> "Particles":
        """Equal particles that do not move, at `position` (n, 3) [m]; `kind` is float64 or float32.

        Particles of `held` (n,) bool never move; without it, all may.
        """
        zeros: np.ndarray = np.zeros(position.shape, kind)
        none, of_none = np.empty(0), np.empty(0, np.int64)
        return cls(
            position, zeros, zeros.copy(), zeros.copy(), zeros.copy(), position.astype(np.float32), identity,
            np.zeros(len(position), np.int32), np.zeros(len(position), np.bool_) if held is None else held,
            none, none.copy(), none.copy(), of_none,
        )  # fmt: skip

    def make_unequal(self, radius: np.ndarray, material: np.ndarray, density: np.ndarray) -> None:
        """Give every particle a radius [m], a material, and the mass of its material's density [kg/m3]."""
        self.radius, self.material = radius, material
        self.mass = density[material] * 4.0 / 3.0 * np.pi * radius**3
        self.inertia = 0.4 * self.mass * radius**2
        self._put_sizes()

    @property
    def kinematics(self) -> Kinematics:
        """Places and velocities, not copied."""
        return Kinematics(self.rows.place, self.rows.motion, rows_from(self.rows.motion, 3))

    @property
    def loads(self) -> Loads:
        """Forces and torques, not copied."""
        return Loads(self.rows.load, rows_from(self.rows.load, 3))

    @property
    def unequal(self) -> bool:
        """Whether the particles have sizes or materials of their own."""
        return len(self.mass) > 0

    def wrap(self, low_m: float, period_m: float) -> None:
        """Put every particle into low <= y < low + period [m], and keep count."""
        self.position[:, 1], turns = wrapped(self.position[:, 1], low_m, period_m)
        self.image += turns.astype(np.int32)

    def wrap_all(self, low_m: np.ndarray, periods_m: np.ndarray) -> None:
        """Put all particles into the box of an endless bed: `low_m` (3,) corner, `periods_m` (3,) size."""
        for a in range(3):
            self.position[:, a] = wrapped(self.position[:, a], low_m[a], periods_m[a])[0]

    def reorder(self, order: np.ndarray) -> None:
        """Put particle order[k] in place k."""
        taken = []
        for rows in self.rows:
            taken.append(line_rows(len(order), rows.shape[1], rows.dtype.type))
            take_rows(rows, order, taken[-1])
        self._use(ParticleRows(*taken))
        for name in ["identity", "image", "held"] + self.unequal * ["radius", "mass", "inertia", "material"]:
            setattr(self, name, getattr(self, name)[order])
        self.built_position = self.position.astype(np.float32)

    def joined(self, others: "Particles") -> "Particles":
        """These particles, followed by `others`."""
        parts = {
            item.name: np.concatenate((getattr(self, item.name), getattr(others, item.name)))
            for item in fields(self)
        }
        return Particles(**parts)

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.position)


class PairList(NamedTuple):
    """Half neighbour list in compressed rows: pairs (i, neighbour[k]), row_start[i] <= k < row_start[i+1].

    `slab_start` cuts the particles into slabs wider than the reach: a slab's pairs touch only itself
    and the next one, so even slabs can run side by side, then odd ones, in an order that does not
    depend on the number of threads.
    """

    row_start: np.ndarray  # (n + 1,) int64
    neighbour: np.ndarray  # (p,) int32
    history: np.ndarray  # springs, and what the law keeps besides, in blocks (dem.blocks.history_blocks)
    slab_start: np.ndarray  # (slabs + 1,) int64


class WallList(NamedTuple):
    """Pairs of a particle and a wall that it may touch, by particle, then by wall."""

    particle: np.ndarray  # (w,) int64
    wall: np.ndarray  # (w,) int64, row of dem.walls.wall_planes
    history: np.ndarray  # the same, float64


class ToolList(NamedTuple):
    """Particles that may touch one tool, and which of its facets.

    A contact is identified by its normal in the tool's frame. Its springs are kept in that frame too,
    so they turn with the tool and pass from facet to facet.
    """

    particle: np.ndarray  # (c,) int64, increasing
    facet_start: np.ndarray  # (c + 1,) int64
    facet: np.ndarray  # (q,) int32
    active: np.ndarray  # (c, CONTACTS) bool
    normal: np.ndarray  # (c, CONTACTS, 3)
    shear: np.ndarray  # (c, CONTACTS, 3) [m]
    rolling: np.ndarray  # (c, CONTACTS, 3 + kept) [rad], then what the law keeps besides
