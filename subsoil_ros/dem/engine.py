"""The soil engine: motions of the tools in, wrenches on the tools out."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numba
import numpy as np

from ..contact_laws.registry import BUILT_IN
from ..errors import InputError, PhysicsError, SceneError
from ..limits.stable_steps import DENSE_COORDINATION, SAFETY, step_limits
from ..loading.loader import ResolvedScene
from ..messages import ToolMotion, ToolWrench
from ..scene.pairs import layer_soils, pair_values, particle_mass_kg
from .bed import Bed, finite_rows, refuse_outside, scaled
from .beds.prepare import prepare_bed
from .blocks import history_blocks
from .bonds.bond_list import BondList
from .bonds.kernel import NO_BONDS
from .contact import history_parity, law_features, soil_laws
from .homogeneous import stretch_springs
from .integration import kick
from .kernel_calls import KernelCalls, use_threads
from .mixture import law_tables, material_at, reaches_m
from .monitors import Domain, SoilMonitor, refuse_lost_numbers
from .neighbours import carry_pairs, cell_grid, endless_list, half_list, slab_starts, sort_by_cell
from .periodic import TOOL_SKIN, periods, refuse_narrow_period
from .readings import SoilReadings
from .snapshot import bed_digest, below, from_named, motion_from, named
from .state import PairList, Particles, WallList
from .step import drift_and_contacts
from .tools.motion import motion_within, refuse_other_kind
from .tools.surface import ToolSurface, refuse_leap, surfaces
from .walls import CHUNKS, carry_walls, near_walls, wall_planes

_CELLS_PER_SLAB = 1
"""Slab width in cells: one is as wide as the reach, and narrow slabs keep threads equally busy."""


_STRAIN_OF_LISTS = 0.02
"""Strain of an endless bed, over skin / radius, beyond which lists are rebuilt: by then pairs are nearer by
less than a twentieth of the skin."""


class _StepCalls(NamedTuple):
    """Kernels of a step, bound to the arrays in use until the lists are rebuilt."""

    drift_and_contacts: Callable[[int, bool], int]
    kick: Callable[[], None]


class SoilEngine(SoilReadings):
    """Discrete elements in a bin, touched by tools. Readings: dem.readings.

    Results do not depend on `threads`. With `book`, or where the scene balances the energy, every energy sink
    is booked (slower). `bed` replaces the bed that the scene describes.
    """

    _moving: Particles  # as the kernels have them; read them as _particles
    _owes_kick: bool  # the second half kick of the last step waits for the next one

    keeps_state = True

    def __init__(
        self, resolved: ResolvedScene, threads: int = 1, *, book: bool = False, bed: Bed | None = None
    ) -> None:
        soil = resolved.scene.particle_soil
        if soil is None:
            raise InputError(f"{resolved.path}: has no 'soil', so it needs no soil engine")
        if not 1 <= threads <= numba.config.NUMBA_NUM_THREADS:
            raise InputError(
                f"threads: {threads} given, this machine allows 1 to {numba.config.NUMBA_NUM_THREADS}; "
                "give fewer, or set NUMBA_NUM_THREADS"
            )
        self._resolved, self._soil, self._threads = resolved, soil, threads
        self._step_s = resolved.timing.soil_step_s
        self._last_tick = resolved.timing.tick_count - 1
        self._kind = np.float32 if soil.precision == "mixed" else np.float64  # of all but positions
        self._gravity = resolved.scene.gravity_m_per_s2
        self._smallest, self._radius = soil.particles.bounds_m  # equal, or smallest and largest radius
        self._mass = particle_mass_kg(soil)
        self._inertia = 0.4 * self._mass * self._radius**2
        self.bed: Bed = bed or prepare_bed(resolved, SoilEngine, threads)
        refuse_narrow_period(self.bed, soil)
        book = book or (soil.monitors is not None and soil.monitors.max_energy_defect is not None)
        self._features = law_features(soil, book=book, periodic=periods(self.bed))
        law, self._boundary, self._at_tools = soil_laws(soil)
        self._pair_law = soil.law.numbers(*np.array(law, self._kind))
        self._pair_laws, self._wall_laws, self._tool_laws = law_tables(soil, self._features)
        self._parity = history_parity(soil.law)
        self._reaches = reaches_m(soil)
        self._density = np.array([layer.particles.density_kg_per_m3 for layer in layer_soils(soil)])
        self._overlap_bound = soil.max_tool_overlap_m or 2.0 * soil.particles.mean_volume_radius_m
        self._planes = wall_planes(self.bed.lower_m, self.bed.upper_m, self.bed.sides)
        self._tools: tuple[ToolSurface, ...] = ()
        self._bonds: BondList | None = None
        self._kernels = KernelCalls()
        self._calls: _StepCalls | None = None
        self._rebuilds = 0
        self._tool_work = 0.0
        self._carried_joule = 0.0
        self._sink_names = soil.law.sinks
        self._sinks = np.zeros(len(self._sink_names))  # of pairs and walls
        self._load(self.bed.positions_m, self.bed.radii_m, self.bed.materials, self.bed.held)
        if bed is None:
            self._refuse_step_too_large()

    @property
    def _particles(self) -> Particles:
        """Particles at the end of the last step or, within a step, in their present state."""
        if self._owes_kick:
            assert self._calls is not None
            use_threads(self._threads)
            self._calls.kick()
            self._owes_kick = False
        return self._moving

    def _refuse_step_too_large(self) -> None:
        """Raise SceneError if the bed has more contacts than DENSE_COORDINATION and needs a smaller step."""
        if self.coordination <= DENSE_COORDINATION:
            return
        limit = step_limits(self._soil, self.coordination)[0]
        if self._step_s > limit.limit_s and "unstable_time_step" not in self._resolved.scene.allow:
            raise SceneError(
                f"soil.time_step_s: {self._step_s:.3g} s is above the stable limit {limit.limit_s:.3g} s of "
                f"the prepared bed ({limit.cause}); use at most {SAFETY * limit.limit_s:.2g} s"
            )

    def _load(
        self,
        position: np.ndarray,
        radii: np.ndarray | None,
        materials: np.ndarray | None,
        held: np.ndarray | None = None,
        identity: np.ndarray | None = None,
    ) -> None:
        """Start from particles at rest without contact history; without `materials`, by their depth."""
        self._owes_kick = False
        if identity is None:
            identity = np.arange(len(position), dtype=np.int32)
        self._moving = p = Particles.at_rest(np.array(position), identity, self._kind, held)
        if self._soil.particles.sizes is not None or self._soil.layers is not None:
            if radii is None and self._soil.particles.sizes is not None:
                raise InputError("radii_m: is missing; a soil with particles.sizes needs one per particle")
            radius = np.full(p.count, self._radius) if radii is None else np.array(radii, np.float64)
            if materials is None:
                materials = material_at(self._soil, -position[:, 2])
            p.make_unequal(radius, np.array(materials, np.int64), self._density)
        self._loaded_position = position
        self._domain = self._domain_about(position)
        self._monitor = (
            None if self._soil.monitors is None else SoilMonitor(self._soil, self._domain, len(position))
        )
        self._forget_contacts()
        self._rebuild(())

    def _domain_about(self, position: np.ndarray) -> Domain:
        return Domain(self._planes, self.bed, position, self._radius)

    def _keep(self, kept: np.ndarray) -> None:
        """Keep only the particles where `kept` (n,) bool is true, without contact history."""
        p = self._particles
        p.reorder(np.flatnonzero(kept))
        self._forget_contacts()

    def _forget_contacts(self) -> None:
        rows = np.zeros(self._particles.count + 1, np.int64)
        self._pairs = PairList(
            rows, np.empty(0, np.int32), self._history(0, self._kind), np.zeros(1, np.int64)
        )
        none = np.empty(0, np.int64)
        self._walls = WallList(none, none.copy(), self._history(0, np.float64))
        if self._soil.bonds is not None:
            self._bonds = BondList(self._soil, self._particles, self._kind, self._features)

    def _history(self, contacts: int, kind: type) -> np.ndarray:
        return history_blocks(contacts, kind, len(self._parity))

    def place(
        self,
        position_m: np.ndarray,
        velocity_m_per_s: np.ndarray | None = None,
        angular_velocity_rad_per_s: np.ndarray | None = None,
        radii_m: np.ndarray | None = None,
    ) -> None:
        """Put these particles into the bin instead of the prepared bed: (n, 3) arrays, world axes.

        radii_m (n,) is for soils with sizes. Layers go by depth. Call it before `start`, which then must not
        remove any particle.

        Raises:
            InputError: no particle, one outside the bin, or rows that are missing or not finite.
        """
        position = np.array(position_m, dtype=np.float64).reshape(-1, 3)
        refuse_outside(self.bed, self._planes, position)
        self._load(position, radii_m, None)
        back = self._particles.identity
        for name, given in (("velocity", velocity_m_per_s), ("spin", angular_velocity_rad_per_s)):
            if given is not None:
                rows = finite_rows(name, given, len(position))[back]
                setattr(self._particles, name, rows.astype(self._kind))
        self._take_over_particles()

    def _take_over_particles(self) -> None:
        """Use arrays of the particles that were replaced."""
        self._calls = None

    def damp(self, kept: float) -> None:
        """Global damping: every linear and angular velocity times `kept`. For the preparation of beds."""
        self._particles.velocity *= kept
        self._particles.spin *= kept

    def resize(self, scale: float | np.ndarray) -> None:
        """Scale an endless bed by `scale`, or (3,) along x, y and z, about the origin. Particles and the ends
        of their contacts' springs move with it. For the preparation and testing of beds, in steps that are
        small against a skin."""
        scales = np.broadcast_to(np.asarray(scale, np.float64), 3)
        p = self._particles
        p.position *= scales
        p.built_position *= scales.astype(np.float32)
        self.bed = scaled(self.bed, scales)
        self._features.periodic[:] = periods(self.bed)
        if np.ndim(scale):
            pairs = self._pairs
            stretch_springs(
                pairs.row_start, pairs.neighbour, p.position, pairs.history, scales - 1.0,
                self._radius, self._boundary, self._mixture(self._pair_laws), self._features,
            )  # fmt: skip
            if self._bonds is not None:
                self._bonds.stretch(self._pairs, p.position, scales - 1.0)
        self._strain += float(np.abs(scales - 1.0).max())
        if self._strain > _STRAIN_OF_LISTS * self._soil.skin_m / self._radius:
            self._rebuild(())

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of the initial state. Particles that the tools overlap are removed; no time advances.

        A particle is removed if its centre is inside a tool or so near that the contact would press.
        """
        use_threads(self._threads)
        tools = surfaces(self._resolved, self.bed, motions)
        p = self._particles
        rest = np.array([pair_values(layer)[1].rest_overlap for layer in layer_soils(self._soil)])
        clearance = p.radius - rest[p.material] if p.unequal else np.full(p.count, self._radius - rest[0])
        kept = np.ones(p.count, np.bool_)
        for surface in tools:
            kept[surface.overlapped(p, clearance)] = False
        if not kept.any():
            raise InputError("tools: they overlap every particle of the bed; check their scale and position")
        self._tools = tools
        self._keep(kept)
        self._rebuild(motions)
        self._begin_tick()
        self._first_forces(motions)
        if self._monitor is not None and self._monitor.balances:
            self._monitor.begin(self.energy())
        return self._wrenches()

    def _first_forces(self, motions: tuple[ToolMotion, ...]) -> None:
        """Forces of the initial state."""
        p = self._particles
        p.force[:] = 0.0
        p.force[:, 2] = -self._masses()[0] * self._gravity
        p.torque[:] = 0.0
        self._bind(step=0.0).drift_and_contacts(0, True)
        self._tool_forces(motions)
        self._calls = None
        for book in (self._pair_book, self._wall_book, *(tool.sinks_joule for tool in self._tools)):
            book[:] = 0.0  # contacts that begin pressed have yielded before

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Arrays, by name, that later ticks depend on, and from which their results count; not copied.

        Lists of neighbours are part of it: their order is the order of the sums of forces.
        """
        arrays = {
            **named("particles", self._particles),
            **named("pairs", self._pairs),
            **named("walls", self._walls),
            "wall_force": self._wall_force,
            "pair_book": self._pair_book,
            "wall_book": self._wall_book,
            "sinks": self._sinks,
            "tool_work": np.array(self._tool_work),
            "rebuilds": np.array(self._rebuilds),
            "bed": self._bed_digest(),
        }
        parts = {f"tool.{tool.name}": tool.state_arrays() for tool in self._tools}
        if self._bonds is not None:
            parts["bonds"] = self._bonds.arrays()
        if self._monitor is not None:
            parts["watch"] = self._monitor.state_arrays()
        for prefix, part in parts.items():
            arrays.update((f"{prefix}.{name}", array) for name, array in part.items())
        return arrays

    def _bed_digest(self) -> np.ndarray:
        return bed_digest(self.bed, self._loaded_position)

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Continue from arrays of `state_arrays`, without copying them; replaces `start`.

        Raises:
            KeyError, ValueError: the arrays are not of this scene and bed.
        """
        if not np.array_equal(arrays["bed"], self._bed_digest()):
            raise ValueError("the bed prepared here is not the one that the state began with")
        names = self._resolved.scene.tools
        tools = [below(f"tool.{name}", arrays) for name in names]
        motions = (motion_from(name, tool["last"]) for name, tool in zip(names, tools, strict=True))
        self._tools = surfaces(self._resolved, self.bed, tuple(motions))
        for surface, tool in zip(self._tools, tools, strict=True):
            surface.restore(tool)
        self._moving, self._owes_kick = from_named(Particles, "particles", arrays), False
        self._pairs = from_named(PairList, "pairs", arrays)
        self._walls = from_named(WallList, "walls", arrays)
        if self._soil.bonds is not None:
            self._bonds = BondList(self._soil, self._moving, self._kind, self._features)
            self._bonds.restore(below("bonds", arrays))
        self._calls = None
        self._wall_force = arrays["wall_force"]
        self._pair_book, self._wall_book = arrays["pair_book"], arrays["wall_book"]
        self._sinks = arrays["sinks"]
        self._tool_work, self._rebuilds = float(arrays["tool_work"]), int(arrays["rebuilds"])
        if self._monitor is not None:
            self._monitor.restore(below("watch", arrays))

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of `tick`, the tools moving from where they stand to `motions`.

        Raises:
            ProtocolError: a planar tool was given a spatial motion, or the reverse.
            PhysicsError: a state that is not a number, a tool sunk too deep into a particle, or a bound of
                soil.monitors passed.
        """
        use_threads(self._threads)
        steps = self._resolved.timing.soil_steps
        starts = tuple(tool.last for tool in self._tools)
        for start, end in zip(starts, motions, strict=True):
            refuse_other_kind(f"tick {tick}", start, end, self._resolved.timing.communication_step_s)
        self._prepare_tick(tick, motions)
        self._begin_tick()
        for s in range(1, steps + 1):
            if s == steps and self._resolved.scene.coupling.force == "tick_end":
                self._keep_last_step_only()
            now = tuple(
                motion_within(a, b, self._resolved.timing.communication_step_s, s / steps)
                for a, b in zip(starts, motions, strict=True)
            )
            self._advance_step(tick, s, now)
            self._after_step(tick, s)
        return self._wrenches()

    def _prepare_tick(self, tick: int, motions: tuple[ToolMotion, ...]) -> None:
        """Hook before the steps of a tick at whose end the tools are at `motions`; does nothing here."""

    def ends_with(self, tick: int) -> None:
        """Let the run end early with `tick`, which is advanced next: the soil is checked at its end."""
        self._last_tick = tick

    def _after_step(self, tick: int, step: int) -> None:
        """Raise PhysicsError if a tool overlaps a particle too far; run the monitors when they are due."""
        for tool in self._tools:
            if tool.max_overlap_m > self._overlap_bound:
                raise PhysicsError(
                    f"{self._where(tick, step)}: tool {tool.name} overlaps a particle by "
                    f"{tool.max_overlap_m:.3g} m, allowed is soil.max_tool_overlap_m "
                    f"{self._overlap_bound:.3g} m; {self._remedy_of_overlap(tool)}"
                )
        timing = self._resolved.timing
        last = step == timing.soil_steps and tick == self._last_tick
        if self._monitor is not None and self._monitor.due(last=last):
            self._monitor.check(self._where(tick, step), tick, self)

    def _remedy_of_overlap(self, tool: ToolSurface) -> str:
        """End of the message that stops a run at an overlap of this tool."""
        return "raise soil.tool_stiffness_factor, or make the tool slower or thicker"

    def _where(self, tick: int, step: int) -> str:
        """Tick and step of an error, for its message."""
        steps = self._resolved.timing.soil_steps
        return f"tick {tick}" if steps == 1 else f"tick {tick}, soil step {step} of {steps}"

    def _begin_tick(self) -> None:
        for tool in self._tools:
            tool.begin_tick()

    def _keep_last_step_only(self) -> None:
        """`tick_end`: the exchanged force is that of the last step; work is still summed over all."""
        for tool in self._tools:
            work = tool.felt.work_joule
            tool.begin_tick()
            tool.felt.work_joule = work

    def _wrenches(self) -> tuple[ToolWrench, ...]:
        return tuple(tool.wrench() for tool in self._tools)

    def _advance_step(self, tick: int, step: int, motions: tuple[ToolMotion, ...]) -> None:
        for tool, motion in zip(self._tools, motions, strict=True):
            if tool.speed_m_per_s(motion) * self._step_s > self._smallest:
                refuse_leap(self._where(tick, step), tool, motion, self._step_s, self._smallest)
            if tool.spatial:
                self._refuse_at_sides(tick, step, tool, motion)
        calls = self._calls or self._bind(self._step_s)
        near = not self._tools_left_their_lists(motions)
        far = calls.drift_and_contacts(2 if self._owes_kick else 1, near)
        self._owes_kick = False
        if far > 0 or not near:
            refuse_lost_numbers(self._where(tick, step), self._particles)
            self._rebuild(motions)
            if self._monitor is not None:
                self._monitor.note_rebuild()
            self._bind(self._step_s).drift_and_contacts(0, True)
        self._tool_forces(motions)
        self._owes_kick = True

    def _refuse_at_sides(self, tick: int, step: int, tool: ToolSurface, motion: ToolMotion) -> None:
        if self._soil.bin.sides != "walls":
            try:
                tool.refuse_at_sides(motion, self.bed, self._soil)
            except SceneError as error:
                raise PhysicsError(f"{self._where(tick, step)}: {error}") from error

    def _tools_left_their_lists(self, motions: tuple[ToolMotion, ...]) -> bool:
        allowed = (TOOL_SKIN - 0.5) * self._soil.skin_m
        return any(tool.moved_m(motion) > allowed for tool, motion in zip(self._tools, motions, strict=True))

    def _bind(self, step: float) -> _StepCalls:
        """Kernel calls for steps of this length [s], valid until an array is replaced."""
        p, pairs, walls, features = self._particles, self._pairs, self._walls, self._features
        motion, (mass, inertia) = (p.position, p.velocity, p.spin, p.force, p.torque), self._masses()
        bind = self._kernels.bind
        drift = (
            *motion, p.built_position, p.held,
            mass, inertia, self._gravity, step, (0.5 * self._soil.skin_m) ** 2,
        )  # fmt: skip
        of_pairs = (
            pairs.slab_start, pairs.row_start, pairs.neighbour, *motion, pairs.history,
            self._kind(self._radius), self._kind(step), self._pair_law, self._mixture(self._pair_laws),
            features, self._pair_book, self._bonds.kernel_arrays() if self._bonds is not None else NO_BONDS,
        )  # fmt: skip
        of_walls = (
            walls.particle, walls.wall, self._planes, *motion, walls.history,
            self._radius, step, self._boundary, self._mixture(self._wall_laws), features,
            self._wall_force, self._wall_book,
        )  # fmt: skip
        self._calls = calls = _StepCalls(
            bind(drift_and_contacts, drift, of_pairs, of_walls, varying=(1, True)),
            bind(kick, p.velocity, p.spin, p.force, p.torque, p.held, mass, inertia, step),
        )
        for tool in self._tools:
            tool.bind(p, self._radius, step, self._at_tools, self._mixture(self._tool_laws), features)
        return calls

    def _tool_forces(self, motions: tuple[ToolMotion, ...]) -> None:
        for tool, at in zip(self._tools, motions, strict=True):
            self._felt_by(tool, *tool.forces(at), at)

    def _felt_by(
        self, tool: ToolSurface, by_group: np.ndarray, moment: np.ndarray, sums: np.ndarray, at: ToolMotion
    ) -> None:
        work = tool.felt.work_joule
        tool.feel(by_group, moment, sums, at)
        self._tool_work -= tool.felt.work_joule - work

    def _near_walls(self, reach: float) -> tuple[np.ndarray, np.ndarray]:
        return near_walls(self._particles.position, self._planes, reach)

    def _reaches_m(self) -> tuple[float, float]:
        """Largest distances at which two centres, and a centre and a wall or tool, interact."""
        at_pairs, at_walls = self._reaches
        return 2.0 * self._radius + at_pairs, self._radius + at_walls

    def _rebuild(self, motions: tuple[ToolMotion, ...], came_from: np.ndarray | None = None) -> None:
        """Sort particles into cells, find pairs, walls and tool candidates, carry histories over.

        came_from (n,): numbers of the particles in the lists so far, if they were renumbered since.
        """
        p, skin = self._particles, self._soil.skin_m
        self._calls = None
        reach, boundary_reach = self._reaches_m()
        reach += skin
        low, high = np.array(self.bed.lower_m), np.array([*self.bed.upper_m, self._domain.ceiling_m])
        period = np.inf
        if self.bed.sides == "endless":
            p.wrap_all(low, np.array(self.bed.periods_m))
        elif self.bed.period_m is not None:
            period = self.bed.period_m
            p.wrap(low[1], period)
        grid = cell_grid(p.position, reach, low, high, period)
        order, cell_start = sort_by_cell(p.position, grid)
        p.reorder(order)
        order = order if came_from is None else came_from[order]
        smaller = self._radius - p.radius if p.unequal else 0.0
        if self.bed.sides == "endless":
            row_start, neighbour = endless_list(self.bed, p.position, reach, smaller)
        else:
            row_start, neighbour = half_list(p.position, grid, cell_start, reach, smaller)
        old = self._pairs
        history = self._history(len(neighbour), self._kind)
        carry_pairs(
            order, old.row_start, old.neighbour, old.history, row_start, neighbour, history, self._parity
        )
        # the last slab of an endless bed touches the first: all is one
        per_slab = grid.nx if self.bed.sides == "endless" else _CELLS_PER_SLAB
        slabs = slab_starts(cell_start, grid, per_slab)
        self._flush_books()
        self._pairs = pairs = PairList(row_start, neighbour, history, slabs)
        if self._bonds is not None:
            self._bonds.carry(order, old, pairs)
            if self._bonds.known <= p.identity.max(initial=-1):
                self._bonds.add(pairs, p, self._laid_out_m(p.identity))
        before, (particle, wall) = self._walls, self._near_walls(boundary_reach + skin)
        history = self._history(len(particle), np.float64)
        carry_walls(
            order, before.particle, before.wall, before.history, particle, wall, history, len(self._parity)
        )
        self._walls = WallList(particle, wall, history)
        for tool, motion in zip(self._tools, motions, strict=True):
            tool.search(motion, p, order, cell_start, grid, boundary_reach + TOOL_SKIN * skin)
        self._wall_force = np.zeros((len(particle), 3))
        self._pair_book = np.zeros((len(slabs) - 1, len(self._sinks)))
        self._wall_book = np.zeros((CHUNKS, len(self._sinks)))
        self._rebuilds += 1
        self._strain = 0.0


def build_engine(resolved: ResolvedScene, threads: int = 1) -> SoilEngine:
    """The engine for the device that the scene names."""
    soil = resolved.scene.particle_soil
    if soil is not None and soil.window is not None:
        from .window import FieldEngine

        return FieldEngine(resolved, threads)
    if soil is None or soil.device == "cpu":
        return SoilEngine(resolved, threads)
    without_memory = [kind for kind, law in BUILT_IN.items() if not law.kept]
    if soil.law.kind not in without_memory:
        raise InputError(
            f"soil.device: 'gpu' computes the contact laws {', '.join(without_memory)}, not "
            f"'{soil.law.kind}'; use 'cpu'"
        )
    from .gpu.engine import GpuSoilEngine

    return GpuSoilEngine(resolved, threads)
