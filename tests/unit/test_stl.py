"""STL files: read as trimesh reads them, and what makes a surface closed."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from subsoil_ros.scene.stl import Surface, read_stl

ROOT = Path(__file__).parents[2]
SHIPPED = sorted([*(ROOT / "config" / "meshes").glob("*.stl"), *(ROOT / "examples").rglob("*.stl")])
ENGINES = {"numba", "scipy", "trimesh", "pandas"}


def surface_of(mesh: trimesh.Trimesh, kind: str = "stl") -> Surface:
    content = mesh.export(file_type=kind)
    return read_stl(content.encode() if isinstance(content, str) else content)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_meshes_as_trimesh_reads_them(path: Path) -> None:
    """Binary and ASCII: the same vertices, to the bit and in the same order, the same facets and volume."""
    theirs = trimesh.load_mesh(path)
    ascii_text = theirs.export(file_type="stl_ascii").encode()
    again = trimesh.load_mesh(io.BytesIO(ascii_text), file_type="stl")
    for mesh, found in ((theirs, read_stl(path.read_bytes())), (again, read_stl(ascii_text))):
        assert_array_equal(found.vertices, mesh.vertices)
        assert_array_equal(found.facets, mesh.faces)
        assert found.is_closed == mesh.is_watertight
        assert_allclose(found.piece_volumes().sum(), mesh.volume, rtol=1e-9)


def test_pieces_that_touch_are_counted_apart() -> None:
    """Two boxes with a common corner, one inside out, are two pieces: they share no edge."""
    outward, inward = trimesh.creation.box((1.0, 1.0, 1.0)), trimesh.creation.box((0.5, 0.5, 0.5))
    inward.invert()
    inward.apply_translation((0.75, 0.75, 0.75))
    found = surface_of(trimesh.util.concatenate([outward, inward]))
    assert len(found.vertices) == 15
    assert found.is_closed
    assert found.turns_one_way
    assert_allclose(np.sort(found.piece_volumes()), [-0.125, 1.0])


def test_one_facet_turned_round() -> None:
    """A closed box with one facet turned round runs along three edges twice in one direction."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    facets = box.faces.copy()
    facets[3] = facets[3][::-1]
    found = surface_of(trimesh.Trimesh(box.vertices, facets, process=False))
    assert found.is_closed
    assert not found.turns_one_way


def test_edges_of_an_open_box() -> None:
    """A box without one facet has three open edges of eighteen."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    box.update_faces(np.arange(12) != 4)
    found = surface_of(box)
    assert (found.open_edge_count, found.edge_count, found.is_closed) == (3, 18, False)


FACET = (
    b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 %s\nendloop\nendsolid"
)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no facets"),
        (b"solid x\nendsolid x\n", "no facets"),
        (FACET % b"nan", "not finite"),
        (FACET % b"up", "cannot be read as STL"),
        (FACET.replace(b"vertex 0 1 %s\n", b""), "no whole triangles"),
    ],
)
def test_file_that_is_no_surface(content: bytes, words: str) -> None:
    """Empty files, coordinates that are no numbers and half triangles are refused."""
    with pytest.raises(ValueError, match=words):
        read_stl(content)


@pytest.mark.parametrize("node", ["coupler", "recorder"])
def test_nodes_without_an_engine_import_none(node: str) -> None:
    """Coupler and recorder read a scene with meshes without the libraries of the engines: a second each."""
    code = (
        f"import json, sys, subsoil_ros.ros.nodes.{node}_node\n"
        "from subsoil_ros.loading.loader import load_scene\n"
        "load_scene('field_swing_brittle')\n"
        "print(json.dumps(sorted({name.partition('.')[0] for name in sys.modules})))"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert ENGINES & set(json.loads(done.stdout.splitlines()[-1])) == set()
