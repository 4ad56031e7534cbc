"""Tool meshes: STL files, checked, placed in the frame of the body that carries them; their mass."""

import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..messages import SpatialMotion, ToolMotion
from ..rotations import placed_m
from .kept_shapes import Shape, sound_shape
from .scene import Scene

if TYPE_CHECKING:
    import trimesh

LARGEST_SIZE_M = 20.0
"""Largest size of a mesh: no tool for a soil bin is larger, so such a file is probably in millimetres."""

SMALLEST_HEIGHT = 1e-6
"""Height of a facet over the mesh's size below which it is degenerate: ten times the round-off of the float32
of an STL file."""

HOLLOW_POINTS = 64
"""Vertices of a part turned inward that are looked up in the others, about."""


@dataclass(frozen=True)
class ToolMesh:
    """Surface of one tool, all its groups, closed group by group.

    In the frame of its body: origin at the body's centre of mass in the reference pose, axes parallel to
    the world's in that pose, y including the tool's lateral offset. A tool on a path: in the path's frame.
    World position of a vertex: (x, 0, z) + R vertex, with R a rotation by phi - phi of the reference pose
    about -y (x' = c x - s z, z' = s x + c z).
    """

    vertices_m: NDArray[np.float64]  # (n, 3)
    facets: NDArray[np.int32]  # (m, 3), counter-clockwise seen from outside: normals point outward
    facet_group: NDArray[np.int32]  # (m,), index into groups
    groups: tuple[str, ...]
    lateral_m: float = 0.0  # y of the body
    setback_m: float = 0.0  # how far particles reach in before they touch it

    def about_body(self) -> "ToolMesh":
        """The mesh with y measured from the body, as needed for a tool that moves in space."""
        return replace(self, vertices_m=self.vertices_m - (0.0, self.lateral_m, 0.0), lateral_m=0.0)

    def part_of_facets(self) -> NDArray[np.int32]:
        """(m,) number of the closed part that each facet belongs to."""
        return _part_of_facets(self.facets)

    def without_voids(self) -> "ToolMesh":
        """The mesh without closed hollows, which no particle can enter."""
        part = self.part_of_facets()
        kept = (_volumes(self.vertices_m, self.facets, part) > 0.0)[part]
        return replace(self, facets=self.facets[kept], facet_group=self.facet_group[kept])


def load_tool_mesh(directory: Path, scene: Scene, tool_name: str) -> ToolMesh:
    """Load, check and place the meshes of a tool; relative paths are seen from `directory`.

    Raises:
        SceneError: a mesh is missing, unreadable, open, degenerate, inside out or far too large.
    """
    tool = scene.tools[tool_name]
    origin = np.array([0.0, -tool.lateral_m, 0.0])
    if tool.body is not None and scene.mechanism is not None:
        x_m, z_m = scene.mechanism.bodies[tool.body].position_m
        origin += (x_m, 0.0, z_m)
    vertices, facets, facet_group = [], [], []
    vertex_count = 0
    for index, (group, part) in enumerate(tool.groups.items()):
        path = directory / part.mesh
        where = f"tools.{tool_name}.groups.{group}.mesh: {path}"
        corners, faces = sound_shape(path, partial(_checked, path, part.scale, where))
        _refuse_large(corners, part.scale, where)
        vertices.append(corners * part.scale + part.position_m - origin)
        facets.append(faces + vertex_count)
        facet_group.append(np.full(len(faces), index))
        vertex_count += len(corners)
    return ToolMesh(
        vertices_m=np.ascontiguousarray(np.concatenate(vertices), dtype=np.float64),
        facets=np.ascontiguousarray(np.concatenate(facets), dtype=np.int32),
        facet_group=np.concatenate(facet_group).astype(np.int32),
        groups=tuple(tool.groups),
        lateral_m=tool.lateral_m,
        setback_m=tool.setback_m,
    )


def _refuse_large(vertices: NDArray[np.float64], scale: float, where: str) -> None:
    """Raises SceneError where the box of a mesh is too large."""
    size = float(np.max(np.ptp(vertices, axis=0)))
    if size * scale > LARGEST_SIZE_M:
        raise SceneError(
            f"{where}: is {size * scale:.4g} m large, allowed are {LARGEST_SIZE_M:g} m; a file in "
            f"millimetres needs 'scale: 0.001' (given {scale:g})"
        )


def _checked(path: Path, scale: float, where: str) -> Shape:
    """The mesh of one group, equal vertices merged, in file units."""
    import trimesh

    from .cad_mesh import read_cad

    mesh, _ = read_cad(path, where)
    if not np.isfinite(mesh.vertices).all():
        raise SceneError(f"{where}: has coordinates that are not finite; export it again")
    _refuse_large(np.asarray(mesh.vertices), scale, where)
    flat = flat_facets(mesh)
    if flat.any():
        raise SceneError(
            f"{where}: facet {int(np.argmax(flat))} and {int(flat.sum()) - 1} others have no area; "
            "remove degenerate facets before exporting"
        )
    if not mesh.is_watertight:
        open_count = len(trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1))
        raise SceneError(
            f"{where}: is not watertight ({open_count} open edges of {len(mesh.edges_unique)}); "
            "a tool needs a closed surface: repair the mesh, each edge shared by exactly two facets"
        )
    if not mesh.is_winding_consistent or _wrong_side_out(mesh):
        raise SceneError(
            f"{where}: facets point inward (volume {mesh.volume * scale**3:.3g} m3); normals must "
            "point outward, those of a closed hollow into it: turn the winding of the facets round, for "
            "example by trimesh's fix_normals()"
        )
    return np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)


