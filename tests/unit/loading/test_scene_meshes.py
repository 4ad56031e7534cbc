"""Tool meshes: what is refused, where they are placed, and that the shipped ones are as declared."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from subsoil_ros.errors import SceneError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.tool_mesh import ToolMesh, load_tool_mesh

ROOT = Path(__file__).parents[3]
MESHES = ROOT / "config" / "meshes"
TINE = ROOT / "config" / "scenes" / "tine.yaml"


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_meshes", MESHES / "make_meshes.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def load(tmp_path: Path) -> Callable[..., ToolMesh]:
    """Loads a mesh as the share of the tine scene."""

    def load_mesh(mesh: trimesh.Trimesh, *overrides: str) -> ToolMesh:
        path = tmp_path / "tool.stl"
        path.write_bytes(mesh.export(file_type="stl"))
        only_share = [f"tools.tine.groups.share.mesh={path}", "tools.tine.groups.blade=null"]
        resolved = load_scene(TINE, [*only_share, *overrides])
        return load_tool_mesh(resolved.directory, resolved.scene, "tine")

    return load_mesh


def complaint(load: Callable[..., ToolMesh], mesh: trimesh.Trimesh, *overrides: str) -> str:
    with pytest.raises(SceneError) as caught:
        load(mesh, *overrides)
    text = str(caught.value)
    assert "tools.tine.groups.share.mesh" in text
    assert "tool.stl" in text
    return text


def test_shipped_meshes_are_those_of_the_script(maker: ModuleType, tmp_path: Path) -> None:
    """The script makes the shipped files again, byte for byte."""
    maker.write_meshes(tmp_path)
    names = sorted(path.name for path in MESHES.glob("*.stl"))
    assert names == ["shank.stl", "share.stl", "wheel.stl"]
    for name in names:
        assert (tmp_path / name).read_bytes() == (MESHES / name).read_bytes(), name


@pytest.mark.parametrize("name", ["shank", "share", "wheel"])
def test_shipped_meshes_are_closed_and_convex(name: str) -> None:
    """Watertight, outward, convex: what one-sided contact needs of each part."""
    mesh = trimesh.load_mesh(MESHES / f"{name}.stl")
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.is_convex
    assert mesh.volume > 0.0


def test_shipped_meshes_stand_where_declared(maker: ModuleType) -> None:
    """Tip, hinge height, widths and wheel radius are those declared, to the float32 of the file."""
    share, blade, wheel = maker.Share(), maker.Blade(), maker.Wheel()
    meshes = {name: trimesh.load_mesh(MESHES / f"{name}.stl") for name in ("share", "shank", "wheel")}
    tolerance = 2.0**-24 + maker.RESOLUTION_M  # half a unit in the last place below 1 m, and rounding
    tip = meshes["share"].vertices[np.argmax(meshes["share"].vertices[:, 0])]
    assert_allclose(tip[[0, 2]], [share.tip_x_m, share.tip_z_m], atol=tolerance)
    assert_allclose(meshes["share"].extents[1], share.width_m, atol=2 * tolerance)
    assert_allclose(meshes["shank"].bounds[1, 2], blade.top_z_m, atol=tolerance)
    assert_allclose(meshes["shank"].extents[1], blade.thickness_m, atol=2 * tolerance)
    radii = np.linalg.norm(meshes["wheel"].vertices[:, [0, 2]], axis=1)
    assert_allclose(radii[radii > 0.0], wheel.radius_m, atol=2 * tolerance)
    polygon = 0.5 * wheel.segment_count * np.sin(2.0 * np.pi / wheel.segment_count) * wheel.radius_m**2
    assert_allclose(meshes["wheel"].volume, polygon * wheel.width_m, rtol=1e-5)


def test_foot_of_the_blade_is_hidden_in_the_share() -> None:
    """Every lower corner of the blade lies inside the share: no gap, and no facet of the foot in the soil."""
    share, blade = (trimesh.load_mesh(MESHES / f"{name}.stl") for name in ("share", "shank"))
    foot = blade.vertices[blade.vertices[:, 2] < 0.0]
    assert len(foot) == 5
    distance = np.einsum("pfi,fi->pf", foot[:, None] - share.triangles_center, share.face_normals)
    assert distance.max() < -0.004  # convex: below every facet's plane, by the declared 5 mm less round-off


def test_mesh_is_placed_in_the_frame_of_its_body() -> None:
    """A wheel stands around its body's centre of mass, moved sideways; a path tool keeps its own frame."""
    resolved = load_scene(ROOT / "config" / "scenes" / "subsoiler_1s300.yaml")
    wheel = load_tool_mesh(resolved.directory, resolved.scene, "wheel_left")
    assert_allclose(wheel.vertices_m.min(axis=0), [-0.2, 0.30, -0.2], atol=1e-6)
    assert_allclose(wheel.vertices_m.max(axis=0), [0.2, 0.40, 0.2], atol=1e-6)
    shank = load_tool_mesh(resolved.directory, resolved.scene, "shank")
    tip = shank.vertices_m[np.argmin(shank.vertices_m[:, 2])]
    assert_allclose(tip[[0, 2]], [0.12 - 0.02, -0.30 - 0.15], atol=1e-6)
    assert shank.groups == ("share", "blade")
    assert_array_equal(np.bincount(shank.facet_group), [12, 16])
    tine = load_scene(TINE)
    tip = load_tool_mesh(tine.directory, tine.scene, "tine").vertices_m.min(axis=0)
    assert_allclose(tip[2], -0.30, atol=1e-6)


