"""Records of messages.py to the bytes (CDR) of their messages, and back.

All follows from the .msg file of a message and the fields of its record, which have the same names but for
those in PLACES. Functions that take a record apart, or make one, are written as text and compiled, as
dataclasses does: they are as fast as written by hand.

Within a run the messages of a kind differ in their numbers alone: texts, lengths and padding stay. They are
kept as a template, and numbers are written into it, or read from a message that fits it, in one call.
"""

import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields
from enum import IntEnum
from functools import cache, partial
from inspect import signature
from operator import attrgetter
from typing import Any, Literal, NamedTuple, get_args, get_type_hints

from rosbags.interfaces import Nodetype

from .. import messages
from ..messages import FacetGroupForce, SoilCloud, ToolMotion, ToolWrench, motion_of
from ..ticks import NANOSECONDS_PER_SECOND, tick_end_ns
from .soil_clouds import point_cloud
from .standard_messages import (
    WORLD_FRAME,
    Clock,
    PoseStamped,
    StandardRecord,
    TransformStamped,
    WrenchStamped,
)
from .types import Message, message_type, older_deserializer, schema_text, serialize, typestore

PLACES: dict[type, dict[str, str]] = {
    ToolMotion: {
        "pose.position": "position_m",
        "pose.orientation": "quaternion",
        "twist.linear": "velocity_m_per_s",
        "twist.angular": "spin_rad_per_s",
    },
    ToolWrench: {
        "wrench.force.x": "force_x_newton",
        "wrench.force.y": "force_y_newton",
        "wrench.force.z": "force_z_newton",
        "wrench.torque.x": "torque_x_newton_m",
        "wrench.torque.y": "torque_y_newton_m",
        "wrench.torque.z": "torque_z_newton_m",
    },
    FacetGroupForce: {"force.x": "force_x_newton", "force.y": "force_y_newton", "force.z": "force_z_newton"},
    PoseStamped: {"pose.position": "position_m", "pose.orientation": "quaternion"},
    WrenchStamped: {
        "header.frame_id": "frame",
        "wrench.force": "force_newton",
        "wrench.torque": "torque_newton_m",
    },
    TransformStamped: {"transform.translation": "translation_m", "transform.rotation": "quaternion"},
    Clock: {"clock": "stamp"},
}
"""Attributes of records with other names than in the message: place in it -> attribute. Several numbers are a
tuple."""

_MAKERS: dict[type, Callable[..., Any]] = {ToolMotion: motion_of}
"""Functions that make a record from these attributes, where its class alone does not."""

_STAMP, _FRAME = "header.stamp", "header.frame_id"
_CODES = {
    "bool": "?", "uint8": "B", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float64": "d",
}  # fmt: skip
_ENCAPSULATION_BYTES = 4  # before the bytes that CDR aligns
_ORDER: Literal["little"] = "little"


def writer(kind: type, communication_step_ns: int = 0) -> Callable[[Any], bytes]:
    """Return the function that converts records of `kind` to CDR bytes.

    communication_step_ns: stamps the records that carry no time of their own with the end of their tick.
    """
    if kind is SoilCloud:
        return lambda cloud: serialize(point_cloud(cloud))
    template: _Template | None = None

    def write(record: Any) -> bytes:
        nonlocal template
        fitting = template
        if fitting is None or not fitting.fits(record, fitting.constants):
            fitting = template = _Template(kind, record)
        return fitting.bytes_of(fitting.numbers_of(record, communication_step_ns))

    return write


def standard_bytes(topic: str, record: StandardRecord) -> bytes:
    """CDR bytes of a standard record; those of a topic have the same texts, so each topic has a template."""
    kind: type = type(record)
    return _standard_writer(topic, kind)(record)


@cache
def _standard_writer(topic: str, kind: type) -> Callable[[Any], bytes]:
    return writer(kind)


def reader(kind: type, schema: str | None = None) -> Callable[[bytes], Any]:
    """Return the function that converts CDR bytes to records of `kind`, of any kind but SoilCloud.

    schema: definition of the messages, a ros2msg text, if they may come from another version.
    """
    name = message_type(kind)
    if schema is not None and schema != schema_text(name):
        deserialize = older_deserializer(name, schema)
        return lambda cdr: from_message(kind, deserialize(cdr))
    template: _Template | None = None

    def read(cdr: bytes) -> Any:
        nonlocal template
        fitting = template
        numbers = fitting.numbers_in(cdr) if fitting is not None else None
        if fitting is None or numbers is None:
            fitting = template = _Template(kind, cdr=cdr)
            numbers = fitting.layout.unpack_from(cdr)
        return fitting.record_of(numbers, fitting.constants)

    return read


