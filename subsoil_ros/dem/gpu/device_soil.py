"""Soil steps on the GPU, and readings of the soil."""

from typing import Any

import numpy as np
from numba import cuda

from ..bonds.kernel import BondArrays
from ..mixture import Mixture
from ..model import SoilModel
from ..neighbours import CellGrid
from ..particles import Particles
from ..state import SoilState
from ..tools.motion import Motion
from .device import Launches, Mirror, blocks
from .device_lists import DeviceLists, form_of
from .gpu_forces import (
    FAR,
    HALTED,
    LOST,
    REPORT,
    STEP,
    World,
    add_up_tool,
    damp,
    drift,
    end_step,
    kick_pending,
    note_kick,
    note_new_lists,
    pair_kernel,
    reduce_pairs_kernel,
    reduce_particles,
    tool_kernel,
    wall_kernel,
    without_period,
)
from .lists import OnDevice
from .scan import SUM_BLOCKS, column_sums


class DeviceSoil(DeviceLists):
    """Particles, lists, histories and tools of one soil on the GPU."""

    def __init__(self, model: SoilModel, state: SoilState, grid: CellGrid) -> None:
        super().__init__(model, state, grid)
        self._ceiling_m = state.domain.ceiling_m
        self._wall_law, self._tool_law = _of_floats(model.wall_law), _of_floats(model.tool_law)
        self._features = without_period(model.features)
        tables = model.pair_laws, model.wall_laws, model.tool_laws
        self._laws = [cuda.to_device(laws) for laws in tables]
        booked = self.count if model.booked else 1
        sinks = len(state.sinks)
        self._books = [cuda.to_device(np.zeros((booked, sinks))) for _ in ("pairs", "walls")]
        self._bonds = self._bonds_of(state, booked)
        self._per_step = sum(tool.columns for tool in self._tools)
        self._slots = model.soil_steps
        self._report = Mirror((REPORT + self._slots * self._per_step,), self.stream)
        forms = [form_of(tool.kernel_motion(tool.last)) for tool in state.tools]
        self._motions = [Mirror((self._slots, *form), self.stream) for form in forms]
        self._of_particles = Mirror((SUM_BLOCKS, 8), self.stream)
        self._of_pairs = Mirror((SUM_BLOCKS, 3), self.stream)

    def _bonds_of(self, state: SoilState, booked: int) -> BondArrays:
        """Numbers that bonds have in common, and their book; without bonds kernels take them too."""
        book, elsewhere = cuda.to_device(np.zeros((booked, 2))), cuda.to_device(np.zeros(1))
        if state.bonds is not None:
            return state.bonds.kernel_arrays()._replace(state=elsewhere, book=book)
        nothing: np.ndarray = np.zeros(len(BondArrays._fields) - 2, self._model.precision)
        return BondArrays(elsewhere, book, *nothing)

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

    def _mixture(self, particles: OnDevice, laws: Any, kind: type = float) -> Mixture:
        p, model = particles, self._model
        return Mixture(kind(model.radius_m), p.radius, p.mass, p.material, laws, model.layers)  # type: ignore[arg-type]

    # soil steps

    def _add_drift(self, launches: Launches) -> None:
        model, p = self._model, self._side.particles
        launches.add(
            drift, blocks(self.count), self._report.there, p.kinematics, p.loads, self._masses(p),
            p.built_position, p.held, model.step_s, (0.5 * model.soil.skin_m) ** 2,
        )  # fmt: skip

    def _add_forces(self, launches: Launches, step_s: float) -> None:
        side, model, kind = self._side, self._model, self._model.precision
        p, walls, report = side.particles, side.walls, self._report.there
        world = World(model.gravity_m_per_s2, self.grid.period, kind(step_s))
        launches.add(
            pair_kernel(self._features, self._bonded), blocks(self.count), report, side.rows, self._bonds,
            p.kinematics, self._masses(p), model.pair_law, self._mixture(p, self._laws[0], kind), world,
            p.loads, self._books[0],
        )  # fmt: skip
        launches.add(
            wall_kernel(self._features), blocks(len(walls.particle)), report, self._size(1), walls,
            self._planes, p.kinematics, self._wall_law, self._mixture(p, self._laws[1]), step_s, p.loads,
            self._books[1],
        )  # fmt: skip
        first = 0
        for k, (tool, near) in enumerate(zip(self._tools, side.tools, strict=True)):
            size = self._size(2 + 2 * k)
            launches.add(
                tool_kernel(self._features, self._rolling_numbers), blocks(len(near.particle)), report, size,
                self._motions[k].there, near, tool.facets, p.kinematics, self._tool_law,
                self._mixture(p, self._laws[2]), step_s, p.loads, tool.loads,
            )  # fmt: skip
            launches.add(
                add_up_tool, tool.columns, report, size, tool.loads, first, self._per_step, self._slots
            )
            first += tool.columns

    def _add_step_end(self, launches: Launches) -> None:
        self._add_forces(launches, self._model.step_s)
        launches.add(end_step, 1, self._report.there, threads=1)

    def _add_step(self, launches: Launches) -> None:
        self._add_drift(launches)
        self._add_step_end(launches)

    def _add_waiting_step_end(self, launches: Launches) -> None:
        launches.add(note_new_lists, 1, self._report.there, threads=1)
        self._add_step_end(launches)

    def put_motions(self, motions: list[tuple[Motion, ...]]) -> None:
        """Send the motions at the ends of the tick's soil steps: (steps, tools)."""
        for k, mirror in enumerate(self._motions):
            for step, of_tools in enumerate(motions):
                mirror.here[step].flat[:] = of_tools[k]
            mirror.send()

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
            kick_pending, blocks(self.count), report, p.kinematics, p.loads, self._masses(p), p.held,
            model.step_s,
        )  # fmt: skip
        launches.add(note_kick, 1, report, threads=1)

    def finish_kick(self) -> None:
        """The second half kick of the last step, if it is still to come."""
        self._run("kick", self._add_kick)

    def damp(self, kept: float) -> None:
        """Every linear and angular velocity times `kept`, at the end of the last step."""
        self.finish_kick()
        p, factor = self._side.particles, self._model.precision(kept)
        self._run(
            f"damp {kept}",
            lambda launches: launches.add(damp, blocks(self.count), p.kinematics, factor),
        )

    # readings

    def reduce_particles(self) -> np.ndarray:
        """(8,) sums over particles at the end of the last step: see forces.reduce_particles."""
        self._run("reduce particles", self._add_sums_of_particles)
        return self._of_particles.take().sum(axis=0)

    def _add_sums_of_particles(self, launches: Launches) -> None:
        self._add_kick(launches)
        p, model = self._side.particles, self._model
        launches.add(
            reduce_particles, SUM_BLOCKS, p.kinematics, p.loads, self._masses(p), model.step_s, self._planes,
            self._radius(p), self._ceiling_m, self._of_particles.there,
        )  # fmt: skip

    def reduce_pairs(self) -> tuple[int, float, float]:
        """Contacts in reach, largest overlap [m], stored energy [J]."""
        self._run("reduce pairs", self._add_sums_of_pairs)
        found = self._of_pairs.take()
        return int(found[:, 0].sum()), float(found[:, 1].max()), float(found[:, 2].sum())

    def _add_sums_of_pairs(self, launches: Launches) -> None:
        side = self._side
        launches.add(
            reduce_pairs_kernel(self._features), SUM_BLOCKS, side.rows, side.particles.position,
            self._wall_law, self._mixture(side.particles, self._laws[0]), self.grid.period,
            self._of_pairs.there,
        )  # fmt: skip

    def take_books(self) -> tuple[np.ndarray, np.ndarray]:
        """Since the last time: (sinks,) [J] of pairs and walls; (2,) [J] of bonds."""
        of_pairs, of_walls, of_bonds = (self._summed(book) for book in (*self._books, self._bonds.book))
        return of_pairs + of_walls, of_bonds

    def _summed(self, book: Any) -> np.ndarray:
        """Sums of the columns of a book, which is then zero."""
        partial = cuda.device_array((SUM_BLOCKS, book.shape[1]), np.float64)
        launches = Launches(self.stream)
        launches.add(column_sums, SUM_BLOCKS, book, partial)
        launches.run()
        book.copy_to_device(np.zeros(book.shape), stream=self.stream)
        return np.asarray(self._take(partial).sum(axis=0))


def _of_floats(law: Any) -> Any:
    return type(law)(*(float(number) for number in law))
