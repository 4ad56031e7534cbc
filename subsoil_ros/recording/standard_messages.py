"""Standard messages for other tools, derived from the records: poses, forces, /tf, /clock; URDF and surfaces.

Those that are written often are records of their own, which message_codec.py converts to bytes.

URDF and surfaces are latched, published once a run. Markers contain their triangles, so the tools can be
shown from the bag alone; the URDF names mesh files.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..loading.loader import ResolvedScene
from ..messages import MechanismState, SpatialMotion, ToolMotion, ToolWrench
from ..rotations import Quaternion, Vector, planar_quaternion, turned
from ..scene.scene import Scene
from ..scene.tool_mesh import ToolMesh, load_tool_mesh
from ..ticks import NANOSECONDS_PER_SECOND
from .robot_description import in_body, robot_description
from .topics import ROBOT_DESCRIPTION, TOOL_MARKERS, pose_topic, wrench_topic
from .types import Message, message_class

WORLD_FRAME = "world"


def header(time_ns: int, frame: str = WORLD_FRAME) -> Message:
    """std_msgs/Header stamped with a simulated time [ns]."""
    return message_class("std_msgs/msg/Header")(stamp=stamp(time_ns), frame_id=frame)


def stamp(time_ns: int) -> Message:
    """builtin_interfaces/Time of a simulated time [ns]."""
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS_PER_SECOND)
    return message_class("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)


def time_ns_of(message_stamp: Message) -> int:
    """Simulated time [ns] of a builtin_interfaces/Time."""
    return message_stamp.sec * NANOSECONDS_PER_SECOND + message_stamp.nanosec


def vector(values: Sequence[float], name: str = "Vector3") -> Message:
    """geometry_msgs/Vector3, or a Point or Quaternion by its name."""
    return message_class(f"geometry_msgs/msg/{name}")(*values)


@dataclass(frozen=True, slots=True)
class PoseStamped:
    """Pose of a tool's body in the world frame."""

    end_time_ns: int
    position_m: Vector
    quaternion: Quaternion


@dataclass(frozen=True, slots=True)
class WrenchStamped:
    """Soil on tool about the centre of mass, components in the body's frame."""

    end_time_ns: int
    frame: str
    force_newton: Vector
    torque_newton_m: Vector


@dataclass(frozen=True, slots=True)
class TransformStamped:
    """Place of a body in the world frame."""

    end_time_ns: int
    child_frame_id: str
    translation_m: Vector
    quaternion: Quaternion


@dataclass(frozen=True, slots=True)
class TFMessage:
    """Places of several bodies."""

    transforms: tuple[TransformStamped, ...]


@dataclass(frozen=True, slots=True)
class Clock:
    """Simulated time."""

    stamp: tuple[int, int]  # [s], [ns]


StandardRecord = PoseStamped | WrenchStamped | TFMessage | Clock


def clock(time_ns: int) -> Clock:
    """The time as a record."""
    return Clock(divmod(time_ns, NANOSECONDS_PER_SECOND))


def body_frame(scene: Scene, tool: str) -> str:
    """Frame of a tool: the name of its body, or its own along a prescribed path."""
    return scene.tools[tool].body or tool


def tool_messages(
    scene: Scene, motions: Iterable[ToolMotion], wrenches: Iterable[ToolWrench], time_ns: int
) -> Iterator[tuple[str, StandardRecord]]:
    """Topic and record of the pose of each tool, and then of its wrench."""
    motion_of = {motion.tool: motion for motion in motions}
    for tool, motion in motion_of.items():
        yield pose_topic(tool), PoseStamped(time_ns, motion.position_m, motion.quaternion)
    for wrench in wrenches:
        if wrench.tool in motion_of:
            frame = body_frame(scene, wrench.tool)
            yield wrench_topic(wrench.tool), wrench_stamped(wrench, motion_of[wrench.tool], frame, time_ns)


