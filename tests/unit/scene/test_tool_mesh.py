"""Mass properties and poses of tools against closed forms."""

import math

import numpy as np
import trimesh
from numpy.testing import assert_allclose

from subsoil_ros.messages import ToolMotion
from subsoil_ros.scene.tool_mesh import ToolMesh, posed_vertices_m, tool_mass


def box(size, centre):
    """Vertices and outward facets of a box."""
    mesh = trimesh.creation.box(size)
    return np.asarray(mesh.vertices) + centre, np.asarray(mesh.faces)


def test_two_boxes_have_the_mass_centre_and_inertia_of_a_dumbbell():
    """Steiner: m (a^2 + c^2) / 12 of each box about its centre, and m d^2 about the common one."""
    (va, fa), (vb, fb) = box((0.2, 0.1, 0.3), (0.5, 0.02, 0.0)), box((0.1, 0.1, 0.1), (-0.5, 0.02, 0.4))
    mesh = ToolMesh(
        np.concatenate((va, vb)),
        np.concatenate((fa, fb + len(va))).astype(np.int32),
        np.repeat([0, 1], [len(fa), len(fb)]).astype(np.int32),
        ("blade", "share"),
    )
    found = tool_mass(mesh, 7850.0)
    masses = 7850.0 * np.array([0.2 * 0.1 * 0.3, 0.1**3])
    centres = np.array([(0.5, 0.02, 0.0), (-0.5, 0.02, 0.4)])
    common = masses @ centres / masses.sum()
    own = masses * np.array([(0.2**2 + 0.3**2) / 12.0, 2.0 * 0.1**2 / 12.0])
    distance2 = ((centres - common)[:, [0, 2]] ** 2).sum(axis=1)
    assert_allclose(found.mass_kg, masses.sum(), rtol=1e-12)
    assert_allclose(found.centre_m, common, rtol=1e-12)
    assert_allclose(found.inertia_kg_m2, (own + masses * distance2).sum(), rtol=1e-12)


def test_outline_is_turned_with_the_tool():
    """A quarter turn by phi takes the body's x axis up, and the turn is counted from the reference pose."""
    corner = np.array([[0.3, 0.1, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    facets = np.array([[0, 1, 2]], dtype=np.int32)
    mesh = ToolMesh(corner, facets, np.zeros(1, dtype=np.int32), ("share",))
    motion = ToolMotion("shank", 2.0, 0.35, 5.0, 0.2 + math.pi / 2, 0.0, 0.0, 0.0)
    world = posed_vertices_m(mesh, motion, 0.2)
    np.testing.assert_allclose(world, [[2.0, 0.1, 5.3], [2.0, 0.0, 5.0], [1.0, 0.0, 5.0]], atol=1e-15)