def test_vertices_are_merged_and_normals_point_outward(load: Callable[..., ToolMesh]) -> None:
    """A box of 36 STL corners has 8 vertices and, by the divergence theorem, its positive volume."""
    mesh = load(trimesh.creation.box((100.0, 200.0, 300.0)), "tools.tine.groups.share.scale=0.001")
    assert mesh.vertices_m.shape == (8, 3)
    assert mesh.facets.shape == (12, 3)
    corners = mesh.vertices_m[mesh.facets]
    volume = np.linalg.det(corners).sum() / 6.0
    assert_allclose(volume, 0.1 * 0.2 * 0.3, rtol=1e-6)


def test_open_mesh(load: Callable[..., ToolMesh]) -> None:
    """A box without one facet is not watertight, and its open edges are counted."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.update_faces(np.arange(12) != 4)
    text = complaint(load, box)
    assert "not watertight (3 open edges" in text


def test_mesh_inside_out(load: Callable[..., ToolMesh]) -> None:
    """Inward facets are refused with the way to mend them."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.invert()
    assert "point inward" in complaint(load, box)


def test_one_piece_inside_out(load: Callable[..., ToolMesh]) -> None:
    """One inward piece beside a larger outward one is found, though the total volume is positive."""
    large, small = trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.box((0.05, 0.05, 0.05))
    small.invert()
    small.apply_translation((0.5, 0.0, 0.0))
    assert "point inward" in complaint(load, trimesh.util.concatenate([large, small]))


def test_a_closed_hollow_points_into_itself(load: Callable[..., ToolMesh]) -> None:
    """The hollow of a welded tube is turned inward, a pin in the hollow outward again."""
    tube, hollow = trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.box((0.1, 0.1, 0.1))
    hollow.invert()
    pin = trimesh.creation.box((0.05, 0.05, 0.05))
    mesh = load(trimesh.util.concatenate([tube, hollow, pin]))
    corners = mesh.vertices_m[mesh.facets]
    assert_allclose(np.linalg.det(corners).sum() / 6.0, 0.2**3 - 0.1**3 + 0.05**3, rtol=1e-6)


def test_flat_facet(load: Callable[..., ToolMesh]) -> None:
    """A facet without area is refused by its number."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    flat = [box.faces[0][0], box.faces[0][1], len(box.vertices)]
    middle = box.vertices[box.faces[0][:2]].mean(axis=0)
    mesh = trimesh.Trimesh(np.vstack([box.vertices, middle]), np.vstack([box.faces, [flat]]), process=False)
    assert "have no area" in complaint(load, mesh)


def test_mesh_in_millimetres(load: Callable[..., ToolMesh]) -> None:
    """A tool of 60 m is a tool in millimetres, and the message says which scale mends it."""
    assert "scale: 0.001" in complaint(load, trimesh.creation.box((60.0, 30.0, 400.0)))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("tool.ply", b"ply", "allowed are .stl"),
        ("tool.stl", b"", "cannot be read|holds no facets"),
        ("tool.stl", b"\x00" * 50, "cannot be read|holds no facets"),
        ("tool.stl", b"solid x\nendsolid x\n", "cannot be read|holds no facets"),
        ("tool.stl", bytes(80) + (12).to_bytes(4, "little") + bytes(500), "cut off: 10 of its 12 facets"),
        ("tool.stl", b"solid x\n facet normal 0 0 1\n  outer loop\n", "cut off: it has no 'endsolid'"),
    ],
)
def test_file_that_is_no_mesh(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    """Another format, an empty file and rubbish are refused by name."""
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(SceneError, match=words):
        load_scene(TINE, [f"tools.tine.groups.share.mesh={path}"])


def test_hash_knows_meshes_by_their_bytes(tmp_path: Path) -> None:
    """The same mesh elsewhere keeps the scene's hash; another mesh in its place changes it."""
    path = tmp_path / "other_name.stl"
    override = f"tools.tine.groups.share.mesh={path}"
    path.write_bytes((MESHES / "share.stl").read_bytes())
    assert load_scene(TINE, [override]).scene_hash == load_scene(TINE).scene_hash
    path.write_bytes((MESHES / "wheel.stl").read_bytes())
    assert load_scene(TINE, [override]).scene_hash != load_scene(TINE).scene_hash
