"""The soil engine: motions of the tools in, wrenches on the tools out."""

import numba
import numpy as np

from ..errors import InputError, PhysicsError, SceneError
from ..messages import SoilCloud, SoilState, ToolMotion, ToolWrench
from ..scene.limits import DENSE_COORDINATION, SAFETY, step_limits
from ..scene.loader import ResolvedScene
from ..scene.meshes import load_tool_mesh
from ..scene.pairs import particle_mass_kg
from .bed import Bed, finite_rows, refuse_outside
from .beds.prepare import prepare_bed
from .contact import SINKS, soil_laws
from .energy import EnergyBook
from .integration import kick, kick_drift, motion_sums
from .monitors import Domain, LostParticle, MotionSums, Watch, half_step_sums, refuse_lost_numbers
from .neighbours import carry_pairs, carry_rows, cell_grid, half_list, slab_starts, sort_by_cell
from .pairs import pair_forces, pair_scan
from .periodic import TOOL_SKIN, refuse_narrow_period, refuse_tool_at_seam, wrapped
from .state import PairList, Particles, WallList
from .tool_surface import ToolSurface, motion_within
from .walls import near_walls, wall_forces, wall_planes, wall_scan

_CELLS_PER_SLAB = 2
"""Slab width in cells: wider than the reach, narrow enough to keep threads equally busy (chosen)."""


