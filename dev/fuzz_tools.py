"""Random solids as tools, and spheres about them.

Each case is a convex solid, turned, and in the float32 of an STL file: whole; subdivided; cut into parts that
lie flush; and with a second solid in it. The first three must have the same contacts with every sphere. Of
two that overlap, the nearest point is a contact, and none lies inside the other solid. A tenth of the spheres
is exactly above edges and vertices.
"""

from typing import NamedTuple

import numpy as np
import trimesh
from hypothesis import strategies as st
from numba import njit
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from subsoil_ros.dem.particles import ToolList
from subsoil_ros.dem.tools.contacts import CANDIDATES, CONTACTS, FOUND, find_contacts
from subsoil_ros.dem.tools.facets import facets_of
from subsoil_ros.scene.tool_mesh import ToolMesh

RADIUS = 0.0125
SPHERES = 200
SAME_M = 2e-3 * RADIUS
"""Distance within which parts count as one surface, and by which forces of unit stiffness may differ."""


@njit
def _found(centres, facets, near, reach):
    """Contacts of new particles: number (n,), and rows (n, CONTACTS, FOUND)."""
    count, rows = np.zeros(len(centres), np.int64), np.zeros((len(centres), CONTACTS, FOUND))
    out = np.empty((CANDIDATES, FOUND))
    for i in range(len(centres)):
        place = centres[i, 0], centres[i, 1], centres[i, 2]
        count[i] = find_contacts(0, place, reach, near, facets, out)
        rows[i, : count[i]] = out[: count[i]]
    return count, rows


class Contacts(NamedTuple):
    """What a tool's contacts with n spheres are."""

    count: np.ndarray  # (n,)
    point_m: np.ndarray  # (n, CONTACTS, 3), of the first count[i]
    force: np.ndarray  # (n, 3) of springs of unit stiffness [m]


def contacts(mesh: ToolMesh, centres: np.ndarray) -> Contacts:
    """Contacts of spheres of RADIUS at `centres` (n, 3) with a tool."""
    springs = [np.zeros((1, CONTACTS, 3)) for _ in range(3)]
    near = ToolList(  # one candidate, near all facets, in no contact yet
        np.zeros(1, np.int64),
        np.array([0, len(mesh.facets)]),
        np.arange(len(mesh.facets), dtype=np.int32),
        np.zeros((1, CONTACTS), np.bool_),
        *springs,
    )
    count, rows = _found(np.ascontiguousarray(centres), facets_of(mesh), near, RADIUS)
    normal, distance = rows[:, :, :3], rows[:, :, 3:4]
    known = np.arange(CONTACTS)[None, :, None] < count[:, None, None]
    force = (normal * (RADIUS - distance) * known).sum(axis=1)
    return Contacts(count, centres[:, None] + normal * distance, force)


def tool(*parts: trimesh.Trimesh) -> ToolMesh:
    """Parts, each a group, as an STL file has them."""
    parts = tuple(map(stored, parts))
    sizes = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return ToolMesh(
        vertices_m=np.concatenate([part.vertices for part in parts]),
        facets=np.concatenate([part.faces + size for part, size in zip(parts, sizes, strict=False)]),
        facet_group=np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts]),
        groups=tuple(f"part{k}" for k in range(len(parts))),
    )


def stored(part: trimesh.Trimesh) -> trimesh.Trimesh:
    """In float32, equal vertices merged."""
    corners = part.triangles.astype(np.float32).reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    return trimesh.Trimesh(corners, faces, process=False).process()


def about(part: trimesh.Trimesh, count: int, rng: np.random.Generator) -> np.ndarray:
    """Centres within a radius of the surface of a convex part, outside of it; a tenth of them exactly above
    vertices and points of edges."""
    points, facet = trimesh.sample.sample_surface(part, count, seed=rng)
    corner, out = part.triangles[facet], part.face_normals[facet]
    special, share = rng.random(count) < 0.1, rng.integers(0, 5, (count, 1)) / 4.0
    points = np.where(special[:, None], corner[:, 0] + share * (corner[:, 1] - corner[:, 0]), points)
    ways = out + special[:, None] * part.vertex_normals[part.faces[facet, 0]]
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    centres = points + ways * RADIUS * rng.uniform(0.2, 0.99, (count, 1))
    return centres[outside(part, centres) > 1e-6]


