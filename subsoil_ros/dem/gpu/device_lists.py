"""Particles and lists of a soil on the GPU, and the rebuilding of lists.

Particles and lists exist twice: new ones are built from the old ones, and then serve the steps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import cuda

from ..bonds.kernel import PARITY, kept_count
from ..model import SoilModel
from ..neighbours import CellGrid
from ..particles import Masses, Particles, ToolList
from ..state import SoilState
from ..tools.motion import PLANAR, Motion
from .arrays import Rows, Tool, ToolRows, WallRows
from .convert import full_rows, wall_rows
from .device import WARP, Launches, Mirror, blocks, on_device, room_for
from .lists import (
    OnDevice,
    Reach,
    clear,
    count_bonds,
    find_cells,
    find_near_tool,
    find_near_walls,
    list_near_tool,
    list_near_walls,
    list_partners,
    note_size,
    place,
    reorder,
    slice_widths,
    sort_in_cells,
)
from .scan import add_scan

_PARTNERS = 20
"""Partners per particle that there is room for at first: equal spheres list some 14."""


@dataclass
class _Side:
    """One of the two states between which lists are built."""

    particles: OnDevice
    rows: Rows
    walls: WallRows
    tools: list[ToolRows]
    bond_counts: Any  # (n, 2) int32, made and broken of each particle; one row without bonds
    launches: dict[str, Launches] = field(default_factory=dict)  # by name, as long as the arrays stay


class DeviceLists:
    """Particles, neighbour lists, and what is near walls and tools."""

    def __init__(self, model: SoilModel, state: SoilState, grid: CellGrid) -> None:
        self._model, self.grid = model, grid
        particles = state.particles
        self.stream = cuda.stream()
        n = self.count = particles.count
        self._unequal = particles.unequal
        kind = model.precision
        # as many as are near five sides of a cube; enlarged when needed, for walls and tools
        near = min(n, room_for(int(8 * n ** (2 / 3))))
        tools, sums = state.tools, len(state.sinks) + 2
        self._tools = [Tool(tool.facets, len(tool.mesh.groups), sums, near) for tool in tools]
        self._components = len(model.parity)  # numbers of a contact, and of its bond behind them
        self._bonded = state.bonds is not None
        self._bond_numbers = kept_count(model.features) if self._bonded else 0
        parity = np.concatenate((model.parity, PARITY[: self._bond_numbers]))
        self._parity = cuda.to_device(parity.astype(kind))
        self._rolling_numbers = 3 + len(model.soil.law.kept)
        self._sides = [
            _Side(
                self._empty_particles(n, kind),
                Rows.empty(n, room_for(_PARTNERS * n), len(parity), kind),
                WallRows.empty(n, near, self._components),
                [ToolRows.empty(n, near, 4 * near, self._rolling_numbers) for _ in tools],
                cuda.to_device(np.zeros((n if self._bonded else 1, 2), np.int32)),
            )
            for _ in range(2)
        ]
        self._at = 0
        self._order = cuda.device_array(n, np.int64)
        cells = grid.nx * grid.ny * grid.nz
        self._cell, self._rank = cuda.device_array(n, np.int64), cuda.device_array(n, np.int32)
        self._cell_count = cuda.device_array(cells, np.int32)
        self._cell_start = cuda.device_array(cells + 1, np.int64)
        self._width = cuda.device_array(-(-n // WARP), np.int32)
        self._near, self._facets_near = cuda.device_array(n, np.int32), cuda.device_array(n, np.int32)
        self._first_facet = cuda.device_array(n + 1, np.int64)
        self._sizes = cuda.to_device(np.zeros(2 + 2 * len(tools), np.int64))
        self._planes = cuda.to_device(state.domain.planes)
        self._nobody = cuda.to_device(np.zeros(1, np.bool_))
        self._poses = [Mirror((1, *form_of(tool.kernel_motion(tool.last))), self.stream) for tool in tools]
        self.put_particles(particles)
        self._forget()

    def _empty_particles(self, n: int, kind: type) -> OnDevice:
        own = n if self._unequal else 1
        vectors = [cuda.device_array((n, 3), kind) for _ in range(4)]
        numbers = [cuda.device_array(own, np.float64) for _ in range(3)]
        return OnDevice(
            position=cuda.device_array((n, 3), np.float64),
            velocity=vectors[0],
            angular_velocity=vectors[1],
            force=vectors[2],
            torque=vectors[3],
            built_position=cuda.device_array((n, 3), np.float32),
            identity=cuda.device_array(n, np.int32),
            image=cuda.device_array(n, np.int32),
            held=cuda.device_array(n, np.bool_),
            radius=numbers[0],
            mass=numbers[1],
            inertia=numbers[2],
            material=cuda.device_array(own, np.int64),
        )

    def _forget(self) -> None:
        """Empty all lists: no contact has a history."""
        side = self._side
        for array in (side.rows.count, side.walls.row, *(tool.row for tool in side.tools)):
            array.copy_to_device(np.zeros(array.shape, array.dtype), stream=self.stream)

    @property
    def _side(self) -> _Side:
        return self._sides[self._at]

    def put_particles(self, particles: Particles) -> None:
        """Replace the particles by these, in their order."""
        for name, array in self._side.particles._asdict().items():
            given = getattr(particles, name)
            if len(given):
                array.copy_to_device(np.ascontiguousarray(given), stream=self.stream)
        self.stream.synchronize()

    def _masses(self, particles: OnDevice) -> Masses:
        p, model = particles, self._model
        if self._unequal:
            return Masses(p.mass, p.inertia)  # type: ignore[arg-type]
        return Masses(model.mass_kg, model.inertia_kg_m2)

    def _radius(self, particles: OnDevice) -> Any:
        return particles.radius if self._unequal else self._model.radius_m

    def _run(self, name: str, fill: Callable[[Launches], None]) -> None:
        """Launch the kernels that `fill` adds: once for each name, until arrays are replaced."""
        side = self._side
        if name not in side.launches:
            fill(side.launches.setdefault(name, Launches(self.stream)))
        side.launches[name].run()

    def _size(self, k: int) -> Any:
        """One of `sizes`, for a kernel."""
        return self._sizes[k : k + 1]

    def rebuild(self, motions: Sequence[Motion]) -> None:
        """Sort particles into cells and rebuild all lists, with the tools at `motions`."""
        for mirror, motion in zip(self._poses, motions, strict=True):
            mirror.here.flat[:] = motion
            mirror.send()
        old, new = self._side, self._sides[1 - self._at]
        self._run("sort", lambda launches: self._add_sorting(launches, old, new))
        self._run("lists", lambda launches: self._add_counting(launches, old, new))
        self._run("fill", lambda launches: self._add_filling(launches, old, new))
        if self._make_room(new):
            self._run("fill", lambda launches: self._add_filling(launches, old, new))
        self._at = 1 - self._at

    def _add_sorting(self, launches: Launches, old: _Side, new: _Side) -> None:
        n, grid = self.count, self.grid
        cells, p = len(self._cell_count), old.particles
        launches.add(clear, blocks(cells), self._cell_count)
        low_y = grid.origin_y
        launches.add(
            find_cells, blocks(n), p.position, p.image, grid, low_y, self._cell, self._rank, self._cell_count
        )
        add_scan(launches, self._cell_count, cells, self._cell_start)
        launches.add(place, blocks(n), self._cell, self._rank, self._cell_start, self._order)
        launches.add(sort_in_cells, blocks(cells), self._cell_start, self._order)
        launches.add(reorder, blocks(n), self._order, p, new.particles, self._unequal)
        if self._bonded:
            launches.add(
                count_bonds, blocks(n), self._order, self._components, old.rows, old.bond_counts,
                new.bond_counts,
            )  # fmt: skip

    def _partners(self, old: _Side, new: _Side, *, fill: bool) -> tuple[Any, ...]:
        model, p = self._model, new.particles
        return (
            list_partners, blocks(self.count), fill, p.position,
            Reach(model.reach_m, model.radius_m, self._radius(p)), self.grid, self._cell_start, self._order,
            self._components, self._parity, old.rows, new.rows,
        )  # fmt: skip

    def _add_counting(self, launches: Launches, old: _Side, new: _Side) -> None:
        """Add the kernels that count partners."""
        slices = len(self._width)
        launches.add(*self._partners(old, new, fill=False))
        launches.add(slice_widths, blocks(slices), new.rows.count, self._width)
        add_scan(launches, self._width, slices, new.rows.slice_start)
        launches.add(note_size, 1, self._sizes, 0, new.rows.slice_start, threads=1)

    def _add_filling(self, launches: Launches, old: _Side, new: _Side) -> None:
        """Add the kernels that fill lists as far as there is room, and note the room needed."""
        n, p, model = self.count, new.particles, self._model
        launches.add(*self._partners(old, new, fill=True))
        walls = new.walls
        held = p.held if model.soil.window is not None else self._nobody  # they stand for walls
        launches.add(
            find_near_walls, blocks(n), p.position, held, self._planes, model.wall_reach_m, self._near
        )
        add_scan(launches, self._near, n, walls.row)
        launches.add(note_size, 1, self._sizes, 1, walls.row, threads=1)
        launches.add(list_near_walls, blocks(n), self._near, self._order, old.walls, walls)
        for k, tool in enumerate(self._tools):
            near, pose = new.tools[k], self._poses[k].there
            launches.add(
                find_near_tool, blocks(n), p.position, pose, tool.surface, model.tool_reach_m, self._near,
                self._facets_near,
            )  # fmt: skip
            add_scan(launches, self._near, n, near.row)
            add_scan(launches, self._facets_near, n, self._first_facet)
            launches.add(note_size, 1, self._sizes, 2 + 2 * k, near.row, threads=1)
            launches.add(note_size, 1, self._sizes, 3 + 2 * k, self._first_facet, threads=1)
            launches.add(
                list_near_tool, blocks(n), p.position, pose, tool.surface, model.tool_reach_m, self._near,
                self._first_facet, self._order, old.tools[k], near,
            )  # fmt: skip

    def sizes(self) -> list[int]:
        """Places of partners, particles near walls, and for each tool candidates and their facets."""
        sizes = self._sizes.copy_to_host(stream=self.stream)
        self.stream.synchronize()
        return sizes.tolist()

    def _make_room(self, new: _Side) -> bool:
        """Enlarge arrays that are too short for their list; return whether any was."""
        places, near_walls, *of_tools = self.sizes()
        n, grown = self.count, False
        if places > len(new.rows.neighbour):
            rows = Rows.empty(n, room_for(places), len(self._parity), self._model.precision)
            new.rows = rows._replace(count=new.rows.count, slice_start=new.rows.slice_start)
            grown = True
        if near_walls > len(new.walls.particle):
            new.walls, grown = WallRows.empty(n, min(n, room_for(near_walls)), self._components), True
        for k, tool in enumerate(self._tools):
            candidates, facets = of_tools[2 * k], of_tools[2 * k + 1]
            near = new.tools[k]
            if candidates > len(near.particle) or facets > len(near.facet):
                room = max(len(near.particle), min(n, room_for(candidates)))
                room_of_facets = max(len(near.facet), room_for(facets))
                new.tools[k] = ToolRows.empty(n, room, room_of_facets, self._rolling_numbers)
                grown = True
                if room > tool.room:
                    tool.make_room(room)
        if grown:
            self._forget_launches()
        return grown

    def _forget_launches(self) -> None:
        """Drop launches, which have arrays that were replaced."""
        for side in self._sides:
            side.launches.clear()

    def _take(self, array: Any) -> np.ndarray:
        here = array.copy_to_host(stream=self.stream)
        self.stream.synchronize()
        return here

    def listed_pairs(self) -> int:
        """Pairs in the neighbour lists."""
        return int(self._take(self._side.rows.count).sum()) // 2

    def put_lists(self, state: SoilState) -> None:
        """The lists of a state, in place of those that `rebuild` would make."""
        side, n, components, bonds = self._side, self.count, self._components, state.bonds
        of_bonds = None if bonds is None else bonds.state
        rows = full_rows(state.pairs, components, of_bonds, self._bond_numbers, self._model.precision)
        side.rows = Rows(**{name: on_device(array) for name, array in rows.items()})
        if bonds is not None:
            side.bond_counts = cuda.to_device(np.stack((bonds.made, bonds.broken), axis=1))
        near_walls = wall_rows(state.walls, state.wall_force, n, components)
        sizes = [len(side.rows.neighbour), len(near_walls["particle"])]
        side.walls = WallRows(**{name: on_device(array) for name, array in near_walls.items()})
        for k, tool in enumerate(state.tools):
            near = tool.near
            row = np.searchsorted(near.particle, np.arange(n + 1)).astype(np.int64)
            arrays = {name: on_device(array) for name, array in near._asdict().items()}
            side.tools[k] = ToolRows(cuda.to_device(row), **arrays)
            sizes += [len(near.particle), len(near.facet)]
            if len(near.particle) > self._tools[k].room:
                self._tools[k].make_room(room_for(len(near.particle)))
        self._forget_launches()
        self._sizes.copy_to_device(np.array(sizes, np.int64), stream=self.stream)
        self.stream.synchronize()

    def take_pairs(self) -> dict[str, np.ndarray]:
        """Partners and bonds of every particle as they stand, and `cell_start` of their cells."""
        self.stream.synchronize()
        return {
            **self._side.rows.taken(self.sizes()[0]),
            "bond_counts": self._take(self._side.bond_counts),
            "cell_start": self._take(self._cell_start),
        }

    def take_walls(self) -> dict[str, np.ndarray]:
        """Particles near walls."""
        self.stream.synchronize()
        return self._side.walls.taken(self.sizes()[1])

    def take_tools(self) -> list[ToolList]:
        """Candidates of every tool."""
        self.stream.synchronize()
        sizes = self.sizes()
        return [near.taken(*sizes[2 + 2 * k : 4 + 2 * k]) for k, near in enumerate(self._side.tools)]


def form_of(motion: Motion) -> tuple[int, ...]:
    """Shape of a motion for tools.motion.motion_at."""
    return (len(motion),) if len(motion) == PLANAR else (len(motion), 1)