class SoilEngine:
    """Discrete elements in a bin, touched by tools.

    Results do not depend on `threads`. With `book`, or where the scene balances the energy, every energy sink
    is booked (slower). `bed` stands for the one the scene describes.
    """

    def __init__(
        self, resolved: ResolvedScene, threads: int = 1, *, book: bool = False, bed: Bed | None = None
    ) -> None:
        soil = resolved.scene.soil
        if soil is None:
            raise InputError(f"{resolved.path}: has no 'soil', so it needs no soil engine")
        if not 1 <= threads <= numba.config.NUMBA_NUM_THREADS:
            raise InputError(
                f"threads: {threads} given, this machine allows 1 to {numba.config.NUMBA_NUM_THREADS}; "
                "give fewer, or set NUMBA_NUM_THREADS"
            )
        self._resolved, self._soil, self._threads = resolved, soil, threads
        self._step_s = resolved.timing.soil_step_s
        self._gravity = resolved.scene.gravity_m_per_s2
        self._radius = soil.particles.radius_m
        self._mass = particle_mass_kg(soil)
        self._inertia = 0.4 * self._mass * self._radius**2
        self.bed: Bed = bed or prepare_bed(resolved, SoilEngine, threads)
        refuse_narrow_period(self.bed, soil)
        book = book or (soil.monitors is not None and soil.monitors.largest_energy_defect is not None)
        period = self.bed.period_m
        self._law, self._boundary, self._features = soil_laws(soil, self._step_s, book=book, period_m=period)
        self._at_tools = self._boundary._replace(
            stiffness=self._boundary.stiffness * soil.tool_stiffness_factor
        )
        self._overlap_bound = soil.largest_tool_overlap_m or 2.0 * self._radius
        self._planes = wall_planes(self.bed.lower_m, self.bed.upper_m, self.bed.sides)
        self._tools: tuple[ToolSurface, ...] = ()
        self._rebuilds = 0
        self._tool_work = 0.0
        self._sinks = np.zeros(len(SINKS))  # of pairs and walls
        self._load(self.bed.positions_m, np.arange(len(self.bed.positions_m)))
        if bed is None:
            self._refuse_step_too_large()

    @property
    def coordination(self) -> float:
        """Contacts in reach per particle, those between particles only."""
        return 2.0 * self._scan_pairs()[0] / self._particles.count

    def _refuse_step_too_large(self) -> None:
        """The scene's step was chosen for dense packing; a bed denser still needs a smaller one."""
        if self.coordination <= DENSE_COORDINATION:
            return
        limit = step_limits(self._soil, self.coordination)[0]
        if self._step_s > limit.limit_s and not self._soil.force_time_step:
            raise SceneError(
                f"soil.time_step_s: {self._step_s:.3g} s is above the stable limit {limit.limit_s:.3g} s of "
                f"the prepared bed ({limit.cause}); use at most {SAFETY * limit.limit_s:.2g} s"
            )

    def _load(self, position: np.ndarray, identity: np.ndarray) -> None:
        """Start from particles at rest without contact history."""
        self._particles = Particles.at_rest(np.array(position), identity)
        self._loaded_position = position.copy()
        self._domain = Domain(self._planes, self.bed, position, self._radius)
        self._watch = None if self._soil.monitors is None else Watch(self._soil, self._domain, len(position))
        self._forget_contacts()
        self._rebuild(())

    def _keep(self, kept: np.ndarray) -> None:
        """Only the particles where `kept` (n,) bool, without contact history."""
        p = self._particles
        p.reorder(np.flatnonzero(kept))
        self._forget_contacts()

    def _forget_contacts(self) -> None:
        none = np.empty((0, 3))
        rows = np.zeros(self._particles.count + 1, np.int64)
        self._pairs = PairList(rows, np.empty(0, np.int32), none, none.copy(), np.zeros(1, np.int64))
        walls = np.empty((0, len(self._planes), 3))
        self._walls = WallList(np.empty(0, np.int64), walls, walls.copy())

    def place(
        self,
        position_m: np.ndarray,
        velocity_m_per_s: np.ndarray | None = None,
        spin_rad_per_s: np.ndarray | None = None,
    ) -> None:
        """Put these particles into the bin instead of the prepared bed: (n, 3) arrays, world axes.

        Call it before `start`, which then must not remove any of them.

        Raises:
            InputError: no particle, one outside the bin, or a number that is none.
        """
        position = np.array(position_m, dtype=np.float64).reshape(-1, 3)
        refuse_outside(self.bed, self._planes, position)
        self._load(position, np.arange(len(position)))
        back = self._particles.identity
        for name, given in (("velocity", velocity_m_per_s), ("spin", spin_rad_per_s)):
            if given is not None:
                setattr(self._particles, name, finite_rows(name, given, len(position))[back])

    def damp(self, kept: float) -> None:
        """Global damping: every velocity and spin times `kept`. For the preparation of beds."""
        self._particles.velocity *= kept
        self._particles.spin *= kept

    @property
    def particle_count(self) -> int:
        """Particles in the bin."""
        return self._particles.count

    @property
    def mass_kg(self) -> float:
        """Mass of one particle."""
        return self._mass

    @property
    def wall_force_newton(self) -> np.ndarray:
        """(3,) sum of what the walls put on the particles in the last soil step, world axes."""
        return self._wall_force.sum(axis=0)

    @property
    def momentum_kg_m_per_s(self) -> np.ndarray:
        """(3,) of all particles, world axes."""
        p = self._particles
        return self._mass * motion_sums(p.position, p.velocity, p.spin)[3]

    def positions_m(self) -> np.ndarray:
        """(n, 3) float64, world axes, in the order of the prepared bed; inside the box if it is periodic."""
        position = self._particles.position[np.argsort(self._particles.identity)]
        if self.bed.period_m is not None:
            position[:, 1] = wrapped(position[:, 1], self.bed.lower_m[1], self.bed.period_m)[0]
        return position

    def displacements_m(self) -> np.ndarray:
        """(n, 3) float64, world axes: from the place in the prepared bed, in its order. The disturbance.

        It goes on growing where a particle passes from one periodic side to the other.
        """
        p = self._particles
        back = np.argsort(p.identity)
        moved = p.position[back] - self._loaded_position[p.identity[back]]
        if self.bed.period_m is not None:
            moved[:, 1] += p.image[back] * self.bed.period_m
        return moved

    @property
    def lost_particles(self) -> tuple[LostParticle, ...]:
        """The first that left the domain."""
        return tuple(self._watch.first_lost) if self._watch is not None else ()

    def velocities_m_per_s(self) -> np.ndarray:
        """(n, 3) float64, world axes, in the order of the prepared bed."""
        return self._particles.velocity[np.argsort(self._particles.identity)]

    def spins_rad_per_s(self) -> np.ndarray:
        """(n, 3) float64, world axes, in the order of the prepared bed."""
        return self._particles.spin[np.argsort(self._particles.identity)]

    def forces_newton(self) -> np.ndarray:
        """(n, 3) float64, world axes, sum on each particle at the end of the last step, weight included."""
        return self._particles.force[np.argsort(self._particles.identity)]

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of the initial state. Particles that the tools overlap are removed; no time advances.

        A particle goes when its centre is inside a tool or so near that the contact would press.
        """
        scene = self._resolved.scene
        bodies = scene.mechanism.bodies if scene.mechanism else {}
        numba.set_num_threads(self._threads)
        tools = []
        for (name, tool), motion in zip(scene.tools.items(), motions, strict=True):
            mesh = load_tool_mesh(self._resolved.directory, scene, name)
            refuse_tool_at_seam(name, mesh.vertices_m, self.bed, self._soil)
            reference = bodies[tool.body].angle_rad if tool.body else 0.0
            tools.append(ToolSurface(name, mesh, reference, motion))
        clearance = self._radius - self._boundary.rest_overlap
        kept = np.ones(self._particles.count, np.bool_)
        for surface in tools:
            kept[surface.overlapped(self._particles, clearance)] = False
        if not kept.any():
            raise InputError("tools: they overlap every particle of the bed; check their scale and position")
        self._tools = tuple(tools)
        self._keep(kept)
        self._rebuild(motions)
        self._begin_tick()
        self._add_forces(motions, step=0.0)
        if self._watch is not None and self._watch.balances:
            self._watch.begin(self.energy())
        return self._wrenches()

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of `tick`, the tools moving from where they stand to `motions`.

        Raises:
            PhysicsError: a state that is not a number, a tool sunk too deep into a particle, or a bound of
                soil.monitors passed.
        """
        numba.set_num_threads(self._threads)
        steps = self._resolved.timing.soil_steps
        starts = tuple(tool.last for tool in self._tools)
        self._begin_tick()
        for s in range(1, steps + 1):
            if s == steps and self._resolved.scene.coupling.force == "tick_end":
                self._keep_last_step_only()
            now = tuple(
                motion_within(a, b, self._resolved.timing.interval_s, s / steps)
                for a, b in zip(starts, motions, strict=True)
            )
            where = f"tick {tick}" if steps == 1 else f"tick {tick}, soil step {s} of {steps}"
            self._advance_step(where, now)
            last = s == steps and tick == self._resolved.timing.tick_count - 1
            if self._watch is not None and self._watch.due(last=last):
                sums = self._motion_sums()
                self._watch.look(where, tick, self._particles, sums, self._largest_overlap, self.energy)
        return self._wrenches()

    def _motion_sums(self) -> MotionSums:
        p = self._particles
        return MotionSums(
            *half_step_sums(
                p.position, p.velocity, p.spin, p.force, p.torque, self._mass, self._inertia, self._step_s
            )
        )

    def _largest_overlap(self) -> float:
        return self._scan_pairs()[1]

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

    def _advance_step(self, where: str, motions: tuple[ToolMotion, ...]) -> None:
        p, skin = self._particles, self._soil.skin_m
        far = kick_drift(
            p.position, p.velocity, p.spin, p.force, p.torque, p.built_position,
            self._mass, self._inertia, self._gravity, self._step_s, (0.5 * skin) ** 2,
        )  # fmt: skip
        allowed = (TOOL_SKIN - 0.5) * skin
        if far or any(t.moved_m(m) > allowed for t, m in zip(self._tools, motions, strict=True)):
            refuse_lost_numbers(where, self._particles)
            self._rebuild(motions)
        self._add_forces(motions, self._step_s)
        kick(p.velocity, p.spin, p.force, p.torque, self._mass, self._inertia, self._step_s)
        deepest = max((tool.largest_overlap_m for tool in self._tools), default=0.0)
        if deepest > self._overlap_bound:
            raise PhysicsError(
                f"{where}: a tool overlaps a particle by {deepest:.3g} m, allowed is "
                f"soil.largest_tool_overlap_m {self._overlap_bound:.3g} m; raise "
                "soil.tool_stiffness_factor, or make the tool slower or thicker"
            )

    def _add_forces(self, motions: tuple[ToolMotion, ...], step: float) -> None:
        p, pairs, walls, features = self._particles, self._pairs, self._walls, self._features
        motion = (p.position, p.velocity, p.spin, p.force, p.torque)
        if step == 0.0:
            p.force[:] = 0.0
            p.force[:, 2] = -self._mass * self._gravity
            p.torque[:] = 0.0
        pair_forces(
            pairs.slab_start, pairs.row_start, pairs.neighbour, *motion, pairs.shear, pairs.roll,
            self._radius, step, self._law, features, self._pair_book,
        )  # fmt: skip
        wall_forces(
            walls.particle, self._planes, *motion, walls.shear, walls.roll,
            self._radius, step, self._boundary, features, self._wall_force, self._wall_book,
        )  # fmt: skip
        for tool, at in zip(self._tools, motions, strict=True):
            work = tool.felt.work_joule
            tool.add_forces(p, at, self._radius, step, self._at_tools, features)
            self._tool_work -= tool.felt.work_joule - work

    def _rebuild(self, motions: tuple[ToolMotion, ...]) -> None:
        """Sort particles into cells, find pairs, walls and tool candidates, carry histories over."""
        p, skin = self._particles, self._soil.skin_m
        adhesive = self._features.adhesion.ndim == 2
        reach = 2.0 * self._radius + (self._law.reach if adhesive else 0.0) + skin
        boundary_reach = self._radius + (self._boundary.reach if adhesive else 0.0)
        low, high = np.array(self.bed.lower_m), np.array([*self.bed.upper_m, self._domain.ceiling_m])
        period = np.inf
        if self.bed.period_m is not None:
            period = self.bed.period_m
            p.wrap(low[1], period)
        grid = cell_grid(p.position, reach, low, high, period)
        order, cell_start = sort_by_cell(p.position, grid)
        p.reorder(order)
        row_start, neighbour = half_list(p.position, grid, cell_start, reach)
        old = self._pairs
        shear, roll = carry_pairs(
            order, old.row_start, old.neighbour, old.shear, old.roll, row_start, neighbour
        )
        slabs = slab_starts(cell_start, grid, _CELLS_PER_SLAB)
        self._flush_books()
        self._pairs = PairList(row_start, neighbour, shear, roll, slabs)
        particle = near_walls(p.position, self._planes, boundary_reach + skin)
        histories = carry_rows(order, self._walls.particle, particle, (self._walls.shear, self._walls.roll))
        self._walls = WallList(particle, *histories)
        for tool, motion in zip(self._tools, motions, strict=True):
            tool.search(motion, p, order, cell_start, grid, boundary_reach + TOOL_SKIN * skin)
        self._wall_force = np.zeros((len(particle), 3))
        self._pair_book = np.zeros((len(slabs) - 1, len(SINKS)))
        self._wall_book = np.zeros((len(particle), len(SINKS)))
        self._rebuilds += 1

    def _flush_books(self) -> None:
        if self._features.book.ndim == 2 and self._rebuilds > 0:
            self._sinks += self._pair_book.sum(axis=0) + self._wall_book.sum(axis=0)
            self._pair_book[:] = 0.0
            self._wall_book[:] = 0.0

    def state(self, run_id: str, tick: int, end_time_ns: int) -> SoilState:
        """Monitors at the end of `tick`.

        The rms spin is that half a step before and after: one that turns round from step to step is zero
        in between.
        """
        n = self._particles.count
        contacts, largest, _ = self._scan_pairs()
        sums = self._motion_sums()
        return SoilState(
            run_id,
            tick,
            end_time_ns,
            particle_count=n,
            contact_count=contacts,
            lost_particle_count=self._watch.lost_count if self._watch is not None else 0,
            rebuild_count=self._rebuilds,
            kinetic_energy_joule=0.5 * (self._mass * sums.speed2 + self._inertia * sums.spin2),
            rms_speed_m_per_s=float(np.sqrt(sums.speed2 / n)),
            rms_spin_rad_per_s=float(np.sqrt((sums.spin2 + sums.half_spin2) / n)),
            largest_overlap_m=largest,
            largest_tool_overlap_m=max((t.largest_overlap_m for t in self._tools), default=0.0),
        )

    def _scan_pairs(self) -> tuple[int, float, float]:
        pairs = self._pairs
        return pair_scan(
            pairs.row_start, pairs.neighbour, self._particles.position, pairs.shear, pairs.roll,
            self._radius, self._law, self._features,
        )  # fmt: skip

    def energy(self) -> EnergyBook:
        """The energy book at the end of the last tick."""
        p, walls = self._particles, self._walls
        self._flush_books()
        speed2, spin2, height, _ = motion_sums(p.position, p.velocity, p.spin)
        at_walls = wall_scan(
            walls.particle, self._planes, p.position, walls.shear, walls.roll,
            self._radius, self._boundary, self._features,
        )[2]  # fmt: skip
        at_tools = sum(t.stored_joule(p, self._radius, self._at_tools, self._features) for t in self._tools)
        sinks = self._sinks + sum((t.sinks_joule for t in self._tools), np.zeros(len(SINKS)))
        return EnergyBook(
            kinetic_joule=0.5 * (self._mass * speed2 + self._inertia * spin2),
            gravity_joule=self._mass * self._gravity * height,
            stored_joule=self._scan_pairs()[2] + at_walls + at_tools,
            sinks_joule=dict(zip(SINKS, sinks.tolist(), strict=True)),
            tool_work_joule=self._tool_work,
        )

    def potential_joule(self) -> float:
        """Energy of position: stored in contacts, and gravity."""
        book = self.energy()
        return book.stored_joule + book.gravity_joule

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """Particles in the order of the prepared bed, float32."""
        speed = np.linalg.norm(self.velocities_m_per_s(), axis=1)
        return SoilCloud(tick, end_time_ns, self.positions_m().astype(np.float32), speed.astype(np.float32))
