"""Conversion of records of messages.py to messages of rosbags' classes (recording/types.py), and back.

Nodes publish the bytes of these messages too, so the modes of a run cannot differ. float64 values are only
copied.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError
from ..messages import (
    BodyState,
    Command,
    CouplingReport,
    DriverCommand,
    FacetGroupForce,
    ForceState,
    Grant,
    JointReaction,
    LostParticle,
    MechanismState,
    NodeState,
    NodeStatus,
    SoilCloud,
    SoilState,
    SpatialMotion,
    TickAck,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from ..rotations import Quaternion
from ..ticks import NANOSECONDS_PER_SECOND, tick_end_ns
from .types import message_class

PACKAGE = "subsoil_msgs/msg/"
WORLD_FRAME = "world"
POINT_FIELDS = ("x", "y", "z", "speed")
_MORE = {
    "identity": "identities",
    "broken_part": "broken_parts",
    "radius": "radii_m",
    "material": "materials",
}
"""Optional fields of a point cloud, and the corresponding ones of SoilCloud."""

_WHOLE = ("identity", "material")
"""The fields that are uint32."""

_LATER = {
    "broken_bond_count": 0,
    "energy_residual_joule": math.nan,
    "part_count": 0,
}  # values of fields that messages of older bags lack
_FLOAT32, _UINT32 = 7, 6  # sensor_msgs/PointField

_PARTS: dict[type, dict[str, type]] = {
    ToolMotions: {"tools": ToolMotion},
    ToolWrenches: {"tools": ToolWrench},
    SoilState: {"lost_particles": LostParticle},
    MechanismState: {"bodies": BodyState, "joints": JointReaction, "forces": ForceState},
    NodeStatus: {"initial_motions": ToolMotion, "initial_wrenches": ToolWrench},
}
_TEXTS: dict[type, tuple[str, ...]] = {NodeStatus: ("message_hashes", "capabilities")}
"""Fields that are tuples of strings; a message has them as a list."""

_ENUMS: dict[tuple[type, str], type] = {(Grant, "command"): Command, (NodeStatus, "state"): NodeState}
_TOP_LEVEL = (
    Grant, DriverCommand, TickAck, NodeStatus, ToolMotions, ToolWrenches, SoilState, MechanismState,
    CouplingReport,
)  # fmt: skip
_RECORD_OF_NAME = {PACKAGE + kind.__name__: kind for kind in _TOP_LEVEL}


def _plain_names(kind: type) -> tuple[str, ...]:
    """Fields that a message copies unchanged."""
    apart = {
        "end_time_ns",
        *_PARTS.get(kind, {}),
        *_TEXTS.get(kind, ()),
        *(name for owner, name in _ENUMS if owner is kind),
    }
    return tuple(item.name for item in fields(kind) if item.name not in apart)


_PLAIN_PARTS = (BodyState, JointReaction, ForceState, LostParticle)
_PLAIN: dict[type, tuple[str, ...]] = {kind: _plain_names(kind) for kind in (*_TOP_LEVEL, *_PLAIN_PARTS)}
_STAMPED_BY_TICK = (Grant, DriverCommand, TickAck, NodeStatus)


def message_type(kind: type) -> str:
    """Type name of the message that carries records of `kind`, "subsoil_msgs/msg/Grant"."""
    return "sensor_msgs/msg/PointCloud2" if kind is SoilCloud else PACKAGE + kind.__name__


def end_time_of(record: Any, communication_step_ns: int) -> int:
    """Simulated time a record is stamped with [ns]: the end of its tick."""
    if type(record) in _STAMPED_BY_TICK:
        return tick_end_ns(record.tick, communication_step_ns)
    return record.end_time_ns


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


def pose(motion: ToolMotion) -> Any:
    """geometry_msgs/Pose of a tool's body."""
    return message_class("geometry_msgs/msg/Pose")(
        position=message_class("geometry_msgs/msg/Point")(x=motion.x_m, y=motion.y_m, z=motion.z_m),
        orientation=rotation(motion.quaternion),
    )


