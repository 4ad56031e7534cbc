"""Soil steps in LAMMPS: motions of a tick go to all ranks, loads of the tools come back."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from ...errors import InputError, PhysicsError, RunError
from ...messages import ToolMotion
from ..cpu_steps import CpuSteps
from ..model import SoilModel
from ..monitors import MotionSums
from ..particles import Particles
from ..state import SoilState
from ..step_checks import StepChecks
from .commands import empty_box, laws, motion
from .rank_soil import Columns, Layout
from .rank_tools import ToolStart, history_numbers
from .ranks import leader


class LammpsSteps:
    """Soil steps of one state whose particles and histories are in LAMMPS, on the ranks of this program.

    Neither runs on one number of ranks and on another, nor a resumed run and a whole one, give the same bits.
    Arrays come to this process only when read. After a PhysicsError the state is of no further use.
    """

    def __init__(self, model: SoilModel, state: SoilState, threads: int) -> None:
        self._model, self.state, self._host = model, state, CpuSteps(model, state, threads)
        self._ranks = leader()
        self._is_there = False  # the soil is in LAMMPS
        self._particles_are_there = False  # those here are old
        self._rebuilds = 0  # before the soil was laid out

    def close(self) -> None:
        """Let the other ranks end."""
        self._ranks.close()

    def _lay_out(self) -> np.ndarray:
        """Put the state into LAMMPS, and compute its forces. Returns what RankSoil.run does."""
        model, state = self._model, self.state
        p, bed = state.particles, state.domain.bed
        radius = p.radius if p.unequal else np.full(p.count, model.radius_m)
        material = p.material if p.unequal else np.zeros(p.count, np.int64)
        if bed.period_m is not None:
            p.wrap(bed.lower_m[1], bed.period_m)
        self._image = p.image.copy()
        columns = Columns(
            np.arange(1, p.count + 1, dtype=np.int32),
            (1 + material + model.layers * p.held).astype(np.int32),
            radius, p.mass if p.unequal else np.full(p.count, model.mass_kg),
            p.position, p.velocity, p.angular_velocity, p.force, p.torque, p.image,
        )  # fmt: skip
        starts = tuple(
            ToolStart(tool.name, tool.mesh, tool.reference_angle_rad, tool.last) for tool in state.tools
        )
        domain = state.domain
        with tempfile.TemporaryDirectory() as folder:
            restart = None
            if len(state.restart_file) > 0:
                restart = Path(folder) / "restart"
                state.restart_file.tofile(restart)
            layout = Layout(
                model, empty_box(model, domain), laws(model, history_numbers(model)), motion(model, domain),
                starts, domain.planes, domain.ceiling_m, restart,
            )  # fmt: skip
            self._ranks.call("lay_out", layout, here=columns if restart is None else None)
        self._is_there, self._rebuilds = True, state.rebuild_count
        loads: np.ndarray = self._ranks.call("first_forces", tuple(tool.last for tool in state.tools))
        if restart is not None:
            self._ranks.call("put_loads", here=columns)
        state.restart_file = np.empty(0, np.uint8)
        return loads

    def particles(self) -> Particles:
        """See Steps."""
        if self._particles_are_there:
            found, p = self._ranks.call("gather"), self.state.particles
            place = found.tag - 1
            for name in ("position", "velocity", "angular_velocity", "force", "torque"):
                getattr(p, name)[place] = getattr(found, name)
            p.image[place] = self._image[place] + found.image
            self._particles_are_there = False
        return self.state.particles

    def to_host(self) -> CpuSteps:
        """See Steps. Contacts stay in LAMMPS; state.restart_file has them."""
        self.particles()
        if self._is_there:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "restart"
                self._ranks.call("write_restart", path)
                self.state.restart_file = np.fromfile(path, np.uint8)
        return self._host

    def from_host(self) -> None:
        """See Steps."""
        self._is_there = self._particles_are_there = False

    def rebuild(self, motions: tuple[ToolMotion, ...]) -> None:
        """See Steps. LAMMPS builds its lists itself."""

    def damp(self, kept: float) -> NoReturn:
        """Not done here: beds are prepared without LAMMPS."""
        _refuse("damps no bed")

    def first_forces(self, motions: tuple[ToolMotion, ...]) -> None:
        """See Steps."""
        self._load_tools(self._lay_out()[0], motions)
        for tool in self.state.tools:
            tool.sinks_joule[:] = 0.0
        self._particles_are_there = True

    def advance(self, tick: int, way: Sequence[tuple[ToolMotion, ...]], checks: StepChecks) -> None:
        """See Steps."""
        if not self._is_there:
            self._lay_out()
        done, monitor = 0, self.state.monitor
        while done < len(way):
            end = checks.first_refused(tick, done, way)
            if monitor is not None:
                end = min(end, done + monitor.steps_until_due())
            self._particles_are_there = True
            try:
                loads = self._ranks.call("run", way[done:end])
            except PhysicsError as error:
                raise PhysicsError(f"{checks.where(tick, done + 1)}: {error}") from error
            except RunError as error:
                advice = "perhaps soil.time_step_s is too large"
                raise RunError(f"{checks.where(tick, done + 1)}: {error}; {advice}") from error
            for s in range(done, end):
                if s + 1 == self._model.soil_steps:
                    checks.keep_last_step_only()
                if (
                    monitor is not None
                    and self._rebuilds + int(loads[s - done][-1]) > self.state.rebuild_count
                ):
                    monitor.note_rebuild()
                self._load_tools(loads[s - done], way[s])
                checks.end(tick, s + 1)
            done = end

    def _load_tools(self, loads: np.ndarray, motions: tuple[ToolMotion, ...]) -> None:
        """Add what RankSoil.run returned of a step to all tools."""
        first = 0
        for tool, at in zip(self.state.tools, motions, strict=True):
            groups, sums = 3 * len(tool.mesh.groups), tool.sink_count + 2
            by_group, rest = loads[first : first + groups], loads[first + groups :]
            self.state.load_tool(tool, by_group.reshape(-1, 3), rest[:3], rest[3 : 3 + sums], at)
            first += groups + 3 + sums
        self.state.rebuild_count = self._rebuilds + int(loads[-1])

    # readings

    def motion_sums(self) -> MotionSums:
        """See Steps."""
        if not self._is_there:
            return self._host.motion_sums()
        return MotionSums(*self._ranks.call("motion_sums"))

    def moving_joule(self) -> tuple[float, float]:
        """See Steps."""
        if not self._is_there:
            return self._host.moving_joule()
        kinetic, height = self._ranks.call("moving_joule")
        return kinetic, self._model.gravity_m_per_s2 * height

    def any_outside(self) -> bool:
        """See Steps."""
        return bool(self._ranks.call("any_outside"))

    def contacts(self) -> tuple[int, float]:
        """See Steps."""
        if not self._is_there and len(self.state.restart_file) > 0:
            self._lay_out()
        if self._is_there:
            count, largest = self._ranks.call("contacts")
            return count, largest
        self._host.rebuild(())
        found = self._host.contacts()
        self.state.forget_contacts(self._model)
        return found

    def take_boundaries(self) -> NoReturn:
        """Not known here."""
        _refuse("tells no force of a wall")

    def listed_pair_count(self) -> int:
        """Pairs in contact: the lists of LAMMPS are not read."""
        return self.contacts()[0]

    def flush_books(self) -> None:
        """See Steps. Nothing is booked."""

    def stored_in_pairs_joule(self) -> NoReturn:
        """Not known here."""
        _refuse("keeps no energy book")


def _refuse(what: str) -> NoReturn:
    raise InputError(f"soil.engine: 'lammps' {what}; use 'own'")
