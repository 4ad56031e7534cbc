"""Reader of a bag: its records, one at a time."""

import struct
from collections.abc import Callable, Iterator
from heapq import heappop, heappush
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex, Statistics
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary

from ..errors import InputError, RecordingError
from ..messages import SoilCloud
from .conversion import cloud_from_message, from_message, message_type
from .topics import RECORD_OF, TOPIC_OF, bag_topic
from .types import deserialize, deserializer

BROKEN = (McapError, struct.error, zstandard.ZstdError, ValueError)
"""Errors of the readers of MCAP, its strings and its chunks where a file is cut off or overwritten."""

At = Callable[[int], bool]
"""Returns from the time of a message [ns] whether it is read."""

_RECORD = struct.Struct("<BQ")  # before every record: opcode, length of the rest
_INDEX = struct.Struct("<HI")  # of a message index: channel, length of the rest
_ENTRY = struct.Struct("<QQ")  # of a message index: time, place in the chunk
_MESSAGE = struct.Struct("<HIQQ")  # before the bytes of a message: channel, sequence, times

_KIND_OF_BAG_TOPIC = {bag_topic(topic): kind for topic, kind in RECORD_OF.items()}


def mcap_path(path: Path) -> Path:
    """The MCAP file of a bag: `path` itself, or the one in the bag folder `path` or in `path`/bag.

    Raises:
        InputError: there is none, or several.
    """
    if path.is_file():
        return path
    for folder in (path, path / "bag"):
        files = sorted(folder.glob("*.mcap")) if folder.is_dir() else []
        if len(files) == 1:
            return files[0]
        if files:
            raise InputError(f"{folder}: holds {len(files)} .mcap files; name one of them")
    raise InputError(f"{path}: no bag there; give a bag folder, an .mcap file or the folder of a run")


def damaged(path: Path, why: object) -> RecordingError:
    """Return the error for a bag that was not closed or is damaged; it names the command that recovers it."""
    return RecordingError(
        f"{path}: the bag was not closed or is damaged ({why}); mend it with `subsoil bag recover {path}`"
    )


class BagReader:
    """Reads a finished bag. Memory is bounded by a few chunks, not by the bag."""

    def __init__(self, path: Path) -> None:
        """Opens a bag folder, its .mcap file, or the folder of a run.

        Raises:
            InputError: there is no bag.
            RecordingError: the bag was not closed, or is damaged.
        """
        self.path = mcap_path(path)
        try:
            with self.path.open("rb") as stream:
                summary = make_reader(stream).get_summary()
        except BROKEN as error:
            raise damaged(self.path, error) from error
        if summary is None or summary.statistics is None:
            raise damaged(self.path, "it has no index")
        self._summary: Summary = summary
        self._statistics: Statistics = summary.statistics

    @property
    def end_time_ns(self) -> int:
        """Simulated time of the last message [ns]."""
        return self._statistics.message_end_time

    def records(self, *kinds: type, at: At | None = None) -> Iterator[Any]:
        """Records of `kinds` in order of simulated time, decoded one by one.

        `at` returns from a record's time [ns] whether to decode it; the others are skipped. Clouds are read
        by `clouds`.

        Raises:
            RecordingError: the bag is damaged.
        """
        topics = [bag_topic(TOPIC_OF[kind]) for kind in kinds]
        for topic, _, data, schema in self._raw(topics, at):
            kind = _KIND_OF_BAG_TOPIC[topic]
            yield from_message(kind, deserializer(message_type(kind), schema)(data))

    def clouds(self, communication_step_ns: int, at: At | None = None) -> Iterator[SoilCloud]:
        """Soil clouds in order of simulated time; positions (n, 3) [m], speeds (n,) [m/s], float32."""
        for _, _, data, _ in self._raw([bag_topic(TOPIC_OF[SoilCloud])], at):
            yield cloud_from_message(deserialize(data, message_type(SoilCloud)), communication_step_ns)

    def cloud_times_ns(self) -> list[int]:
        """Simulated times of the soil clouds [ns]; decodes none."""
        times: list[int] = []

        def passed(time_ns: int) -> bool:
            times.append(time_ns)
            return False

        for _ in self._raw([bag_topic(TOPIC_OF[SoilCloud])], passed):
            pass
        return sorted(times)

    def _raw(self, topics: list[str], at: At | None) -> Iterator[tuple[str, int, bytes, str]]:
        """Topic, time [ns], bytes and definition of messages, in order of time."""
        schemas = {key: schema.data.decode() for key, schema in self._summary.schemas.items()}
        chunks = self._summary.chunk_indexes
        indexed = chunks and all(chunk.message_index_offsets for chunk in chunks)
        try:
            with self.path.open("rb") as stream:
                if not indexed:  # of another writer
                    for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages(topics):
                        if at is None or at(message.log_time):
                            yield channel.topic, message.log_time, message.data, schemas[channel.schema_id]
                    return
                for number, time_ns, data in self._wanted(stream, topics, at):
                    channel = self._summary.channels[number]
                    yield channel.topic, time_ns, data, schemas[channel.schema_id]
        except BROKEN as error:
            raise damaged(self.path, error) from error

    def _wanted(self, stream: BinaryIO, topics: list[str], at: At | None) -> Iterator[tuple[int, int, bytes]]:
        """Channel, time [ns] and bytes of messages, in order of time. Only chunks that hold one are read."""
        numbers = {number for number, channel in self._summary.channels.items() if channel.topic in topics}
        waiting: list[tuple[int, int, int, int, bytes]] = []  # chunks may overlap in time
        for chunk in sorted(
            self._summary.chunk_indexes,
            key=lambda chunk: (chunk.message_start_time, chunk.chunk_start_offset),
        ):
            while waiting and waiting[0][0] < chunk.message_start_time:
                time_ns, _, _, number, data = heappop(waiting)
                yield number, time_ns, data
            places = [
                (time_ns, place, number)
                for number in numbers & set(chunk.message_index_offsets)
                for time_ns, place in _entries(stream, chunk.message_index_offsets[number])
                if at is None or at(time_ns)
            ]
            content = _content(stream, chunk) if places else b""
            for time_ns, place, number in places:
                _, length = _RECORD.unpack_from(content, place)
                start = place + _RECORD.size
                data = content[start + _MESSAGE.size : start + length]
                heappush(waiting, (time_ns, chunk.chunk_start_offset, place, number, data))
        while waiting:
            time_ns, _, _, number, data = heappop(waiting)
            yield number, time_ns, data


def _entries(stream: BinaryIO, start: int) -> Iterator[tuple[int, int]]:
    """Times [ns] and places in their chunk of the messages in the index at `start` of a file."""
    stream.seek(start)
    opcode, _ = _RECORD.unpack(stream.read(_RECORD.size))
    if opcode != Opcode.MESSAGE_INDEX:
        raise ValueError(f"no message index at byte {start}")
    _, length = _INDEX.unpack(stream.read(_INDEX.size))
    return _ENTRY.iter_unpack(stream.read(length))


def _content(stream: BinaryIO, chunk: ChunkIndex) -> bytes:
    """Records of a chunk."""
    stream.seek(chunk.chunk_start_offset + _RECORD.size)
    records, length = get_chunk_data_stream(Chunk.read(ReadDataStream(stream)), validate_crc=True)
    return bytes(records.read(length))
