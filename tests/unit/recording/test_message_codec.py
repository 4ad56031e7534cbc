"""Records to bytes and back, beside the serializer of rosbags, which knows only the definitions."""

import math
import random
import struct
from dataclasses import replace
from typing import Any

import pytest

from subsoil_ros.messages import (
    Command,
    FacetGroupForce,
    Grant,
    Head,
    JointReaction,
    LostParticle,
    MechanismState,
    SoilState,
    SpatialMotion,
    TickAck,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from subsoil_ros.recording.message_codec import from_message, reader, standard_bytes, writer
from subsoil_ros.recording.standard_messages import (
    PoseStamped,
    TFMessage,
    TransformStamped,
    WrenchStamped,
    clock,
)
from subsoil_ros.recording.types import deserialize, message_type, serialize, typestore
from subsoil_ros.rotations import quaternion_of

KINDS = (Grant, TickAck, ToolMotions, ToolWrenches, MechanismState, SoilState)
NAMES = [("a", "share", "wheel_left"), ("é",), ("abc", "de"), ()]
GROUPS = [("share", "blade"), (), ("x",)]


def records(kind: type, seed: int) -> list[Any]:
    """Random records of several shapes, each shape several times in a row."""
    rng = random.Random(seed)

    def number() -> float:
        return rng.choice([rng.gauss(0.0, 1e3), 0.0, -0.0, math.inf, 5e-324])

    def motion(name: str) -> ToolMotion:
        if rng.random() < 0.4:
            turn = quaternion_of((rng.gauss(0, 1), rng.gauss(0, 1), rng.gauss(0, 1)))
            vectors = [(number(), number(), number()) for _ in range(3)]
            return SpatialMotion.of(name, vectors[0], turn, *vectors[1:])
        return ToolMotion(name, number(), number(), number(), rng.gauss(0, 9), number(), number(), number())

    def wrench(name: str, groups: tuple[str, ...]) -> ToolWrench:
        forces = tuple(FacetGroupForce(group, number(), number(), number()) for group in groups)
        return ToolWrench(name, *(number() for _ in range(7)), rng.randrange(2**32), forces)

    made: list[Any] = []
    for names in NAMES:
        for groups in GROUPS:
            for _ in range(3):
                tick = rng.randrange(-1, 10**9)
                head = (rng.choice(["run", "another"]), tick, rng.randrange(2**31 * 10**9))
                if kind is Grant:
                    made.append(Grant(*head[:2], rng.choice(list(Command)), rng.choice(["", "", "bad é"])))
                elif kind is TickAck:
                    made.append(TickAck(*head[:2]))
                elif kind is ToolMotions:
                    made.append(ToolMotions(*head, tuple(map(motion, names))))
                elif kind is MechanismState:
                    joints = (JointReaction(name, number(), 0.1, 0.2, rng.random() < 0.5) for name in names)
                    numbers = (number() for _ in range(10))
                    made.append(MechanismState(*head, *numbers, rng.randrange(2**64), (), tuple(joints)))
                elif kind is SoilState:
                    lost = (LostParticle(rng.randrange(2**32), number(), 0.1, 0.2, tick) for _ in groups)
                    numbers = (number() for _ in range(5))
                    made.append(SoilState(*head, *range(5), *numbers, tuple(lost)))
                else:
                    made.append(ToolWrenches(*head, tuple(wrench(name, groups) for name in names)))
    return made


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", KINDS)
def test_rosbags_reads_and_writes_the_same_bytes(kind: type, seed: int) -> None:
    """Whatever the names and numbers, and however shapes follow one another; repr tells -0.0 from 0.0."""
    write = writer(kind, 1)
    for record in records(kind, seed):
        data = write(record)
        message = deserialize(data, message_type(kind))
        assert serialize(message) == data
        assert repr(from_message(kind, message)) == repr(record)
        time_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        assert time_ns == getattr(record, "end_time_ns", record.tick + 1)
        assert message.header.frame_id == "world"


@pytest.mark.parametrize("padding", [b"", b"\0\0\0"])
@pytest.mark.parametrize("kind", KINDS)
def test_records_come_back(kind: type, padding: bytes) -> None:
    """Also with the padding that DDS may add, to a reader of other shapes and to one that begins."""
    write, read = writer(kind, 1), reader(kind)
    for record in records(kind, seed=7):
        data = write(record) + padding
        assert repr(read(data)) == repr(reader(kind)(data)) == repr(record)


@pytest.mark.parametrize("kind", KINDS)
def test_another_order_of_bytes_is_read(kind: type) -> None:
    """A node on a big-endian machine."""
    write, read, name = writer(kind, 1), reader(kind), message_type(kind)
    for record in records(kind, seed=8):
        message = deserialize(write(record), name)
        data = bytes(typestore().serialize_cdr(message, name, little_endian=False))
        assert repr(read(data)) == repr(record)


@pytest.mark.parametrize("kind", KINDS)
def test_every_message_of_a_tick_begins_with_the_head(kind: type) -> None:
    """The recorder reads run and time of all of them alike."""
    write, read = writer(kind, 1), reader(Head)
    for record in records(kind, seed=9):
        time_ns = getattr(record, "end_time_ns", record.tick + 1)
        assert read(write(record)) == Head(record.run_id, record.tick, time_ns)


def test_a_message_cut_short_is_an_error() -> None:
    """A length beyond the end of the message is not followed."""
    data = writer(SoilState, 1)(SoilState("run", 1, 2, *range(5), *map(float, range(5))))
    with pytest.raises(struct.error, match="a length of 4294967295 in a message of"):
        reader(SoilState)(data[:-4] + b"\xff" * 4)


def test_a_value_that_is_no_member_is_an_error() -> None:
    """A command that this version does not have, first and after others."""
    write, read = writer(Grant, 1), reader(Grant)
    message = deserialize(write(Grant("run", 1)), message_type(Grant))
    message.command = 9
    for _ in range(2):
        with pytest.raises(ValueError, match="9 is not a valid Command"):
            read(serialize(message))


NOW = 3 * 10**9 + 7
TURN = (0.0, 0.6, 0.0, 0.8)
PLACE = TransformStamped(NOW, "a", (1.0, 2.0, 3.0), TURN)
STANDARD = [
    clock(NOW),
    PoseStamped(NOW, (1.0, 2.0, 3.0), TURN),
    WrenchStamped(NOW, "share", (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)),
    TFMessage((PLACE, replace(PLACE, child_frame_id="b"))),
]


def test_standard_records_are_what_rosbags_reads() -> None:
    """Their numbers in the fields of these messages, the same bytes from rosbags; then with another name."""
    found = []
    for record in (*STANDARD, *STANDARD, replace(STANDARD[2], frame="left")):  # type: ignore[type-var]
        data = standard_bytes(type(record).__name__, record)
        found.append(deserialize(data, message_type(type(record))))
        assert serialize(found[-1]) == data
    for now, pose, wrench, tf in (found[:4], found[4:8]):
        assert (now.clock.sec, now.clock.nanosec) == (3, 7)
        assert (pose.header.stamp.nanosec, pose.header.frame_id) == (7, "world")
        assert (pose.pose.position.z, pose.pose.orientation.w) == (3.0, 0.8)
        assert (wrench.header.stamp.sec, wrench.header.frame_id) == (3, "share")
        assert (wrench.wrench.force.x, wrench.wrench.torque.z) == (1.0, 6.0)
        first, second = tf.transforms
        assert (first.header.frame_id, first.child_frame_id, second.child_frame_id) == ("world", "a", "b")
        assert (first.transform.translation.y, second.transform.rotation.y) == (2.0, 0.6)
    assert found[8].header.frame_id == "left"
