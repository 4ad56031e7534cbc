"""The quick way to serialize a tick gives what the general one gives."""

import math
import random

import pytest

from subsoil_ros.messages import (
    Command,
    FacetGroupForce,
    Grant,
    SpatialMotion,
    TickAck,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from subsoil_ros.ros.transport.convert import to_bytes
from subsoil_ros.ros.transport.tick_codec import TICKED, TickCodec, Ticked
from subsoil_ros.rotations import quaternion_of

NAMES = [("a", "share", "wheel_left"), ("é",), ("abc", "de"), ()]
GROUPS = [("share", "blade"), (), ("x",)]


def records(kind: type, seed: int) -> list[Ticked]:
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

    made: list[Ticked] = []
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
                else:
                    made.append(ToolWrenches(*head, tuple(wrench(name, groups) for name in names)))
    return made


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", TICKED)
def test_bytes_are_those_of_the_general_serializer(kind: type, seed: int) -> None:
    """Whatever the names and numbers, and however shapes follow one another."""
    codec = TickCodec(kind, 1)
    for record in records(kind, seed):
        assert codec.encode(record) == to_bytes(record, 1)


@pytest.mark.parametrize("padding", [b"", b"\0\0\0"])
@pytest.mark.parametrize("kind", TICKED)
def test_records_come_back(kind: type, padding: bytes) -> None:
    """Decoding gives the record, with the padding that DDS may add; repr tells -0.0 from 0.0."""
    codec = TickCodec(kind, 1)
    for record in records(kind, seed=7):
        assert repr(codec.decode(to_bytes(record, 1) + padding)) == repr(record)
