"""How many contacts a sphere has with a tool, and where: the same however the same surface is given."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numba import njit
from scipy.spatial.transform import Rotation

from subsoil_ros.dem.tools.facets import facets_of
from subsoil_ros.dem.tools.forces import CANDIDATES, CONTACTS, FOUND, _find_contacts
from subsoil_ros.scene.meshes import ToolMesh

RADIUS, DEPTH = 0.0125, 0.0005
BOX = (0.02, 0.12, 0.16)


@njit
def found(centres, facets, facet, reach):
    """Contacts of new particles: number (n,), and the sum of their springs' forces at stiffness 1 (n, 3)."""
    count, force = np.zeros(len(centres), np.int64), np.zeros((len(centres), 3))
    active, normal = np.zeros(CONTACTS, np.bool_), np.zeros((CONTACTS, 3))
    out = np.empty((CANDIDATES, FOUND))
    for i in range(len(centres)):
        x, y, z = centres[i]
        n = _find_contacts(x, y, z, facets, 0, len(facet), facet, reach, active, normal, out)
        count[i] = n
        for k in range(n):
            for a in range(3):
                force[i, a] += out[k, a] * (reach - out[k, 3])
    return count, force


def tool(*parts: trimesh.Trimesh) -> ToolMesh:
    """Parts, each a group."""
    sizes = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return ToolMesh(
        vertices_m=np.concatenate([part.vertices for part in parts]),
        facets=np.concatenate([part.faces + size for part, size in zip(parts, sizes, strict=False)]),
        facet_group=np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts]),
        groups=tuple(f"part{k}" for k in range(len(parts))),
    )