def flat_facets(mesh: "trimesh.Trimesh") -> NDArray[np.bool_]:
    """(m,) whether a facet has no area, but for round-off."""
    edges = np.linalg.norm(mesh.triangles - np.roll(mesh.triangles, 1, axis=1), axis=2)
    size = float(np.max(np.ptp(mesh.vertices, axis=0)))
    return np.asarray(2.0 * mesh.area_faces <= SMALLEST_HEIGHT * size * edges.max(axis=1))


def _part_of_facets(facets: NDArray[Any]) -> NDArray[np.int32]:
    """(m,) number of the part that each facet of a watertight mesh belongs to; parts share no edge."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2)
    pairs = np.lexsort(ends.T).reshape(-1, 2) // 3
    links = coo_array((np.ones(len(pairs), dtype=bool), pairs.T), shape=(len(facets), len(facets)))
    return np.asarray(connected_components(links, directed=False)[1], np.int32)


def _volumes(
    vertices: NDArray[np.float64], facets: NDArray[Any], part: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Signed volume of each part [length units^3], (parts,)."""
    corners = vertices[facets] - vertices.mean(axis=0)
    sixfold = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return np.bincount(part, weights=sixfold) / 6.0


def _wrong_side_out(mesh: "trimesh.Trimesh") -> bool:
    """Whether a part has its facets inward and is no hollow of another one."""
    vertices, facets = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    part = _part_of_facets(facets)
    volumes = _volumes(vertices, facets, part)
    solid = facets[(volumes > 0.0)[part]]
    for k in np.flatnonzero(volumes <= 0.0):
        own = np.unique(facets[part == k])
        points = vertices[own[:: max(1, len(own) // HOLLOW_POINTS)]]
        if volumes[k] == 0.0 or any(_turns_around(point, vertices[solid]) < 0.5 for point in points):
            return True
    return False


def _turns_around(point: NDArray[np.float64], corners: NDArray[np.float64]) -> float:
    """How often facets (m, 3, 3) enclose a point: solid angle over 4 pi (A. van Oosterom, J. Strackee, IEEE
    Trans. Biomed. Eng. 30, 1983)."""
    a, b, c = np.moveaxis(corners - point, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    base = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.arctan2(volume, base).sum() / math.tau)


@dataclass(frozen=True)
class ToolMass:
    """Mass of the solid inside the meshes, in the frame of the tool's body; overlaps count twice."""

    mass_kg: float
    centre_m: tuple[float, float, float]  # from the body's typed centre of mass
    inertia_kg_m2: float  # about the y axis through the computed centre


def tool_mass(mesh: ToolMesh, density_kg_per_m3: float) -> ToolMass:
    """Integrals over the closed meshes of a tool (divergence theorem, by trimesh)."""
    import trimesh

    mass, moment, about_origin = 0.0, np.zeros(3), 0.0
    for group in range(len(mesh.groups)):
        part = trimesh.Trimesh(mesh.vertices_m, mesh.facets[mesh.facet_group == group], process=False)
        found = trimesh.triangles.mass_properties(part.triangles, density=density_kg_per_m3)
        centre = np.asarray(found["center_mass"])
        mass += float(found["mass"])
        moment += found["mass"] * centre
        about_origin += float(found["inertia"][1, 1] + found["mass"] * (centre[0] ** 2 + centre[2] ** 2))
    x, y, z = (moment / mass).tolist()
    return ToolMass(mass, (x, y, z), about_origin - mass * (x**2 + z**2))


def reference_angle(scene: Scene, tool: str) -> float:
    """Angle of a tool's body in the reference pose [rad]; 0 along a path."""
    body, mechanism = scene.tools[tool].body, scene.mechanism
    return mechanism.bodies[body].angle_rad if body is not None and mechanism is not None else 0.0


def posed_vertices_m(mesh: ToolMesh, motion: ToolMotion, reference_angle_rad: float) -> NDArray[np.float64]:
    """Vertices (n, 3) of a tool in world axes at a motion's pose."""
    if isinstance(motion, SpatialMotion):
        return placed_m(mesh.about_body().vertices_m, motion.position_m, motion.quaternion)
    turn = motion.angle_rad - reference_angle_rad
    cosine, sine = np.cos(turn), np.sin(turn)
    x, y, z = mesh.vertices_m.T
    return np.column_stack([motion.x_m + cosine * x - sine * z, y, motion.z_m + sine * x + cosine * z])
