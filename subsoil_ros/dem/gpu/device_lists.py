"""Particles and lists of a soil on the GPU, and the rebuilding of lists.

Particles and lists exist twice: new ones are built from the old ones, and then serve the steps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import cuda

from ..model import SoilModel
from ..neighbours import CellGrid
from ..particles import PairList, Particles, ToolList, WallList
from ..state import SoilState
from ..tools.facets import Facets
from .arrays import Rows, Tool, ToolRows, WallRows
from .convert import full_rows, wall_rows
from .device import WARP, Launches, Mirror, blocks, on_device, room_for
from .lists import (
    OnDevice,
    clear,
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
    launches: dict[str, Launches] = field(default_factory=dict)  # by name, as long as the arrays stay


class DeviceLists:
    """Particles, neighbour lists, and what is near walls and tools."""

    def __init__(
        self, model: SoilModel, state: SoilState, grid: CellGrid, tools: list[tuple[Facets, int]]
    ) -> None:
        self._model, self.grid = model, grid
        particles = state.particles
        self.stream = cuda.stream()
        n = self.count = particles.count
        self._unequal = particles.unequal
        kind = model.precision
        # as many as are near five sides of a cube; enlarged when needed, for walls and tools
        near = min(n, room_for(int(8 * n ** (2 / 3))))
        self._tools = [Tool(facets, groups, near) for facets, groups in tools]
        self._sides = [
            _Side(
                self._empty_particles(n, kind),
                Rows.empty(n, room_for(_PARTNERS * n), kind),
                WallRows.empty(n, near),
                [ToolRows.empty(n, near, 4 * near) for _ in tools],
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
        self._poses = [Mirror((4,), self.stream) for _ in tools]
        self.put_particles(particles)
        self._forget()

    def _empty_particles(self, n: int, kind: type) -> OnDevice:
        own = n if self._unequal else 1
        vectors = [cuda.device_array((n, 3), kind) for _ in range(4)]
        numbers = [cuda.device_array(own, np.float64) for _ in range(3)]
        return OnDevice(
            position=cuda.device_array((n, 3), np.float64),
            velocity=vectors[0],
            spin=vectors[1],
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

    def _masses(self, particles: OnDevice) -> tuple[Any, Any]:
        model = self._model
        if self._unequal:
            return particles.mass, particles.inertia
        return model.mass_kg, model.inertia_kg_m2

    def _radius(self, particles: OnDevice) -> Any:
        return particles.radius if self._unequal else self._model.radius_m

    def _run(self, name: str, fill: Callable[[Launches], None]) -> None:
        """Launch the kernels that `fill` adds: once for each name, until arrays are replaced."""
        side = self._side
        if name not in side.launches:
            fill(side.launches.setdefault(name, Launches(self.stream)))
        side.launches[name].run()

    def rebuild(self, poses: Sequence[tuple[float, ...]]) -> None:
        """Sort particles into cells and rebuild all lists, with tools at poses (tools, 4): x, z [m],
        cosine, sine."""
        for mirror, pose in zip(self._poses, poses, strict=True):
            mirror.here[:] = pose
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

    def _partners(self, old: _Side, new: _Side, *, fill: bool) -> tuple[Any, ...]:
        model, p, rows, before = self._model, new.particles, new.rows, old.rows
        return (
            list_partners, blocks(self.count), fill, p.position, self._radius(p), model.radius_m,
            self.grid, self._cell_start, model.reach_m, rows.count, rows.slice_start, rows.neighbour,
            rows.history, self._order, before.count, before.slice_start, before.neighbour, before.history,
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
        walls, before = new.walls, old.walls
        launches.add(find_near_walls, blocks(n), p.position, self._planes, model.wall_reach_m, self._near)
        add_scan(launches, self._near, n, walls.row)
        launches.add(note_size, 1, self._sizes, 1, walls.row, threads=1)
        launches.add(
            list_near_walls, blocks(n), self._near, walls.row, self._order, walls.particle, walls.held,
            walls.springs, before.row, before.held, before.springs,
        )  # fmt: skip
        for k, tool in enumerate(self._tools):
            near, was = new.tools[k], old.tools[k]
            low, high, *surface = tool.near
            launches.add(
                find_near_tool, blocks(n), p.position, self._poses[k].there, low, high, *surface,
                model.tool_reach_m, self._near, self._facets_near,
            )  # fmt: skip
            add_scan(launches, self._near, n, near.row)
            add_scan(launches, self._facets_near, n, self._first_facet)
            launches.add(note_size, 1, self._sizes, 2 + 2 * k, near.row, threads=1)
            launches.add(note_size, 1, self._sizes, 3 + 2 * k, self._first_facet, threads=1)
            launches.add(
                list_near_tool, blocks(n), p.position, self._poses[k].there, *surface, model.tool_reach_m,
                self._near, near.row, self._first_facet, self._order, near.particle, near.facet_start,
                near.facet, near.active, near.normal, near.shear, near.roll,
                was.row, was.active, was.normal, was.shear, was.roll,
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
            count, slice_start = new.rows.count, new.rows.slice_start
            new.rows = Rows.empty(n, room_for(places), self._model.precision)
            new.rows.count, new.rows.slice_start, grown = count, slice_start, True
        if near_walls > len(new.walls.particle):
            new.walls, grown = WallRows.empty(n, min(n, room_for(near_walls))), True
        for k, tool in enumerate(self._tools):
            candidates, facets = of_tools[2 * k], of_tools[2 * k + 1]
            near = new.tools[k]
            if candidates > len(near.particle) or facets > len(near.facet):
                room = max(len(near.particle), min(n, room_for(candidates)))
                new.tools[k], grown = ToolRows.empty(n, room, max(len(near.facet), room_for(facets))), True
                if room > tool.moment.shape[1]:
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

    def put_lists(
        self, pairs: PairList, walls: WallList, tools: list[ToolList], wall_force: np.ndarray
    ) -> None:
        """Lists in the form of the CPU's, in place of those that `rebuild` would make."""
        side, n, kind = self._side, self.count, self._model.precision
        side.rows = Rows(**{name: on_device(array) for name, array in full_rows(pairs, kind).items()})
        near_walls = wall_rows(walls, wall_force, n)
        sizes = [len(side.rows.neighbour), len(near_walls["particle"])]
        side.walls = WallRows(**{name: on_device(array) for name, array in near_walls.items()})
        for k, near in enumerate(tools):
            row = np.searchsorted(near.particle, np.arange(n + 1)).astype(np.int64)
            arrays = {name: on_device(array) for name, array in vars(near).items()}
            side.tools[k] = ToolRows(cuda.to_device(row), **arrays)
            sizes += [len(near.particle), len(near.facet)]
            if len(near.particle) > self._tools[k].moment.shape[1]:
                self._tools[k].make_room(room_for(len(near.particle)))
        self._forget_launches()
        self._sizes.copy_to_device(np.array(sizes, np.int64), stream=self.stream)
        self.stream.synchronize()

    def take_pairs(self) -> dict[str, np.ndarray]:
        """Partners of every particle as they stand, and `cell_start` of the cells they are in."""
        self.stream.synchronize()
        return {
            **self._side.rows.taken(self.sizes()[0]),
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
