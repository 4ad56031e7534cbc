"""The soil engine on a GPU: motions of a tick go in, wrenches come out, all else stays on the device."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...contact_laws.base import SINKS
from ...loading.loader import ResolvedScene
from ...messages import ToolMotion, ToolWrench
from ..bed import Bed
from ..energy import EnergyBook
from ..engine import SoilEngine
from ..monitors import MotionSums, refuse_lost_numbers
from ..neighbours import CellGrid, slab_starts
from ..periodic import TOOL_SKIN
from ..readings import SoilReadings
from ..state import PairList, Particles, WallList
from ..tools.motion import motion_within, refuse_other_kind
from ..tools.surface import refuse_leap
from ..walls import CHUNKS
from .convert import half_rows, wall_pairs
from .device import refuse_without_gpu
from .device_lists import Numbers
from .forces import TOOL_SUMS
from .soil import DeviceSoil

_HEADROOM = 0.25
"""Height over the bed that has cells of its own, in heights of the bed: for soil that a tool heaps up. What
is higher belongs to the uppermost cells."""

_UNKNOWN_STEPS, _FEWEST_STEPS = 16, 4
"""Soil steps that are launched before the host checks whether lists are still valid: while it is unknown how
long they last, and when they have lasted as long as the last ones (a step in vain costs only some 10 us)."""


class GpuSoilEngine(SoilEngine):
    """SoilEngine whose particles, lists, histories and tools are on a GPU.

    Two runs on one device give the same bits. Those of the CPU differ by round-off: forces are added up in
    another order. Arrays are copied to the host only when read. An engine that raised PhysicsError is of no
    further use: its particles may have gone on for some steps.

    Raises:
        InputError: there is no GPU, besides what SoilEngine raises.
    """

    def __init__(
        self, resolved: ResolvedScene, threads: int = 1, *, book: bool = False, bed: Bed | None = None
    ) -> None:
        refuse_without_gpu()
        self._device: DeviceSoil | None = None
        self._here_is_old = False  # particles on the device have moved on from those here
        self._there_is_old = True  # particles here were replaced
        self._steps_done = 0  # on this device
        self._looked: np.ndarray | None = None  # sums over particles, until they move
        self._restored_slabs: np.ndarray | None = None  # of restored lists, until there are new ones
        self._lasted = self._since = 0  # soil steps between the last two new lists, and since then
        super().__init__(resolved, threads, book=book, bed=bed)

    @property
    def _particles(self) -> Particles:
        if self._here_is_old:
            assert self._device is not None
            self._moving = self._device.take_particles()
            self._here_is_old = False
        return self._moving

    @property
    def particle_count(self) -> int:
        """Particles in the bin."""
        return self._moving.count

    @property
    def listed_pair_count(self) -> int:
        """Pairs in the neighbour list, the skin included."""
        return self._soil_there.listed_pairs()

    @property
    def _soil_there(self) -> DeviceSoil:
        assert self._device is not None
        return self._device

    @property
    def wall_force_newton(self) -> np.ndarray:
        """(3,) sum of what the walls put on the particles in the last soil step, world axes."""
        self._fetch_boundaries()
        return super().wall_force_newton

    def _load(self, *particles: Any) -> None:
        self._here_is_old, self._there_is_old = False, True
        super()._load(*particles)

    def _keep(self, kept: np.ndarray) -> None:
        super()._keep(kept)
        self._there_is_old = True

    def _take_over_particles(self) -> None:
        self._soil_there.put_particles(self._particles)
        self._looked = None

    def damp(self, kept: float) -> None:
        """Global damping: every velocity and spin times `kept`."""
        self._soil_there.damp(kept)
        self._here_is_old, self._looked = True, None

    # lists

    def _grid(self, reach: float) -> CellGrid:
        """Cells over the whole bed, the same for all lists, so that the host needs no places of particles."""
        low, high = np.array(self.bed.lower_m), np.array([*self.bed.upper_m, 0.0])
        top = float(self._loaded_position[:, 2].max())  # as a restored run has it too
        high[2] = min(self._domain.ceiling_m, top + _HEADROOM * (top - low[2]))
        count = np.maximum(np.ceil((high - low) / reach), 1).astype(np.int64)
        edge_y, period = reach, np.inf
        if self.bed.period_m is not None:
            period = self.bed.period_m
            count[1] = int(period / reach + 1e-9)
            edge_y = period / count[1]
        nx, ny, nz = count.tolist()
        x, y, z = low.tolist()
        return CellGrid(x, y, z, reach, edge_y, nx, ny, nz, period)

    def _new_device(self) -> None:
        """Put a soil with the particles and tools of the host on the device, its lists still to be built."""
        self._device = None  # frees its memory first
        kind, skin = self._kind, self._soil.skin_m
        reach, wall_reach = self._reaches_m()
        reach += skin
        numbers = Numbers(
            features=self._features,
            precision=kind,
            step_s=self._step_s,
            gravity_m_per_s2=self._gravity,
            skin_m=skin,
            radius_m=self._radius,
            mass_kg=self._mass,
            inertia_kg_m2=self._inertia,
            pair_law=self._pair_law,
            wall_law=_of_floats(self._boundary),
            tool_law=_of_floats(self._at_tools),
            pair_laws=self._pair_laws,
            wall_laws=self._wall_laws,
            tool_laws=self._tool_laws,
            materials=len(self._density),
            planes=self._planes,
            ceiling_m=self._domain.ceiling_m,
            reach_m=reach,
            wall_reach_m=wall_reach + skin,
            tool_reach_m=wall_reach + TOOL_SKIN * skin,
            soil_steps=self._resolved.timing.soil_steps,
        )
        tools = [(tool.facets, len(tool.mesh.groups)) for tool in self._tools]
        self._device = DeviceSoil(numbers, self._moving, self._grid(reach), tools)
        self._here_is_old = self._there_is_old = False
        self._steps_done, self._looked, self._restored_slabs = 0, None, None

    def _rebuild(self, motions: tuple[ToolMotion, ...], came_from: np.ndarray | None = None) -> None:
        assert came_from is None, "soil comes and goes on a CPU only"
        if self._there_is_old:
            self._new_device()
        poses = [tool.kernel_motion(motion)[:4] for tool, motion in zip(self._tools, motions, strict=True)]
        self._soil_there.rebuild(poses)
        for tool, motion in zip(self._tools, motions, strict=True):
            tool.searched_at(motion)
        self._here_is_old, self._looked = True, None
        self._restored_slabs = None
        self._rebuilds += 1
        self._lasted, self._since = self._since, 0

    # soil steps

    def _first_forces(self, motions: tuple[ToolMotion, ...]) -> None:
        self._soil_there.put_motions([self._of_tools(motions)])
        self._note_tools(self._soil_there.first_forces(), motions)

    def _of_tools(self, motions: tuple[ToolMotion, ...]) -> tuple[Any, ...]:
        return tuple(tool.kernel_motion(at) for tool, at in zip(self._tools, motions, strict=True))

    def _note_tools(self, felt: np.ndarray, motions: tuple[ToolMotion, ...]) -> None:
        """Note the loads `felt` (columns,) of all tools: forces by group, moment, sums."""
        first = 0
        for tool, at in zip(self._tools, motions, strict=True):
            of_groups = 3 * len(tool.mesh.groups)
            by_group, rest = felt[first : first + of_groups], felt[first + of_groups :]
            self._felt_by(tool, by_group.reshape(-1, 3), rest[:3], rest[3:TOOL_SUMS], at)
            first += of_groups + TOOL_SUMS

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """See SoilEngine."""
        timing, device = self._resolved.timing, self._soil_there
        steps = timing.soil_steps
        starts = tuple(tool.last for tool in self._tools)
        for start, end in zip(starts, motions, strict=True):
            refuse_other_kind(f"tick {tick}", start, end, timing.communication_step_s)
        ends = [
            tuple(
                motion_within(a, b, timing.communication_step_s, s / steps)
                for a, b in zip(starts, motions, strict=True)
            )
            for s in range(1, steps + 1)
        ]
        self._begin_tick()
        device.put_motions([self._of_tools(at) for at in ends])
        done = 0
        while done < steps:
            self._here_is_old, self._looked = True, None
            refused = self._refuse_leaps(tick, done, ends)
            wanted = self._steps_to_launch(done, refused, ends)
            if wanted > 0:
                device.run_steps(wanted)
            else:
                device.drift_only()
            told, felt = device.report()
            reached = told["steps"] - self._steps_done
            rebuilt = bool(told["halted"]) or wanted == 0
            self._since += reached - done
            # a step to look at is the last of those launched: where it halted there is none
            for s in range(done, reached):
                self._end_step(tick, s, felt[s], ends[s], rebuilt=False)
            if rebuilt:
                if told["lost"]:
                    refuse_lost_numbers(self._where(tick, reached + 1), device.take_particles())
                self._rebuild(ends[reached])
                device.finish_step()
                told, felt = device.report()
                self._end_step(tick, reached, felt[reached], ends[reached], rebuilt=True)
                reached += 1
            done = reached
        self._steps_done += steps
        return self._wrenches()

    def _refuse_leaps(self, tick: int, done: int, ends: list[tuple[ToolMotion, ...]]) -> int:
        """The first soil step, counted from 0, before which the tool leaps; refuses one that comes next."""
        for s in range(done, len(ends)):
            for tool, motion in zip(self._tools, ends[s], strict=True):
                if tool.speed_m_per_s(motion) * self._step_s > self._smallest:
                    if s == done:
                        refuse_leap(self._where(tick, s + 1), tool, motion, self._step_s, self._smallest)
                    return s
        return len(ends)

    def _steps_to_launch(self, done: int, end: int, ends: list[tuple[ToolMotion, ...]]) -> int:
        """Soil steps from `done` on until the host looks; 0 where a tool leaves its lists in the next."""
        for s in range(done, end):
            if self._tools_left_their_lists(ends[s]):
                end = s
                break
        left = max(self._lasted - self._since, _FEWEST_STEPS) if self._lasted else _UNKNOWN_STEPS
        until_look = left if self._monitor is None else self._monitor.steps_until_due()
        return min(end - done, left, until_look)

    def _end_step(
        self, tick: int, s: int, felt: np.ndarray, at: tuple[ToolMotion, ...], *, rebuilt: bool
    ) -> None:
        """Finish soil step s, counted from 0, on the CPU."""
        steps = self._resolved.timing.soil_steps
        if s == steps - 1 and self._resolved.scene.coupling.force == "tick_end":
            self._keep_last_step_only()
        self._note_tools(felt, at)
        if rebuilt and self._monitor is not None:
            self._monitor.note_rebuild()
        self._after_step(tick, s + 1)

    # readings

    def _look(self) -> np.ndarray:
        if self._looked is None:
            self._looked = self._soil_there.look_at_particles()
        return self._looked

    def motion_sums(self) -> MotionSums:
        """Sums over particles from which the monitors judge motion."""
        return MotionSums(*self._look()[:5].tolist())

    def anyone_outside(self) -> bool:
        """Whether a particle has left the domain."""
        return bool(self._look()[7] > 0.0)

    def _moving_joule(self) -> tuple[float, float]:
        _, _, _, _, _, kinetic, height, _ = self._look().tolist()
        return kinetic, self._gravity * height

    def _scan_contacts(self) -> tuple[int, float]:
        contacts, largest, _ = self._soil_there.look_at_pairs()
        return contacts, largest

    def _stored_in_pairs(self) -> float:
        return self._soil_there.look_at_pairs()[2]

    def _flush_books(self) -> None:
        if self._features.book.ndim == 2:
            self._sinks += self._soil_there.take_books()

    def energy(self) -> EnergyBook:
        """The energy book at the end of the last tick."""
        self._fetch_boundaries()
        return super().energy()

    def state_arrays(self) -> dict[str, np.ndarray]:
        """See SoilEngine; a CPU and a GPU can continue from these arrays."""
        self._flush_books()
        self._fetch_boundaries()
        lists = self._soil_there.take_pairs()
        slabs = self._restored_slabs
        if slabs is None:
            slabs = slab_starts(lists["cell_start"], self._soil_there.grid, 1)
        self._pairs = PairList(*half_rows(lists, self._kind), slabs)
        self._pair_book = np.zeros((len(slabs) - 1, len(SINKS)))
        self._wall_book = np.zeros((CHUNKS, len(SINKS)))
        return super().state_arrays()

    def _fetch_boundaries(self) -> None:
        """Copy the contacts at walls and tools to the host, in the form of the CPU's lists."""
        particle, wall, history, force = wall_pairs(self._soil_there.take_walls(), self._planes)
        self._walls, self._wall_force = WallList(particle, wall, history), force
        for tool, near in zip(self._tools, self._soil_there.take_tools(), strict=True):
            tool.near = near

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """See SoilEngine."""
        super().restore(arrays)
        SoilReadings._flush_books(self)  # what a CPU has not booked yet
        self._here_is_old = False
        self._new_device()
        self._restored_slabs = self._pairs.slab_start
        self._soil_there.put_lists(
            self._pairs, self._walls, [tool.near for tool in self._tools], self._wall_force
        )
        self._here_is_old = True


def _of_floats(law: Any) -> Any:
    return type(law)(*(float(number) for number in law))
