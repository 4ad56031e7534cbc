"""What a terrain sees of a tool: points of its surface, the plates it consists of, and its views from above,
in whose columns it carries soil."""

import math
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from ..scene.tool_mesh import ToolMesh

Array = NDArray[np.float64]

POINTS_PER_CELL = 2
"""Points of the surface per cell and direction, so that each cell that a tool touches has one."""

FINE = 4
"""Parts of a column per direction in which the cavity's walls are found: they may be a quarter as thick."""

PLATE_RAD = math.radians(20.0)
"""Largest angle between facets of one plate: a curved mouldboard becomes a few plates."""

PITCHES_RAD = np.radians(np.arange(-90.0, 91.0, 7.5))
"""Tilts about the tool's y axis from which it is seen: a slope is then off by 4 degrees at most."""

LEAST_HELD_CELLS = 2.0
"""Volume below which a tool has no cavity, in cubes of a cell: what unevenness of a plate holds."""


class ToolShape(NamedTuple):
    """Surface of a tool, in its own axes."""

    points_m: Array  # (n, 3), of the surface
    normals: Array  # (n, 3), outward
    areas_m2: Array  # (n,)
    plate_first: NDArray[np.int64]  # (plates + 1,) number of the first point of each plate, and of all points
    plate_group: NDArray[np.int64]  # (plates,) facet group of each plate


class View(NamedTuple):
    """A tool seen from above at one pitch: columns on a grid along a level axis and the tool's y axis."""

    axes: Array  # (3, 3): rows along, y, up, in the tool's axes
    corner_m: Array  # (2,) coordinates along and y of the grid's corner
    floor_m: Array  # (a, b) coordinate up of the highest surface in the middle; NaN where there is none
    walls_m: Array  # (2, a, b) highest surface on the way to the next column along the first, second axis


def tool_shape(mesh: ToolMesh, cell_m: float) -> ToolShape:
    """The surface of a mesh about its body, for a terrain with cells of this size."""
    corners = mesh.vertices_m[mesh.facets]
    points, normals, areas, facets = _points(corners, cell_m / POINTS_PER_CELL)
    plate_of_facet = _plates(mesh, corners)
    plate_group = np.zeros(plate_of_facet.max() + 1, dtype=np.int64)
    plate_group[plate_of_facet] = mesh.facet_group
    plate = plate_of_facet[facets]
    order = np.argsort(plate, kind="stable")
    first = np.searchsorted(plate[order], np.arange(len(plate_group) + 1))
    return ToolShape(points[order], normals[order], areas[order], first, plate_group)


def views(mesh: ToolMesh, cell_m: float) -> tuple[View, ...]:
    """The tool seen from above, by PITCHES_RAD; none if it holds no soil at any."""
    dense = _points(mesh.vertices_m[mesh.facets], 0.5 * cell_m / FINE)[0]
    found = tuple(_view(dense, _axes(pitch), cell_m) for pitch in PITCHES_RAD)
    held = max(held_m3(view, cell_m) for view in found)
    return found if held >= LEAST_HELD_CELLS * cell_m**3 else ()


