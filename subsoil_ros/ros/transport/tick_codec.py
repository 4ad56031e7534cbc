"""Fast CDR codec for the messages of every tick.

Within a run these messages differ in their numbers alone: names, lengths and padding stay. The first
message of each shape is converted by the general serializer; its bytes without the numbers are kept, and
from then on numbers are written into them, or read, in one call. The bytes are the same.
"""

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from ...messages import (
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
from ...recording.conversion import from_message, message_type, to_message
from ...recording.types import deserialize, serialize
from ...ticks import NANOSECONDS_PER_SECOND, tick_end_ns

Ticked = Grant | TickAck | ToolMotions | ToolWrenches
Names = tuple[tuple[str, tuple[str, ...]], ...]
"""(tool, its groups) of every tool."""

TICKED = (Grant, TickAck, ToolMotions, ToolWrenches)
"""The kinds of record that the codec converts."""

_ENCAPSULATION_BYTES = 4  # before the bytes that CDR aligns
_FRAME = "world"
_ORDER: Literal["little"] = "little"
_COMMANDS = tuple(Command)
_SPATIAL = ((0, 3), (3, 7), (7, 10), (10, 13))
"""Places of position, orientation, velocity and angular velocity among the numbers of a motion."""


@dataclass(frozen=True)
class _Shape:
    """Properties common to messages of one shape."""

    numbers: struct.Struct  # all numbers in their places, zeros elsewhere
    constant: int  # all else in its place, zeros where numbers are; bytes as one integer
    mask: int  # ones where `constant` stands
    run_id: str
    names: Names

    def bytes_of(self, numbers: list[Any]) -> bytes:
        """The message with these numbers."""
        packed = int.from_bytes(self.numbers.pack(*numbers), _ORDER)
        return (packed | self.constant).to_bytes(self.numbers.size, _ORDER)

    def numbers_of(self, cdr: bytes) -> tuple[Any, ...] | None:
        """The numbers of a message; None if it is of another shape."""
        size = self.numbers.size
        if len(cdr) < size or int.from_bytes(cdr[:size], _ORDER) & self.mask != self.constant:
            return None
        return self.numbers.unpack_from(cdr)


class _Walk:
    """Walks through a message in the layout of CDR, and records the places of its numbers."""

    def __init__(self) -> None:
        self.offset = _ENCAPSULATION_BYTES
        self._codes = "<"
        self._mask = b""

    def numbers(self, codes: str, size: int) -> None:
        """Add adjacent numbers, the first of `size` bytes."""
        self._align(size)
        self._constant_up_to_here()
        self._codes += codes
        self.offset += struct.calcsize("<" + codes)
        self._mask = self._mask.ljust(self.offset, b"\0")

    def length(self) -> None:
        """Add the length of a sequence."""
        self._align(4)
        self.offset += 4

    def text(self, value: str) -> None:
        """Add a string with its closing zero."""
        self.length()
        self.offset += len(value.encode()) + 1

    def layout(self) -> tuple[struct.Struct, bytes]:
        """Return the numbers in their places, and the mask of the bytes between and after them."""
        self._constant_up_to_here()
        return struct.Struct(self._codes), self._mask

    def _constant_up_to_here(self) -> None:
        self._codes += f"{self.offset - len(self._mask)}x"
        self._mask = self._mask.ljust(self.offset, b"\xff")

    def _align(self, size: int) -> None:
        self.offset += -(self.offset - _ENCAPSULATION_BYTES) % size


def _layout(kind: type[Ticked], run_id: str, names: Names) -> tuple[struct.Struct, bytes]:
    walk = _Walk()
    walk.numbers("iI", 4)
    walk.text(_FRAME)
    walk.text(run_id)
    walk.numbers("q", 8)
    if kind is Grant:
        walk.numbers("B", 1)
        walk.text("")
    if kind in (Grant, TickAck):
        return walk.layout()
    walk.length()
    for tool, groups in names:
        walk.text(tool)
        if kind is ToolMotions:
            walk.numbers("14d", 8)
            continue
        walk.numbers("7dI", 8)
        walk.length()
        for group in groups:
            walk.text(group)
            walk.numbers("3d", 8)
    return walk.layout()


def _names_of(record: Ticked) -> Names:
    if isinstance(record, ToolMotions):
        return tuple([(tool.tool, ()) for tool in record.tools])
    if isinstance(record, ToolWrenches):
        return tuple([(tool.tool, tuple([item.group for item in tool.groups])) for tool in record.tools])
    return ()


def _numbers_of_motion(motion: ToolMotion) -> tuple[float, ...]:
    return (
        *motion.position_m,
        *motion.quaternion,
        *motion.velocity_m_per_s,
        *motion.spin_rad_per_s,
        motion.angle_rad,
    )


def _numbers_of_wrench(wrench: ToolWrench) -> tuple[float, ...]:
    return (
        wrench.force_x_newton,
        wrench.force_y_newton,
        wrench.force_z_newton,
        wrench.torque_x_newton_m,
        wrench.torque_y_newton_m,
        wrench.torque_z_newton_m,
        wrench.work_joule,
        wrench.contact_count,
    )


def _motions(names: Names, numbers: tuple[float, ...]) -> Iterator[ToolMotion]:
    place = 0
    for tool, _ in names:
        x_m, y_m, z_m, _, _, _, _, speed_x, _, speed_z, _, rate, _, angle_rad = numbers[place : place + 14]
        if math.isnan(angle_rad):
            parts = [numbers[place + first : place + last] for first, last in _SPATIAL]
            yield SpatialMotion.of(tool, *parts)  # type: ignore[arg-type]
        else:
            yield ToolMotion(tool, x_m, y_m, z_m, angle_rad, speed_x, speed_z, -rate)
        place += 14


def _wrenches(names: Names, numbers: tuple[Any, ...]) -> Iterator[ToolWrench]:
    place = 0
    for tool, groups in names:
        force_x, force_y, force_z, torque_x, torque_y, torque_z, work, count = numbers[place : place + 8]
        place += 8
        forces = []
        for group in groups:
            forces.append(FacetGroupForce(group, *numbers[place : place + 3]))
            place += 3
        yield ToolWrench(
            tool, force_x, force_y, force_z, torque_x, torque_y, torque_z, work, count, tuple(forces)
        )


class TickCodec:
    """Bytes of the records of one kind and back. Not for use from several threads at once.

    Args:
        kind: one of TICKED.
        communication_step_ns: stamps the records that carry no time of their own.
    """

    def __init__(self, kind: type[Ticked], communication_step_ns: int) -> None:
        self._kind = kind
        self._communication_step_ns = communication_step_ns
        self._type_name = message_type(kind)
        self._shape: _Shape | None = None

    def encode(self, record: Any) -> bytes:
        """CDR of the message that carries `record`."""
        if self._kind is Grant and record.reason:
            return self._general(record)
        names = _names_of(record)
        shape = self._shape
        if shape is None or shape.names != names or shape.run_id != record.run_id:
            shape = self._shape = self._shape_of(record, names)
        return shape.bytes_of(self._numbers_of(record))

    def decode(self, cdr: bytes) -> Any:
        """The record in CDR bytes of any shape; fast if the shape is that of the last message."""
        shape = self._shape
        numbers = shape.numbers_of(cdr) if shape is not None else None
        if shape is None or numbers is None:
            record = from_message(self._kind, deserialize(cdr, self._type_name))
            if self._kind is not Grant or not record.reason:
                self._shape = self._shape_of(record, _names_of(record))
            return record
        seconds, nanoseconds, tick, *_ = numbers
        if self._kind is TickAck:
            return TickAck(shape.run_id, tick)
        if self._kind is Grant:
            return Grant(shape.run_id, tick, _COMMANDS[numbers[3]])
        end_ns = seconds * NANOSECONDS_PER_SECOND + nanoseconds
        parts = _motions if self._kind is ToolMotions else _wrenches
        return self._kind(shape.run_id, tick, end_ns, tuple(parts(shape.names, numbers[3:])))  # type: ignore[arg-type, call-arg]

    def _numbers_of(self, record: Any) -> list[Any]:
        """The numbers of a record in their order."""
        kind, tick = self._kind, record.tick
        if kind is TickAck:
            return [*divmod(tick_end_ns(tick, self._communication_step_ns), NANOSECONDS_PER_SECOND), tick]
        if kind is Grant:
            stamp = divmod(tick_end_ns(tick, self._communication_step_ns), NANOSECONDS_PER_SECOND)
            return [*stamp, tick, record.command]
        numbers = [*divmod(record.end_time_ns, NANOSECONDS_PER_SECOND), tick]
        if kind is ToolMotions:
            for motion in record.tools:
                numbers += _numbers_of_motion(motion)
            return numbers
        for wrench in record.tools:
            numbers += _numbers_of_wrench(wrench)
            for item in wrench.groups:
                numbers += (item.force_x_newton, item.force_y_newton, item.force_z_newton)
        return numbers

    def _shape_of(self, record: Any, names: Names) -> _Shape:
        layout, mask_bytes = _layout(self._kind, record.run_id, names)
        mask = int.from_bytes(mask_bytes, _ORDER)
        constant = int.from_bytes(self._general(record)[: layout.size], _ORDER) & mask
        return _Shape(layout, constant, mask, record.run_id, names)

    def _general(self, record: Any) -> bytes:
        return serialize(to_message(record, self._communication_step_ns))
