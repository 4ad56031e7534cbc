"""Soil steps on the GPU, and readings of the soil."""

from typing import Any

import numpy as np
from numba import cuda

from ..mixture import Mixture
from ..model import SoilModel
from ..neighbours import CellGrid
from ..particles import Particles
from ..state import SoilState
from ..tools.facets import Facets
from .device import Launches, Mirror, blocks
from .device_lists import DeviceLists
from .forces import (
    FAR,
    HALTED,
    LOST,
    REPORT,
    STEP,
    add_up_tool,
    damp,
    drift,
    end_step,
    kick_owed,
    kick_paid,
    lists_are_new,
    look_at_pairs_kernel,
    look_at_particles,
    pair_kernel,
    tool_kernel,
    wall_kernel,
    without_period,
)
from .lists import OnDevice
from .scan import SUM_BLOCKS, column_sums


class DeviceSoil(DeviceLists):
    """Particles, lists, histories and tools of one soil on the GPU."""

    def __init__(
        self, model: SoilModel, state: SoilState, grid: CellGrid, tools: list[tuple[Facets, int]]
    ) -> None:
        super().__init__(model, state, grid, tools)
        self._ceiling_m = state.domain.ceiling_m
        self._wall_law, self._tool_law = _of_floats(model.wall_law), _of_floats(model.tool_law)
        n = self.count
        self._features = without_period(model.features)
        tables = model.pair_laws, model.wall_laws, model.tool_laws
        self._laws = [cuda.to_device(laws) for laws in tables]
        booked = n if model.booked else 1
        self._pair_book = cuda.to_device(np.zeros((booked, 5)))
        self._wall_book = cuda.to_device(np.zeros((booked, 5)))
        self._per_step = sum(tool.columns for tool in self._tools)
        self._slots = model.soil_steps
        self._report = Mirror((REPORT + self._slots * self._per_step,), self.stream)
        tool_count = max(1, len(tools))
        self._motions = Mirror((self._slots, tool_count, 8), self.stream)
        self._of_particles = Mirror((SUM_BLOCKS, 8), self.stream)
        self._of_pairs = Mirror((SUM_BLOCKS, 3), self.stream)

    def take_particles(self) -> Particles:
        """A copy, at the end of the last step or, where it halted, after the drift."""
        if not self._report.take()[HALTED]:
            self.finish_kick()
        arrays = {
            name: array.copy_to_host(stream=self.stream)
            for name, array in self._side.particles._asdict().items()
        }
        self.stream.synchronize()
        if not self._unequal:
            for name in ("radius", "mass", "inertia", "material"):
                arrays[name] = arrays[name][:0]
        return Particles(**arrays)

    # what kernels take

    def _mixture(self, particles: OnDevice, laws: Any) -> Mixture:
        return Mixture(particles.radius, particles.mass, particles.material, laws, self._model.layers)  # type: ignore[arg-type]

    @staticmethod
    def _motion(particles: OnDevice) -> tuple[Any, ...]:
        p = particles
        return p.position, p.velocity, p.spin, p.force, p.torque

    # soil steps

    def _add_drift(self, launches: Launches) -> None:
        model, p = self._model, self._side.particles
        launches.add(
            drift, blocks(self.count), self._report.there, *self._motion(p), p.built_position, p.held,
            *self._masses(p), model.step_s, (0.5 * model.soil.skin_m) ** 2,
        )  # fmt: skip

    def _add_forces(self, launches: Launches, step_s: float) -> None:
        side, model, kind = self._side, self._model, self._model.precision
        p, rows, walls, report = side.particles, side.rows, side.walls, self._report.there
        motion = self._motion(p)
        launches.add(
            pair_kernel(self._features), blocks(self.count), report,
            rows.count, rows.slice_start, rows.neighbour, rows.history, *motion,
            self._masses(p)[0], model.gravity_m_per_s2, kind(model.radius_m), kind(step_s),
            model.pair_law, self._mixture(p, self._laws[0]), self.grid.period, self._pair_book,
        )  # fmt: skip
        launches.add(
            wall_kernel(self._features), blocks(len(walls.particle)), report, self._sizes, 1,
            walls.particle, walls.held, walls.springs, self._planes, *motion, model.radius_m, step_s,
            self._wall_law, self._mixture(p, self._laws[1]), walls.force, self._wall_book,
        )  # fmt: skip
        first = 0
        for k, (tool, near) in enumerate(zip(self._tools, side.tools, strict=True)):
            felt = tool.group_force, tool.moment, tool.sums
            launches.add(
                tool_kernel(self._features), blocks(len(near.particle)), report, self._sizes,
                2 + 2 * k, self._motions.there, k, near.particle, near.facet_start, near.facet, tool.facets,
                *motion, near.active, near.normal, near.shear, near.roll, model.radius_m, step_s,
                self._tool_law, self._mixture(p, self._laws[2]), *felt,
            )  # fmt: skip
            launches.add(
                add_up_tool, tool.columns, report, self._sizes, 2 + 2 * k, *felt, first,
                self._per_step, self._slots,
            )  # fmt: skip
            first += tool.columns

    def _add_step_end(self, launches: Launches) -> None:
        self._add_forces(launches, self._model.step_s)
        launches.add(end_step, 1, self._report.there, threads=1)

    def _add_step(self, launches: Launches) -> None:
        self._add_drift(launches)
        self._add_step_end(launches)

    def _add_waiting_step_end(self, launches: Launches) -> None:
        launches.add(lists_are_new, 1, self._report.there, threads=1)
        self._add_step_end(launches)

    def put_motions(self, motions: list[tuple[Any, ...]]) -> None:
        """Send the motions at the ends of the tick's soil steps: (steps, tools) of tools.motion.Motion."""
        if self._tools:
            self._motions.here[: len(motions)] = motions
            self._motions.send()

    def first_forces(self) -> np.ndarray:
        """Compute the forces of the initial state, without time; return the loads of the tools (columns,)."""
        self._run("first", lambda launches: self._add_forces(launches, 0.0))
        return self.report()[1][0]

    def run_steps(self, count: int) -> None:
        """Run `count` soil steps, or fewer if lists must be rebuilt: see `report`."""
        for _ in range(count):
            self._run("step", self._add_step)

    def drift_only(self) -> None:
        """The drift of a step whose forces wait for new lists."""
        self._run("drift", self._add_drift)

    def finish_step(self) -> None:
        """The forces of a step that waited for new lists."""
        self._run("forces", self._add_waiting_step_end)

    def report(self) -> tuple[dict[str, int], np.ndarray]:
        """State of the steps, and the loads of the tools in each of the last ones: (soil steps, columns)."""
        here = self._report.take()
        told = {"steps": int(here[STEP]), "halted": int(here[HALTED] or here[FAR]), "lost": int(here[LOST])}
        return told, here[REPORT:].reshape(self._slots, self._per_step)

    def _add_kick(self, launches: Launches) -> None:
        p, model, report = self._side.particles, self._model, self._report.there
        launches.add(
            kick_owed, blocks(self.count), report, p.velocity, p.spin, p.force, p.torque, p.held,
            *self._masses(p), model.step_s,
        )  # fmt: skip
        launches.add(kick_paid, 1, report, threads=1)

    def finish_kick(self) -> None:
        """The second half kick of the last step, if it is still to come."""
        self._run("kick", self._add_kick)

    def damp(self, kept: float) -> None:
        """Every velocity and spin times `kept`, at the end of the last step."""
        self.finish_kick()
        p, factor = self._side.particles, self._model.precision(kept)
        self._run(
            f"damp {kept}",
            lambda launches: launches.add(damp, blocks(self.count), p.velocity, p.spin, factor),
        )

    # readings

    def look_at_particles(self) -> np.ndarray:
        """(8,) sums over particles at the end of the last step: see forces.look_at_particles."""
        self._run("look at particles", self._add_look_at_particles)
        return self._of_particles.take().sum(axis=0)

    def _add_look_at_particles(self, launches: Launches) -> None:
        self._add_kick(launches)
        p, model = self._side.particles, self._model
        launches.add(
            look_at_particles, SUM_BLOCKS, *self._motion(p), *self._masses(p), model.step_s, self._planes,
            self._radius(p), self._ceiling_m, self._of_particles.there,
        )  # fmt: skip

    def look_at_pairs(self) -> tuple[int, float, float]:
        """Contacts in reach, largest overlap [m], stored energy [J]."""
        self._run("look at pairs", self._add_look_at_pairs)
        found = self._of_pairs.take()
        return int(found[:, 0].sum()), float(found[:, 1].max()), float(found[:, 2].sum())

    def _add_look_at_pairs(self, launches: Launches) -> None:
        side, model = self._side, self._model
        p, rows = side.particles, side.rows
        launches.add(
            look_at_pairs_kernel(self._features), SUM_BLOCKS, rows.count, rows.slice_start, rows.neighbour,
            rows.history, p.position, model.radius_m, self._wall_law, self._mixture(p, self._laws[0]),
            self.grid.period,
            self._of_pairs.there,
        )  # fmt: skip

    def take_books(self) -> np.ndarray:
        """(5,) sinks [J] of pairs and walls since the last time."""
        total = np.zeros(5)
        for book in (self._pair_book, self._wall_book):
            partial = cuda.device_array((SUM_BLOCKS, 5), np.float64)
            launches = Launches(self.stream)
            launches.add(column_sums, SUM_BLOCKS, book, partial)
            launches.run()
            total += self._take(partial).sum(axis=0)
            book.copy_to_device(np.zeros(book.shape), stream=self.stream)
        return total


def _of_floats(law: Any) -> Any:
    return type(law)(*(float(number) for number in law))