def _points(corners: Array, spacing_m: float) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Points on triangles (m, 3, 3) no farther apart than a spacing; normals, areas, number of triangle."""
    points, normals, areas, facets = [], [], [], []
    for facet, triangle in enumerate(corners):
        sides = np.linalg.norm(np.roll(triangle, -1, axis=0) - triangle, axis=1)
        a, b, c = np.roll(triangle, -int(np.argmax(sides)), axis=0)  # a to b is the longest side
        normal = np.cross(b - a, c - a)
        double = float(np.linalg.norm(normal))
        rows = max(1, math.ceil(double / sides.max() / spacing_m))
        for row in range(rows):  # strips parallel to the longest side
            v = (row + 0.5) / rows
            columns = max(1, math.ceil((1.0 - v) * sides.max() / spacing_m))
            u = (np.arange(columns) + 0.5) / columns * (1.0 - v)
            points.append(a + u[:, None] * (b - a) + v * (c - a))
            areas.append(np.full(columns, double * (1.0 - v) / rows / columns))
            normals.append(np.tile(normal / double, (columns, 1)))
            facets.append(np.full(columns, facet))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(areas), np.concatenate(facets)


def _plates(mesh: ToolMesh, corners: Array) -> NDArray[np.int64]:
    """Number of the plate of each facet: neighbours within PLATE_RAD of the largest one of them."""
    surface = trimesh.Trimesh(mesh.vertices_m, mesh.facets, process=False)
    neighbours: list[list[int]] = [[] for _ in corners]
    for one, other in surface.face_adjacency.tolist():
        neighbours[one].append(other)
        neighbours[other].append(one)
    normal, plate = surface.face_normals, np.full(len(corners), -1)
    for first in np.argsort(-surface.area_faces, kind="stable").tolist():
        if plate[first] >= 0:
            continue
        number, waiting = plate.max() + 1, [first]
        plate[first] = number
        while waiting:
            for other in neighbours[waiting.pop()]:
                same = mesh.facet_group[other] == mesh.facet_group[first]
                if plate[other] < 0 and same and normal[other] @ normal[first] > math.cos(PLATE_RAD):
                    plate[other] = number
                    waiting.append(other)
    return plate


def _axes(pitch_rad: float) -> Array:
    """Rows along, y and up, up being z turned by the pitch about y."""
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def _view(dense: Array, axes: Array, cell_m: float) -> View:
    """The highest of dense points by column, and on the way from column to column."""
    a, b, up = np.einsum("ij,nj->in", axes, dense)  # BLAS would take other cores
    corner = np.array([a.min(), b.min()]) - cell_m
    shape = tuple(math.ceil(np.ptp(x) / cell_m) + 3 for x in (a, b))  # its border is empty
    fine, part, middle = np.full((FINE * shape[0], FINE * shape[1]), -np.inf), cell_m / FINE, FINE // 2
    np.maximum.at(fine, (((a - corner[0]) / part).astype(int), ((b - corner[1]) / part).astype(int)), up)
    blocks = fine.reshape(shape[0], FINE, shape[1], FINE)
    floor = blocks[:, middle - 1 : middle + 1, :, middle - 1 : middle + 1].min(axis=(1, 3))
    rows = _lower(fine[:, middle - 1 :: FINE], fine[:, middle::FINE])
    columns = _lower(fine[middle - 1 :: FINE], fine[middle::FINE])
    walls = np.stack([_walls(rows), _walls(columns.T).T])
    return View(axes, corner, np.where(np.isfinite(floor), floor, np.nan), walls)


def _lower(one: Array, other: Array) -> Array:
    """The lower of two heights side by side, as of a floor; the other where one has no surface."""
    return np.where(np.isfinite(one) & np.isfinite(other), np.minimum(one, other), np.maximum(one, other))


def _walls(fine: Array) -> Array:
    """Highest surface between the middles of columns along the first axis, thin walls in one included."""
    a, b, c, d = (fine[k::FINE] for k in range(FINE))
    ridge = np.where(np.maximum(b, c) > np.maximum(a, d), np.maximum(b, c), -np.inf)
    between = np.maximum(d[:-1], a[1:])
    whole = np.maximum(between, np.maximum(ridge[:-1], ridge[1:]))
    return np.concatenate([whole, np.full((1, whole.shape[1]), np.inf)])


def held_m3(view: View, cell_m: float) -> float:
    """Volume of water that a tool holds in a view: the level rises to the lowest rim on any way out."""
    inside = np.isfinite(view.floor_m)
    floor = np.where(inside, view.floor_m, -np.inf)
    level = np.where(inside, np.inf, -np.inf)
    for _ in range(sum(level.shape)):
        before = level.copy()
        for axis, wall in enumerate(view.walls_m):
            one, other = _pair(level, axis)
            rim = _pair(wall, axis)[0]
            passed = np.maximum(other, rim), np.maximum(one, rim)
            np.minimum(one, passed[0], out=one)
            np.minimum(other, passed[1], out=other)
        np.maximum(level, floor, out=level, where=inside)
        if np.array_equal(level, before):
            break
    return float((level[inside] - floor[inside]).sum()) * cell_m**2


def _pair(values: NDArray[np.generic], axis: int) -> tuple[NDArray[np.generic], NDArray[np.generic]]:
    """Each column but the last along an axis, and the one after it."""
    return (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])
