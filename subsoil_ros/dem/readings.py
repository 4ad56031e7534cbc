"""Readings of a soil between two soil steps: particles, contacts, energy, messages."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..contact_laws.base import Features
from ..messages import LostParticle, SoilCloud, SoilState
from .bed import Bed
from .blocks import history_places
from .bonds.bond_list import SINKS as BOND_SINKS
from .bonds.bond_list import BondList
from .energy import EnergyBook
from .homogeneous import pair_stress
from .integration import mass_sums, motion_sums
from .kernel_calls import use_threads
from .mixture import Mixture
from .monitors import MotionSums, SoilMonitor, half_step_sums
from .pairs import contact_scan, pair_energy
from .periodic import wrapped
from .state import PairList, Particles, WallList
from .tools.surface import ToolSurface
from .walls import wall_scan


class SoilReadings(ABC):
    """The reading side of a soil engine, which sets these attributes."""

    bed: Bed
    _threads: int
    _step_s: float
    _gravity: float
    _parity: np.ndarray  # (components,) of what the law keeps of a contact
    _radius: float  # of all, or the largest [m]
    _mass: float  # of all, or of one of mean volume [kg]
    _inertia: float
    _density: np.ndarray  # (layers,)
    _features: Features
    _pair_laws: np.ndarray
    _wall_laws: np.ndarray
    _tool_laws: np.ndarray
    _boundary: Any  # ContactLaw.numbers
    _at_tools: Any
    _planes: np.ndarray
    _loaded_position: np.ndarray
    _pairs: PairList
    _walls: WallList
    _bonds: BondList | None
    _tools: Sequence[ToolSurface]
    _monitor: SoilMonitor | None
    _rebuilds: int
    _tool_work: float
    _carried_joule: float  # that came in less what left with a window
    _sinks: np.ndarray
    _sink_names: tuple[str, ...]
    _wall_force: np.ndarray
    _pair_book: np.ndarray
    _wall_book: np.ndarray

    @property
    @abstractmethod
    def _particles(self) -> Particles:
        """Particles at the end of the last step or, within a step, in their present state."""

    @property
    def particle_count(self) -> int:
        """Particles in the bin."""
        return self._particles.count

    @property
    def listed_pair_count(self) -> int:
        """Pairs in the neighbour list, the skin included."""
        return len(self._pairs.neighbour)

    @property
    def mass_kg(self) -> float:
        """Mass of one particle; of one of mean volume where they are unequal."""
        return self._mass

    @property
    def coordination(self) -> float:
        """Contacts in reach per particle, those between particles only."""
        return 2.0 * self._scan_contacts()[0] / self.particle_count

    def radii_m(self) -> np.ndarray:
        """(n,) float64, in the order of the prepared bed."""
        p = self._particles
        return p.radius[np.argsort(p.identity)] if p.unequal else np.full(p.count, self._radius)

    def materials(self) -> np.ndarray:
        """(n,) int64 number of the layer of each particle, in the order of the prepared bed."""
        p = self._particles
        return p.material[np.argsort(p.identity)] if p.unequal else np.zeros(p.count, np.int64)

    def positions_m(self) -> np.ndarray:
        """(n, 3) float64, world axes, in the order of the prepared bed; inside the box if it is periodic."""
        position = self._particles.position[np.argsort(self._particles.identity)]
        for a, period in enumerate(self.bed.periods_m):
            if np.isfinite(period):
                position[:, a] = wrapped(position[:, a], self.bed.lower_m[a], period)[0]
        return position

    def displacements_m(self) -> np.ndarray:
        """(n, 3) float64, world axes: from the place in the prepared bed, in its order. The disturbance.

        It does not jump when a particle passes from one periodic side to the other.
        """
        p = self._particles
        back = np.argsort(p.identity)
        moved = p.position[back] - self._laid_out_m(p.identity[back])
        if self.bed.period_m is not None:
            moved[:, 1] += p.image[back] * self.bed.period_m
        return moved

    def _laid_out_m(self, identity: np.ndarray) -> np.ndarray:
        """(n, 3) places in the prepared bed."""
        return self._loaded_position[identity]

    def contact_histories(self) -> tuple[np.ndarray, np.ndarray]:
        """(p, 2) numbers in the prepared bed of the listed pairs, and (p, components) their histories."""
        rows, neighbour = self._pairs.row_start, self._pairs.neighbour
        identity = self._particles.identity
        first = np.repeat(np.arange(len(rows) - 1), np.diff(rows))
        history = self._pairs.history[history_places(np.arange(len(neighbour)), len(self._parity))]
        return np.stack((identity[first], identity[neighbour]), axis=1).astype(np.int64), history

    def velocities_m_per_s(self) -> np.ndarray:
        """(n, 3) float64, world axes, in the order of the prepared bed."""
        return self._particles.velocity[np.argsort(self._particles.identity)].astype(np.float64)

    def angular_velocities_rad_per_s(self) -> np.ndarray:
        """(n, 3) float64, world axes, in the order of the prepared bed."""
        return self._particles.spin[np.argsort(self._particles.identity)].astype(np.float64)

    def forces_newton(self) -> np.ndarray:
        """(n, 3) float64, world axes, sum on each particle at the end of the last step, weight included."""
        return self._particles.force[np.argsort(self._particles.identity)].astype(np.float64)

    @property
    def wall_force_newton(self) -> np.ndarray:
        """(3,) sum of the forces of the walls on the particles in the last soil step, world axes."""
        return self._wall_force.sum(axis=0)

    @property
    def momentum_kg_m_per_s(self) -> np.ndarray:
        """(3,) momentum of all particles, world axes."""
        p = self._particles
        if p.unequal:
            return mass_sums(p.position, p.velocity, p.spin, p.mass, p.inertia)[2]
        return self._mass * motion_sums(p.position, p.velocity, p.spin)[3]

    @property
    def lost_particles(self) -> tuple[LostParticle, ...]:
        """The first particles that left the domain, at most dem.monitors.NAMED."""
        return tuple(self._monitor.first_lost) if self._monitor is not None else ()

    @property
    def velocity_reversal(self) -> float:
        """Velocity reversal indicator, 0 to 1 (dem.monitors)."""
        return self.motion_sums().velocity_reversal

    def state(self, run_id: str, tick: int, end_time_ns: int) -> SoilState:
        """SoilState at the end of `tick`.

        The rms angular velocity is taken half a step before and after: one that reverses at every step is
        zero at whole steps.
        """
        n = self.particle_count
        contacts, largest = self._scan_contacts()
        sums = self.motion_sums()
        return SoilState(
            run_id,
            tick,
            end_time_ns,
            particle_count=n,
            contact_count=contacts,
            lost_particle_count=self._monitor.lost_count if self._monitor is not None else 0,
            broken_bond_count=self._bonds.count(self._pairs)[1] if self._bonds is not None else 0,
            rebuild_count=self._rebuilds,
            kinetic_energy_joule=self._moving_joule()[0],
            rms_speed_m_per_s=float(np.sqrt(sums.speed2 / n)),
            rms_angular_velocity_rad_per_s=float(np.sqrt((sums.spin2 + sums.half_spin2) / n)),
            max_overlap_m=largest,
            max_tool_overlap_m=max((t.max_overlap_m for t in self._tools), default=0.0),
            lost_particles=self.lost_particles,
        )

    def energy(self) -> EnergyBook:
        """The energy book at the end of the last tick."""
        p, walls = self._particles, self._walls
        self._flush_books()
        kinetic, gravity = self._moving_joule()
        at_walls = wall_scan(
            walls.particle, walls.wall, self._planes, p.position, walls.history,
            self._radius, self._boundary, self._mixture(self._wall_laws), self._features,
        )[2]  # fmt: skip
        mixture = self._mixture(self._tool_laws)
        at_tools = sum(
            t.stored_joule(p, self._radius, self._at_tools, mixture, self._features) for t in self._tools
        )
        sinks = self._sinks + sum((t.sinks_joule for t in self._tools), np.zeros_like(self._sinks))
        booked = dict(zip(self._sink_names, sinks.tolist(), strict=True))
        in_bonds = 0.0
        if self._bonds is not None:
            self._bonds.flush()
            in_bonds = self._bonds.sums(self._pairs, p.position)[0]
            booked |= zip(BOND_SINKS, self._bonds.lost_joule.tolist(), strict=True)
        return EnergyBook(
            kinetic_joule=kinetic,
            gravity_joule=gravity,
            stored_joule=self._stored_in_pairs() + in_bonds + at_walls + at_tools,
            sinks_joule=booked,
            tool_work_joule=self._tool_work,
            carried_joule=self._carried_joule,
        )

    def potential_joule(self) -> float:
        """Energy of position: stored in contacts, and gravity."""
        book = self.energy()
        return book.stored_joule + book.gravity_joule

    def stress_pa(self) -> np.ndarray:
        """(3, 3) mean stress of an endless bed, compression positive, along x, y and z; without dampers."""
        pairs, position = self._pairs, self._particles.position
        total = pair_stress(
            pairs.row_start, pairs.neighbour, position, pairs.history,
            self._radius, self._boundary, self._mixture(self._pair_laws), self._features,
        )  # fmt: skip
        if self._bonds is not None:
            total = total + self._bonds.sums(pairs, position)[1]
        return total / float(np.prod(self.bed.periods_m))

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """Particles in the order of the prepared bed, float32."""
        speed = np.linalg.norm(self.velocities_m_per_s(), axis=1)
        broken = None
        if self._bonds is not None:
            broken = self._bonds.broken_part(self._pairs)[np.argsort(self._particles.identity)]
        return SoilCloud(
            tick,
            end_time_ns,
            self.positions_m().astype(np.float32),
            speed.astype(np.float32),
            broken_parts=broken,
            radii_m=self.radii_m().astype(np.float32) if self._features.sizes.ndim == 2 else None,
            materials=self.materials().astype(np.uint32) if self._features.materials.ndim == 2 else None,
        )

    def _masses(self) -> tuple[float | np.ndarray, float | np.ndarray]:
        """Mass [kg] and inertia [kg m2] for the kernels: of all particles, or arrays (n,)."""
        p = self._particles
        return (p.mass, p.inertia) if p.unequal else (self._mass, self._inertia)

    def _mixture(self, laws: np.ndarray) -> Mixture:
        p = self._particles
        return Mixture(p.radius, p.mass, p.material, laws, len(self._density))

    def motion_sums(self) -> MotionSums:
        """Sums over particles from which the monitors judge motion."""
        use_threads(self._threads)
        p = self._particles
        return MotionSums(
            *half_step_sums(p.position, p.velocity, p.spin, p.force, p.torque, *self._masses(), self._step_s)
        )

    def particles(self) -> Particles:
        """Particles in the order of the kernels, sorted by cell; not copied."""
        return self._particles

    def max_overlap_m(self) -> float:
        """Largest overlap of two particles."""
        return self._scan_contacts()[1]

    def anyone_outside(self) -> bool:
        """Whether a particle may have left the domain: always true here, so that each is checked."""
        return True

    def _scan_contacts(self) -> tuple[int, float]:
        """Contacts in reach, and the largest overlap [m]."""
        use_threads(self._threads)
        pairs = self._pairs
        return contact_scan(
            pairs.row_start, pairs.neighbour, self._particles.position,
            self._radius, self._boundary, self._mixture(self._pair_laws), self._features,
        )  # fmt: skip

    def _stored_in_pairs(self) -> float:
        use_threads(self._threads)
        pairs = self._pairs
        return pair_energy(
            pairs.row_start, pairs.neighbour, self._particles.position, pairs.history,
            self._radius, self._boundary, self._mixture(self._pair_laws), self._features,
        )  # fmt: skip

    def _moving_joule(self) -> tuple[float, float]:
        """Kinetic energy and that of gravity, zero at z = 0."""
        p = self._particles
        if p.unequal:
            kinetic, height, _ = mass_sums(p.position, p.velocity, p.spin, p.mass, p.inertia)
            return kinetic, self._gravity * height
        speed2, spin2, height, _ = motion_sums(p.position, p.velocity, p.spin)
        return 0.5 * (self._mass * speed2 + self._inertia * spin2), self._mass * self._gravity * height

    def _flush_books(self) -> None:
        if self._features.book.ndim == 2 and self._rebuilds > 0:
            self._sinks += self._pair_book.sum(axis=0) + self._wall_book.sum(axis=0)
            self._pair_book[:] = 0.0
            self._wall_book[:] = 0.0
