"""How many contacts a sphere has with a tool, and where: the same however the same surface is given."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from dev import fuzz_tools
from dev.fuzz import run
from dev.fuzz_tools import RADIUS, about, contacts, tool

DEPTH = 0.0005
BOX = (0.02, 0.12, 0.16)


def test_random_solids_have_the_same_contacts_in_any_form() -> None:
    """Whole, subdivided, cut into flush parts, overlapping another; `make fuzz` draws 20,000."""
    assert run(fuzz_tools, 200, 7)


@pytest.mark.parametrize("turned", [False, True])
def test_a_box_has_one_contact_however_it_is_meshed(turned: bool) -> None:
    """12 and 768 facets, and eight flush slices, also for spheres in its planes of symmetry."""
    box = trimesh.creation.box(BOX)
    rng = np.random.default_rng(0)
    centres = about(box, 20_000, rng)
    centres[::10, rng.integers(0, 3, len(centres[::10]))] = 1e-21
    centres = centres[(np.abs(centres) > 0.5 * np.array(BOX) + 1e-6).any(axis=1)]
    fine = box.subdivide().subdivide().subdivide()
    slices = [trimesh.creation.box((BOX[0], BOX[1] / 8, BOX[2])) for _ in range(8)]
    for k, part in enumerate(slices):
        part.apply_translation((0.0, ((k + 0.5) / 8 - 0.5) * BOX[1], 0.0))
    turn = Rotation.random(random_state=1) if turned else Rotation.identity()
    for part in (box, fine, *slices):
        part.vertices = turn.apply(part.vertices)
    coarse, *others = [contacts(tool(*parts), turn.apply(centres)) for parts in ([box], [fine], slices)]
    assert set(coarse.count) <= {0, 1}
    assert coarse.count.mean() > 0.9
    for found in others:
        assert (found.count == coarse.count).all()
        np.testing.assert_allclose(found.force, coarse.force, atol=1e-5 * RADIUS)


def test_a_vertex_on_an_edge_holds_a_particle() -> None:
    """The grid bed's particle over a vertex in the middle of a convex edge, off by a round-off."""
    fine = trimesh.creation.box(BOX)
    for _ in range(4):
        fine = fine.subdivide()
    for part in (trimesh.creation.box(BOX), fine):
        assert contacts(tool(part), np.array([[-0.0202, 1e-21, -0.08185]])).count[0] == 1


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
    assert (contacts(tool(mesh), centres).count == 1).all()


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
    found = contacts(tool(floor, wall), np.array([[-0.05 + gap, 0.0, gap]]))
    assert found.count[0] == 2
    np.testing.assert_allclose(found.force[0], [-DEPTH, 0.0, -DEPTH], atol=1e-8)


def test_a_hollow_is_no_surface() -> None:
    """Of a closed solid with a closed hollow, only the outside is left."""
    outer, inner = trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.box((0.1, 0.1, 0.1))
    inner.invert()
    mesh = tool(trimesh.util.concatenate(outer, inner))
    left = mesh.without_voids()
    assert len(left.facets) == 12
    assert np.abs(left.vertices_m[left.facets]).min() == pytest.approx(0.1)
    assert len(tool(outer).without_voids().facets) == 12
