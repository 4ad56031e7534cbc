"""Standard messages for other tools, derived from the records: poses, forces, /tf, /clock."""

import math
from collections.abc import Iterable
from typing import Any

from ..messages import MechanismState, SpatialMotion, ToolMotion, ToolMotions, ToolWrench
from ..rotations import Quaternion, Vector, planar_quaternion, turned
from ..scene.model import Scene
from .conversion import header, pose, rotation, stamp, vector
from .types import message_class


def clock(time_ns: int) -> Any:
    """rosgraph_msgs/Clock."""
    return message_class("rosgraph_msgs/msg/Clock")(clock=stamp(time_ns))


def body_frame(scene: Scene, tool: str) -> str:
    """Frame of a tool: the name of its body, or its own along a prescribed path."""
    return scene.tools[tool].body or tool


def pose_stamped(motion: ToolMotion, time_ns: int) -> Any:
    """geometry_msgs/PoseStamped of a tool's body in the world frame."""
    return message_class("geometry_msgs/msg/PoseStamped")(
        header=header(time_ns),
        pose=pose(motion),
    )


def wrench_stamped(wrench: ToolWrench, motion: ToolMotion, frame: str, time_ns: int) -> Any:
    """geometry_msgs/WrenchStamped: soil on tool about the centre of mass, components in the body frame."""
    if isinstance(motion, SpatialMotion):
        x, y, z, w = motion.quaternion

        def in_body(*parts: float) -> Any:
            return vector(*turned((-x, -y, -z, w), parts))  # type: ignore[arg-type]
    else:
        cosine, sine = math.cos(motion.angle_rad), math.sin(motion.angle_rad)

        def in_body(*parts: float) -> Any:
            x, y, z = parts
            return vector(cosine * x + sine * z, y, cosine * z - sine * x)

    return message_class("geometry_msgs/msg/WrenchStamped")(
        header=header(time_ns, frame),
        wrench=message_class("geometry_msgs/msg/Wrench")(
            force=in_body(wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton),
            torque=in_body(wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m),
        ),
    )


def transforms(scene: Scene, state: MechanismState | None, motions: ToolMotions | None, time_ns: int) -> Any:
    """tf2_msgs/TFMessage: every body of the mechanism, or every tool on a path, in the world frame."""
    if state is not None:
        lateral = {tool.body: tool.lateral_m for tool in scene.tools.values()}
        places: Iterable[tuple[str, Vector, Quaternion]] = (
            (body.name, (body.x_m, lateral.get(body.name, 0.0), body.z_m), planar_quaternion(body.angle_rad))
            for body in state.bodies
        )
    else:
        places = (
            (body_frame(scene, item.tool), item.position_m, item.quaternion)
            for item in (motions.tools if motions else ())
        )
    return message_class("tf2_msgs/msg/TFMessage")(
        transforms=[
            message_class("geometry_msgs/msg/TransformStamped")(
                header=header(time_ns),
                child_frame_id=name,
                transform=message_class("geometry_msgs/msg/Transform")(
                    translation=vector(*position_m), rotation=rotation(quaternion)
                ),
            )
            for name, position_m, quaternion in places
        ]
    )
