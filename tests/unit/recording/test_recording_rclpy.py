"""Messages made without ROS and with rclpy are the same messages."""

import json
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.messages import (
    BodyState,
    CouplingReport,
    DriverCommand,
    FacetGroupForce,
    ForceState,
    Grant,
    JointReaction,
    MechanismState,
    NodeState,
    NodeStatus,
    SoilCloud,
    SoilState,
    TickAck,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from subsoil_ros.recording.message_codec import from_message, reader, writer
from subsoil_ros.recording.soil_clouds import cloud_from_message
from subsoil_ros.recording.types import deserialize, message_type, type_hash

pytest.importorskip("subsoil_msgs.msg", reason="rclpy and subsoil_msgs are not installed")
serialization = pytest.importorskip("rclpy.serialization")

INTERVAL_NS = 48_000
THIRD = 1.0 / 3.0
MOTION = ToolMotion("shank", THIRD, 0.2, -0.0, 7.1, -0.5, 1e-300, 2 * THIRD)
WRENCH = ToolWrench(
    "shank", 1.0, 2.0, THIRD, 4.0, -5.0, 6.0, 1e300, 2**32 - 1, (FacetGroupForce("share", THIRD, 0.0, 1.0),)
)
RECORDS = [
    Grant("run", 3),
    TickAck("run", 2),
    NodeStatus(
        "run", "soil", NodeState.READY, "ab" * 32, "0.1", ("Grant RIHS01_0",), ("tick_mean",), 12, -1, "",
        (MOTION,), (WRENCH,),
    ),
    DriverCommand("run", 40, "drive", 0.25),
    ToolMotions("run", 41, 42 * INTERVAL_NS, (MOTION, MOTION)),
    ToolWrenches("run", 41, 42 * INTERVAL_NS, (WRENCH,)),
    MechanismState(
        "run", 41, 42 * INTERVAL_NS, *(THIRD * k for k in range(10)), 2**40,
        (BodyState("frame", *(THIRD * k for k in range(9))),),
        (JointReaction("pin", 1.0, THIRD, 3.0, False),), (ForceState("spring", 1.0, THIRD, 3.0),),
    ),
    SoilState("run", 41, 42 * INTERVAL_NS, 1, 2, 3, 7, 4, 0.1, 0.2, 0.3, 0.4, THIRD),
    CouplingReport("run", 41, 42 * INTERVAL_NS, 0.1, 0.2, 0.3, 0.4, 0.5, THIRD),
]  # fmt: skip


def rclpy_class(name: str):
    """rclpy's class of a message type."""
    package, _, short = name.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), short)


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_both_families_read_each_others_bytes(record):
    """A record read by rclpy, and sent on by it, comes back bit for bit."""
    kind, name = type(record), message_type(type(record))
    message = serialization.deserialize_message(writer(kind, INTERVAL_NS)(record), rclpy_class(name))
    assert from_message(kind, message) == record
    assert reader(kind)(serialization.serialize_message(message)) == record


def test_a_cloud_passes_through_rclpy():
    """A point cloud read by rclpy, and sent on by it, holds the same particles."""
    rng = np.random.default_rng(1)
    cloud = SoilCloud(
        9, 10 * INTERVAL_NS, rng.random((50, 3)).astype(np.float32), rng.random(50).astype(np.float32)
    )
    message = serialization.deserialize_message(
        writer(SoilCloud, INTERVAL_NS)(cloud), rclpy_class(message_type(SoilCloud))
    )
    data = serialization.serialize_message(message)
    read = cloud_from_message(deserialize(data, message_type(SoilCloud)), INTERVAL_NS)
    np.testing.assert_array_equal(read.positions_m, cloud.positions_m)
    np.testing.assert_array_equal(read.speeds_m_per_s, cloud.speeds_m_per_s)
    assert read.tick == 9


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_type_hash_is_that_of_rosidl(record):
    """The hash in the bag is the one that the installed interface package declares."""
    declared = Path(sys.prefix) / "share/subsoil_msgs/msg" / f"{type(record).__name__}.json"
    if not declared.is_file():
        pytest.skip("rosidl's type descriptions are not installed in this prefix")
    name = message_type(type(record))
    hashes = {
        item["type_name"]: item["hash_string"] for item in json.loads(declared.read_text())["type_hashes"]
    }
    assert type_hash(name) == hashes[name]