def wrench_stamped(wrench: ToolWrench, motion: ToolMotion, frame: str, time_ns: int) -> WrenchStamped:
    """A wrench with components in the body's frame."""

    def in_tool(x: float, y: float, z: float) -> Vector:
        if isinstance(motion, SpatialMotion):
            turn_x, turn_y, turn_z, turn_w = motion.quaternion
            return turned((-turn_x, -turn_y, -turn_z, turn_w), (x, y, z))
        forward, up = in_body(motion.angle_rad, x, z)
        return forward, y, up

    return WrenchStamped(
        time_ns,
        frame,
        in_tool(wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton),
        in_tool(wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m),
    )


def transforms(
    scene: Scene, state: MechanismState | None, motions: Iterable[ToolMotion], time_ns: int
) -> TFMessage:
    """Every body of the mechanism, or every tool on a path, in the world frame."""
    if state is None:
        return TFMessage(
            tuple(
                TransformStamped(time_ns, body_frame(scene, item.tool), item.position_m, item.quaternion)
                for item in motions
            )
        )
    lateral = {tool.body: tool.lateral_m for tool in scene.tools.values()}
    return TFMessage(
        tuple(
            TransformStamped(
                time_ns,
                body.name,
                (body.x_m, lateral.get(body.name, 0.0), body.z_m),
                planar_quaternion(body.angle_rad),
            )
            for body in state.bodies
        )
    )


_SHARE_COLOUR, _WHEEL_COLOUR = (0.55, 0.57, 0.6, 1.0), (0.25, 0.25, 0.28, 1.0)
_TRIANGLE_LIST = 11  # visualization_msgs/Marker


def latched_messages(resolved: ResolvedScene) -> dict[str, Message]:
    """The message of each latched topic of a scene; tool markers only if it has tools.

    Raises:
        SceneError: a mesh cannot be read.
    """
    text = robot_description(resolved.scene)
    messages = {ROBOT_DESCRIPTION: message_class("std_msgs/msg/String")(data=text)}
    if resolved.scene.tools:
        messages[TOOL_MARKERS] = tool_markers(resolved)
    return messages


def tool_markers(resolved: ResolvedScene) -> Message:
    """visualization_msgs/MarkerArray: the triangles of each facet group, fixed in the frame of its body.

    Stamp 0: RViz then places them by the newest /tf.
    """
    markers = []
    for name in resolved.scene.tools:
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
        for index, group in enumerate(mesh.groups):
            markers.append(_marker(resolved, name, mesh, index, f"{name}/{group}"))
    return message_class("visualization_msgs/msg/MarkerArray")(markers=markers)


def _marker(resolved: ResolvedScene, name: str, mesh: ToolMesh, index: int, label: str) -> Message:
    tool = resolved.scene.tools[name]
    mechanism = resolved.scene.mechanism
    angle_rad = mechanism.bodies[tool.body].angle_rad if mechanism is not None and tool.body else 0.0
    corners = mesh.vertices_m[mesh.facets[mesh.facet_group == index].reshape(-1)]
    points = []
    for x, y, z in corners.tolist():
        turned_x, turned_z = in_body(angle_rad, x, z)
        points.append(vector((turned_x, y - tool.lateral_m, turned_z), "Point"))  # /tf has the lateral offset
    red, green, blue, alpha = _SHARE_COLOUR if tool.is_tillage else _WHEEL_COLOUR
    no_header, no_bytes = header(0, ""), np.empty(0, np.uint8)
    return message_class("visualization_msgs/msg/Marker")(
        header=header(0, body_frame(resolved.scene, name)),
        ns=label,
        id=index,
        type=_TRIANGLE_LIST,
        action=0,
        pose=message_class("geometry_msgs/msg/Pose")(
            position=vector((0.0, 0.0, 0.0), "Point"),
            orientation=vector((0.0, 0.0, 0.0, 1.0), "Quaternion"),
        ),
        scale=vector((1.0, 1.0, 1.0)),
        color=message_class("std_msgs/msg/ColorRGBA")(r=red, g=green, b=blue, a=alpha),
        lifetime=message_class("builtin_interfaces/msg/Duration")(sec=0, nanosec=0),
        frame_locked=True,
        points=points,
        colors=[],
        texture_resource="",
        texture=message_class("sensor_msgs/msg/CompressedImage")(header=no_header, format="", data=no_bytes),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=message_class("visualization_msgs/msg/MeshFile")(filename="", data=no_bytes),
        mesh_use_embedded_materials=False,
    )