def from_message(kind: type, message: Message) -> Any:
    """The record of `kind` in a deserialized message of rclpy or rosbags.

    A field that its definition lacks has the default of the record, or else 0, NaN, or is empty.
    """
    values: dict[str, object] = {}
    for field in _fields(kind):
        try:
            value = attrgetter(field.path)(message)
        except AttributeError:
            values[field.attribute] = _default(kind, field.attribute)
            continue
        if field.path == _STAMP:
            value = value.sec * NANOSECONDS_PER_SECOND + value.nanosec
        elif field.leaves:
            value = attrgetter(*field.leaves)(value)
        elif field.item is not None:
            value = tuple(value if field.item is str else (from_message(field.item, one) for one in value))
        elif field.enum is not None:
            value = field.enum(value)
        values[field.attribute] = value
    make = _MAKERS.get(kind, kind)
    return make(*(values[name] for name in _parameters(make)))


class _Field(NamedTuple):
    """A value of a message: numbers, a text or a sequence."""

    path: str  # in the message
    attribute: str  # of the record
    codes: str = ""  # of the numbers, as struct names them
    leaves: tuple[str, ...] = ()  # names of the numbers, if they are several
    item: type | None = None  # kind of record in the sequence, or str
    enum: type[IntEnum] | None = None


@cache
def _fields(kind: type) -> tuple[_Field, ...]:
    """Fields of the message of a kind of record, in the order of their bytes."""
    return tuple(_fields_of(message_type(kind), "", get_type_hints(kind), PLACES.get(kind, {})))


def _fields_of(
    message_name: str, prefix: str, hints: dict[str, type], places: dict[str, str]
) -> Iterator[_Field]:
    definitions: Mapping[str, Any] = typestore().fielddefs
    for name, (node, content) in definitions[message_name][1]:
        path = prefix + name
        attribute = places.get(path, path)
        if node is Nodetype.SEQUENCE:
            yield _Field(path, attribute, item=get_args(hints[attribute])[0])
        elif node is Nodetype.NAME and path in (*places, _STAMP):
            numbers = definitions[content][1]
            codes = "".join(_CODES[base] for _, (_, (base, _)) in numbers)
            attribute = "end_time_ns" if path == _STAMP else attribute
            yield _Field(path, attribute, codes, tuple(leaf for leaf, _ in numbers))
        elif node is Nodetype.NAME:
            yield from _fields_of(content, f"{path}.", hints, places)
        elif content[0] == "string":
            yield _Field(path, attribute)
        else:
            hint = hints.get(attribute)
            enum = hint if isinstance(hint, type) and issubclass(hint, IntEnum) else None
            yield _Field(path, attribute, _CODES[content[0]], enum=enum)


@cache
def _parameters(make: Callable[..., Any]) -> tuple[str, ...]:
    return tuple(signature(make).parameters)


def _default(kind: type, attribute: str) -> Any:
    for field in fields(kind):
        if field.name == attribute and field.default is not MISSING:
            return field.default
    hint = get_type_hints(kind)[attribute]
    return math.nan if hint is float else hint()


class _Members(dict[int, IntEnum]):
    """Members of an enumeration by their value."""

    def __init__(self, kind: type[IntEnum]) -> None:
        super().__init__((int(member), member) for member in kind)
        self._kind = kind

    def __missing__(self, value: int) -> IntEnum:
        return self._kind(value)  # raises the error


_SCOPE = {"tick_end_ns": tick_end_ns, **vars(messages)}
_SCOPE.update(
    {
        kind.__name__: _Members(kind)
        for kind in IntEnum.__subclasses__()
        if kind.__module__ == messages.__name__
    }
)
"""Names in the sources of a template: n, numbers; c, constants; r, record; step, communication step [ns]."""


@cache
def _compiled(source: str) -> Callable[..., Any]:
    made: Callable[..., Any] = eval(source, _SCOPE)  # of names of fields and of indices alone
    return made


