"""Reader of a bag: its records, one at a time, and the scene in it, with its meshes."""

import struct
from bisect import bisect_left
from collections.abc import Callable, Container, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, Statistics
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary

from ..errors import InputError, RecordingError, SceneError
from ..loading.loader import ResolvedScene
from ..loading.scene_bundle import SCENE_FILE, SceneBundle, unpack_to_show
from ..messages import SoilCloud
from .bag_folder import BROKEN, NOTES, mcap_file
from .message_codec import reader
from .recovery import readable
from .soil_clouds import cloud_from_message
from .topics import RECORD_OF, TOPIC_OF, bag_topic
from .types import deserialize, message_type

_RECORD = struct.Struct("<BQ")  # opcode and size of a record
_MESSAGE = struct.Struct("<H4xQ")  # channel and time of a message
_MESSAGE_HEAD = 22  # bytes of a message before its data: its time of publishing comes last

_KIND_OF_BAG_TOPIC = {bag_topic(topic): kind for topic, kind in RECORD_OF.items()}


def mcap_path(path: Path) -> Path:
    """The MCAP file of a bag: `path` itself, or the one in the bag folder `path` or in `path`/bag. Of a bag
    that is being written, a copy of what is there.

    Raises:
        InputError: there is none, or several.
    """
    return readable(mcap_file(path))


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

    def records(self, *kinds: type, at: Callable[[int], bool] | None = None) -> Iterator[Any]:
        """Records of `kinds` in order of simulated time, decoded one by one.

        `at` returns from a record's time [ns] whether to decode it; the others are skipped. Clouds are read
        by `clouds`.

        Raises:
            RecordingError: the bag is damaged.
        """
        readers: dict[tuple[str, str], Callable[[bytes], Any]] = {}
        for topic, time_ns, data, schema in self._raw([bag_topic(TOPIC_OF[kind]) for kind in kinds]):
            if at is None or at(time_ns):
                if (topic, schema) not in readers:
                    readers[topic, schema] = reader(_KIND_OF_BAG_TOPIC[topic], schema)
                yield readers[topic, schema](data)

    def clouds(
        self, communication_step_ns: int, at: Callable[[int], bool] | None = None
    ) -> Iterator[SoilCloud]:
        """Soil clouds in order of simulated time; positions (n, 3) [m], speeds (n,) [m/s], float32."""
        for _, time_ns, data, _ in self._raw([bag_topic(TOPIC_OF[SoilCloud])]):
            if at is None or at(time_ns):
                yield cloud_from_message(deserialize(data, message_type(SoilCloud)), communication_step_ns)

    def cloud_times_ns(self) -> list[int]:
        """Simulated times of the soil clouds [ns]; decodes none."""
        return [time_ns for _, time_ns, _, _ in self._raw([bag_topic(TOPIC_OF[SoilCloud])])]

    def _raw(self, topics: list[str]) -> Iterator[tuple[str, int, bytes, str]]:
        """Topic, time [ns], bytes and definition of every message, in order of time, then of the file.

        The reader of MCAP makes objects of all messages of a chunk, which takes five times as long.
        """
        schemas = {key: schema.data.decode() for key, schema in self._summary.schemas.items()}
        wanted = {
            key: (channel.topic, schemas[channel.schema_id])
            for key, channel in self._summary.channels.items()
            if channel.topic in topics
        }
        chunks = [
            index
            for index in self._summary.chunk_indexes
            if not index.message_index_offsets or wanted.keys() & index.message_index_offsets.keys()
        ]
        chunks.sort(key=lambda index: (index.message_start_time, index.chunk_start_offset))
        read: list[tuple[int, int, int, int, bytes]] = []  # time, chunk, place in it, channel, bytes
        try:
            with self.path.open("rb") as stream:
                if not self._summary.chunk_indexes:
                    for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages(topics):
                        yield channel.topic, message.log_time, message.data, schemas[channel.schema_id]
                for place, index in enumerate(chunks):
                    read += _messages(stream, index.chunk_start_offset, wanted)
                    read.sort()
                    following = chunks[place + 1 :][:1]
                    due = bisect_left(read, (following[0].message_start_time,)) if following else len(read)
                    for time_ns, _, _, key, data in read[:due]:
                        yield wanted[key][0], time_ns, data, wanted[key][1]
                    del read[:due]
        except BROKEN as error:
            raise damaged(self.path, error) from error


def _messages(
    stream: BinaryIO, offset: int, wanted: Container[int]
) -> Iterator[tuple[int, int, int, int, bytes]]:
    """Time [ns], chunk, place in it, channel and bytes of messages of a chunk in the channels `wanted`."""
    stream.seek(offset + _RECORD.size)
    chunk, length = get_chunk_data_stream(Chunk.read(ReadDataStream(stream)), validate_crc=True)
    data = chunk.read(length)
    place = 0
    while place < length:
        opcode, size = _RECORD.unpack_from(data, place)
        start = place + _RECORD.size
        place = start + size
        if opcode == Opcode.MESSAGE:
            channel, time_ns = _MESSAGE.unpack_from(data, start)
            if channel in wanted:
                yield time_ns, offset, start, channel, data[start + _MESSAGE_HEAD : place]


_HASH = "scene_hash"


def scene_attachments(bundle: SceneBundle | None) -> dict[str, bytes]:
    """The files of a bag's attachments by name."""
    return {} if bundle is None else {SCENE_FILE: bundle.text.encode(), **bundle.files}


def scene_notes(bundle: SceneBundle | None) -> dict[str, str]:
    """Notes on the scene in a bag's metadata."""
    return {} if bundle is None else {_HASH: bundle.scene_hash}


def read_scene(bag: Path, folder: Path) -> ResolvedScene:
    """The scene that a bag was recorded from; its files are written into `folder`, which must exist.

    A saved bed is not in a bag: a scene that has one can be shown, but not run again.

    Raises:
        InputError: there is no bag, or it contains no scene.
        SceneError: this version cannot read the scene.
        RecordingError: the bag was not closed, or is damaged.
    """
    path = mcap_path(bag)
    try:
        with path.open("rb") as stream:
            reader = make_reader(stream)
            if reader.get_summary() is None:
                raise damaged(path, "it has no index")
            files = {item.name: item.data for item in reader.iter_attachments()}
            notes = {record.name: record.metadata for record in reader.iter_metadata()}.get(NOTES, {})
    except BROKEN as error:
        raise damaged(path, error) from error
    if SCENE_FILE not in files or _HASH not in notes:
        raise InputError(
            f"{path}: it contains no scene, as bags of `subsoil run` do; name the folder of its run, "
            "which has a scene.yaml"
        )
    text = files.pop(SCENE_FILE).decode(errors="replace")
    plain = {name: data for name, data in files.items() if Path(name).name == name}  # none beside `folder`
    try:
        return unpack_to_show(SceneBundle(text, plain, notes[_HASH]), folder)
    except SceneError as error:
        raise SceneError(f"{path}: the scene in it: {error}") from error