def rotation(quaternion: Quaternion) -> Any:
    """geometry_msgs/Quaternion."""
    x, y, z, w = quaternion
    return message_class("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w)


def vector(x: float, y: float, z: float) -> Any:
    """geometry_msgs/Vector3."""
    return message_class("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)


def to_message(record: Any, communication_step_ns: int) -> Any:
    """The message of a record; `communication_step_ns` stamps the records that carry no time of their own.

    A SoilCloud becomes a sensor_msgs/PointCloud2, every other record the message of its name.

    Raises:
        RecordingError: there is no message for this kind of record.
    """
    kind = type(record)
    if kind is SoilCloud:
        return point_cloud(record)
    if kind not in _TOP_LEVEL:
        raise RecordingError(f"no message carries a {kind.__name__}; give one of the records of messages.py")
    values = {name: getattr(record, name) for name in _PLAIN[kind]}
    for owner, name in _ENUMS:
        if owner is kind:
            values[name] = int(getattr(record, name))
    for name in _TEXTS.get(kind, ()):
        values[name] = list(getattr(record, name))
    for name, part in _PARTS.get(kind, {}).items():
        values[name] = [_PART_TO_MESSAGE[part](item) for item in getattr(record, name)]
    return message_class(PACKAGE + kind.__name__)(
        header=header(end_time_of(record, communication_step_ns)), **values
    )


def _motion_to_message(motion: ToolMotion) -> Any:
    return message_class("subsoil_msgs/msg/ToolMotion")(
        tool=motion.tool,
        pose=pose(motion),
        twist=message_class("geometry_msgs/msg/Twist")(
            linear=vector(*motion.velocity_m_per_s), angular=vector(*motion.spin_rad_per_s)
        ),
        angle_rad=motion.angle_rad,
    )


def _wrench_to_message(wrench: ToolWrench) -> Any:
    return message_class("subsoil_msgs/msg/ToolWrench")(
        tool=wrench.tool,
        wrench=message_class("geometry_msgs/msg/Wrench")(
            force=vector(wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton),
            torque=vector(wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m),
        ),
        work_joule=wrench.work_joule,
        contact_count=wrench.contact_count,
        groups=[
            message_class("subsoil_msgs/msg/FacetGroupForce")(
                group=group.group,
                force=vector(group.force_x_newton, group.force_y_newton, group.force_z_newton),
            )
            for group in wrench.groups
        ],
    )


def _plain_to_message(kind: type) -> Callable[[Any], Any]:
    names = _PLAIN[kind]
    type_name = PACKAGE + kind.__name__
    return lambda item: message_class(type_name)(**{name: getattr(item, name) for name in names})


_PART_TO_MESSAGE: dict[type, Callable[[Any], Any]] = {
    ToolMotion: _motion_to_message,
    ToolWrench: _wrench_to_message,
    **{kind: _plain_to_message(kind) for kind in _PLAIN_PARTS},
}


def point_cloud(cloud: SoilCloud) -> Any:
    """sensor_msgs/PointCloud2 of the particles: x, y, z [m] and speed [m/s], float32, little-endian. With a
    window also their identity, uint32; with bonds, the part of the bonds that broke; with several sizes,
    their radius [m]; with layers, their material, uint32."""
    positions = np.asarray(cloud.positions_m)
    more: dict[str, Any] = {name: getattr(cloud, key) for name, key in _MORE.items()}
    names = (*POINT_FIELDS, *(name for name, values in more.items() if values is not None))
    points = np.empty((len(positions), len(names)), dtype="<f4")
    points[:, :3] = positions
    points[:, 3] = cloud.speeds_m_per_s
    for k, name in enumerate(names[4:], 4):
        points.view("<u4" if name in _WHOLE else "<f4")[:, k] = more[name]
    return points_message(cloud.end_time_ns, points[None], names, is_dense=True)


def points_message(time_ns: int, points: NDArray[Any], names: Sequence[str], *, is_dense: bool) -> Any:
    """sensor_msgs/PointCloud2 of points (rows, columns, fields) with named fields, little-endian: float32,
    and uint32 of _WHOLE.

    is_dense: no value is NaN.
    """
    rows, columns, _ = points.shape
    return message_class("sensor_msgs/msg/PointCloud2")(
        header=header(time_ns),
        height=rows,
        width=columns,
        fields=[
            message_class("sensor_msgs/msg/PointField")(
                name=name, offset=4 * i, datatype=_UINT32 if name in _WHOLE else _FLOAT32, count=1
            )
            for i, name in enumerate(names)
        ],
        is_bigendian=False,
        point_step=4 * len(names),
        row_step=4 * len(names) * columns,
        data=points.reshape(-1).view(np.uint8),
        is_dense=is_dense,
    )


def from_message(kind: type | str, message: Any) -> Any:
    """The record of `kind` that a message of either family carries; undoes `to_message`.

    `kind` is the record's class, or its message type name ("subsoil_msgs/msg/Grant").
    """
    if isinstance(kind, str):
        kind = _RECORD_OF_NAME[kind]
    values = {name: getattr(message, name, _LATER.get(name)) for name in _PLAIN[kind]}
    if kind not in _STAMPED_BY_TICK:
        values["end_time_ns"] = time_ns_of(message.header.stamp)
    for owner, name in _ENUMS:
        if owner is kind:
            values[name] = _ENUMS[owner, name](getattr(message, name))
    for name in _TEXTS.get(kind, ()):
        values[name] = tuple(getattr(message, name))
    for name, part in _PARTS.get(kind, {}).items():
        values[name] = tuple(_PART_FROM_MESSAGE[part](item) for item in getattr(message, name, ()))
    return kind(**values)


def _motion_from_message(message: Any) -> ToolMotion:
    position, twist = message.pose.position, message.twist
    if math.isnan(message.angle_rad):
        at, v, w = message.pose.orientation, twist.linear, twist.angular
        return SpatialMotion.of(
            message.tool, (position.x, position.y, position.z), (at.x, at.y, at.z, at.w), (v.x, v.y, v.z),
            (w.x, w.y, w.z),
        )  # fmt: skip
    return ToolMotion(
        tool=message.tool,
        x_m=position.x,
        y_m=position.y,
        z_m=position.z,
        angle_rad=message.angle_rad,
        velocity_x_m_per_s=twist.linear.x,
        velocity_z_m_per_s=twist.linear.z,
        angular_velocity_rad_per_s=-twist.angular.y,
    )


def _wrench_from_message(message: Any) -> ToolWrench:
    force, torque = message.wrench.force, message.wrench.torque
    return ToolWrench(
        tool=message.tool,
        force_x_newton=force.x,
        force_y_newton=force.y,
        force_z_newton=force.z,
        torque_x_newton_m=torque.x,
        torque_y_newton_m=torque.y,
        torque_z_newton_m=torque.z,
        work_joule=message.work_joule,
        contact_count=message.contact_count,
        groups=tuple(
            FacetGroupForce(item.group, item.force.x, item.force.y, item.force.z) for item in message.groups
        ),
    )


def _plain_from_message(kind: type) -> Callable[[Any], Any]:
    names = _PLAIN[kind]
    return lambda message: kind(*(getattr(message, name) for name in names))


_PART_FROM_MESSAGE: dict[type, Callable[[Any], Any]] = {
    ToolMotion: _motion_from_message,
    ToolWrench: _wrench_from_message,
    **{kind: _plain_from_message(kind) for kind in _PLAIN_PARTS},
}


def cloud_from_message(message: Any, communication_step_ns: int) -> SoilCloud:
    """The SoilCloud of a PointCloud2 made by `point_cloud`."""
    words = message.point_step // 4
    points = np.frombuffer(memoryview(message.data), dtype="<f4").reshape(-1, words)
    places = {field.name: field.offset // 4 for field in message.fields}
    more = {
        key: points.view("<u4" if name in _WHOLE else "<f4")[:, places[name]]
        for name, key in _MORE.items()
        if name in places
    }
    time_ns = time_ns_of(message.header.stamp)
    tick = time_ns // communication_step_ns - 1
    return SoilCloud(tick, time_ns, points[:, :3], points[:, 3], **more)