def outside(part: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """(n,) [m] how far points are beyond the farthest face plane of a convex part; negative inside."""
    planes = part.face_normals, (part.face_normals * part.triangles[:, 0]).sum(axis=1)
    return (points @ planes[0].T - planes[1]).max(axis=1)


def cut(part: trimesh.Trimesh, normal: np.ndarray, level_m: float) -> list[trimesh.Trimesh]:
    """Both sides of a convex part at a plane; the part itself if one side is nearly empty."""
    height = part.vertices @ normal - level_m
    edges = part.edges_unique
    one, other = height[edges].T
    crossed = one * other < 0.0
    share = (one / np.where(crossed, one - other, 1.0))[crossed, None]
    ends = part.vertices[edges[crossed]]
    seam = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
    sides = []
    for kept in (height > 0.0, height < 0.0):
        points = np.concatenate((part.vertices[kept], seam))
        if np.abs(height[kept]).max(initial=0.0) < 0.01 or len(seam) < 3:
            return [part]
        sides.append(hull(points))
    return sides


def hull(points: np.ndarray) -> trimesh.Trimesh:
    """Convex solid about points, its facets outward."""
    found = ConvexHull(points)
    mesh = trimesh.Trimesh(points, found.simplices, process=True)
    mesh.fix_normals()
    return mesh


class Case(NamedTuple):
    """A solid and how it is given."""

    seed: int
    corners: int
    subdivisions: int
    cuts: int


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Random cases; the seed decides places and turns."""
    return Case(
        draw(st.integers(0, 2**32 - 1)),
        draw(st.integers(5, 12)),
        draw(st.integers(0, 2)),
        draw(st.integers(0, 3)),
    )


def judge(case: Case) -> str:
    """Raise AssertionError unless the contacts are those of the solid."""
    rng = np.random.default_rng(case.seed)
    solid = hull(rng.uniform(-1.0, 1.0, (case.corners, 3)) * rng.uniform(0.02, 0.1, 3))
    solid.vertices = Rotation.random(random_state=case.seed).apply(solid.vertices)
    centres = about(solid, SPHERES, rng)
    whole = contacts(tool(solid), centres)
    assert (whole.count == 1).all(), "a convex solid has one contact"
    fine = solid
    for _ in range(case.subdivisions):
        fine = fine.subdivide()
    parts = [solid]
    for _ in range(case.cuts):
        normal = rng.standard_normal(3)
        normal /= np.linalg.norm(normal)
        parts = [side for part in parts for side in cut(part, normal, rng.uniform(-0.01, 0.01))]
    for name, given_as in (("subdivided", tool(fine)), ("in parts", tool(*parts))):
        found = contacts(given_as, centres)
        assert (found.count == 1).all(), f"{name} it has other contacts: {np.flatnonzero(found.count != 1)}"
        assert np.abs(found.force - whole.force).max() < SAME_M, f"{name} it is pressed otherwise"
    second = hull(rng.uniform(-0.05, 0.05, (8, 3)) + rng.uniform(-0.05, 0.05, 3))
    pair = (solid, second)
    free = np.concatenate([about(part, SPHERES, rng) for part in pair])
    free = free[(outside(solid, free) > SAME_M) & (outside(second, free) > SAME_M)]
    both, alone = contacts(tool(*pair), free), [contacts(tool(part), free) for part in pair]
    deepest = [np.linalg.norm(found.force, axis=1) for found in alone]
    for i in range(len(free)):
        points = both.point_m[i, : both.count[i]]
        for part in pair:
            assert (outside(part, points) > -SAME_M).all(), "a contact is inside the other solid"
        reached = [np.linalg.norm(point - free[i]) for point in points]
        nearest = RADIUS - max(deepest[0][i], deepest[1][i])
        assert min(reached, default=RADIUS) < nearest + SAME_M, "the nearest point is no contact"
    return "alike in all forms"
