"""Contents of a bag: topics with counts, rates and sizes, types, chunks, and the run that it records."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.summary import Summary

from ..messages import Command, Grant
from .bag_folder import BROKEN, NOTES
from .bag_reader import damaged, mcap_path
from .message_codec import reader
from .recovery import forget_copies
from .topics import TOPIC_OF, bag_topic

_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; the rest is data
_MESSAGE_OPCODE = 0x05
_GRANTS = bag_topic(TOPIC_OF[Grant])


@dataclass
class TopicFacts:
    """Contents of one topic of a bag; sizes before compression."""

    name: str
    message_type: str
    type_hash: str  # RIHS01; empty if the bag has none
    message_count: int = 0
    size_bytes: int = 0
    start_ns: int = 0
    end_ns: int = 0

    @property
    def rate_hz(self) -> float:
        """Messages per simulated second; 0 for less than two."""
        span_ns = self.end_ns - self.start_ns
        return (self.message_count - 1) * 1e9 / span_ns if span_ns > 0 else 0.0

    def count(self, time_ns: int, size_bytes: int) -> None:
        """Add a message."""
        if self.message_count == 0:
            self.start_ns = self.end_ns = time_ns
        self.start_ns, self.end_ns = min(self.start_ns, time_ns), max(self.end_ns, time_ns)
        self.message_count += 1
        self.size_bytes += size_bytes


@dataclass(frozen=True)
class BagFacts:
    """Contents of a bag."""

    path: Path
    file_bytes: int
    profile: str
    library: str
    compression: str
    chunk_count: int
    chunk_bytes: int  # of all chunks, before compression
    packed_bytes: int  # of all chunks, in the file
    topics: tuple[TopicFacts, ...]
    notes: dict[str, str]  # what is recorded, and what is thinned
    attachments: dict[str, int]  # sizes of the files in it, by name
    run_id: str  # empty: the bag records no run
    complete: bool  # the run came to its end

    @property
    def message_count(self) -> int:
        """Messages of all topics."""
        return sum(topic.message_count for topic in self.topics)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Simulated times of the first and the last message [ns]."""
        filled = [topic for topic in self.topics if topic.message_count]
        if not filled:
            return 0, 0
        return min(topic.start_ns for topic in filled), max(topic.end_ns for topic in filled)


def describe(path: Path, on_progress: Callable[[int], None] = lambda done_bytes: None) -> BagFacts:
    """Read through the bag at `path`: bag folder, its .mcap file, or the folder of a run.

    on_progress: called now and then with the bytes that have been read.

    Raises:
        InputError: there is no bag.
        RecordingError: it was not closed, or is damaged.
    """
    forget_copies()
    source = mcap_path(path)
    try:
        with source.open("rb") as stream:
            reader = make_reader(stream)
            summary, header = reader.get_summary(), reader.get_header()
            if summary is None or summary.statistics is None:
                raise damaged(source, "it has no index")
            notes = [dict(record.metadata) for record in reader.iter_metadata() if record.name == NOTES]
        topics = _topics(summary)
        grants: list[bytes] = []  # the first and the last
        for number, time_ns, data in _messages(source, on_progress):
            topics[number].count(time_ns, len(data))
            if topics[number].name == _GRANTS:
                grants[1:] = [bytes(data)]
    except BROKEN as error:
        raise damaged(source, error) from error
    first, last = grants[:1], grants[-1:]
    chunks = summary.chunk_indexes
    return BagFacts(
        path=source,
        file_bytes=source.stat().st_size,
        profile=header.profile,
        library=header.library,
        compression=", ".join(sorted({chunk.compression or "none" for chunk in chunks})),
        chunk_count=len(chunks),
        chunk_bytes=sum(chunk.uncompressed_size for chunk in chunks),
        packed_bytes=sum(chunk.compressed_size for chunk in chunks),
        topics=tuple(topics.values()),
        notes=notes[0] if notes else {},
        attachments={item.name: item.data_size for item in summary.attachment_indexes},
        run_id=_grant(first[0]).run_id if first else "",
        complete=bool(last) and _grant(last[0]).command is Command.END,
    )


def _topics(summary: Summary) -> dict[int, TopicFacts]:
    """Topics by the number of their channel, nothing counted."""
    return {
        number: TopicFacts(
            channel.topic,
            summary.schemas[channel.schema_id].name,
            channel.metadata.get("topic_type_hash", ""),
        )
        for number, channel in summary.channels.items()
    }


def _grant(data: bytes) -> Grant:
    grant: Grant = reader(Grant)(data)
    return grant


def _messages(source: Path, on_progress: Callable[[int], None]) -> Iterator[tuple[int, int, memoryview]]:
    """Channel, log time [ns] and data of every message, in file order; no object per record."""
    with source.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Message):
                yield record.channel_id, record.log_time, memoryview(record.data)
            elif isinstance(record, Chunk):
                chunk, length = get_chunk_data_stream(record, validate_crc=True)
                yield from _messages_of(memoryview(chunk.read(length)))
                on_progress(stream.tell())


def _messages_of(chunk: memoryview) -> Iterator[tuple[int, int, memoryview]]:
    at = 0
    while at < len(chunk):
        opcode, length = _RECORD.unpack_from(chunk, at)
        at += _RECORD.size
        if opcode == _MESSAGE_OPCODE:
            number, _, time_ns, _ = _MESSAGE.unpack_from(chunk, at)
            yield number, time_ns, chunk[at + _MESSAGE.size : at + length]
        at += length
