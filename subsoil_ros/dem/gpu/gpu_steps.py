"""Soil steps on a GPU: motions of a tick go in, loads of the tools come out, all else stays on the device."""

from collections.abc import Sequence

import numpy as np

from ...contact_laws.registry import BUILT_IN
from ...errors import InputError
from ...messages import ToolMotion
from ..cpu_steps import CpuSteps, tools_left_their_lists
from ..model import SoilModel
from ..monitors import MotionSums, refuse_lost_numbers
from ..neighbours import CellGrid, slab_starts
from ..particles import PairList, Particles
from ..state import SoilState
from ..step_checks import StepChecks
from ..tools.motion import Motion
from ..walls import CHUNKS
from .convert import half_rows, wall_pairs
from .device import refuse_without_gpu
from .device_soil import DeviceSoil

_HEADROOM = 0.25
"""Height over the bed that has cells of its own, in heights of the bed: for soil that a tool heaps up. What
is higher belongs to the uppermost cells."""

_UNKNOWN_STEPS, _FEWEST_STEPS = 16, 4
"""Soil steps that are launched before the host checks whether lists are still valid: while it is unknown how
long they last, and when they have lasted as long as the last ones (a step in vain costs only some 10 us)."""


class GpuSteps:
    """Soil steps of one state whose particles, lists, histories and tools are on a GPU.

    Two runs on one device give the same bits. Those of the CPU differ by round-off: forces are added up in
    another order. Arrays are copied to the host only when read. After a PhysicsError the state is of no
    further use: its particles may have gone on for some steps.

    Raises:
        InputError: there is no GPU, or it does not compute the contact law.
    """

    def __init__(self, model: SoilModel, state: SoilState, threads: int) -> None:
        refuse_without_gpu()
        if model.soil.law.kind not in BUILT_IN:
            raise InputError(
                f"soil.device: 'gpu' computes the contact laws {', '.join(BUILT_IN)}, not "
                f"'{model.soil.law.kind}'; use 'cpu'"
            )
        self._model, self.state, self._host = model, state, CpuSteps(model, state, threads)
        self._device: DeviceSoil | None = None  # None: the state here is to be put there
        self._particles_are_there = False  # those here are old
        self._lists_are_there = False
        self._steps_done = 0  # on this device
        self._sums: np.ndarray | None = None  # over particles, until they move
        self._restored_slabs: np.ndarray | None = (
            None  # of lists that came from here, until there are new ones
        )
        self._lasted = self._since = 0  # soil steps between the last two new lists, and since then

    # the state, here and there

    @property
    def _soil_there(self) -> DeviceSoil:
        """The soil on the device, after its lists were put there if they are still here."""
        if self._device is None:
            state = self.state
            state.flush_books()  # what a CPU has not booked yet
            if state.bonds is not None:
                state.bonds.flush()
            device = self._new_device()
            self._restored_slabs = state.pairs.slab_start
            device.put_lists(state)
            self._lists_are_there = True
        assert self._device is not None
        return self._device

    def _new_device(self) -> DeviceSoil:
        """Put a soil with the particles and tools of the host on the device, its lists still to be built."""
        self._device = None  # frees its memory first
        self._device = device = DeviceSoil(self._model, self.state, self._grid())
        self._particles_are_there = False
        self._steps_done, self._sums, self._restored_slabs = 0, None, None
        return device

    def _grid(self) -> CellGrid:
        """Cells over the whole bed, the same for all lists, so that the host needs no places of particles."""
        domain, reach = self.state.domain, self._model.reach_m
        bed = domain.bed
        low, high = np.array(bed.lower_m), np.array([*bed.upper_m, 0.0])
        top = float(self.state.origin.places_m[:, 2].max())  # as a restored run has it too
        high[2] = min(domain.ceiling_m, top + _HEADROOM * (top - low[2]))
        count = np.maximum(np.ceil((high - low) / reach), 1).astype(np.int64)
        edge_y, period = reach, np.inf
        if bed.period_m is not None:
            period = bed.period_m
            count[1] = int(period / reach + 1e-9)
            edge_y = period / count[1]
        nx, ny, nz = count.tolist()
        x, y, z = low.tolist()
        return CellGrid(x, y, z, reach, edge_y, nx, ny, nz, period)

    def particles(self) -> Particles:
        """See Steps."""
        if self._particles_are_there:
            self.state.particles = self._soil_there.take_particles()
            self._particles_are_there = False
        return self.state.particles

    def take_boundaries(self) -> None:
        """See Steps."""
        if not self._lists_are_there:
            return
        state, device = self.state, self._soil_there
        components = len(self._model.parity)
        state.walls, state.wall_force = wall_pairs(device.take_walls(), state.domain.planes, components)
        for tool, near in zip(state.tools, device.take_tools(), strict=True):
            tool.near = near

    def to_host(self) -> CpuSteps:
        """See Steps."""
        self.particles()
        if self._lists_are_there:
            self.flush_books()
            self.take_boundaries()
            state, device = self.state, self._soil_there
            lists = device.take_pairs()
            slabs = self._restored_slabs
            if slabs is None:
                slabs = slab_starts(lists["cell_start"], device.grid, 1)
            components, kind = len(self._model.parity), self._model.precision
            row_start, neighbour, history, of_bonds = half_rows(lists, components, kind)
            state.pairs = PairList(row_start, neighbour, history, slabs)
            if state.bonds is not None:
                state.bonds.take(of_bonds, lists["bond_counts"], len(slabs) - 1)
            state.pair_book = np.zeros((len(slabs) - 1, len(state.sinks)))
            state.wall_book = np.zeros((CHUNKS, len(state.sinks)))
        return self._host

    def from_host(self) -> None:
        """See Steps."""
        self._device, self._particles_are_there, self._lists_are_there = None, False, False
        self._host.from_host()

    def rebuild(self, motions: tuple[ToolMotion, ...]) -> None:
        """See Steps."""
        state = self.state
        if state.bonds is not None and state.bonds.known <= state.particles.identity.max(initial=-1):
            self.to_host().rebuild(motions)  # which makes the bonds of new particles
            self.from_host()
            return
        device = self._device or self._new_device()
        device.rebuild(self._of_tools(motions))
        for tool, motion in zip(state.tools, motions, strict=True):
            tool.searched_at(motion)
        self._particles_are_there = self._lists_are_there = True
        self._sums = self._restored_slabs = None
        state.rebuild_count += 1
        self._lasted, self._since = self._since, 0

    def damp(self, kept: float) -> None:
        """See Steps."""
        self._soil_there.damp(kept)
        self._particles_are_there, self._sums = True, None

    # soil steps

    def first_forces(self, motions: tuple[ToolMotion, ...]) -> None:
        """See Steps."""
        device = self._soil_there
        device.put_motions([self._of_tools(motions)])
        self._load_tools(device.first_forces(), motions)
        device.take_books()  # contacts that begin pressed have yielded before
        for tool in self.state.tools:
            tool.sinks_joule[:] = 0.0

    def _of_tools(self, motions: tuple[ToolMotion, ...]) -> tuple[Motion, ...]:
        return tuple(tool.kernel_motion(at) for tool, at in zip(self.state.tools, motions, strict=True))

    def _load_tools(self, loads: np.ndarray, motions: tuple[ToolMotion, ...]) -> None:
        """Add the loads `loads` (columns,) of all tools: forces by group, moment, sums."""
        first, sums = 0, len(self.state.sinks) + 2
        for tool, at in zip(self.state.tools, motions, strict=True):
            of_groups = 3 * len(tool.mesh.groups)
            by_group, rest = loads[first : first + of_groups], loads[first + of_groups :]
            self.state.load_tool(tool, by_group.reshape(-1, 3), rest[:3], rest[3 : 3 + sums], at)
            first += of_groups + 3 + sums

    def advance(self, tick: int, way: Sequence[tuple[ToolMotion, ...]], checks: StepChecks) -> None:
        """See Steps."""
        device, done = self._soil_there, 0
        device.put_motions([self._of_tools(at) for at in way])
        while done < len(way):
            self._particles_are_there, self._sums = True, None
            wanted = self._steps_to_launch(done, checks.first_refused(tick, done, way), way)
            if wanted > 0:
                device.run_steps(wanted)
            else:
                device.drift_only()
            told, loads = device.report()
            reached = told["steps"] - self._steps_done
            rebuilt = bool(told["halted"]) or wanted == 0
            self._since += reached - done
            # a step to check is the last of those launched: where it halted there is none
            for s in range(done, reached):
                self._end_step(tick, s, loads[s], way[s], checks)
            if rebuilt:
                if told["lost"]:
                    refuse_lost_numbers(checks.where(tick, reached + 1), device.take_particles())
                self.rebuild(way[reached])
                device.finish_step()
                told, loads = device.report()
                if self.state.monitor is not None:
                    self.state.monitor.note_rebuild()
                self._end_step(tick, reached, loads[reached], way[reached], checks)
                reached += 1
            done = reached
        self._steps_done += len(way)

    def _steps_to_launch(self, done: int, end: int, way: Sequence[tuple[ToolMotion, ...]]) -> int:
        """Soil steps from `done` on until the host looks; 0 where a tool leaves its lists in the next."""
        for s in range(done, end):
            if tools_left_their_lists(self._model, self.state, way[s]):
                end = s
                break
        left = max(self._lasted - self._since, _FEWEST_STEPS) if self._lasted else _UNKNOWN_STEPS
        monitor = self.state.monitor
        return min(end - done, left, left if monitor is None else monitor.steps_until_due())

    def _end_step(
        self, tick: int, s: int, loads: np.ndarray, at: tuple[ToolMotion, ...], checks: StepChecks
    ) -> None:
        """Finish soil step s, counted from 0, on the CPU."""
        if s + 1 == self._model.soil_steps:
            checks.keep_last_step_only()
        self._load_tools(loads, at)
        checks.end(tick, s + 1)

    # readings

    def listed_pair_count(self) -> int:
        """See Steps."""
        return self._soil_there.listed_pairs()

    def flush_books(self) -> None:
        """See Steps."""
        if self._model.booked:
            sinks, of_bonds = self._soil_there.take_books()
            self.state.sinks += sinks
            if self.state.bonds is not None:
                self.state.bonds.lost_joule += of_bonds

    def _reduced(self) -> np.ndarray:
        if self._sums is None:
            self._sums = self._soil_there.reduce_particles()
        return self._sums

    def motion_sums(self) -> MotionSums:
        """See Steps."""
        return MotionSums(*self._reduced()[:5].tolist())

    def any_outside(self) -> bool:
        """See Steps."""
        return bool(self._reduced()[7] > 0.0)

    def moving_joule(self) -> tuple[float, float]:
        """See Steps."""
        _, _, _, _, _, kinetic, height, _ = self._reduced().tolist()
        return kinetic, self._model.gravity_m_per_s2 * height

    def contacts(self) -> tuple[int, float]:
        """See Steps."""
        contacts, largest, _ = self._soil_there.reduce_pairs()
        return contacts, largest

    def stored_in_pairs_joule(self) -> float:
        """See Steps."""
        return self._soil_there.reduce_pairs()[2]
