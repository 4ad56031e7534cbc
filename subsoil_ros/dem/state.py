"""What changes in a soil: its state holds all that later steps depend on, and nothing else."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..messages import ToolMotion
from .blocks import history_blocks
from .bonds.bond_list import BondList
from .domain import Domain, Origin
from .model import SoilModel
from .monitors import SoilMonitor
from .particles import PairList, Particles, WallList
from .snapshot import below, from_named, named
from .tools.surface import ToolSurface
from .walls import CHUNKS


@dataclass
class SoilState:
    """The state of a soil between two soil steps. Lists of neighbours are part of it, as their order
    is that of the sums of forces."""

    particles: Particles
    domain: Domain
    origin: Origin
    monitor: SoilMonitor | None
    pairs: PairList
    walls: WallList
    bonds: BondList | None
    wall_force: np.ndarray  # (w, 3) [N] of every pair of particle and wall, in the last soil step
    pair_book: np.ndarray  # (slabs, sinks) [J] since the lists were built
    wall_book: np.ndarray  # (CHUNKS, sinks) [J]
    sinks: np.ndarray  # (sinks,) [J] of pairs and walls, before the lists were built
    tools: tuple[ToolSurface, ...] = ()
    tool_work_joule: float = 0.0  # of the tools on the soil, since the start
    carried_joule: float = 0.0  # of soil that was added, less that of soil removed
    leaps: int = 0  # of tools, since the start
    removed: int = 0  # particles that the tools then overlapped
    rebuild_count: int = 0
    strain: float = 0.0  # of an endless bed since the lists were built
    restart_file: np.ndarray = field(default_factory=lambda: np.empty(0, np.uint8))
    """(n,) bytes of LAMMPS's restart file, which has the contacts in place of the lists here; empty: none."""

    @classmethod
    def of(cls, model: SoilModel, particles: Particles, domain: Domain, origin: Origin) -> "SoilState":
        """Particles without lists and tools."""
        soil, sinks = model.soil, len(model.soil.law.sinks)
        return cls(
            particles,
            domain,
            origin,
            SoilMonitor(soil, domain, particles.count) if soil.monitors is not None else None,
            *no_contacts(model, particles),
            wall_force=np.zeros((0, 3)),
            pair_book=np.zeros((0, sinks)),
            wall_book=np.zeros((CHUNKS, sinks)),
            sinks=np.zeros(sinks),
        )

    def forget_contacts(self, model: SoilModel) -> None:
        """Empty all lists but those of tools: no contact has a history."""
        self.pairs, self.walls, self.bonds = no_contacts(model, self.particles)
        self.restart_file = self.restart_file[:0]

    def flush_books(self) -> None:
        """Add what was booked since the lists were built to `sinks`."""
        self.sinks += self.pair_book.sum(axis=0) + self.wall_book.sum(axis=0)
        self.pair_book[:] = 0.0
        self.wall_book[:] = 0.0

    def load_tool(
        self, tool: ToolSurface, by_group: np.ndarray, moment: np.ndarray, sums: np.ndarray, at: ToolMotion
    ) -> None:
        """Add the load of one soil step, see tools.forces.tool_forces, to a tool, which is then `at`."""
        work = tool.load.work_joule
        tool.add_load(by_group, moment, sums, at)
        self.tool_work_joule -= tool.load.work_joule - work

    def arrays(self) -> dict[str, np.ndarray]:
        """The state as arrays, by name; not copied."""
        arrays = {
            **named("particles", self.particles),
            **named("pairs", self.pairs),
            **named("walls", self.walls),
            "wall_force": self.wall_force,
            "pair_book": self.pair_book,
            "wall_book": self.wall_book,
            "sinks": self.sinks,
            "tool_work": np.array(self.tool_work_joule),
            "rebuilds": np.array(self.rebuild_count),
        }
        if len(self.restart_file) > 0:
            arrays["restart_file"] = self.restart_file
        parts = {f"tool.{tool.name}": tool.state_arrays() for tool in self.tools}
        if self.bonds is not None:
            parts["bonds"] = self.bonds.arrays()
        if self.monitor is not None:
            parts["watch"] = self.monitor.state_arrays()
        for prefix, part in parts.items():
            arrays.update((f"{prefix}.{name}", array) for name, array in part.items())
        return arrays

    def restore(self, model: SoilModel, arrays: Mapping[str, np.ndarray]) -> None:
        """Continue from `arrays`, of which those of particles are copied; the tools are there.

        Raises:
            KeyError: an array is missing.
        """
        for tool in self.tools:
            tool.restore(below(f"tool.{tool.name}", arrays))
        self.particles = from_named(Particles, "particles", arrays)
        self.pairs = from_named(PairList, "pairs", arrays)
        self.walls = from_named(WallList, "walls", arrays)
        if model.soil.bonds is not None:
            self.bonds = BondList(model.soil, self.particles, model.precision, model.features)
            self.bonds.restore(below("bonds", arrays))
        self.wall_force = arrays["wall_force"]
        self.pair_book, self.wall_book = arrays["pair_book"], arrays["wall_book"]
        self.sinks = arrays["sinks"]
        self.restart_file = arrays.get("restart_file", self.restart_file[:0])
        if (model.soil.engine == "lammps") != (len(self.restart_file) > 0):
            raise ValueError("the state is of the other soil.engine")
        self.tool_work_joule, self.rebuild_count = float(arrays["tool_work"]), int(arrays["rebuilds"])
        if self.monitor is not None:
            self.monitor.restore(below("watch", arrays))


def no_contacts(model: SoilModel, particles: Particles) -> tuple[PairList, WallList, BondList | None]:
    """Lists of particles that touch nothing."""
    pairs = PairList(
        np.zeros(particles.count + 1, np.int64),
        np.empty(0, np.int32),
        history_blocks(0, model.precision, len(model.parity)),
        np.zeros(1, np.int64),
    )
    none = np.empty(0, np.int64)
    walls = WallList(none, none.copy(), history_blocks(0, np.float64, len(model.parity)))
    soil = model.soil
    bonds = BondList(soil, particles, model.precision, model.features) if soil.bonds is not None else None
    return pairs, walls, bonds
