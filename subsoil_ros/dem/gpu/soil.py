"""A soil on the GPU: its arrays, and the launches that work on them.

Particles and lists exist twice: new ones are built from the old ones, and then serve the steps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import cuda

from ..contact import Features, PairLaw
from ..facets import Facets
from ..mixture import Mixture
from ..neighbours import CellGrid
from ..pairs import HISTORY
from ..state import PairList, Particles, ToolList, WallList
from ..tools import CONTACTS
from ..walls import WALLS
from .convert import full_rows, wall_rows
from .device import WARP, Launches, Mirror, blocks, on_device, room_for
from .forces import (
    FAR,
    HALTED,
    LOST,
    REPORT,
    STEP,
    TOOL_SUMS,
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
from .scan import SUM_BLOCKS, add_scan, column_sums

_PARTNERS = 20
"""Partners per particle that there is room for at first (chosen: equal spheres list some 14)."""


@dataclass(frozen=True)
class Numbers:
    """What a soil is made of, apart from its particles. SI."""

    features: Features
    precision: type  # float64 or float32, of all but positions and boundaries
    step_s: float
    gravity_m_per_s2: float
    skin_m: float
    radius_m: float  # of all, or the largest
    mass_kg: float  # of all
    inertia_kg_m2: float
    pair_law: PairLaw
    wall_law: PairLaw
    tool_law: PairLaw
    pair_laws: np.ndarray
    wall_laws: np.ndarray
    tool_laws: np.ndarray
    materials: int
    planes: np.ndarray
    ceiling_m: float
    reach_m: float  # of the neighbour search, skin included
    wall_reach_m: float
    tool_reach_m: float
    soil_steps: int  # per tick


@dataclass
class _Rows:
    """Partners of every particle."""

    count: Any
    slice_start: Any
    neighbour: Any
    history: Any

    @classmethod
    def empty(cls, particles: int, room: int, kind: type) -> "_Rows":
        slices = -(-particles // WARP)
        return cls(
            cuda.device_array(particles, np.int32),
            cuda.device_array(slices + 1, np.int64),
            cuda.device_array(room, np.int32),
            cuda.to_device(np.zeros((HISTORY, room), kind)),  # springs that a law has not stay zero
        )


@dataclass
class _WallRows:
    """Particles near walls."""

    row: Any  # (n + 1,) first row of a particle
    particle: Any
    held: Any
    springs: Any
    force: Any

    @classmethod
    def empty(cls, particles: int, room: int) -> "_WallRows":
        of_walls = len(WALLS)
        return cls(
            cuda.device_array(particles + 1, np.int64),
            cuda.device_array(room, np.int64),
            cuda.device_array(room, np.int32),
            cuda.device_array((of_walls * HISTORY, room), np.float64),
            cuda.to_device(np.zeros((of_walls * 3, room))),
        )


@dataclass
class _ToolRows:
    """Candidates of one tool: dem.state.ToolList."""

    row: Any
    particle: Any
    facet_start: Any
    facet: Any
    active: Any
    normal: Any
    shear: Any
    roll: Any

    @classmethod
    def empty(cls, particles: int, room: int, facets: int) -> "_ToolRows":
        return cls(
            cuda.device_array(particles + 1, np.int64),
            cuda.device_array(room, np.int64),
            cuda.device_array(room + 1, np.int64),
            cuda.device_array(facets, np.int32),
            cuda.device_array((room, CONTACTS), np.bool_),
            *(cuda.device_array((room, CONTACTS, 3), np.float64) for _ in range(3)),
        )


class _Tool:
    """Surface of a tool, and room for what its candidates feel."""

    def __init__(self, facets: Facets, groups: int, room: int) -> None:
        self.facets = Facets(*(cuda.to_device(array) for array in facets))
        self.groups = groups
        corner = facets.corner
        centre = corner.mean(axis=1)
        extent = np.linalg.norm(corner - centre[:, None], axis=2).max(axis=1)
        places = corner.reshape(-1, 3)
        low, high = places.min(axis=0), places.max(axis=0)
        self.near = [cuda.to_device(array) for array in (low, high, facets.corner, centre, extent)]
        self.columns = 3 * groups + TOOL_SUMS
        self.make_room(room)

    def make_room(self, room: int) -> None:
        """For so many candidates."""
        self.group_force = cuda.device_array((self.groups, 3, room), np.float64)
        self.moment = cuda.device_array((3, room), np.float64)
        self.sums = cuda.device_array((7, room), np.float64)


@dataclass
class _Side:
    """One of the two states between which lists are built."""

    particles: OnDevice
    rows: _Rows
    walls: _WallRows
    tools: list[_ToolRows]
    launches: dict[str, Launches] = field(default_factory=dict)  # by name, as long as the arrays stay


class DeviceSoil:
    """Particles, lists, histories and tools of one soil on the GPU."""

    def __init__(
        self, numbers: Numbers, particles: Particles, grid: CellGrid, tools: list[tuple[Facets, int]]
    ) -> None:
        self._numbers, self.grid = numbers, grid
        self.stream = cuda.stream()
        self._features = without_period(numbers.features)
        n = self.count = particles.count
        self._unequal = particles.unequal
        kind = numbers.precision
        # as many as stand near five sides of a cube, and near tools: both grow when they must
        near = min(n, room_for(int(8 * n ** (2 / 3))))
        self._tools = [_Tool(facets, groups, near) for facets, groups in tools]
        self._sides = [
            _Side(
                self._empty_particles(n, kind),
                _Rows.empty(n, room_for(_PARTNERS * n), kind),
                _WallRows.empty(n, near),
                [_ToolRows.empty(n, near, 4 * near) for _ in tools],
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
        self._planes = cuda.to_device(numbers.planes)
        tables = numbers.pair_laws, numbers.wall_laws, numbers.tool_laws
        self._laws = [cuda.to_device(laws) for laws in tables]
        booked = n if numbers.features.book.ndim == 2 else 1
        self._pair_book = cuda.to_device(np.zeros((booked, 5)))
        self._wall_book = cuda.to_device(np.zeros((booked, 5)))
        self._per_step = sum(tool.columns for tool in self._tools)
        self._slots = numbers.soil_steps
        self._report = Mirror((REPORT + self._slots * self._per_step,), self.stream)
        tool_count = max(1, len(tools))
        self._motions = Mirror((self._slots, tool_count, 8), self.stream)
        self._of_particles = Mirror((SUM_BLOCKS, 8), self.stream)
        self._of_pairs = Mirror((SUM_BLOCKS, 3), self.stream)
        self._poses = [Mirror((4,), self.stream) for _ in range(tool_count)]
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
            radius=numbers[0],
            mass=numbers[1],
            inertia=numbers[2],
            material=cuda.device_array(own, np.int64),
        )

    def _forget(self) -> None:
        """No pair, wall or tool has been touched."""
        side = self._side
        for array in (side.rows.count, side.walls.row, *(tool.row for tool in side.tools)):
            array.copy_to_device(np.zeros(array.shape, array.dtype), stream=self.stream)

    @property
    def _side(self) -> _Side:
        return self._sides[self._at]

    def put_particles(self, particles: Particles) -> None:
        """These instead, in their order."""
        for name, array in self._side.particles._asdict().items():
            given = getattr(particles, name)
            if len(given):
                array.copy_to_device(np.ascontiguousarray(given), stream=self.stream)
        self.stream.synchronize()

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

    def _masses(self, particles: OnDevice) -> tuple[Any, Any]:
        numbers = self._numbers
        if self._unequal:
            return particles.mass, particles.inertia
        return numbers.mass_kg, numbers.inertia_kg_m2

    def _radius(self, particles: OnDevice) -> Any:
        return particles.radius if self._unequal else self._numbers.radius_m

    def _mixture(self, particles: OnDevice, laws: Any) -> Mixture:
        return Mixture(particles.radius, particles.mass, particles.material, laws, self._numbers.materials)  # type: ignore[arg-type]

    @staticmethod
    def _motion(particles: OnDevice) -> tuple[Any, ...]:
        p = particles
        return p.position, p.velocity, p.spin, p.force, p.torque

    # soil steps

    def _run(self, name: str, fill: Callable[[Launches], None]) -> None:
        """Launches what `fill` adds, which is the same until arrays are replaced."""
        side = self._side
        if name not in side.launches:
            fill(side.launches.setdefault(name, Launches(self.stream)))
        side.launches[name].run()

    def _add_drift(self, launches: Launches) -> None:
        numbers, p = self._numbers, self._side.particles
        launches.add(
            drift, blocks(self.count), self._report.there, *self._motion(p), p.built_position,
            *self._masses(p), numbers.step_s, (0.5 * numbers.skin_m) ** 2,
        )  # fmt: skip

    def _add_forces(self, launches: Launches, step_s: float) -> None:
        side, numbers, kind = self._side, self._numbers, self._numbers.precision
        p, rows, walls, report = side.particles, side.rows, side.walls, self._report.there
        motion = self._motion(p)
        launches.add(
            pair_kernel(self._features), blocks(self.count), report,
            rows.count, rows.slice_start, rows.neighbour, rows.history, *motion,
            self._masses(p)[0], numbers.gravity_m_per_s2, kind(numbers.radius_m), kind(step_s),
            numbers.pair_law, self._mixture(p, self._laws[0]), self.grid.period, self._pair_book,
        )  # fmt: skip
        launches.add(
            wall_kernel(self._features), blocks(len(walls.particle)), report, self._sizes, 1,
            walls.particle, walls.held, walls.springs, self._planes, *motion, numbers.radius_m, step_s,
            numbers.wall_law, self._mixture(p, self._laws[1]), walls.force, self._wall_book,
        )  # fmt: skip
        first = 0
        for k, (tool, near) in enumerate(zip(self._tools, side.tools, strict=True)):
            felt = tool.group_force, tool.moment, tool.sums
            launches.add(
                tool_kernel(self._features), blocks(len(near.particle)), report, self._sizes,
                2 + 2 * k, self._motions.there, k, near.particle, near.facet_start, near.facet, tool.facets,
                *motion, near.active, near.normal, near.shear, near.roll, numbers.radius_m, step_s,
                numbers.tool_law, self._mixture(p, self._laws[2]), *felt,
            )  # fmt: skip
            launches.add(
                add_up_tool, tool.columns, report, self._sizes, 2 + 2 * k, *felt, first,
                self._per_step, self._slots,
            )  # fmt: skip
            first += tool.columns

    def _add_step_end(self, launches: Launches) -> None:
        self._add_forces(launches, self._numbers.step_s)
        launches.add(end_step, 1, self._report.there, threads=1)

    def _add_step(self, launches: Launches) -> None:
        self._add_drift(launches)
        self._add_step_end(launches)

    def put_motions(self, motions: list[tuple[Any, ...]]) -> None:
        """Of all tools at the ends of the tick's soil steps: (steps, tools) of tool_surface.Motion."""
        if self._tools:
            self._motions.here[: len(motions)] = motions
            self._motions.send()

    def first_forces(self) -> np.ndarray:
        """Of a state at rest, without time: what the tools feel, (columns,)."""
        self._run("first", lambda launches: self._add_forces(launches, 0.0))
        return self.report()[1][0]

    def run_steps(self, count: int) -> None:
        """So many soil steps, or fewer: see `report`."""
        for _ in range(count):
            self._run("step", self._add_step)

    def drift_only(self) -> None:
        """The drift of a step whose forces wait for new lists."""
        self._run("drift", self._add_drift)

    def finish_step(self) -> None:
        """The forces of a step that waited for new lists."""
        self._run("forces", self._add_step_end)

    def report(self) -> tuple[dict[str, int], np.ndarray]:
        """How far the steps came, and what the tools felt in each of the last ones: (soil steps, columns)."""
        here = self._report.take()
        told = {"steps": int(here[STEP]), "halted": int(here[HALTED] or here[FAR]), "lost": int(here[LOST])}
        return told, here[REPORT:].reshape(self._slots, self._per_step)

    def _add_kick(self, launches: Launches) -> None:
        p, numbers, report = self._side.particles, self._numbers, self._report.there
        launches.add(
            kick_owed, blocks(self.count), report, p.velocity, p.spin, p.force, p.torque,
            *self._masses(p), numbers.step_s,
        )  # fmt: skip
        launches.add(kick_paid, 1, report, threads=1)

    def finish_kick(self) -> None:
        """The second half kick of the last step, if it is still to come."""
        self._run("kick", self._add_kick)

    def damp(self, kept: float) -> None:
        """Every velocity and spin times `kept`, at the end of the last step."""
        self.finish_kick()
        p, factor = self._side.particles, self._numbers.precision(kept)
        self._run(
            f"damp {kept}",
            lambda launches: launches.add(damp, blocks(self.count), p.velocity, p.spin, factor),
        )

    # lists

    def rebuild(self, poses: Sequence[tuple[float, ...]]) -> None:
        """Sorts particles into cells and builds all lists anew, tools being at poses (tools, 4): x, z [m],
        cosine, sine."""
        for mirror, pose in zip(self._poses, poses, strict=False):
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
        numbers, p, rows, before = self._numbers, new.particles, new.rows, old.rows
        return (
            list_partners, blocks(self.count), fill, p.position, self._radius(p), numbers.radius_m,
            self.grid, self._cell_start, numbers.reach_m, rows.count, rows.slice_start, rows.neighbour,
            rows.history, self._order, before.count, before.slice_start, before.neighbour, before.history,
        )  # fmt: skip

    def _add_counting(self, launches: Launches, old: _Side, new: _Side) -> None:
        """Of partners."""
        slices = len(self._width)
        launches.add(*self._partners(old, new, fill=False))
        launches.add(slice_widths, blocks(slices), new.rows.count, self._width)
        add_scan(launches, self._width, slices, new.rows.slice_start)
        launches.add(note_size, 1, self._sizes, 0, new.rows.slice_start, threads=1)

    def _add_filling(self, launches: Launches, old: _Side, new: _Side) -> None:
        """Lists what there is room for, and notes for how much there should be."""
        n, p, numbers = self.count, new.particles, self._numbers
        launches.add(*self._partners(old, new, fill=True))
        walls, before = new.walls, old.walls
        launches.add(find_near_walls, blocks(n), p.position, self._planes, numbers.wall_reach_m, self._near)
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
                numbers.tool_reach_m, self._near, self._facets_near,
            )  # fmt: skip
            add_scan(launches, self._near, n, near.row)
            add_scan(launches, self._facets_near, n, self._first_facet)
            launches.add(note_size, 1, self._sizes, 2 + 2 * k, near.row, threads=1)
            launches.add(note_size, 1, self._sizes, 3 + 2 * k, self._first_facet, threads=1)
            launches.add(
                list_near_tool, blocks(n), p.position, self._poses[k].there, *surface, numbers.tool_reach_m,
                self._near, near.row, self._first_facet, self._order, near.particle, near.facet_start,
                near.facet, near.active, near.normal, near.shear, near.roll,
                was.row, was.active, was.normal, was.shear, was.roll,
            )  # fmt: skip
        launches.add(lists_are_new, 1, self._report.there, threads=1)

    def sizes(self) -> list[int]:
        """Places of partners, particles near walls, and for each tool candidates and their facets."""
        sizes = self._sizes.copy_to_host(stream=self.stream)
        self.stream.synchronize()
        return sizes.tolist()

    def _make_room(self, new: _Side) -> bool:
        """Whether a list was longer than its arrays, which then are larger now."""
        places, near_walls, *of_tools = self.sizes()
        n, grown = self.count, False
        if places > len(new.rows.neighbour):
            count, slice_start = new.rows.count, new.rows.slice_start
            new.rows = _Rows.empty(n, room_for(places), self._numbers.precision)
            new.rows.count, new.rows.slice_start, grown = count, slice_start, True
        if near_walls > len(new.walls.particle):
            new.walls, grown = _WallRows.empty(n, min(n, room_for(near_walls))), True
        for k, tool in enumerate(self._tools):
            candidates, facets = of_tools[2 * k], of_tools[2 * k + 1]
            near = new.tools[k]
            if candidates > len(near.particle) or facets > len(near.facet):
                room = max(len(near.particle), min(n, room_for(candidates)))
                new.tools[k], grown = _ToolRows.empty(n, room, max(len(near.facet), room_for(facets))), True
                if room > tool.moment.shape[1]:
                    tool.make_room(room)
        if grown:
            self._forget_launches()
        return grown

    def _forget_launches(self) -> None:
        """Of arrays that are there no more."""
        for side in self._sides:
            side.launches.clear()

    # readings

    def look_at_particles(self) -> np.ndarray:
        """(8,) sums over particles at the end of the last step: see forces.look_at_particles."""
        self._run("look at particles", self._add_look_at_particles)
        return self._of_particles.take().sum(axis=0)

    def _add_look_at_particles(self, launches: Launches) -> None:
        self._add_kick(launches)
        p, numbers = self._side.particles, self._numbers
        launches.add(
            look_at_particles, SUM_BLOCKS, *self._motion(p), *self._masses(p), numbers.step_s, self._planes,
            self._radius(p), numbers.ceiling_m, self._of_particles.there,
        )  # fmt: skip

    def look_at_pairs(self) -> tuple[int, float, float]:
        """Contacts in reach, largest overlap [m], stored energy [J]."""
        self._run("look at pairs", self._add_look_at_pairs)
        found = self._of_pairs.take()
        return int(found[:, 0].sum()), float(found[:, 1].max()), float(found[:, 2].sum())

    def _add_look_at_pairs(self, launches: Launches) -> None:
        side, numbers = self._side, self._numbers
        p, rows = side.particles, side.rows
        launches.add(
            look_at_pairs_kernel(self._features), SUM_BLOCKS, rows.count, rows.slice_start, rows.neighbour,
            rows.history, p.position, numbers.radius_m, self._mixture(p, self._laws[0]), self.grid.period,
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
        side, n, kind = self._side, self.count, self._numbers.precision
        side.rows = _Rows(**{name: on_device(array) for name, array in full_rows(pairs, kind).items()})
        near_walls = wall_rows(walls, wall_force, n)
        sizes = [len(side.rows.neighbour), len(near_walls["particle"])]
        side.walls = _WallRows(**{name: on_device(array) for name, array in near_walls.items()})
        for k, near in enumerate(tools):
            row = np.searchsorted(near.particle, np.arange(n + 1)).astype(np.int64)
            arrays = {name: on_device(array) for name, array in vars(near).items()}
            side.tools[k] = _ToolRows(cuda.to_device(row), **arrays)
            sizes += [len(near.particle), len(near.facet)]
            if len(near.particle) > self._tools[k].moment.shape[1]:
                self._tools[k].make_room(room_for(len(near.particle)))
        self._forget_launches()
        self._sizes.copy_to_device(np.array(sizes, np.int64), stream=self.stream)
        self.stream.synchronize()

    def take_pairs(self) -> dict[str, np.ndarray]:
        """Partners of every particle as they stand, copied; `cell_start` tells the cells they are in."""
        rows, places = self._side.rows, self.sizes()[0]
        return {
            "count": self._take(rows.count),
            "slice_start": self._take(rows.slice_start),
            "neighbour": self._take(rows.neighbour)[:places],
            "history": self._take(rows.history)[:, :places],
            "cell_start": self._take(self._cell_start),
        }

    def take_walls(self) -> dict[str, np.ndarray]:
        """Particles near walls, cut to those that are listed."""
        walls, near_walls = self._side.walls, self.sizes()[1]
        return {
            "particle": self._take(walls.particle)[:near_walls],
            "held": self._take(walls.held)[:near_walls],
            "springs": self._take(walls.springs)[:, :near_walls],
            "force": self._take(walls.force)[:, :near_walls],
        }

    def take_tools(self) -> list[ToolList]:
        """Candidates of every tool, cut to those that are listed."""
        sizes, tools = self.sizes(), []
        for k, near in enumerate(self._side.tools):
            candidates, facets = sizes[2 + 2 * k : 4 + 2 * k]
            arrays = {name: self._take(array) for name, array in vars(near).items() if name != "row"}
            cut = {name: array[:candidates] for name, array in arrays.items()}
            cut["facet_start"] = arrays["facet_start"][: candidates + 1]
            if candidates == 0:
                cut["facet_start"] = np.zeros(1, np.int64)
            cut["facet"] = arrays["facet"][:facets]
            tools.append(ToolList(**cut))
        return tools
