"""Readings of a soil between two soil steps: particles, contacts, energy, messages."""

import numpy as np

from .. import messages
from ..errors import InputError
from ..messages import LostParticle, SoilCloud
from .bed import Bed
from .blocks import history_places
from .bonds.bond_list import SINKS as BOND_SINKS
from .energy import EnergyBook
from .homogeneous import pair_stress
from .integration import mass_sums, motion_sums
from .model import SoilModel
from .monitors import MotionSums
from .particles import Particles
from .periodic import wrapped
from .state import SoilState
from .steps import Steps
from .walls import wall_scan


class SoilReadings:
    """The reading side of a soil engine. Unless said, arrays are float64, in world axes and the order of the
    prepared bed."""

    _model: SoilModel
    _steps: Steps
    _may_leap: bool  # whether particles are removed where a tool enters after a leap

    @property
    def _state(self) -> SoilState:
        return self._steps.state

    @property
    def _comes_and_goes(self) -> bool:
        """Whether the particles there are change."""
        return self._model.soil.window is not None or self._may_leap

    @property
    def leaps(self) -> tuple[int, int]:
        """Leaps of tools since the start, and the particles that were removed."""
        return self._state.leaps, self._state.removed

    @property
    def bed(self) -> Bed:
        """The prepared bed, in the box it has now."""
        return self._state.domain.bed

    @property
    def particle_count(self) -> int:
        """Particles in the bin."""
        return self._state.particles.count

    @property
    def listed_pair_count(self) -> int:
        """Pairs in the neighbour list, the skin included."""
        return self._steps.listed_pair_count()

    @property
    def mass_kg(self) -> float:
        """Mass of one particle; of one of mean volume where they are unequal."""
        return self._model.mass_kg

    @property
    def coordination(self) -> float:
        """Contacts in reach per particle, those between particles only."""
        return 2.0 * self._steps.contacts()[0] / self.particle_count

    def particles(self) -> Particles:
        """Particles in the order of the kernels, sorted by cell; not copied."""
        return self._steps.particles()

    def whole_state(self) -> SoilState:
        """Particles, lists and all else at the end of the last step; not copied."""
        return self._steps.to_host().state

    def radii_m(self) -> np.ndarray:
        """(n,) radii."""
        p = self.particles()
        return p.radius[np.argsort(p.identity)] if p.unequal else np.full(p.count, self._model.radius_m)

    def materials(self) -> np.ndarray:
        """(n,) int64 number of the layer of each particle."""
        p = self.particles()
        return p.material[np.argsort(p.identity)] if p.unequal else np.zeros(p.count, np.int64)

    def positions_m(self) -> np.ndarray:
        """(n, 3) positions; inside the box if it is periodic."""
        p, bed = self.particles(), self.bed
        position = p.position[np.argsort(p.identity)]
        for a, period in enumerate(bed.periods_m):
            if np.isfinite(period):
                position[:, a] = wrapped(position[:, a], bed.lower_m[a], period)[0]
        return position

    def displacements_m(self) -> np.ndarray:
        """(n, 3) from the place in the prepared bed. The disturbance.

        It does not jump when a particle passes from one periodic side to the other.
        """
        p, period_m = self.particles(), self.bed.period_m
        back = np.argsort(p.identity)
        moved = p.position[back] - self._state.origin.laid_out_m(p.identity[back])
        if period_m is not None:
            moved[:, 1] += p.image[back] * period_m
        return moved

    def contact_histories(self) -> tuple[np.ndarray, np.ndarray]:
        """(p, 2) numbers in the prepared bed of the listed pairs, and (p, components) their histories."""
        if self._model.soil.engine != "own":
            raise InputError("soil.engine: 'lammps' keeps histories to itself; use 'own'")
        state = self.whole_state()
        pairs, identity = state.pairs, state.particles.identity
        rows, neighbour = pairs.row_start, pairs.neighbour
        first = np.repeat(np.arange(len(rows) - 1), np.diff(rows))
        history = pairs.history[history_places(np.arange(len(neighbour)), len(self._model.parity))]
        return np.stack((identity[first], identity[neighbour]), axis=1).astype(np.int64), history

    def velocities_m_per_s(self) -> np.ndarray:
        """(n, 3) velocities."""
        p = self.particles()
        return p.velocity[np.argsort(p.identity)].astype(np.float64)

    def angular_velocities_rad_per_s(self) -> np.ndarray:
        """(n, 3) angular velocities."""
        p = self.particles()
        return p.angular_velocity[np.argsort(p.identity)].astype(np.float64)

    def forces_newton(self) -> np.ndarray:
        """(n, 3) sum on each particle at the end of the last step, weight included."""
        p = self.particles()
        return p.force[np.argsort(p.identity)].astype(np.float64)

    @property
    def wall_force_newton(self) -> np.ndarray:
        """(3,) sum of the forces of the walls on the particles in the last soil step."""
        self._steps.take_boundaries()
        return self._state.wall_force.sum(axis=0)

    @property
    def momentum_kg_m_per_s(self) -> np.ndarray:
        """(3,) momentum of all particles."""
        p = self.particles()
        if p.unequal:
            return mass_sums(p.kinematics, self._model.masses(p))[2]
        return self.mass_kg * motion_sums(p.kinematics)[3]

    @property
    def lost_particles(self) -> tuple[LostParticle, ...]:
        """The first particles that left the domain, at most dem.monitors.NAMED."""
        monitor = self._state.monitor
        return tuple(monitor.first_lost) if monitor is not None else ()

    @property
    def velocity_reversal(self) -> float:
        """Velocity reversal indicator, 0 to 1 (dem.monitors)."""
        return self.motion_sums().velocity_reversal

    def motion_sums(self) -> MotionSums:
        """Sums over particles from which the monitors judge motion."""
        return self._steps.motion_sums()

    def max_overlap_m(self) -> float:
        """Largest overlap of two particles."""
        return self._steps.contacts()[1]

    def any_outside(self) -> bool:
        """Whether a particle may have left the domain."""
        return self._steps.any_outside()

    def bond_counts(self) -> tuple[int, int]:
        """Intact bonds, and those broken since the start."""
        state = self.whole_state()
        return state.bonds.count(state.pairs) if state.bonds is not None else (0, 0)

    def state(self, run_id: str, tick: int, end_time_ns: int) -> messages.SoilState:
        """SoilState at the end of `tick`.

        The rms angular velocity is taken half a step before and after: one that reverses at every step is
        zero at whole steps.
        """
        n, state = self.particle_count, self._state
        contacts, largest = self._steps.contacts()
        sums = self.motion_sums()
        return messages.SoilState(
            run_id,
            tick,
            end_time_ns,
            particle_count=n,
            contact_count=contacts,
            lost_particle_count=state.monitor.lost_count if state.monitor is not None else 0,
            broken_bond_count=self.bond_counts()[1] if state.bonds is not None else 0,
            rebuild_count=state.rebuild_count,
            kinetic_energy_joule=self._steps.moving_joule()[0],
            rms_speed_m_per_s=float(np.sqrt(sums.speed2 / n)),
            rms_angular_velocity_rad_per_s=float(np.sqrt((sums.spin2 + sums.half_spin2) / n)),
            max_overlap_m=largest,
            max_tool_overlap_m=max((tool.max_overlap_m for tool in state.tools), default=0.0),
            lost_particles=self.lost_particles,
        )

    def energy(self) -> EnergyBook:
        """The energy book at the end of the last tick."""
        model, state = self._model, self._state
        self._steps.take_boundaries()
        self._steps.flush_books()
        kinetic, gravity = self._steps.moving_joule()
        p = self.particles()
        at_walls = wall_scan(state.walls, state.domain.planes, p.rows.place, model.at_walls(p))[2]
        at_tools = sum(tool.stored_joule(p, model.at_tools(p)) for tool in state.tools)
        sinks = state.sinks + sum((tool.sinks_joule for tool in state.tools), np.zeros_like(state.sinks))
        booked = dict(zip(model.soil.law.sinks, sinks.tolist(), strict=True))
        in_bonds = 0.0
        if state.bonds is not None:
            bonds = self.whole_state().bonds
            assert bonds is not None
            bonds.flush()
            in_bonds = bonds.sums(state.pairs, p.rows.place)[0]
            booked |= zip(BOND_SINKS, bonds.lost_joule.tolist(), strict=True)
        return EnergyBook(
            kinetic_joule=kinetic,
            gravity_joule=gravity,
            stored_joule=self._steps.stored_in_pairs_joule() + in_bonds + at_walls + at_tools,
            sinks_joule=booked,
            tool_work_joule=state.tool_work_joule,
            carried_joule=state.carried_joule,
        )

    def potential_joule(self) -> float:
        """Energy of position: stored in contacts, and gravity."""
        book = self.energy()
        return book.stored_joule + book.gravity_joule

    def stress_pa(self) -> np.ndarray:
        """(3, 3) mean stress of an endless bed, compression positive, along x, y and z; without dampers."""
        model, state = self._model, self.whole_state()
        pairs, p = state.pairs, state.particles
        total = pair_stress(pairs, p.rows.place, *model.seen_at_pairs(p))
        if state.bonds is not None:
            total = total + state.bonds.sums(pairs, p.rows.place)[1]
        return total / float(np.prod(self.bed.periods_m))

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """Particles, float32; with identities where they come and go."""
        p, soil, broken = self.particles(), self._model.soil, None
        if self._state.bonds is not None:
            state = self.whole_state()
            assert state.bonds is not None
            broken = state.bonds.broken_part(state.pairs)[np.argsort(p.identity)]
        return SoilCloud(
            tick,
            end_time_ns,
            self.positions_m().astype(np.float32),
            np.linalg.norm(self.velocities_m_per_s(), axis=1).astype(np.float32),
            identities=np.sort(p.identity).astype(np.uint32) if self._comes_and_goes else None,
            broken_parts=broken,
            radii_m=self.radii_m().astype(np.float32) if soil.particles.sizes is not None else None,
            materials=self.materials().astype(np.uint32) if soil.layers is not None else None,
        )
