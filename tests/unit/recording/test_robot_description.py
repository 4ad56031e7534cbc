"""The machine's description: where it puts meshes and rods is where the engines have them."""

import io
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from subsoil_ros.cli.main import main
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.recording.robot_description import WORLD, mesh_uri, robot_description
from subsoil_ros.recording.standard_messages import WORLD_FRAME, tool_markers, transforms
from subsoil_ros.scene.tool_mesh import load_tool_mesh

ROOT = Path(__file__).parents[3]
SCENES = ROOT / "config" / "scenes"
TURNED = ["mechanism.bodies.shank.angle_rad=0.3"]  # where the frame of the reference pose is turned


def numbers(text: str) -> np.ndarray:
    """The numbers of an attribute."""
    return np.array([float(word) for word in text.split()])


def origin(element: ElementTree.Element) -> np.ndarray:
    """The 4 x 4 matrix of an element's origin; rpy is roll about x, then pitch about y, then yaw about z."""
    found = element.find("origin")
    assert found is not None
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", numbers(found.get("rpy", ""))).as_matrix()
    matrix[:3, 3] = numbers(found.get("xyz", ""))
    return matrix


def moved(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) taken along by a matrix."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def frames(resolved: ResolvedScene) -> tuple[dict[str, np.ndarray], dict[str, tuple[float, float, float]]]:
    """/tf of the start of a run as matrices, and (x, z, phi) of the bodies."""
    state = MechanismEngine(resolved.scene, resolved.timing).state("run", -1, 0)
    found = {}
    for item in transforms(resolved.scene, state, None, 0).transforms:
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(item.quaternion).as_matrix()
        matrix[:3, 3] = item.translation_m
        found[item.child_frame_id] = matrix
    return found, {body.name: (body.x_m, body.z_m, body.angle_rad) for body in state.bodies}


def soils_vertices(resolved: ResolvedScene, tool: str) -> np.ndarray:
    """Vertices of a tool in the world at the start, as ToolMesh says that the soil places them."""
    scene = resolved.scene
    assert scene.mechanism is not None
    body = scene.tools[tool].body
    assert body is not None
    _, poses = frames(resolved)
    x, z, phi = poses[body]
    turn = phi - scene.mechanism.bodies[body].angle_rad
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec([0.0, -turn, 0.0]).as_matrix()
    matrix[:3, 3] = x, 0.0, z
    return moved(matrix, load_tool_mesh(resolved.directory, scene, tool).vertices_m)


@pytest.mark.parametrize("overrides", [[], TURNED], ids=["as shipped", "turned reference"])
def test_meshes_stand_where_the_soil_meets_them(overrides: list[str]) -> None:
    """/tf, the visual's origin and its scale put each vertex where the soil engine has it, in y too."""
    resolved = load_scene(SCENES / "subsoiler_1s300.yaml", overrides)
    robot = ElementTree.fromstring(robot_description(resolved.scene))
    placed, _ = frames(resolved)
    for tool, keys in resolved.scene.tools.items():
        link = next(item for item in robot.iter("link") if item.get("name") == keys.body)
        found = []
        for group, part in keys.groups.items():
            visual = next(item for item in link.iter("visual") if item.get("name") == group)
            shape = visual.find("geometry/mesh")
            assert shape is not None
            vertices = trimesh.load_mesh(part.mesh).vertices * numbers(shape.get("scale", ""))
            found.append(moved(placed[keys.body or ""] @ origin(visual), vertices))
        assert_allclose(np.concatenate(found), soils_vertices(resolved, tool), atol=1e-12)


@pytest.mark.parametrize("overrides", [[], TURNED], ids=["as shipped", "turned reference"])
def test_markers_stand_where_the_soil_meets_them(overrides: list[str]) -> None:
    """The same for the triangles of the markers."""
    resolved = load_scene(SCENES / "subsoiler_1s300.yaml", overrides)
    placed, _ = frames(resolved)
    markers = tool_markers(resolved).markers
    assert [marker.ns for marker in markers] == [
        "shank/share", "shank/blade", "wheel_left/tread", "wheel_right/tread"
    ]  # fmt: skip
    for tool, keys in resolved.scene.tools.items():
        own = [marker for marker in markers if marker.ns.startswith(f"{tool}/")]
        assert {marker.header.frame_id for marker in own} == {keys.body}
        points = np.array([[point.x, point.y, point.z] for marker in own for point in marker.points])
        mesh = load_tool_mesh(resolved.directory, resolved.scene, tool)
        expected = soils_vertices(resolved, tool)[mesh.facets.reshape(-1)]
        assert_allclose(moved(placed[keys.body or ""], points), expected, atol=1e-12)


