"""A rosbag2 bag folder with one MCAP file: the format, independent of the messages recorded.

The `mcap` writer is used because that of rosbags has fixed chunks of 1 MiB, no sequence numbers and no
checksums. rosbags, rosbag2 and mcap's own readers read the result.
"""

import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import zstandard
from mcap.exceptions import McapError
from mcap.writer import CompressionType, Writer

from ..errors import InputError, RecordingError
from ..yaml_document import Document, dump_yaml
from .bag_lock import lock, unlock

CHUNK_BYTES = 128 * 1024
"""Size of a chunk before compression; a killed writer loses at most the one being filled."""

NOTES = "subsoil_ros"
"""Name of the metadata record with the notes."""

MEDIA_TYPES = {".yaml": "application/yaml", ".stl": "model/stl"}
"""Media types of attachments, by the ending of their name (RFC 9512; IANA)."""

_ROSBAG2_VERSION = 9
_SCHEMA_ENCODING = "ros2msg"


BROKEN = (McapError, struct.error, zstandard.ZstdError, ValueError)
"""Errors of the readers of MCAP, its strings and its chunks where a file is cut off or overwritten."""


def mcap_file(path: Path) -> Path:
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


@dataclass(frozen=True)
class TopicInfo:
    """Description of a topic in a bag."""

    name: str
    message_type: str  # "geometry_msgs/msg/Pose"
    schema: str  # full ros2msg text
    type_hash: str  # RIHS01
    qos_profiles: list[Document]


@dataclass
class _Channel:
    info: TopicInfo
    number: int
    message_count: int = 0


class BagFolder:
    """Writes metadata.yaml and one .mcap; every chunk is written to the disk as soon as it is full.

    Raises (all methods):
        RecordingError: the disk cannot be written.
    """

    def __init__(
        self,
        directory: Path,
        file_name: str | None = None,
        notes: Mapping[str, str] | None = None,
        attachments: Mapping[str, bytes] | None = None,
    ) -> None:
        """Create the folder, and in it `file_name` (default: as rosbag2 names it, FOLDER_0.mcap).

        `notes` describe the whole bag; they are in the file's metadata, before the first message, and in
        metadata.yaml as custom_data. `attachments` are files by name, also before the first message.

        Raises:
            InputError: the folder exists, or cannot be created.
        """
        self.directory = directory
        self.path = directory / (file_name or f"{directory.name}_0.mcap")
        try:
            directory.mkdir(parents=True)
            self._stream = self.path.open("xb")
            lock(self._stream)
        except FileExistsError:
            raise InputError(
                f"{directory}: exists already; a bag is never written over, name another folder"
            ) from None
        except OSError as error:
            raise InputError(
                f"{directory}: cannot be created ({error.strerror}); name a folder that can"
            ) from error
        self._channels: dict[str, _Channel] = {}
        self._schema_ids: dict[str, int] = {}
        self._times_ns: list[int] = []  # [first, last]
        self._open = True
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._notes = dict(notes or {})
        try:
            self._writer.start(profile="ros2", library="subsoil_ros")
            if self._notes:
                self._writer.add_metadata(NOTES, self._notes)
            for name, content in (attachments or {}).items():
                self._writer.add_attachment(0, 0, name, _media_type(name), content)  # simulated time 0
            self._stream.flush()
        except OSError as error:
            raise self._refused(error) from error
        self._on_disk = self._stream.tell()

    def __contains__(self, topic: str) -> bool:
        return topic in self._channels

    def add_topic(self, info: TopicInfo) -> None:
        """Declare a topic, before its first message."""
        schema_id = self._schema_ids.get(info.message_type)
        if schema_id is None:
            schema_id = self._writer.register_schema(
                info.message_type, _SCHEMA_ENCODING, info.schema.encode()
            )
            self._schema_ids[info.message_type] = schema_id
        number = self._writer.register_channel(
            info.name,
            "cdr",
            schema_id,
            {"offered_qos_profiles": dump_yaml(info.qos_profiles).strip(), "topic_type_hash": info.type_hash},
        )
        self._channels[info.name] = _Channel(info, number)

    def write(self, topic: str, time_ns: int, data: bytes) -> None:
        """Write a CDR message, logged and published at a simulated time; sequence counts from 0."""
        channel = self._channels[topic]
        try:
            self._writer.add_message(channel.number, time_ns, data, time_ns, channel.message_count)
            if (position := self._stream.tell()) != self._on_disk:  # a chunk was ended
                self._stream.flush()
                self._on_disk = position
        except OSError as error:
            raise self._refused(error) from error
        channel.message_count += 1
        if not self._times_ns:
            self._times_ns = [time_ns, time_ns]
        elif time_ns > self._times_ns[1]:
            self._times_ns[1] = time_ns
        elif time_ns < self._times_ns[0]:
            self._times_ns[0] = time_ns

    def sync(self) -> None:
        """End the chunk, and write everything to the disk."""
        try:
            self._writer.flush()
            os.fsync(self._stream.fileno())
            self._on_disk = self._stream.tell()
        except OSError as error:
            raise self._refused(error) from error

    def close(self) -> None:
        """Writes index and metadata. Idempotent."""
        if not self._open:
            return
        self._open = False
        try:
            with self._stream:
                information = self._information()
                self._writer.add_metadata("rosbag2", {"serialized_metadata": dump_yaml(information).strip()})
                self._writer.finish()
                self._stream.flush()
                unlock(self._stream)
            partial = self.directory / "metadata.yaml.tmp"
            partial.write_text(dump_yaml({"rosbag2_bagfile_information": information}), encoding="utf-8")
            partial.replace(self.directory / "metadata.yaml")
        except OSError as error:
            raise self._refused(error) from error

    def _refused(self, error: OSError) -> RecordingError:
        return RecordingError(
            f"{self.path}: cannot be written ({error.strerror}). What reached the disk can be mended with "
            f"`subsoil bag recover {self.directory}`"
        )

    def _information(self) -> Document:
        """rosbag2's metadata, version 9."""
        start_ns, end_ns = self._times_ns or (0, 0)
        message_count = sum(channel.message_count for channel in self._channels.values())
        span: Document = {
            "starting_time": {"nanoseconds_since_epoch": start_ns},
            "duration": {"nanoseconds": end_ns - start_ns},
            "message_count": message_count,
        }
        return {
            "version": _ROSBAG2_VERSION,
            "storage_identifier": "mcap",
            **span,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": channel.info.name,
                        "type": channel.info.message_type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": channel.info.qos_profiles,
                        "type_description_hash": channel.info.type_hash,
                    },
                    "message_count": channel.message_count,
                }
                for channel in self._channels.values()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self.path.name],
            "files": [{"path": self.path.name, **span}],
            "custom_data": self._notes or None,
            "ros_distro": "jazzy",
        }


def _media_type(name: str) -> str:
    return MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
