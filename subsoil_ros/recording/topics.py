"""Topics of a run: their names, message types, order within a tick, and the QoS they are offered with."""

from typing import Any

from ..messages import (
    CouplingReport,
    DriverCommand,
    Grant,
    MechanismState,
    NodeHello,
    SoilCloud,
    SoilState,
    TickAck,
    ToolMotions,
    ToolWrenches,
)
from ..scene.model import Scene

BAG_NAMESPACE = "/subsoil"
"""Topics stand below it in every bag, whatever namespace the nodes ran in."""

LOCKSTEP_DEPTH = 1000
"""History depth of the lockstep topics: more than any grant window."""

TOPIC_OF: dict[type, str] = {
    NodeHello: "node_hello",
    TickAck: "tick_ack",
    Grant: "grant",
    DriverCommand: "driver_command",
    ToolMotions: "tool_motions",
    ToolWrenches: "tool_wrenches",
    MechanismState: "mechanism_state",
    SoilState: "soil_state",
    CouplingReport: "coupling_report",
    SoilCloud: "soil/cloud",
}
"""Relative topic of each record, in the order of a tick."""

RECORD_OF: dict[str, type] = {topic: kind for kind, topic in TOPIC_OF.items()}

CLOCK, TRANSFORMS = "/clock", "/tf"

HEIGHT_MAP = "soil/height_map"
"""Relative topic of the surface's height, one for each cloud (height_map.py)."""


def pose_topic(tool: str) -> str:
    """Relative topic of a tool's PoseStamped."""
    return f"tool/{tool}/pose"


def wrench_topic(tool: str) -> str:
    """Relative topic of a tool's WrenchStamped."""
    return f"tool/{tool}/wrench"


def derived_topics(scene: Scene) -> dict[str, str]:
    """What BagWriter derives: topic -> message type; poses and wrenches are relative, the others absolute."""
    topics = {CLOCK: "rosgraph_msgs/msg/Clock", TRANSFORMS: "tf2_msgs/msg/TFMessage"}
    for tool in scene.tools:
        topics[pose_topic(tool)] = "geometry_msgs/msg/PoseStamped"
        topics[wrench_topic(tool)] = "geometry_msgs/msg/WrenchStamped"
    if scene.particle_soil is not None:
        topics[HEIGHT_MAP] = "sensor_msgs/msg/PointCloud2"
    return topics


def bag_topic(topic: str) -> str:
    """Name of a topic inside a bag."""
    return topic if topic.startswith("/") else f"{BAG_NAMESPACE}/{topic}"


def qos_profile(topic: str) -> dict[str, Any]:
    """Offered QoS as rosbag2 metadata (version 9) writes it, so that a replay offers the same."""
    lockstep = topic in RECORD_OF and topic != TOPIC_OF[SoilCloud]
    unlimited = {"sec": 9223372036, "nsec": 854775807}
    return {
        "history": "keep_last",
        "depth": LOCKSTEP_DEPTH if lockstep else 10,
        "reliability": "reliable",
        "durability": "volatile",
        "deadline": dict(unlimited),
        "lifespan": dict(unlimited),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(unlimited),
        "avoid_ros_namespace_conventions": False,
    }
