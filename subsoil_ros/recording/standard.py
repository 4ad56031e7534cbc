"""Standard messages for other tools, derived from the records: poses, forces, /tf, /clock."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from ..messages import MechanismState, SpatialMotion, ToolMotion, ToolWrench
from ..rotations import Quaternion, Vector, planar_quaternion, turned
from ..scene.scene import Scene
from ..ticks import NANOSECONDS_PER_SECOND
from .robot_description import in_body
from .topics import pose_topic, wrench_topic
from .types import message_class

WORLD_FRAME = "world"


def header(time_ns: int, frame: str = WORLD_FRAME) -> Any:
    """std_msgs/Header stamped with a simulated time [ns]."""
    return message_class("std_msgs/msg/Header")(stamp=stamp(time_ns), frame_id=frame)


def stamp(time_ns: int) -> Any:
    """builtin_interfaces/Time of a simulated time [ns]."""
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS_PER_SECOND)
    return message_class("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)


def time_ns_of(message_stamp: Any) -> int:
    """Simulated time [ns] of a builtin_interfaces/Time."""
    return message_stamp.sec * NANOSECONDS_PER_SECOND + message_stamp.nanosec


def vector(values: Sequence[float], name: str = "Vector3") -> Any:
    """geometry_msgs/Vector3, or a Point or Quaternion by its name."""
    return message_class(f"geometry_msgs/msg/{name}")(*values)


def clock(time_ns: int) -> Any:
    """rosgraph_msgs/Clock."""
    return message_class("rosgraph_msgs/msg/Clock")(clock=stamp(time_ns))


def body_frame(scene: Scene, tool: str) -> str:
    """Frame of a tool: the name of its body, or its own along a prescribed path."""
    return scene.tools[tool].body or tool


def tool_messages(
    scene: Scene, motions: Iterable[ToolMotion], wrenches: Iterable[ToolWrench], time_ns: int
) -> Iterator[tuple[str, Any]]:
    """Topic and message of the pose of each tool, and then of its wrench."""
    motion_of = {motion.tool: motion for motion in motions}
    for tool, motion in motion_of.items():
        yield pose_topic(tool), pose_stamped(motion, time_ns)
    for wrench in wrenches:
        if wrench.tool in motion_of:
            frame = body_frame(scene, wrench.tool)
            yield wrench_topic(wrench.tool), wrench_stamped(wrench, motion_of[wrench.tool], frame, time_ns)


def pose_stamped(motion: ToolMotion, time_ns: int) -> Any:
    """geometry_msgs/PoseStamped of a tool's body in the world frame."""
    return message_class("geometry_msgs/msg/PoseStamped")(
        header=header(time_ns),
        pose=message_class("geometry_msgs/msg/Pose")(
            position=vector(motion.position_m, "Point"), orientation=vector(motion.quaternion, "Quaternion")
        ),
    )


def wrench_stamped(wrench: ToolWrench, motion: ToolMotion, frame: str, time_ns: int) -> Any:
    """geometry_msgs/WrenchStamped: soil on tool about the centre of mass, components in the body frame."""

    def in_tool(x: float, y: float, z: float) -> Any:
        if isinstance(motion, SpatialMotion):
            turn_x, turn_y, turn_z, turn_w = motion.quaternion
            return vector(turned((-turn_x, -turn_y, -turn_z, turn_w), (x, y, z)))
        forward, up = in_body(motion.angle_rad, x, z)
        return vector((forward, y, up))

    return message_class("geometry_msgs/msg/WrenchStamped")(
        header=header(time_ns, frame),
        wrench=message_class("geometry_msgs/msg/Wrench")(
            force=in_tool(wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton),
            torque=in_tool(wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m),
        ),
    )


def transforms(
    scene: Scene, state: MechanismState | None, motions: Iterable[ToolMotion], time_ns: int
) -> Any:
    """tf2_msgs/TFMessage: every body of the mechanism, or every tool on a path, in the world frame."""
    if state is not None:
        lateral = {tool.body: tool.lateral_m for tool in scene.tools.values()}
        places: Iterable[tuple[str, Vector, Quaternion]] = (
            (body.name, (body.x_m, lateral.get(body.name, 0.0), body.z_m), planar_quaternion(body.angle_rad))
            for body in state.bodies
        )
    else:
        places = ((body_frame(scene, item.tool), item.position_m, item.quaternion) for item in motions)
    return message_class("tf2_msgs/msg/TFMessage")(
        transforms=[
            message_class("geometry_msgs/msg/TransformStamped")(
                header=header(time_ns),
                child_frame_id=name,
                transform=message_class("geometry_msgs/msg/Transform")(
                    translation=vector(position_m), rotation=vector(quaternion, "Quaternion")
                ),
            )
            for name, position_m, quaternion in places
        ]
    )
