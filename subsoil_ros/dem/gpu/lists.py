"""Cells, neighbour lists and candidates on the GPU, and the histories they carry over.

Every particle lists all its partners, so that it gathers its own forces and no two threads write to one
place. Rows stand in slices of WARP particles, as wide as the longest of them: partner number k of particle i
is at slice_start[i // WARP] + WARP k + i % WARP, side by side in memory for the particles of a warp.

A partner out of reach is listed as ~j: the pair's springs are zero, whatever stands in the history. Those
of a pair, and its bond, are kept twice, for both sides alike, as of the particle with the lower number.

Kernels write to arguments that end in _out.
"""

from typing import NamedTuple

import numpy as np
from numba import cuda, float32

from ..neighbours import axis_cell
from ..particles import Kinematics, Loads
from ..per_particle import of_particle
from ..periodic import nearest_image
from ..tools.contacts import CONTACTS
from ..tools.facets import closest_feature
from ..tools.motion import into_body, motion_at
from ..walls import WALLS
from .device import WARP

_WALLS = len(WALLS)


class OnDevice(NamedTuple):
    """Arrays of dem.state.Particles on the GPU; those of unequal ones have length 1 where all are equal."""

    position: object
    velocity: object
    angular_velocity: object
    force: object
    torque: object
    built_position: object
    identity: object
    image: object
    held: object
    radius: object
    mass: object
    inertia: object
    material: object

    @property
    def kinematics(self) -> Kinematics:
        """Places and velocities."""
        return Kinematics(self.position, self.velocity, self.angular_velocity)  # type: ignore[arg-type]

    @property
    def loads(self) -> Loads:
        """Forces and torques."""
        return Loads(self.force, self.torque)  # type: ignore[arg-type]


class Reach(NamedTuple):
    """How near partners are [m]: centres closer than `reach`, less what their radii lack to the largest."""

    reach: float
    largest: float
    radius: object  # of each particle (n,), or of all


@cuda.jit(cache=True)
def clear(numbers):
    """Sets integers to zero."""
    k = cuda.grid(1)
    if k < numbers.shape[0]:
        numbers[k] = 0


