"""CDR of motions and wrenches at the speed of a lockstep exchange.

Within a run these messages differ in their numbers alone: names, lengths and padding stay. The first
message of each shape goes through the general serializer; its bytes then serve as a template whose
numbers are overwritten, or read. The bytes are those of the general serializer, five times as fast.
"""

import math
import struct
from dataclasses import dataclass
from typing import Any

from ..messages import GroupForce, ToolMotion, ToolMotions, ToolWrench, ToolWrenches
from ..recording.conversion import from_message, message_type, to_message
from ..recording.types import deserialize, message_class, serialize
from ..ticks import NANOSECONDS_PER_SECOND

Answer = ToolMotions | ToolWrenches

_ENCAPSULATION_BYTES = 4  # before what CDR aligns to
_FRAME = "world"


@dataclass(frozen=True)
class _Shape:
    """Where the numbers of a message stand."""

    template: bytes
    regions: tuple[tuple[int, struct.Struct], ...]  # (offset, numbers): stamp, tick, then tool by tool
    constants: tuple[tuple[int, int], ...]  # (start, end) of everything between
    run_id: str
    names: tuple[tuple[str, tuple[str, ...]], ...]  # (tool, its groups)


class _Walk:
    """Walks through a message as CDR lays it out, and notes its numbers."""

    def __init__(self) -> None:
        self.offset = _ENCAPSULATION_BYTES
        self.regions: list[tuple[int, struct.Struct]] = []

    def _align(self, size: int) -> None:
        self.offset += -(self.offset - _ENCAPSULATION_BYTES) % size

    def numbers(self, codes: str, size: int) -> None:
        """Numbers side by side, the first of `size` bytes."""
        self._align(size)
        region = struct.Struct("<" + codes)
        self.regions.append((self.offset, region))
        self.offset += region.size

    def length(self) -> None:
        """The length of a sequence."""
        self._align(4)
        self.offset += 4

    def text(self, value: str) -> None:
        """A string with its closing zero."""
        self.length()
        self.offset += len(value.encode()) + 1


def _shape_of(record: Answer, names: tuple[tuple[str, tuple[str, ...]], ...]) -> _Shape:
    walk = _Walk()
    walk.numbers("iI", 4)
    walk.text(_FRAME)
    walk.text(record.run_id)
    walk.numbers("q", 8)
    walk.length()
    for tool, groups in names:
        walk.text(tool)
        if isinstance(record, ToolMotions):
            walk.numbers("14d", 8)
            continue
        walk.numbers("7dI", 8)
        walk.length()
        for group in groups:
            walk.text(group)
            walk.numbers("3d", 8)
    starts = [0, *(offset + region.size for offset, region in walk.regions)]
    ends = [*(offset for offset, _ in walk.regions), walk.offset]
    return _Shape(
        template=serialize(to_message(message_class, record, 1)),
        regions=tuple(walk.regions),
        constants=tuple((start, end) for start, end in zip(starts, ends, strict=True) if end > start),
        run_id=record.run_id,
        names=names,
    )


def _names_of(record: Answer) -> tuple[tuple[str, tuple[str, ...]], ...]:
    if isinstance(record, ToolMotions):
        return tuple((tool.tool, ()) for tool in record.tools)
    return tuple((tool.tool, tuple(item.group for item in tool.groups)) for tool in record.tools)


def _numbers_of(record: Answer) -> list[tuple[Any, ...]]:
    """The numbers of a record, region by region."""
    regions: list[tuple[Any, ...]] = [divmod(record.end_time_ns, NANOSECONDS_PER_SECOND), (record.tick,)]
    if isinstance(record, ToolMotions):
        for motion in record.tools:
            half = 0.5 * motion.phi_rad
            place = (motion.x_m, motion.y_m, motion.z_m, 0.0, -math.sin(half), 0.0, math.cos(half))
            speed = (motion.velocity_x_m_per_s, 0.0, motion.velocity_z_m_per_s)
            regions.append((*place, *speed, 0.0, -motion.phi_rate_rad_per_s, 0.0, motion.phi_rad))
        return regions
    for wrench in record.tools:
        force = (wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton)
        torque = (wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m)
        regions.append((*force, *torque, wrench.work_joule, wrench.contact_count))
        regions += [(item.force_x_newton, item.force_y_newton, item.force_z_newton) for item in wrench.groups]
    return regions


def _motion(tool: str, numbers: tuple[Any, ...]) -> ToolMotion:
    x_m, y_m, z_m = numbers[:3]
    return ToolMotion(tool, x_m, y_m, z_m, numbers[13], numbers[7], numbers[9], -numbers[11])


def _wrench(tool: str, numbers: tuple[Any, ...], groups: tuple[GroupForce, ...]) -> ToolWrench:
    force_x, force_y, force_z, torque_x, torque_y, torque_z, work, count = numbers
    return ToolWrench(tool, force_x, force_y, force_z, torque_x, torque_y, torque_z, work, count, groups)


class TickCodec:
    """Bytes of ToolMotions or ToolWrenches and back. Not for use from several threads at once."""

    def __init__(self, kind: type[ToolMotions] | type[ToolWrenches]) -> None:
        self._kind = kind
        self._type_name = message_type(kind)
        self._shape: _Shape | None = None

    def encode(self, record: Answer) -> bytes:
        """CDR of the message that carries `record`."""
        names = _names_of(record)
        shape = self._shape
        if shape is None or shape.names != names or shape.run_id != record.run_id:
            shape = self._shape = _shape_of(record, names)
        data = bytearray(shape.template)
        for (offset, region), numbers in zip(shape.regions, _numbers_of(record), strict=True):
            region.pack_into(data, offset, *numbers)
        return bytes(data)

    def decode(self, cdr: bytes) -> Answer:
        """The record in CDR bytes; of whatever shape, but only the last one's again is quick."""
        shape = self._shape
        if shape is None or not self._fits(cdr, shape):
            record: Answer = from_message(self._kind, deserialize(cdr, self._type_name))
            self._shape = _shape_of(record, _names_of(record))
            return record
        numbers = iter([region.unpack_from(cdr, offset) for offset, region in shape.regions])
        seconds, nanoseconds = next(numbers)
        (tick,) = next(numbers)
        end_ns = seconds * NANOSECONDS_PER_SECOND + nanoseconds
        if self._kind is ToolMotions:
            motions = tuple(_motion(tool, next(numbers)) for tool, _ in shape.names)
            return ToolMotions(shape.run_id, tick, end_ns, motions)
        wrenches = []
        for tool, groups in shape.names:
            values = next(numbers)
            forces = tuple(GroupForce(group, *next(numbers)) for group in groups)
            wrenches.append(_wrench(tool, values, forces))
        return ToolWrenches(shape.run_id, tick, end_ns, tuple(wrenches))

    @staticmethod
    def _fits(cdr: bytes, shape: _Shape) -> bool:
        template = shape.template
        return len(cdr) >= len(template) and all(
            cdr[start:end] == template[start:end] for start, end in shape.constants
        )
