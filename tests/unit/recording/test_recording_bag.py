"""Bags: round trips through readers of other makers, order, stamps, chunks."""

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability

from subsoil_ros.errors import InputError, ProtocolError, RecordingError
from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.messages import (
    CouplingReport,
    DriverCommand,
    FacetGroupForce,
    Grant,
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
from subsoil_ros.recording.bag_reader import BagReader
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.recording.message_codec import writer as message_writer
from subsoil_ros.recording.types import message_folder, schema_text
from tests.unit.recording.recording_samples import (
    INTERVAL_NS,
    SCENE,
    TICKS,
    TIMING,
    end_ns,
    raw_messages,
    records_of,
    write_long_bag,
)

RECORDS = [
    NodeStatus(
        "run", "soil", NodeState.FAULT, "ab" * 32, "0.1", ("Grant RIHS01_0",), (), 4_000_000_000, -1, "no",
        (ToolMotion("shank", 0.1, 0.2, 0.3, 7.1, -0.5, 0.6, 0.0),),
        (ToolWrench("shank", 1 / 3, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 4_000_000_000, ()),),
    ),
    TickAck("run", 2**40),
    DriverCommand("run", TICKS - 1, "drive", -1 / 3),
    *records_of(TICKS - 1)[:-1],
]  # fmt: skip


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_every_kind_of_record_comes_back_equal(record, tmp_path):
    """No field of any record is lost or changed on the way through a bag."""
    writer = BagWriter(tmp_path / "bag", SCENE, TIMING)
    writer.write(record)
    writer.close()
    assert list(BagReader(tmp_path / "bag").records(type(record))) == [record]


def test_reader_of_rosbags_gives_the_same_bits(bag):
    """Float64 values read by rosbags from the schemas inside the bag are those of the engines."""
    with AnyReader([bag]) as reader:
        found = {
            (connection.topic, stamp): reader.deserialize(data, connection.msgtype)
            for connection, stamp, data in reader.messages()
        }
    for tick in range(TICKS):
        records = {type(record): record for record in records_of(tick)}
        wrenches = found["/subsoil/tool_wrenches", end_ns(tick)]
        motions = found["/subsoil/tool_motions", end_ns(tick)]
        for given, read in zip(records[ToolWrenches].tools, wrenches.tools, strict=True):
            assert read.wrench.force.x == given.force_x_newton
            assert read.wrench.torque.y == given.torque_y_newton_m
            assert read.groups[0].force.z == given.groups[0].force_z_newton
        for given, read in zip(records[ToolMotions].tools, motions.tools, strict=True):
            assert (read.pose.position.z, read.twist.linear.x) == (given.z_m, given.velocity_x_m_per_s)
            assert (read.angle_rad, read.twist.angular.y) == (
                given.angle_rad,
                -given.angular_velocity_rad_per_s,
            )
    state = found["/subsoil/mechanism_state", end_ns(TICKS - 1)]
    assert state.draft_newton == records[MechanismState].draft_newton
    assert state.bodies[1].z_m == records[MechanismState].bodies[1].z_m


def test_every_lockstep_message_is_there_once_and_in_order(bag):
    """One message per tick and lockstep topic, with ascending ticks; the clock follows every tick."""
    messages = raw_messages(bag)
    for topic in ("/subsoil/grant", "/subsoil/tool_motions", "/subsoil/tool_wrenches", "/clock"):
        times = [log_time for name, log_time, *_ in messages if name == topic]
        assert times == [end_ns(tick) for tick in range(TICKS)]
    kinds = (Grant, ToolMotions, ToolWrenches)
    ticks = [record.tick for record in BagReader(bag).records(*kinds)]
    assert ticks == [tick for tick in range(TICKS) for _ in kinds]


def test_log_time_is_publish_time_and_the_file_is_in_time_order(bag):
    """Streaming readers see time go forward; sequences count per channel from 0."""
    messages = raw_messages(bag)
    times = [log_time for _, log_time, *_ in messages]
    assert times == sorted(times)
    assert all(log_time == publish_time for _, log_time, publish_time, *_ in messages)
    for topic in {name for name, *_ in messages}:
        sequence = [number for name, _, _, number, _ in messages if name == topic]
        assert sequence == list(range(len(sequence)))


def test_raw_bytes_in_any_order_make_the_same_bag(bag, tmp_path):
    """CDR bytes, the topics of a tick overtaking one another, give the messages that records give."""
    writer = BagWriter(tmp_path / "raw", SCENE, TIMING)
    names = {
        Grant: "grant", ToolMotions: "tool_motions", ToolWrenches: "tool_wrenches", SoilCloud: "soil/points",
        MechanismState: "mechanism_state", SoilState: "soil_state", CouplingReport: "coupling_report",
    }  # fmt: skip
    for tick in range(TICKS):
        records = records_of(tick)
        for place in np.random.default_rng(tick).permutation(len(records)):
            record = records[place]
            data = message_writer(type(record), INTERVAL_NS)(record)
            writer.write_raw(names[type(record)], tick, data)
    writer.close()
    assert raw_messages(tmp_path / "raw") == raw_messages(bag)


def test_a_tick_that_is_over_stays_so(tmp_path):
    """A record of an earlier tick is an error with both ticks in it; the bag stays readable."""
    writer = BagWriter(tmp_path / "bag", SCENE, TIMING)
    writer.write(Grant("run", 4))
    with pytest.raises(ProtocolError, match="tick 3 comes after tick 4"):
        writer.write(Grant("run", 3))
    writer.close()
    assert [record.tick for record in BagReader(tmp_path / "bag").records(Grant)] == [4]


def test_schemas_carry_the_texts_of_subsoil_msgs(bag):
    """Another program finds every type, and the units in our comments, inside the bag."""
    with next(bag.glob("*.mcap")).open("rb") as stream:
        found = make_reader(stream).get_summary().schemas.values()
    schemas = {schema.name: schema.data.decode() for schema in found}
    for name in ("Grant", "ToolMotions", "ToolWrenches", "MechanismState", "SoilState", "CouplingReport"):
        text = (message_folder() / f"{name}.msg").read_text()
        assert schemas[f"subsoil_msgs/msg/{name}"].startswith(text)
    wrenches = schemas["subsoil_msgs/msg/ToolWrenches"].split("=" * 80 + "\n")
    headings = {part.partition("\n")[0]: part.partition("\n")[2] for part in wrenches[1:]}
    assert headings["MSG: subsoil_msgs/ToolWrench"] == (message_folder() / "ToolWrench.msg").read_text()
    assert set(headings) == {
        "MSG: " + name
        for name in (
            "std_msgs/Header", "builtin_interfaces/Time", "subsoil_msgs/ToolWrench",
            "subsoil_msgs/FacetGroupForce", "geometry_msgs/Wrench", "geometry_msgs/Vector3",
        )
    }  # fmt: skip
    assert schema_text("tf2_msgs/msg/TFMessage").startswith("geometry_msgs/TransformStamped[] transforms\n")


def test_chunks_are_small_and_compressed_as_chunks(tmp_path):
    """zstd per chunk, 64 to 256 KiB before compression, profile ros2, no message compression."""
    writer = BagWriter(tmp_path / "bag", SCENE, Timing(INTERVAL_NS, 1500, 1, 1))
    write_long_bag(writer, 1500)
    writer.close()
    with next((tmp_path / "bag").glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        chunks = reader.get_summary().chunk_indexes
    assert len(chunks) > 3
    assert {chunk.compression for chunk in chunks} == {"zstd"}
    assert all(64 * 1024 <= chunk.uncompressed_size <= 256 * 1024 for chunk in chunks[:-1])
    metadata = yaml.safe_load((tmp_path / "bag/metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert metadata["compression_mode"] == ""


def test_metadata_offers_the_lockstep_qos_to_a_replay(bag):
    """rosbags parses metadata.yaml; topics are offered as the nodes offered them."""
    with AnyReader([bag]) as reader:
        durability = {item.topic: item.ext.offered_qos_profiles[0].durability for item in reader.connections}
        assert reader.message_count == len(raw_messages(bag))
    assert durability["/subsoil/grant"] == QosDurability.VOLATILE
    assert durability["/tf"] == QosDurability.VOLATILE


def test_closing_twice_is_closing_once(bag, tmp_path):
    """close() is idempotent."""
    writer = BagWriter(tmp_path / "twice", SCENE, TIMING)
    writer.write(Grant("run", 0))
    writer.close()
    before = next((tmp_path / "twice").glob("*.mcap")).read_bytes()
    writer.close()
    assert next((tmp_path / "twice").glob("*.mcap")).read_bytes() == before


def test_a_bag_is_never_written_over(bag):
    """An existing folder is refused with a word on what to do."""
    with pytest.raises(InputError, match="exists already"):
        BagWriter(bag, SCENE, TIMING)


def test_derived_topics_are_refused_as_bytes(tmp_path):
    """A recorder that also subscribed to what is derived would write it twice; it is told so."""
    writer = BagWriter(tmp_path / "bag", SCENE, TIMING)
    with pytest.raises(ProtocolError, match="tool/wheel/pose"):
        writer.write_raw("tool/wheel/pose", 0, b"")
    writer.close()


def test_unknown_record_is_refused(tmp_path):
    """What is no record of messages.py cannot slip into a bag."""
    writer = BagWriter(tmp_path / "bag", SCENE, TIMING)
    with pytest.raises(RecordingError, match="FacetGroupForce"):
        writer.write(FacetGroupForce("share", 0.0, 0.0, 0.0))
    writer.close()


def test_reader_names_the_cure_for_an_unfinished_bag(tmp_path):
    """A bag without its index is an error that names `subsoil bag recover`."""
    BagWriter(tmp_path / "bag", SCENE, TIMING)
    with pytest.raises(RecordingError, match="subsoil bag recover"):
        BagReader(tmp_path / "bag")
    with pytest.raises(InputError, match="no bag there"):
        BagReader(tmp_path / "nothing")