@cuda.jit(cache=True)
def find_cells(position, image, grid, low_y, cell, rank, cell_count):
    """The cell of each particle, put back into its period first. `rank`: any order within a cell."""
    i = cuda.grid(1)
    if i < position.shape[0]:
        if grid.period != np.inf:
            y = position[i, 1]
            turns = int((y - low_y) // grid.period)
            y -= turns * grid.period
            if y >= low_y + grid.period:
                y = low_y
                turns += 1
            position[i, 1] = y
            image[i] += turns
        cx = axis_cell(position[i, 0], grid.origin_x, grid.edge, grid.nx)
        cy = axis_cell(position[i, 1], grid.origin_y, grid.edge_y, grid.ny)
        cz = axis_cell(position[i, 2], grid.origin_z, grid.edge, grid.nz)
        here = (cx * grid.ny + cy) * grid.nz + cz
        cell[i] = here
        rank[i] = cuda.atomic.add(cell_count, here, 1)


@cuda.jit(cache=True)
def place(cell, rank, cell_start, order):
    """Particle numbers cell by cell."""
    i = cuda.grid(1)
    if i < cell.shape[0]:
        order[cell_start[cell[i]] + rank[i]] = i


@cuda.jit(cache=True)
def sort_in_cells(cell_start, order):
    """Sorts each cell by number, so that the order of threads has no effect."""
    c = cuda.grid(1)
    if c < cell_start.shape[0] - 1:
        first = cell_start[c]
        for k in range(first + 1, cell_start[c + 1]):
            moving = order[k]
            m = k
            while m > first and order[m - 1] > moving:
                order[m] = order[m - 1]
                m -= 1
            order[m] = moving


@cuda.jit(cache=True)
def reorder(order, old, new, unequal):
    """Particle order[i] of `old` in place i of `new`."""
    i = cuda.grid(1)
    if i < order.shape[0]:
        k = order[i]
        for a in range(3):
            new.position[i, a] = old.position[k, a]
            new.velocity[i, a] = old.velocity[k, a]
            new.angular_velocity[i, a] = old.angular_velocity[k, a]
            new.force[i, a] = old.force[k, a]
            new.torque[i, a] = old.torque[k, a]
            new.built_position[i, a] = float32(old.position[k, a])
        new.identity[i] = old.identity[k]
        new.image[i] = old.image[k]
        new.held[i] = old.held[k]
        if unequal:
            new.radius[i] = old.radius[k]
            new.mass[i] = old.mass[k]
            new.inertia[i] = old.inertia[k]
            new.material[i] = old.material[k]


@cuda.jit(device=True)
def _carry(i, j, at, order, components, parity, old, rows_out):
    """Lists j as the partner at `at` of particle i, with the springs and the bond that the pair had."""
    numbers = parity.shape[0]
    first, second = order[i], order[j]
    spot = old.slice_start[first // WARP] + first % WARP
    rows_out.neighbour[at] = ~j
    for a in range(components, numbers):
        rows_out.history[a, at] = 0.0
    for _ in range(old.count[first]):
        listed = old.neighbour[spot]
        active = listed >= 0
        if (listed if active else ~listed) == second:
            turned = (first < second) != (i < j)
            for a in range(0 if active else components, numbers):
                kept = old.history[a, spot]
                rows_out.history[a, at] = parity[a] * kept if turned else kept
            if numbers > components and rows_out.history[components, at] < 0.0:
                rows_out.history[components, at] = 0.0  # a broken bond, which count_bonds counts
            if active:
                rows_out.neighbour[at] = j
            return
        spot += WARP


@cuda.jit(cache=True)
def count_bonds(order, components, old, old_counts, counts_out):
    """Bonds made and broken (n, 2) of each particle, with those that broke since its lists were built."""
    i = cuda.grid(1)
    if i < order.shape[0]:
        k = order[i]
        broken = old_counts[k, 1]
        spot = old.slice_start[k // WARP] + k % WARP
        for _ in range(old.count[k]):
            if old.history[components, spot] < 0.0:
                broken += 1
            spot += WARP
        counts_out[i, 0], counts_out[i, 1] = old_counts[k, 0], broken


@cuda.jit(cache=True)
def list_partners(fill, position, reaches, grid, cell_start, order, components, parity, old, rows_out):
    """Partners in reach: counted, or with `fill` listed as far as there is room.

    parity (numbers,): see dem.contact.history_parity; behind those of contacts, the first `components`, those
    of bonds.
    """
    reach, largest, radius = reaches
    i = cuda.grid(1)
    if i >= position.shape[0]:
        return
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    cx = axis_cell(x, grid.origin_x, grid.edge, grid.nx)
    cy = axis_cell(y, grid.origin_y, grid.edge_y, grid.ny)
    cz = axis_cell(z, grid.origin_z, grid.edge, grid.nz)
    low, high = max(cz - 1, 0), min(cz + 1, grid.nz - 1)
    allowed_here = reach - (largest - of_particle(radius, i))
    found = 0
    for column_x in range(max(cx - 1, 0), min(cx + 1, grid.nx - 1) + 1):
        for side in range(cy - 1, cy + 2):
            column_y = side
            if side < 0 or side >= grid.ny:
                if grid.period == np.inf:
                    continue
                column_y = side + grid.ny if side < 0 else side - grid.ny
            column = (column_x * grid.ny + column_y) * grid.nz
            for j in range(cell_start[column + low], cell_start[column + high + 1]):
                if j != i:
                    dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
                    if grid.period != np.inf:
                        dy = nearest_image(dy, grid.period)
                    allowed = allowed_here - (largest - of_particle(radius, j))
                    if dx * dx + dy * dy + dz * dz < allowed * allowed:
                        if fill:
                            at = rows_out.slice_start[i // WARP] + WARP * found + i % WARP
                            if at < rows_out.neighbour.shape[0]:
                                _carry(i, j, at, order, components, parity, old, rows_out)
                        found += 1
    if not fill:
        rows_out.count[i] = found


@cuda.jit(cache=True)
def slice_widths(count, width):
    """Places that each slice of WARP rows takes."""
    s = cuda.grid(1)
    if s < width.shape[0]:
        widest = 0
        for i in range(WARP * s, min(WARP * s + WARP, count.shape[0])):
            widest = max(widest, count[i])
        width[s] = WARP * widest


@cuda.jit(cache=True)
def find_near_walls(position, held, planes, reach, near_out):
    """`near_out` (n,) 1 where a wall is closer than `reach` [m] to a particle that is not `held`, else 0."""
    i = cuda.grid(1)
    if i < position.shape[0]:
        near_out[i] = 0
        for wall in range(_WALLS):
            gap = planes[wall, 3]
            for a in range(3):
                gap -= planes[wall, a] * position[i, a]
            if gap < reach and not (i < held.shape[0] and held[i]):
                near_out[i] = 1


@cuda.jit(cache=True)
def list_near_walls(near, order, old, walls_out):
    """Rows of the particles near walls, with the springs they had."""
    i = cuda.grid(1)
    row = walls_out.row
    if i < near.shape[0] and near[i] and row[i] < walls_out.particle.shape[0]:
        to, k = row[i], order[i]
        walls_out.particle[to], walls_out.active[to] = i, 0
        if old.row[k + 1] > old.row[k] and old.row[k] < old.active.shape[0]:
            here = old.row[k]
            walls_out.active[to] = old.active[here]
            for a in range(old.springs.shape[0]):
                walls_out.springs[a, to] = old.springs[a, here]


@cuda.jit(cache=True)
def find_near_tool(position, pose, surface, reach, near_out, facets_near_out):
    """`facets_near_out` (n,): facets closer than `reach` [m]; `near_out` 1 where there are any.

    pose: one motion of the tool for tools.motion.motion_at.
    """
    i = cuda.grid(1)
    if i >= position.shape[0]:
        return
    low, high = surface.low, surface.high
    x, y, z = into_body(motion_at(pose[0]), position[i, 0], position[i, 1], position[i, 2])
    found = 0
    inside = x > low[0] - reach and y > low[1] - reach and z > low[2] - reach
    if inside and x < high[0] + reach and y < high[1] + reach and z < high[2] + reach:
        for m in range(surface.corner.shape[0]):
            if _near_facet(x, y, z, m, surface, reach):
                found += 1
    facets_near_out[i] = found
    near_out[i] = 1 if found > 0 else 0


@cuda.jit(device=True)
def _near_facet(x, y, z, m, surface, reach):
    centre, ball = surface.centre, reach + surface.extent[m]
    dx, dy, dz = x - centre[m, 0], y - centre[m, 1], z - centre[m, 2]
    if dx * dx + dy * dy + dz * dz >= ball * ball:
        return False
    qx, qy, qz, _ = closest_feature(x, y, z, surface.corner[m])
    return (x - qx) * (x - qx) + (y - qy) * (y - qy) + (z - qz) * (z - qz) < reach * reach


@cuda.jit(cache=True)
def list_near_tool(position, pose, surface, reach, near, first_facet, order, old, rows_out):
    """Candidates of a tool as in dem.particles.ToolList, with the contacts they had."""
    i = cuda.grid(1)
    n = position.shape[0]
    row, facet = rows_out.row, rows_out.facet
    if i == n - 1 and row[n] < rows_out.facet_start.shape[0]:
        rows_out.facet_start[row[n]] = first_facet[n]
    if i >= n or near[i] == 0 or row[i] >= rows_out.particle.shape[0]:
        return
    to, k = row[i], order[i]
    x, y, z = into_body(motion_at(pose[0]), position[i, 0], position[i, 1], position[i, 2])
    rows_out.particle[to], rows_out.facet_start[to] = i, first_facet[i]
    at = first_facet[i]
    for m in range(surface.corner.shape[0]):
        if _near_facet(x, y, z, m, surface, reach):
            if at < facet.shape[0]:
                facet[at] = m
            at += 1
    known = old.row[k + 1] > old.row[k] and old.row[k] < old.active.shape[0]
    here = old.row[k] if known else 0
    for s in range(CONTACTS):
        rows_out.active[to, s] = known and old.active[here, s]
        for a in range(3):
            rows_out.normal[to, s, a] = old.normal[here, s, a] if known else 0.0
            rows_out.shear[to, s, a] = old.shear[here, s, a] if known else 0.0
        for a in range(rows_out.rolling.shape[2]):
            rows_out.rolling[to, s, a] = old.rolling[here, s, a] if known else 0.0


@cuda.jit(cache=True)
def note_size(sizes, k, before):
    """Stores the sum at the end of a scan."""
    sizes[k] = before[before.shape[0] - 1]