def test_rods_end_at_the_joints() -> None:
    """In the reference pose a rod of the frame reaches from its centre of mass to the hinge of the shank."""
    resolved = load_scene(SCENES / "subsoiler_1s300.yaml", ["mechanism.bodies.frame.angle_rad=0.2"])
    robot = ElementTree.fromstring(robot_description(resolved.scene))
    joint = next(item for item in robot.iter("joint") if item.get("name") == "frame_floats")
    link = next(item for item in robot.iter("link") if item.get("name") == "frame")
    ends = []
    for visual in link.iter("visual"):
        rod = visual.find("geometry/cylinder")
        assert rod is not None
        half = 0.5 * float(rod.get("length", ""))
        ends.append(moved(origin(joint) @ origin(visual), np.array([[0.0, 0.0, -half], [0.0, 0.0, half]])))
    assert_allclose([end[0] for end in ends], np.tile([0.35, 0.0, 0.52], (len(ends), 1)), atol=1e-12)
    hinge, lug = [0.0, 0.0, 0.40], [0.40, 0.0, 0.65]
    for point in (hinge, lug):
        assert min(np.abs(end[1] - point).max() for end in ends) < 1e-12


def test_every_body_floats_on_world() -> None:
    """One link per body beside `world`, one floating joint each, with mass and a possible inertia."""
    scene = load_scene(SCENES / "mechanism_only.yaml").scene
    assert scene.mechanism is not None
    robot = ElementTree.fromstring(robot_description(scene))
    assert [link.get("name") for link in robot.iter("link")] == [WORLD, *scene.mechanism.bodies]
    assert {joint.get("type") for joint in robot.iter("joint")} == {"floating"}
    assert {parent.get("link") for parent in robot.iter("parent")} == {WORLD}
    for name, body in scene.mechanism.bodies.items():
        link = next(item for item in robot.iter("link") if item.get("name") == name)
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        assert mass is not None
        assert inertia is not None
        assert float(mass.get("value", "")) == body.mass_kg
        moments = [float(inertia.get(key, "")) for key in ("ixx", "iyy", "izz")]
        assert moments[1] == body.inertia_kg_m2
        assert sum(moments) >= 2.0 * max(moments)
    assert WORLD == WORLD_FRAME


def test_a_tool_on_a_path_is_described_in_its_own_frame() -> None:
    """Without a mechanism the frames are those of the tools."""
    robot = ElementTree.fromstring(robot_description(load_scene(SCENES / "tine.yaml").scene))
    assert [link.get("name") for link in robot.iter("link")] == [WORLD, "tine"]
    uris = [mesh.get("filename") for mesh in robot.iter("mesh")]
    assert uris == [f"package://subsoil_ros/config/meshes/{name}.stl" for name in ("share", "shank")]


def test_meshes_are_named_so_that_others_find_them() -> None:
    """By package for what is shipped, wherever it is installed, by file for all else."""
    assert mesh_uri(ROOT / "config/meshes/share.stl") == "package://subsoil_ros/config/meshes/share.stl"
    installed = Path("/opt/ros/jazzy/share/subsoil_ros/config/meshes/share.stl")
    assert mesh_uri(installed) == "package://subsoil_ros/config/meshes/share.stl"
    assert mesh_uri(Path("/home/me/my share.stl")) == "file:///home/me/my%20share.stl"


@pytest.mark.parametrize("name", ["subsoiler_1s300", "subsoiler_1s300_quick", "three_shanks", "tine"])
def test_another_parser_reads_it(name: str) -> None:
    """yourdfpy reads it whole: links, floating joints, meshes, masses; nothing it has to complain of."""
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed")
    resolved = load_scene(SCENES / f"{name}.yaml")
    text = robot_description(resolved.scene)
    found = yourdfpy.URDF.load(io.StringIO(text), load_meshes=False, build_scene_graph=False)
    assert found.errors == []
    assert found.robot.name == resolved.scene.name
    visuals = [visual for link in found.robot.links for visual in link.visuals]
    meshes = [visual.geometry.mesh for visual in visuals if visual.geometry.mesh is not None]
    assert len(meshes) == sum(len(tool.groups) for tool in resolved.scene.tools.values())
    assert {joint.type for joint in found.robot.joints} == {"floating"}
    masses = {link.name: link.inertial.mass for link in found.robot.links if link.inertial is not None}
    mechanism = resolved.scene.mechanism
    assert masses == ({key: body.mass_kg for key, body in mechanism.bodies.items()} if mechanism else {})


def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`subsoil urdf`: to standard output, to a file; a file that cannot be is named."""
    scene = SCENES / "tine.yaml"
    assert main(["urdf", str(scene)]) == 0
    assert capsys.readouterr().out == robot_description(load_scene(scene).scene)
    assert main(["urdf", str(scene), "--out", str(tmp_path / "tine.urdf")]) == 0
    assert (tmp_path / "tine.urdf").read_text() == robot_description(load_scene(scene).scene)
    assert main(["urdf", str(scene), "--out", str(tmp_path / "no" / "tine.urdf")]) == 2
    assert "--out" in capsys.readouterr().err
