"""Topics of a run: their names, message types, order within a tick, and the QoS they are offered with."""

from functools import cache

from ..messages import (
    CouplingReport,
    DriverCommand,
    Grant,
    MechanismState,
    NodeStatus,
    SoilCloud,
    SoilState,
    TickAck,
    ToolMotions,
    ToolWrenches,
)
from ..scene.scene import Scene
from ..yaml_document import Document
from .types import message_type

BAG_NAMESPACE = "/subsoil"
"""Namespace of the topics in every bag, independent of that of the nodes."""

LOCKSTEP_DEPTH = 1000
"""History depth of the lockstep topics: more than any grant window."""

TOPIC_OF: dict[type, str] = {
    NodeStatus: "node_status",
    TickAck: "tick_ack",
    Grant: "grant",
    DriverCommand: "driver_command",
    ToolMotions: "tool_motions",
    ToolWrenches: "tool_wrenches",
    MechanismState: "mechanism_state",
    SoilState: "soil_state",
    CouplingReport: "coupling_report",
    SoilCloud: "soil/points",
}
"""Relative topic of each record, in the order of a tick."""


def batch_topic(kind: type) -> str:
    """Relative topic of batches of records of `kind`: grants, motions and wrenches."""
    return f"{TOPIC_OF[kind]}_batch"


RECORD_OF: dict[str, type] = {topic: kind for kind, topic in TOPIC_OF.items()}

CLOCK, TRANSFORMS = "/clock", "/tf"
ROBOT_DESCRIPTION, TOOL_MARKERS = "/robot_description", "tool_markers"

LATCHED: dict[str, str] = {
    ROBOT_DESCRIPTION: "std_msgs/msg/String",
    TOOL_MARKERS: "visualization_msgs/msg/MarkerArray",
}
"""Topics published once, before the first tick, and kept for late joiners: topic -> message type."""

HEIGHT_MAP = "soil/height_map"
"""Relative topic of the surface's height, one for each cloud (soil_clouds.py)."""


@cache
def pose_topic(tool: str) -> str:
    """Relative topic of a tool's PoseStamped."""
    return f"tool/{tool}/pose"


@cache
def wrench_topic(tool: str) -> str:
    """Relative topic of a tool's WrenchStamped."""
    return f"tool/{tool}/wrench"


def tool_topics(scene: Scene) -> dict[str, str]:
    """Relative topics of the poses and wrenches of the tools: topic -> message type."""
    topics = {}
    for tool in scene.tools:
        topics[pose_topic(tool)] = "geometry_msgs/msg/PoseStamped"
        topics[wrench_topic(tool)] = "geometry_msgs/msg/WrenchStamped"
    return topics


def derived_topics(scene: Scene) -> dict[str, str]:
    """Topics that BagWriter derives: topic -> message type. Poses and wrenches are relative, others not."""
    topics = {CLOCK: "rosgraph_msgs/msg/Clock", TRANSFORMS: "tf2_msgs/msg/TFMessage", **tool_topics(scene)}
    if scene.has_clouds and scene.record.cloud_hz > 0.0:
        topics[HEIGHT_MAP] = "sensor_msgs/msg/PointCloud2"
    return topics


def recorded_topics(scene: Scene) -> dict[str, str]:
    """Every topic that a run of the scene writes beside the latched ones: topic -> message type."""
    kinds: list[type] = [Grant, ToolMotions, CouplingReport]
    if scene.controller is not None:
        kinds.append(DriverCommand)
    if scene.mechanism is not None:
        kinds.append(MechanismState)
    if scene.soil is not None:
        kinds += [ToolWrenches, SoilState]
    if scene.has_clouds and scene.record.cloud_hz > 0.0:
        kinds.append(SoilCloud)
    return {TOPIC_OF[kind]: message_type(kind) for kind in kinds} | derived_topics(scene)


@cache
def bag_topic(topic: str) -> str:
    """Name of a topic inside a bag."""
    return topic if topic.startswith("/") else f"{BAG_NAMESPACE}/{topic}"


def qos_profile(topic: str) -> Document:
    """Offered QoS as rosbag2 metadata (version 9) writes it, so that a replay offers the same."""
    lockstep = topic in RECORD_OF and topic != TOPIC_OF[SoilCloud]
    latched = topic in LATCHED
    unlimited = {"sec": 9223372036, "nsec": 854775807}
    return {
        "history": "keep_last",
        "depth": LOCKSTEP_DEPTH if lockstep else 1 if latched else 10,
        "reliability": "reliable",
        "durability": "transient_local" if latched else "volatile",
        "deadline": dict(unlimited),
        "lifespan": dict(unlimited),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(unlimited),
        "avoid_ros_namespace_conventions": False,
    }