def contacts(mesh: ToolMesh, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """See found."""
    return found(centres, facets_of(mesh), np.arange(len(mesh.facets), dtype=np.int32), RADIUS)


def stored(part: trimesh.Trimesh) -> trimesh.Trimesh:
    """As an STL file has it: float32, equal vertices merged."""
    return trimesh.Trimesh(part.triangles.astype(np.float32).reshape(-1, 3), process=False,
                           faces=np.arange(3 * len(part.faces)).reshape(-1, 3)).process()  # fmt: skip


def about(part: trimesh.Trimesh, count: int, rng: np.random.Generator) -> np.ndarray:
    """Centres within a radius of the surface of a convex part, outside of it: anywhere, and a tenth exactly
    above edges, vertices and planes of symmetry."""
    points, facet = trimesh.sample.sample_surface(part, count, seed=rng)
    out = part.face_normals[facet]
    special = rng.random(count) < 0.1
    kind = rng.integers(0, 3, count)
    corner = part.triangles[facet]
    edge = corner[:, 0] + rng.integers(0, 5, (count, 1)) / 4.0 * (corner[:, 1] - corner[:, 0])
    points = np.where((special & (kind == 0))[:, None], edge, points)
    points = np.where((special & (kind == 1))[:, None], corner[:, 2], points)
    ways = out + (special & (kind < 2))[:, None] * part.vertex_normals[part.faces[facet, 2]]
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    centres = points + ways * RADIUS * rng.uniform(0.2, 0.99, (count, 1))
    flat = special & (kind == 2)
    centres[flat, rng.integers(0, 3, flat.sum())] = 1e-21
    outside = (np.abs(centres) > 0.5 * part.extents + 1e-6).any(axis=1)
    return np.ascontiguousarray(centres[outside])


@pytest.mark.parametrize("subdivisions", [1, 3])
@pytest.mark.parametrize("turned", [False, True])
def test_a_convex_body_has_one_contact_however_it_is_meshed(subdivisions: int, turned: bool) -> None:
    """A box of 12 facets and the same of 48 and 768, in float32: each centre in reach has one contact."""
    rng = np.random.default_rng(subdivisions)
    centres = about(trimesh.creation.box(BOX), 20_000, rng)
    turn = Rotation.random(random_state=1) if turned else Rotation.identity()
    fine = trimesh.creation.box(BOX)
    for _ in range(subdivisions):
        fine = fine.subdivide()
    counts = []
    for part in (trimesh.creation.box(BOX), fine):
        part.vertices = turn.apply(part.vertices)
        counts.append(contacts(tool(stored(part)), turn.apply(centres))[0])
    assert (counts[0] <= 1).all()
    assert (counts[0] == counts[1]).all()
    assert counts[0].mean() > 0.9


def test_a_vertex_on_an_edge_holds_a_particle() -> None:
    """The grid bed's particle over a vertex in the middle of a convex edge, off by a round-off."""
    fine = trimesh.creation.box(BOX)
    for _ in range(4):
        fine = fine.subdivide()
    centre = np.array([[-0.0202, 1e-21, -0.08185]])
    for part in (trimesh.creation.box(BOX), fine):
        assert contacts(tool(part), centre)[0][0] == 1


@pytest.mark.parametrize("degrees", [0.0, 33.0])
def test_flush_parts_are_one_plate(degrees: float) -> None:
    """Eight boxes side by side, in float32 and turned, act as the plate that they make."""
    rng = np.random.default_rng(0)
    plate = trimesh.creation.box(BOX)
    slices = [trimesh.creation.box((BOX[0], BOX[1] / 8, BOX[2])) for _ in range(8)]
    for k, part in enumerate(slices):
        part.apply_translation((0.0, ((k + 0.5) / 8 - 0.5) * BOX[1], 0.0))
    turn = Rotation.from_euler("xyz", (degrees, 2 * degrees, degrees), degrees=True)
    centres = turn.apply(about(plate, 20_000, rng))
    for part in (plate, *slices):
        part.vertices = turn.apply(part.vertices)
    one, whole = contacts(tool(stored(plate)), centres)
    many, pieces = contacts(tool(*map(stored, slices)), centres)
    assert (many == one).all()
    np.testing.assert_allclose(pieces, whole, atol=2e-3 * RADIUS)


def test_parts_that_overlap_are_their_union() -> None:
    """Two boxes turned by 37 degrees: contacts are those of the parts' surfaces outside the other part."""
    first, second = trimesh.creation.box(BOX), trimesh.creation.box((0.02, 0.1, 0.1))
    second.apply_transform(trimesh.transformations.rotation_matrix(np.radians(37.0), (1.0, 0.0, 0.0)))
    second.apply_translation((0.0, 0.0, 0.08))
    rng = np.random.default_rng(3)
    centres = np.concatenate([about(part, 5000, rng) for part in (first, second)])
    distances = [-trimesh.proximity.signed_distance(part, centres) for part in (first, second)]
    outside = (distances[0] > 1e-6) & (distances[1] > 1e-6)
    # both faces at x = 0.01 m are in one plane, and so are those at -0.01 m
    count, _ = contacts(tool(first, second), centres[outside])
    nearest = np.minimum(*distances)[outside]
    reached = nearest < RADIUS - 1e-6
    assert (count[reached] >= 1).all()
    flat = np.abs(centres[outside][:, 0]) > 0.01 + 1e-6
    assert (count[reached & flat & (nearest > np.abs(centres[outside][:, 0]) - 0.01 - 1e-9)] == 1).all()


@pytest.mark.parametrize("radius_m", [0.03, 0.06, 0.15, 0.3])
@pytest.mark.parametrize("facets", [16, 64, 256])
def test_a_smooth_trough_is_one_contact(radius_m: float, facets: int) -> None:
    """A sphere in a trough of any fineness; the force is that of one spring."""
    angles = np.linspace(0.0, np.pi, facets + 1)
    arc = radius_m * np.column_stack((np.cos(angles), -np.sin(angles)))
    rim = np.array([(-1.2 * radius_m, 0.0), (-1.2 * radius_m, -1.2 * radius_m),
                    (1.2 * radius_m, -1.2 * radius_m), (1.2 * radius_m, 0.0)])  # fmt: skip
    outline = np.concatenate((arc, rim))
    n = len(outline)
    around = np.arange(n)
    side = (
        np.column_stack((around, np.roll(around, -1), np.roll(around, -1) + n)),
        np.column_stack((around, np.roll(around, -1) + n, around + n)),
    )
    caps = _ears(outline)
    vertices = np.concatenate(
        [np.column_stack((outline[:, 0], np.full(n, y), outline[:, 1])) for y in (0, 1)]
    )
    mesh = trimesh.Trimesh(vertices, np.concatenate((*side, caps[:, ::-1], caps + n)), process=False)
    mesh.fix_normals()
    assert mesh.is_watertight
    rng = np.random.default_rng(0)
    at, along = rng.uniform(0.3, np.pi - 0.3, 500), rng.uniform(0.2, 0.8, 500)
    off = (at % (np.pi / facets)) - 0.5 * np.pi / facets  # from the middle of a facet
    way = (radius_m * np.cos(0.5 * np.pi / facets) - RADIUS + DEPTH) / np.cos(off)
    centres = np.column_stack((way * np.cos(at), along, -way * np.sin(at)))
    count, _ = contacts(tool(mesh), centres)
    assert (count == 1).all()


def _ears(outline: np.ndarray) -> np.ndarray:
    """Triangles of the trough's end: a fan from the rim's lower corners to the arc."""
    n = len(outline)
    arc, (a, b, c, d) = n - 4, range(n - 4, n)
    half = arc // 2
    fan = [(k, k + 1, c) for k in range(half)] + [(k, k + 1, b) for k in range(half, arc - 1)]
    return np.array([*fan, (half, b, c), (arc - 1, a, b), (0, c, d)])


def test_a_true_corner_is_two_contacts() -> None:
    """A groove of 90 degrees keeps both of its faces, of one part or of two that overlap."""
    floor = trimesh.creation.box((0.2, 0.2, 0.02))
    wall = trimesh.creation.box((0.02, 0.2, 0.2))
    wall.apply_translation((-0.05, 0.0, 0.09))
    gap = 0.01 + RADIUS - DEPTH
    count, force = contacts(tool(floor, wall), np.array([[-0.05 + gap, 0.0, gap]]))
    assert count[0] == 2
    np.testing.assert_allclose(force[0], [-DEPTH, 0.0, -DEPTH], atol=1e-9)


def test_a_hollow_is_no_surface() -> None:
    """Of a closed solid with a closed hollow, only the outside is left."""
    outer, inner = trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.box((0.1, 0.1, 0.1))
    inner.invert()
    mesh = tool(trimesh.util.concatenate(outer, inner))
    left = mesh.without_voids()
    assert len(left.facets) == 12
    assert np.abs(left.vertices_m[left.facets]).min() == pytest.approx(0.1)
    assert (
        len(replace(mesh, facets=mesh.facets[:12], facet_group=mesh.facet_group[:12]).without_voids().facets)
        == 12
    )