class _Template:
    """All of a message but its numbers, and functions that pass these to and from records.

    Args:
        kind: kind of the records.
        record: to begin with; or
        cdr: its message.
    """

    def __init__(self, kind: type, record: Any = None, cdr: bytes = b"\0\1") -> None:
        self._record, self._cdr = record, cdr
        self._order = "<" if cdr[1] & 1 else ">"
        self._bytes = bytearray((0, cdr[1] & 1, 0, 0))  # zeros where numbers are
        self._mask = bytearray(b"\xff" * len(self._bytes))  # zeros where numbers are, else ones
        self._codes, self._coded_bytes, self._number_count = self._order, 0, 0
        self._constants: list[str | int] = []
        self._checks: list[str] = []
        self._numbers: list[str] = []
        made = self._add_record(kind, "r")
        self._code_constants()
        self.layout = struct.Struct(self._codes)
        self._constant = int.from_bytes(self._bytes, _ORDER)
        self._constant_bits = int.from_bytes(self._mask, _ORDER)
        self.constants = tuple(self._constants)
        """Texts, and lengths of sequences."""
        self.fits = _compiled(f"lambda r, c: {' and '.join(self._checks) or True}")
        self.numbers_of = _compiled(f"lambda r, step: ({', '.join(self._numbers)},)")
        self.record_of = _compiled(f"lambda n, c: {made}")

    def bytes_of(self, numbers: tuple[object, ...]) -> bytes:
        """The message with these numbers."""
        layout = self.layout
        return (int.from_bytes(layout.pack(*numbers), _ORDER) | self._constant).to_bytes(layout.size, _ORDER)

    def numbers_in(self, cdr: bytes) -> tuple[object, ...] | None:
        """The numbers of a message; None if it does not fit."""
        size = self.layout.size
        if len(cdr) < size or int.from_bytes(cdr[:size], _ORDER) & self._constant_bits != self._constant:
            return None
        return self.layout.unpack_from(cdr)

    def _add_record(self, kind: type, name: str) -> str:
        """Add the record of source `name`; return the source that makes it."""
        made = {}
        for field in _fields(kind):
            attribute, source = field.attribute, f"{name}.{field.attribute}"
            if field.codes:
                made[attribute] = self._add_numbers(field, source, kind)
            elif field.item is None:
                made[attribute] = self._add_text(repr(WORLD_FRAME) if field.attribute == _FRAME else source)
            else:
                count = self._add_constant(f"len({source})", int)
                add = self._add_text if field.item is str else partial(self._add_record, field.item)
                items = [add(f"{source}[{i}]") for i in range(count)]
                made[attribute] = f"({''.join(f'{item}, ' for item in items)})"
        make = _MAKERS.get(kind, kind)
        return f"{make.__name__}({', '.join(made[attribute] for attribute in _parameters(make))})"

    def _add_numbers(self, field: _Field, source: str, kind: type) -> str:
        first = self._number_count
        self._number_count += len(field.codes)
        for code in field.codes:
            size = struct.calcsize(f"<{code}")
            self._align(size)
            self._code_constants()
            self._codes += code
            self._bytes += bytes(size)
            self._mask += bytes(size)
            self._coded_bytes = len(self._bytes)
        if field.path == _STAMP:
            time = source if "end_time_ns" in _parameters(kind) else "tick_end_ns(r.tick, step)"
            self._numbers.append(f"*divmod({time}, {NANOSECONDS_PER_SECOND})")
            return f"n[{first}] * {NANOSECONDS_PER_SECOND} + n[{first + 1}]"
        if field.leaves:
            self._numbers.append(f"*{source}")
            return f"n[{first}:{first + len(field.leaves)}]"
        self._numbers.append(source)
        return f"{field.enum.__name__}[n[{first}]]" if field.enum is not None else f"n[{first}]"

    def _add_text(self, source: str) -> str:
        self._add_bytes(self._add_constant(source, str).encode() + b"\0")
        return f"c[{len(self._constants) - 1}]"

    def _add_constant(self, source: str, kind: type) -> Any:
        """Add the length of a text (str) or sequence (int); return the text or the length."""
        self._align(4)
        offset = len(self._bytes)
        if self._record is not None:
            value = eval(source, _SCOPE, {"r": self._record})
        else:
            (length,) = struct.unpack_from(f"{self._order}I", self._cdr, offset)
            if length > len(self._cdr):
                raise struct.error(f"a length of {length} in a message of {len(self._cdr)} bytes")
            value = bytes(self._cdr[offset + 4 : offset + 3 + length]).decode() if kind is str else length
        self._checks.append(f"{source} == c[{len(self._constants)}]")
        self._constants.append(value)
        self._add_bytes(struct.pack(f"{self._order}I", len(value.encode()) + 1 if kind is str else value))
        return value

    def _align(self, size: int) -> None:
        self._add_bytes(bytes(-(len(self._bytes) - _ENCAPSULATION_BYTES) % size))

    def _add_bytes(self, constant: bytes) -> None:
        self._bytes += constant
        self._mask += b"\xff" * len(constant)

    def _code_constants(self) -> None:
        self._codes += f"{len(self._bytes) - self._coded_bytes}x"
