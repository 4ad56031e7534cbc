"""The machine of a scene as URDF, for tools that draw it; /tf moves it.

A URDF is a tree and cannot hold the four-bar loop of a hitch: each body floats on `world`. A body's frame is
the one of /tf: origin at its centre of mass (y: the lateral offset of its tool), turned by phi about -y.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..scene.mechanism import Body, Driver, Joint, Mechanism, SpringDamper, WheelContact
from ..scene.scene import Scene
from ..scene.tools import Tool

WORLD = "world"

ROD_RADIUS_M = 0.012
"""Radius of the rods from a body's centre of mass to its joints: thinner than the tools."""

WHEEL_WIDTH_M = 0.1
"""Width of a wheel that has no mesh, as of config/meshes/wheel.stl."""

_PACKAGE = "subsoil_ros"
_SOURCES = Path(__file__).parents[2]
_COLOURS = {"steel": "0.55 0.57 0.6 1", "rod": "0.2 0.35 0.6 1"}
_NEAR_M = 1e-3  # a rod shorter than this is left out


def robot_description(scene: Scene) -> str:
    """The URDF of a scene's bodies, or of its tools on paths, with visual meshes and inertials.

    A scene has the moment of inertia about y alone; the other two get the same value, with which the tensor
    is physically possible.
    """
    robot = ElementTree.Element("robot", name=scene.name)
    for name, rgba in _COLOURS.items():
        ElementTree.SubElement(ElementTree.SubElement(robot, "material", name=name), "color", rgba=rgba)
    ElementTree.SubElement(robot, "link", name=WORLD)
    if scene.mechanism is None:
        for name, tool in scene.tools.items():
            link = _link(robot, name, (0.0, tool.lateral_m, 0.0), 0.0)
            _add_meshes(link, tool, (0.0, 0.0), 0.0)
    else:
        carried = {tool.body: tool for tool in scene.tools.values()}
        for name, body in scene.mechanism.bodies.items():
            _add_body(robot, name, body, scene.mechanism, carried.get(name))
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def mesh_uri(path: Path) -> str:
    """URI of a mesh: package:// for meshes of this package, file:// for others."""
    parts = path.parts
    for end in range(len(parts) - 1, 1, -1):
        if parts[end - 2 : end] == ("share", _PACKAGE):
            return f"package://{_PACKAGE}/{'/'.join(parts[end:])}"
    if path.is_relative_to(_SOURCES / "config"):
        return f"package://{_PACKAGE}/{path.relative_to(_SOURCES).as_posix()}"
    return path.absolute().as_uri()


def in_body(angle_rad: float, x: float, z: float) -> tuple[float, float]:
    """(x, z) of a vector, given in world axes in the reference pose, in the axes of a body at `angle_rad`."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return cosine * x + sine * z, cosine * z - sine * x


def _add_body(
    robot: ElementTree.Element, name: str, body: Body, mechanism: Mechanism, tool: Tool | None
) -> None:
    x_m, z_m = body.position_m
    link = _link(robot, name, (x_m, tool.lateral_m if tool else 0.0, z_m), body.angle_rad)
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "mass", value=repr(body.mass_kg))
    moment = repr(body.inertia_kg_m2)
    ElementTree.SubElement(inertial, "inertia", ixx=moment, ixy="0", ixz="0", iyy=moment, iyz="0", izz=moment)
    if tool is not None:
        _add_meshes(link, tool, body.position_m, body.angle_rad)
    for force in mechanism.forces.values():
        if isinstance(force, WheelContact) and force.body == name:
            wheel = _visual(link, f"{name}_wheel", (0.0, 0.0, 0.0), (0.5 * math.pi, 0.0, 0.0), "steel")
            ElementTree.SubElement(wheel, "cylinder", radius=repr(force.radius_m), length=repr(WHEEL_WIDTH_M))
    for number, (point_x, point_z) in enumerate(_points(mechanism, name)):
        _add_rod(link, f"{name}_rod_{number}", in_body(body.angle_rad, point_x - x_m, point_z - z_m))


def _link(
    robot: ElementTree.Element, name: str, place_m: tuple[float, float, float], angle_rad: float
) -> ElementTree.Element:
    """Add a link that floats on `world`, placed in its reference pose for viewers without /tf."""
    link = ElementTree.SubElement(robot, "link", name=name)
    joint = ElementTree.SubElement(robot, "joint", name=f"{name}_floats", type="floating")
    ElementTree.SubElement(joint, "parent", link=WORLD)
    ElementTree.SubElement(joint, "child", link=name)
    _origin(joint, place_m, (0.0, -angle_rad, 0.0))  # phi turns about -y, pitch about y
    return link


def _add_meshes(
    link: ElementTree.Element, tool: Tool, centre_m: tuple[float, float], angle_rad: float
) -> None:
    """Add the meshes of a tool, turned back by phi: in the reference pose they have the world's axes."""
    for group, part in tool.groups.items():
        x, y, z = part.position_m
        x, z = in_body(angle_rad, x - centre_m[0], z - centre_m[1])
        geometry = _visual(link, group, (x, y, z), (0.0, angle_rad, 0.0), "steel")
        scale = " ".join([repr(part.scale)] * 3)
        ElementTree.SubElement(geometry, "mesh", filename=mesh_uri(Path(part.mesh)), scale=scale)


def _add_rod(link: ElementTree.Element, name: str, end: tuple[float, float]) -> None:
    """Add a rod from the origin to `end` (x, z) [m]; a cylinder's axis is z."""
    length = math.hypot(*end)
    if length < _NEAR_M:
        return
    middle = (0.5 * end[0], 0.0, 0.5 * end[1])
    geometry = _visual(link, name, middle, (0.0, math.atan2(end[0], end[1]), 0.0), "rod")
    ElementTree.SubElement(geometry, "cylinder", radius=repr(ROD_RADIUS_M), length=repr(length))


def _visual(
    link: ElementTree.Element, name: str, xyz: Sequence[float], rpy: Sequence[float], material: str
) -> ElementTree.Element:
    """Add a visual to a link; return its empty geometry."""
    visual = ElementTree.SubElement(link, "visual", name=name)
    _origin(visual, xyz, rpy)
    geometry = ElementTree.SubElement(visual, "geometry")
    ElementTree.SubElement(visual, "material", name=material)
    return geometry


def _origin(parent: ElementTree.Element, xyz: Sequence[float], rpy: Sequence[float]) -> None:
    ElementTree.SubElement(
        parent,
        "origin",
        xyz=" ".join(repr(value + 0.0) for value in xyz),  # no negative zero
        rpy=" ".join(repr(value + 0.0) for value in rpy),
    )


def _points(mechanism: Mechanism, body: str) -> list[tuple[float, float]]:
    """Points at which joints and springs act on a body, in the reference pose, each once [m]."""
    found: dict[tuple[float, float], None] = {}
    for joint in mechanism.joints.values():
        for point in _joint_points(joint, body):
            found[point] = None
    for force in mechanism.forces.values():
        if isinstance(force, SpringDamper):
            if force.body_a == body:
                found[force.point_a_m] = None
            if force.body_b == body:
                found[force.point_b_m] = None
    return list(found)


def _joint_points(joint: Joint, body: str) -> Iterator[tuple[float, float]]:
    if isinstance(joint, Driver):
        return
    if joint.body_a == body:
        yield joint.point_m
    if joint.body_b == body:
        yield getattr(joint, "point_b_m", None) or joint.point_m
