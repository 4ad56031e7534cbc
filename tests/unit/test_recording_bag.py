"""Bags: round trips through readers of other makers, order, stamps, chunks, recovery."""

import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability

from subsoil_ros.errors import InputError, ProtocolError, RecordingError
from subsoil_ros.messages import (
    BodyState,
    Command,
    CouplingReport,
    DriverCommand,
    ForceState,
    Grant,
    GroupForce,
    JointReaction,
    MechanismState,
    NodeHello,
    NodeState,
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
from subsoil_ros.recording.conversion import to_message
from subsoil_ros.recording.recovery import recover
from subsoil_ros.recording.types import message_class, message_folder, schema_text, serialize
from subsoil_ros.scene.limits import Timing
from subsoil_ros.scene.model import Scene

INTERVAL_NS = 48_000
TICKS = 50
SERIES_TICKS = 20
TOOLS = ("shank", "wheel")

WET = {
    "stiffness_newton_per_m": 1e4,
    "tangential_stiffness_newton_per_m": 8e3,
    "damping_newton_s_per_m": 20.0,
    "tangential_damping_newton_s_per_m": 20.0,
    "adhesion_newton_per_m": 7e3,
    "static_friction": 0.5,
    "sliding_friction": 0.5,
    "rolling_friction": 0.3,
    "rest_overlap_m": 0.002,
    "reach_m": 0.002,
}
SCENE = Scene.model_validate(
    {
        "name": "bag",
        "duration_s": TICKS * INTERVAL_NS * 1e-9,
        "soil": {
            "bin": {"length_m": 1.0, "width_m": 0.2, "depth_m": 0.1},
            "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
            "bed": {"kind": "grid", "spacing_m": 0.018},
            "law": {"kind": "wet", "particle": WET, "boundary": WET},
        },
        "mechanism": {
            "bodies": {
                "frame": {"mass_kg": 1.0, "inertia_kg_m2": 1.0, "position_m": [0.0, 0.0]},
                "hub": {"mass_kg": 1.0, "inertia_kg_m2": 1.0, "position_m": [0.5, 0.0]},
            }
        },
        "tools": {
            "shank": {"body": "frame", "groups": {"share": {"mesh": "share.stl"}}},
            "wheel": {"body": "hub", "lateral_m": 0.35, "groups": {"rim": {"mesh": "rim.stl"}}},
        },
        "record": {"series_ticks": SERIES_TICKS},
    }
)
TIMING = Timing(interval_ns=INTERVAL_NS, tick_count=TICKS, soil_steps=1, mechanism_steps=1)


def end_ns(tick: int) -> int:
    return (tick + 1) * INTERVAL_NS


def is_series(tick: int) -> bool:
    return (tick + 1) % SERIES_TICKS == 0 or tick == TICKS - 1


def awkward(rng: np.random.Generator, count: int) -> list[float]:
    """Doubles over the whole range of exponents: a float32 or a decimal detour cannot keep them."""
    return [float(v) for v in rng.standard_normal(count) * 10.0 ** rng.integers(-300, 300, count)]


def records_of(tick: int) -> list:
    """Every record of a tick, with numbers that only an exact copy keeps."""
    rng = np.random.default_rng(tick + 10)
    motions = tuple(
        ToolMotion(tool, *awkward(rng, 3), float(rng.uniform(-9.0, 9.0)), *awkward(rng, 3)) for tool in TOOLS
    )
    wrenches = tuple(
        ToolWrench(tool, *awkward(rng, 7), int(rng.integers(2**32)), (GroupForce("share", *awkward(rng, 3)),))
        for tool in TOOLS
    )
    found = [
        Grant("run", tick, Command.END if tick == TICKS - 1 else Command.RUN, "last" * (tick == TICKS - 1)),
        ToolMotions("run", tick, end_ns(tick), motions),
        ToolWrenches("run", tick, end_ns(tick), wrenches),
    ]
    if is_series(tick):
        bodies = (BodyState("frame", *awkward(rng, 9)), BodyState("hub", *awkward(rng, 9)))
        joints = (JointReaction("pin", *awkward(rng, 3), False),)
        forces = (ForceState("spring", *awkward(rng, 3)),)
        found += [
            MechanismState("run", tick, end_ns(tick), *awkward(rng, 9), bodies, joints, forces),
            SoilState("run", tick, end_ns(tick), 7, 8, 0, 9, *awkward(rng, 5)),
            CouplingReport("run", tick, end_ns(tick), *awkward(rng, 6)),
        ]
    if tick == TICKS - 1:
        positions = rng.standard_normal((100, 3)).astype(np.float32)
        found.append(SoilCloud(tick, end_ns(tick), positions, rng.random(100).astype(np.float32)))
    return found


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A finished bag of TICKS ticks."""
    writer = BagWriter(tmp_path / "bag", SCENE, TIMING)
    for tick in range(TICKS):
        for record in records_of(tick):
            writer.write(record)
    writer.close()
    return tmp_path / "bag"


def raw_messages(bag: Path) -> list[tuple[str, int, int, int, bytes]]:
    """(topic, log time, publish time, sequence, data) as mcap's own reader gives them in file order."""
    with next(bag.glob("*.mcap")).open("rb") as stream:
        messages = make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        return [(c.topic, m.log_time, m.publish_time, m.sequence, m.data) for _, c, m in messages]


RECORDS = [
    NodeHello(
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
            assert (read.phi_rad, read.twist.angular.y) == (given.phi_rad, -given.phi_rate_rad_per_s)
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
        Grant: "grant", ToolMotions: "tool_motions", ToolWrenches: "tool_wrenches", SoilCloud: "soil/cloud",
        MechanismState: "mechanism_state", SoilState: "soil_state", CouplingReport: "coupling_report",
    }  # fmt: skip
    for tick in range(TICKS):
        records = records_of(tick)
        for place in np.random.default_rng(tick).permutation(len(records)):
            record = records[place]
            data = serialize(to_message(message_class, record, INTERVAL_NS))
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
    """A stranger finds every type, and the units in our comments, inside the bag."""
    schemas = BagReader(bag).schema_texts()
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
            "subsoil_msgs/GroupForce", "geometry_msgs/Wrench", "geometry_msgs/Vector3",
        )
    }  # fmt: skip
    assert schema_text("tf2_msgs/msg/TFMessage").startswith("geometry_msgs/TransformStamped[] transforms\n")


