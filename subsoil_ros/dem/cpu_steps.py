"""Soil steps on a CPU: motion, lists of neighbours, forces."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..messages import ToolMotion
from .bed import scaled
from .blocks import history_blocks
from .bonds.kernel import NO_BONDS
from .homogeneous import stretch_springs
from .integration import kick, mass_sums, motion_sums
from .kernel_calls import KernelCalls, use_threads
from .model import SoilModel
from .monitors import MotionSums, half_step_sums, refuse_lost_numbers
from .neighbours import carry_pairs, cell_grid, endless_list, half_list, slab_starts, sort_by_cell
from .pairs import contact_scan, pair_energy
from .particles import PairList, Particles, WallList
from .periodic import TOOL_SKIN, periods
from .state import SoilState
from .step import drift_and_contacts
from .step_checks import StepChecks
from .walls import CHUNKS, carry_walls, near_walls

_CELLS_PER_SLAB = 1
"""Slab width in cells: one is as wide as the reach, and narrow slabs keep threads equally busy."""

_STRAIN_OF_LISTS = 0.02
"""Strain of an endless bed, over skin / radius, beyond which lists are rebuilt: by then pairs are nearer by
less than a twentieth of the skin."""

_ALL, _ONE, _NONE = 2, 1, 0
"""Half kicks of a drift: the one pending from the last step and its own, its own, no drift."""


class _Calls(NamedTuple):
    """Kernels of a step, bound to the arrays in use until the lists are rebuilt."""

    drift_and_contacts: Callable[[int, bool], int]
    kick: Callable[[], None]


class CpuSteps:
    """Soil steps of one state. Results do not depend on `threads`."""

    def __init__(self, model: SoilModel, state: SoilState, threads: int) -> None:
        self._model, self.state, self._threads = model, state, threads
        self._kernels = KernelCalls()
        self._calls: _Calls | None = None
        self._half_kick_is_pending = False  # the second one of the last step waits for the next drift

    def advance(self, tick: int, way: Sequence[tuple[ToolMotion, ...]], checks: StepChecks) -> None:
        """Run the soil steps of a tick, at whose ends the tools are at `way`."""
        use_threads(self._threads)
        for number, motions in enumerate(way, 1):
            checks.begin(tick, number, motions)
            self._step(checks.where(tick, number), motions)
            checks.end(tick, number)

    def _step(self, where: str, motions: tuple[ToolMotion, ...]) -> None:
        state, calls = self.state, self._calls or self._bind(self._model.step_s)
        in_reach = not tools_left_their_lists(self._model, state, motions)
        far = calls.drift_and_contacts(_ALL if self._half_kick_is_pending else _ONE, in_reach)
        self._half_kick_is_pending = False
        if far > 0 or not in_reach:
            refuse_lost_numbers(where, state.particles)
            self.rebuild(motions)
            if state.monitor is not None:
                state.monitor.note_rebuild()
            self._bind(self._model.step_s).drift_and_contacts(_NONE, True)
        self._load_tools(motions)
        self._half_kick_is_pending = True

    def first_forces(self, motions: tuple[ToolMotion, ...]) -> None:
        """Compute the forces of the initial state."""
        use_threads(self._threads)
        state = self.state
        self._forces_without_time()
        self._load_tools(motions)
        self._calls = None
        for book in (state.pair_book, state.wall_book, *(tool.sinks_joule for tool in state.tools)):
            book[:] = 0.0  # contacts that begin pressed have yielded before

    def forces_on(self, fresh: np.ndarray) -> None:
        """Compute the forces on the particles of `fresh` (n,) bool in their present state; all other forces,
        all springs and books keep their values."""
        state = self.state
        p, bonds = state.particles, state.bonds
        changed = [state.pairs.history, state.walls.history, state.pair_book, state.wall_book]
        if bonds is not None:
            changed += [bonds.state, bonds.book]
        before = [array.copy() for array in changed]
        force, torque = p.force.copy(), p.torque.copy()
        self._forces_without_time()
        self._calls = None
        p.force[~fresh], p.torque[~fresh] = force[~fresh], torque[~fresh]
        for array, values in zip(changed, before, strict=True):
            array[:] = values

    def _forces_without_time(self) -> None:
        """Forces of pairs and walls and the weight, in place of those there are."""
        p = self.state.particles
        p.force[:] = 0.0
        p.force[:, 2] = -self._model.masses(p)[0] * self._model.gravity_m_per_s2
        p.torque[:] = 0.0
        self._bind(step_s=0.0).drift_and_contacts(_NONE, True)

    def _load_tools(self, motions: tuple[ToolMotion, ...]) -> None:
        for tool, at in zip(self.state.tools, motions, strict=True):
            self.state.load_tool(tool, *tool.forces(at), at)

    def _bind(self, step_s: float) -> _Calls:
        """Kernel calls for steps of this length, valid until an array is replaced."""
        model, state, bind = self._model, self.state, self._kernels.bind
        p, bonds = state.particles, state.bonds
        kinematics, loads, masses = p.kinematics, p.loads, model.masses(p)
        drift = (
            kinematics, loads, masses, p.built_position, p.held,
            model.gravity_m_per_s2, step_s, (0.5 * model.soil.skin_m) ** 2,
        )  # fmt: skip
        pairs = state.pairs
        of_pairs = (
            pairs, np.repeat(np.arange(p.count, dtype=np.int32), np.diff(pairs.row_start)),
            bonds.kernel_arrays() if bonds is not None else NO_BONDS, p.rows, *model.at_pairs(p, step_s),
            state.pair_book,
        )  # fmt: skip
        of_walls = (
            state.walls, state.domain.planes, kinematics, *model.at_walls(p, step_s), loads,
            state.wall_force, state.wall_book,
        )  # fmt: skip
        self._calls = calls = _Calls(
            bind(drift_and_contacts, drift, of_pairs, of_walls, varying=(1, True)),
            bind(kick, kinematics, loads, masses, p.held, step_s),
        )
        for tool in state.tools:
            tool.bind(p, model.at_tools(p, step_s))
        return calls

    def rebuild(self, motions: tuple[ToolMotion, ...], came_from: np.ndarray | None = None) -> None:
        """Sort particles into cells, find pairs, walls and tool candidates, carry histories over.

        came_from (n,): numbers of the particles in the lists so far, if they were renumbered since.
        """
        model, state, domain = self._model, self.state, self.state.domain
        p, bed, components = state.particles, domain.bed, len(model.parity)
        self._calls = None
        low, high = np.array(bed.lower_m), np.array([*bed.upper_m, domain.ceiling_m])
        period = np.inf
        if bed.sides == "endless":
            p.wrap_all(low, np.array(bed.periods_m))
        elif bed.period_m is not None:
            period = bed.period_m
            p.wrap(low[1], period)
        grid = cell_grid(p.rows.place, model.reach_m, low, high, period)
        order, cell_start = sort_by_cell(p.rows.place, grid)
        p.reorder(order)
        order = order if came_from is None else came_from[order]
        smaller = model.radius_m - p.radius if p.unequal else 0.0
        if bed.sides == "endless":
            row_start, neighbour = endless_list(bed, p.position, model.reach_m, smaller)
        else:
            row_start, neighbour = half_list(p.rows.place, grid, cell_start, model.reach_m, smaller)
        old = state.pairs
        history = history_blocks(len(neighbour), model.precision, components)
        carry_pairs(
            order, old.row_start, old.neighbour, old.history, row_start, neighbour, history, model.parity
        )
        # the last slab of an endless bed touches the first: all is one
        per_slab = grid.nx if bed.sides == "endless" else _CELLS_PER_SLAB
        slabs = slab_starts(cell_start, grid, per_slab)
        self.flush_books()
        state.pairs = pairs = PairList(row_start, neighbour, history, slabs)
        if state.bonds is not None:
            state.bonds.carry(order, old, pairs)
            if state.bonds.known <= p.identity.max(initial=-1):
                state.bonds.add(pairs, p, state.origin.laid_out_m(p.identity))
        before, (particle, wall) = state.walls, self._near_walls(p)
        history = history_blocks(len(particle), np.float64, components)
        carry_walls(order, before.particle, before.wall, before.history, particle, wall, history, components)
        state.walls = WallList(particle, wall, history)
        for tool, motion in zip(state.tools, motions, strict=True):
            tool.search(motion, p, order, cell_start, grid, model.tool_reach_m)
        state.wall_force = np.zeros((len(particle), 3))
        state.pair_book = np.zeros((len(slabs) - 1, len(state.sinks)))
        state.wall_book = np.zeros((CHUNKS, len(state.sinks)))
        state.rebuild_count += 1
        state.strain = 0.0

    def _near_walls(self, p: Particles) -> tuple[np.ndarray, np.ndarray]:
        """Particles near walls, and these walls; in a window without those held, which stand for walls."""
        particle, wall = near_walls(p.rows.place, self.state.domain.planes, self._model.wall_reach_m)
        if self._model.soil.window is None:
            return particle, wall
        free = ~p.held[particle]
        return particle[free], wall[free]

    def stretch(self, scale: float | np.ndarray) -> None:
        """Scale an endless bed, its box and particles, by `scale` about the origin; by (3,) along x, y and z,
        the ends of the springs of contacts too."""
        model, state, domain = self._model, self.state, self.state.domain
        scales = np.broadcast_to(np.asarray(scale, np.float64), 3)
        p, pairs, strain = self.particles(), state.pairs, scales - 1.0
        p.position[:] *= scales
        p.built_position *= scales.astype(np.float32)
        domain.bed = scaled(domain.bed, scales)
        model.features.periodic[:] = periods(domain.bed)
        if np.ndim(scale):
            stretch_springs(pairs, p.rows.place, strain, *model.seen_at_pairs(p))
            if state.bonds is not None:
                state.bonds.stretch(pairs, p.rows.place, strain)
        state.strain += float(np.abs(strain).max())
        if state.strain > _STRAIN_OF_LISTS * model.soil.skin_m / model.radius_m:
            self.rebuild(())

    # the state, and sums over it

    def particles(self) -> Particles:
        """The particles at the end of the last step or, within a step, in their present state."""
        if self._half_kick_is_pending:
            assert self._calls is not None
            use_threads(self._threads)
            self._calls.kick()
            self._half_kick_is_pending = False
        return self.state.particles

    def to_host(self) -> "CpuSteps":
        """Steps of the whole state, in this process's memory, at the end of the last step."""
        self.particles()
        return self

    def from_host(self) -> None:
        """Use a state that was replaced or changed."""
        self._calls, self._half_kick_is_pending = None, False

    def take_boundaries(self) -> None:
        """Bring the contacts of walls and tools up to date: they are."""

    def damp(self, kept: float) -> None:
        """Every linear and angular velocity times `kept`."""
        p = self.particles()
        p.velocity[:] *= kept
        p.angular_velocity[:] *= kept

    def listed_pair_count(self) -> int:
        """Pairs in the neighbour list, the skin included."""
        return len(self.state.pairs.neighbour)

    def flush_books(self) -> None:
        """Add what was booked to the sinks of the state."""
        if self._model.booked:
            self.state.flush_books()

    def motion_sums(self) -> MotionSums:
        """Sums over particles from which the monitors judge motion."""
        use_threads(self._threads)
        p, model = self.particles(), self._model
        return MotionSums(*half_step_sums(p.kinematics, p.loads, model.masses(p), model.step_s))

    def any_outside(self) -> bool:
        """Whether a particle may have left the domain: always true, so that each is checked."""
        return True

    def moving_joule(self) -> tuple[float, float]:
        """Kinetic energy and that of gravity, zero at z = 0."""
        p, model = self.particles(), self._model
        if p.unequal:
            kinetic, height, _ = mass_sums(p.kinematics, model.masses(p))
            return kinetic, model.gravity_m_per_s2 * height
        speed2, spin2, height, _ = motion_sums(p.kinematics)
        kinetic = 0.5 * (model.mass_kg * speed2 + model.inertia_kg_m2 * spin2)
        return kinetic, model.mass_kg * model.gravity_m_per_s2 * height

    def contacts(self) -> tuple[int, float]:
        """Contacts in reach, and the largest overlap [m]."""
        use_threads(self._threads)
        p, pairs, model = self.particles(), self.state.pairs, self._model
        return contact_scan(pairs, p.rows.place, *model.seen_at_pairs(p))

    def stored_in_pairs_joule(self) -> float:
        """Energy stored between particles, bonds apart."""
        use_threads(self._threads)
        p, pairs, model = self.particles(), self.state.pairs, self._model
        return pair_energy(pairs, p.rows.place, *model.seen_at_pairs(p))


def tools_left_their_lists(model: SoilModel, state: SoilState, motions: tuple[ToolMotion, ...]) -> bool:
    """Whether a tool at `motions` may touch particles that are not among its candidates."""
    allowed = (TOOL_SKIN - 0.5) * model.soil.skin_m
    return any(tool.moved_m(motion) > allowed for tool, motion in zip(state.tools, motions, strict=True))
