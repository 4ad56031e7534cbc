"""What visualization and other tools find in a bag: poses, wrenches, frames, meshes, clouds."""

import math

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from subsoil_ros.messages import SoilCloud, ToolMotion, ToolMotions, ToolWrench, ToolWrenches
from subsoil_ros.recording.bag_reader import BagReader
from subsoil_ros.recording.bag_writer import BagWriter
from tests.unit.recording.recording_samples import (
    INTERVAL_NS,
    SCENE,
    TICKS,
    TIMING,
    end_ns,
    records_of,
)


def test_people_see_poses_wrenches_and_frames(bag):
    """Poses are in the world, wrenches in the body's frame, /tf has every body at its lateral place."""
    with AnyReader([bag]) as reader:
        last = {
            connection.topic: reader.deserialize(data, connection.msgtype)
            for connection, stamp, data in reader.messages()
            if stamp == end_ns(TICKS - 1)
        }
    records = {type(record): record for record in records_of(TICKS - 1)}
    motion, wrench = records[ToolMotions].tools[1], records[ToolWrenches].tools[1]
    stamped = last["/subsoil/tool/wheel/wrench"]
    assert stamped.header.frame_id == "hub"
    assert stamped.wrench.force.y == wrench.force_y_newton
    pose = last["/subsoil/tool/wheel/pose"]
    assert (pose.header.frame_id, pose.pose.position.x) == ("world", motion.x_m)
    assert pose.pose.orientation.y == pytest.approx(-math.sin(motion.angle_rad / 2), rel=1e-12)
    frames = last["/tf"].transforms
    assert [frame.child_frame_id for frame in frames] == ["frame", "hub"]
    assert [frame.transform.translation.y for frame in frames] == [0.0, 0.35]
    assert last["/clock"].clock.nanosec == end_ns(TICKS - 1)


def test_wrench_stamped_is_turned_into_the_body_frame(tmp_path):
    """Tip up by 0.3 rad: a push along the body's own x axis reads (5, 0, 0), a turn about its z likewise."""
    phi = 0.3
    along_x = (5.0 * math.cos(phi), 0.0, 5.0 * math.sin(phi))  # the body's axes in world axes
    along_z = (-5.0 * math.sin(phi), 0.0, 5.0 * math.cos(phi))
    writer = BagWriter(tmp_path / "bag", SCENE, TIMING)
    tick = TICKS - 1
    writer.write(ToolMotions("run", tick, end_ns(tick), (ToolMotion("shank", 1.0, 0.0, 2.0, phi, 0, 0, 0),)))
    wrench = ToolWrench("shank", *along_x, *along_z, 0.0, 1)
    writer.write(ToolWrenches("run", tick, end_ns(tick), (wrench,)))
    writer.close()
    with AnyReader([tmp_path / "bag"]) as reader:
        connections = [item for item in reader.connections if item.topic == "/subsoil/tool/shank/wrench"]
        ((connection, _, data),) = reader.messages(connections)
        read = reader.deserialize(data, connection.msgtype).wrench
    np.testing.assert_allclose([read.force.x, read.force.y, read.force.z], [5.0, 0.0, 0.0], atol=1e-14)
    np.testing.assert_allclose([read.torque.x, read.torque.y, read.torque.z], [0.0, 0.0, 5.0], atol=1e-14)


def test_cloud_has_four_float32_fields(bag):
    """The soil cloud is x, y, z, speed in float32, and comes back bit for bit."""
    with AnyReader([bag]) as reader:
        connections = [item for item in reader.connections if item.topic == "/subsoil/soil/points"]
        (connection, _, data), *others = reader.messages(connections)
        message = reader.deserialize(data, connection.msgtype)
    assert not others
    given = records_of(TICKS - 1)[-1]
    fields = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    assert fields == [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("speed", 12, 7, 1)]
    points = message.data.view("<f4").reshape(-1, 4)
    np.testing.assert_array_equal(points[:, :3], given.positions_m)
    np.testing.assert_array_equal(points[:, 3], given.speeds_m_per_s)
    (cloud,) = BagReader(bag).clouds(INTERVAL_NS)
    assert cloud.tick == TICKS - 1
    np.testing.assert_array_equal(cloud.speeds_m_per_s, given.speeds_m_per_s)


def test_a_cloud_may_be_empty(tmp_path):
    """A region without particles is a cloud of no points, for our reader and for others."""
    writer = BagWriter(tmp_path / "bag", SCENE, TIMING)
    tick = TICKS - 1
    writer.write(SoilCloud(tick, end_ns(tick), np.empty((0, 3), np.float32), np.empty(0, np.float32)))
    writer.close()
    (cloud,) = BagReader(tmp_path / "bag").clouds(INTERVAL_NS)
    assert np.asarray(cloud.positions_m).shape == (0, 3)
    with AnyReader([tmp_path / "bag"]) as reader:
        connections = [item for item in reader.connections if item.topic == "/subsoil/soil/points"]
        ((connection, _, data),) = reader.messages(connections)
        assert reader.deserialize(data, connection.msgtype).width == 0