def test_chunks_are_small_and_compressed_as_chunks(tmp_path):
    """zstd per chunk, 64 to 256 KiB before compression, profile ros2, no message compression."""
    writer = BagWriter(tmp_path / "bag", SCENE, Timing(INTERVAL_NS, 1500, 1, 1))
    for tick in range(1500):
        for record in records_of(tick % TICKS)[1:3]:
            writer.write(type(record)("run", tick, end_ns(tick), record.tools))
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
    assert pose.pose.orientation.y == pytest.approx(-math.sin(motion.phi_rad / 2), rel=1e-12)
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
        connections = [item for item in reader.connections if item.topic == "/subsoil/soil/cloud"]
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
    with pytest.raises(RecordingError, match="GroupForce"):
        writer.write(GroupForce("share", 0.0, 0.0, 0.0))
    writer.close()


def test_reader_names_the_cure_for_an_unfinished_bag(tmp_path):
    """A bag without its index is an error that names `subsoil bag recover`."""
    BagWriter(tmp_path / "bag", SCENE, TIMING)
    with pytest.raises(RecordingError, match="subsoil bag recover"):
        BagReader(tmp_path / "bag")
    with pytest.raises(InputError, match="no bag there"):
        BagReader(tmp_path / "nothing")


def test_a_truncated_bag_is_mended(tmp_path):
    """Cut anywhere, the whole chunks come back in order, equal bit for bit, for readers of all makers."""
    writer = BagWriter(tmp_path / "bag", SCENE, Timing(INTERVAL_NS, 1500, 1, 1))
    for tick in range(1500):
        for record in records_of(tick % TICKS)[1:3]:
            writer.write(type(record)("run", tick, end_ns(tick), record.tools))
    writer.close()
    path = next((tmp_path / "bag").glob("*.mcap"))
    everything = raw_messages(tmp_path / "bag")
    with path.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    third = chunks[2]
    os.truncate(path, third.chunk_start_offset + third.chunk_length // 2)
    (tmp_path / "bag/metadata.yaml").unlink()

    result = recover(tmp_path / "bag")

    mended = raw_messages(tmp_path / "bag")
    assert mended == everything[: len(mended)]
    assert end_ns(100) < mended[-1][1] <= third.message_start_time
    assert (result.message_count, result.end_time_ns) == (len(mended), mended[-1][1])
    assert result.damaged_path.is_file()
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == len(mended)
    assert recover(tmp_path / "bag").damaged_path is None


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path[:0] = {paths!r}
from test_recording_bag import SCENE, TIMING, records_of, TICKS, end_ns
from subsoil_ros.recording.bag_writer import BagWriter
writer = BagWriter(Path({bag!r}), SCENE, TIMING)
for tick in range({count}):
    for record in records_of(tick % TICKS)[1:3]:
        writer.write(type(record)("run", tick, end_ns(tick), record.tools))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_writer_loses_at_most_the_last_chunk(tmp_path):
    """After SIGKILL all but the chunk that was being filled is on the disk."""
    count = 1000
    paths = [str(Path(__file__).parent), *(item for item in sys.path if item)]
    source = KILLED.format(paths=paths, bag=str(tmp_path / "bag"), count=count)
    ended = subprocess.run([sys.executable, "-c", source], timeout=120, check=False)
    assert ended.returncode == -signal.SIGKILL
    recover(tmp_path / "bag")
    ticks = [record.tick for record in BagReader(tmp_path / "bag").records(ToolWrenches)]
    assert ticks == list(range(len(ticks)))
    assert len(ticks) >= count - 128 * 1024 / 700  # bytes of a chunk over those of a tick, or less


def test_the_bag_says_what_was_thinned(bag: Path) -> None:
    """Every how many ticks clouds and series are there: in file and metadata.yaml, also when mended."""
    expected = {
        "interval_ns": str(INTERVAL_NS),
        "lockstep_messages": "every tick",
        "series": f"every {SERIES_TICKS} ticks, and the last",
        "clouds": f"thinned: every {round(0.1e9 / INTERVAL_NS)} ticks, and the last",
    }
    (path,) = bag.glob("*.mcap")
    path.write_bytes(path.read_bytes()[:-1])  # no footer any more
    recover(bag)
    with path.open("rb") as stream:
        notes = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
    assert notes["subsoil_ros"] == expected
    metadata = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert metadata["custom_data"] == expected
    with AnyReader([bag]) as reader:  # others still read it
        assert reader.message_count > 0
