"""Recovery of a bag whose writer was killed: every whole chunk is read in sequence and written anew."""

import atexit
import logging
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from ..errors import InputError, RecordingError
from ..yaml_document import parse_yaml
from .bag_folder import BROKEN, NOTES, BagFolder, TopicInfo, mcap_file
from .bag_lock import writer_of

METADATA = "metadata.yaml"
"""Description of a bag, beside its file."""


@dataclass(frozen=True)
class Recovery:
    """Result of a recovery."""

    path: Path  # the recovered .mcap file
    damaged_path: Path | None  # where the damaged one was moved to; None: the bag was whole
    message_count: int
    end_time_ns: int


def recover(path: Path, on_progress: Callable[[int], None] = lambda done_bytes: None) -> Recovery:
    """Recover the bag at `path` (bag folder, .mcap file or folder of a run) in its place.

    The damaged file is kept as NAME.damaged. A bag that is whole is left as it is: a file, or a folder with
    metadata.yaml. Where that describes no file there, it is kept as metadata.yaml.damaged. The messages of
    the chunk that was being written are lost. `on_progress` is called now and then with the bytes read so
    far.

    Raises:
        InputError: there is no bag, it is being written, or an earlier recovery's remains are in the way.
        RecordingError: no message can be read.
    """
    source = mcap_file(path)
    writer = writer_of(source)
    if writer:
        raise InputError(f"{source}: is being written by {writer}; wait for its end, or end it")
    described = source.parent / METADATA
    whole = _is_whole(source) and (path.is_file() or described.is_file())
    kept = source.with_name(source.name + ".damaged")
    fresh = source.parent / (source.parent.name + ".mended")
    if not whole:
        for obstacle in (kept, fresh, described.with_name(METADATA + ".damaged")):
            if obstacle.exists():
                raise InputError(f"{obstacle}: is left from an earlier recovery; move it away first")
    try:
        return _recover(source, fresh, kept, whole, on_progress)
    except (OSError, RecordingError) as error:
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError):
            raise  # nothing to recover
        shutil.rmtree(fresh, ignore_errors=True)
        raise RecordingError(
            f"{source}: cannot be mended in its place ({cause.strerror}); make room, or mend a copy "
            "of the bag where there is some"
        ) from error


def _recover(
    source: Path, fresh: Path, kept: Path, whole: bool, on_progress: Callable[[int], None]
) -> Recovery:
    directory = source.parent
    folder = None if whole else BagFolder(fresh, source.name, *_beginning(source))
    count, end_ns = _copied(source, folder, on_progress)
    if folder is None:
        return Recovery(source, None, count, end_ns)
    folder.close()
    if count == 0:
        _remove(folder)
        raise RecordingError(f"{source}: not one whole chunk is in it; there is nothing to recover")
    source.rename(kept)
    folder.path.rename(source)
    described = directory / METADATA
    files = _files_of(described) if described.exists() else [source.name]
    if source.name not in files and any((directory / name).is_file() for name in files):
        (fresh / METADATA).unlink()  # the folder's is of another bag
    else:
        if source.name not in files:
            described.rename(described.with_name(METADATA + ".damaged"))
        (fresh / METADATA).replace(described)
    fresh.rmdir()
    return Recovery(source, kept, count, end_ns)


def _copied(source: Path, folder: BagFolder | None, on_progress: Callable[[int], None]) -> tuple[int, int]:
    """Copy what can be read of a bag to `folder`; return the number of messages and the last time [ns]."""
    channels: dict[int, str] = {}
    schemas: dict[int, Schema] = {}
    count, end_ns = 0, 0
    for record in _readable(source, on_progress):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record.topic
            if folder is not None and record.topic not in folder:
                folder.add_topic(_topic_info(record, schemas))
        elif isinstance(record, Message):
            count += 1
            end_ns = max(end_ns, record.log_time)
            if folder is not None:
                folder.write(channels[record.channel_id], record.log_time, record.data)
    return count, end_ns


_copies: dict[Path, Path] = {}
"""Copies of bags that were being written when this process read them, by their place."""


def readable(source: Path) -> Path:
    """The bag file itself or, while it is being written, a copy of what is there, until forget_copies."""
    if source in _copies:
        return _copies[source]
    writer = writer_of(source)
    if not writer:
        return source
    log = logging.getLogger("subsoil_ros")
    log.warning("%s: is being written by %s; reading what is there", source, writer)
    place = Path(tempfile.mkdtemp(prefix="subsoil-live-"))
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    folder = BagFolder(place / "bag", None, *_beginning(source))
    _copied(source, folder, lambda done_bytes: None)
    folder.close()
    return _copies.setdefault(source, folder.path)  # below `place`, which goes with the process or before


def forget_copies() -> None:
    """Let the next reader of a bag that is being written see what is there by then; remove the copies."""
    while _copies:
        _, copy = _copies.popitem()
        shutil.rmtree(copy.parents[1], ignore_errors=True)


def _files_of(metadata: Path) -> list[str]:
    """Names of the files of a bag that a metadata.yaml describes; none if it is damaged, or no such file."""
    try:
        text = metadata.read_text(encoding="utf-8")
        found: Any = parse_yaml(text, str(metadata))
        return [str(name) for name in found["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (UnicodeDecodeError, InputError, KeyError, TypeError):
        return []


def _beginning(path: Path) -> tuple[dict[str, str], dict[str, bytes]]:
    """Notes and attachments of the bag, which stand before the first message."""
    notes: dict[str, str] = {}
    attachments: dict[str, bytes] = {}
    for record in _readable(path):
        if isinstance(record, Metadata) and record.name == NOTES:
            notes = dict(record.metadata)
        elif isinstance(record, Attachment):
            attachments[record.name] = record.data
        elif isinstance(record, Message):
            break
    return notes, attachments


def last_time_ns(path: Path) -> int:
    """Simulated time of the last message [ns] that can be read from a bag, closed or not; 0 if none can."""
    source = mcap_file(path)
    return max((record.log_time for record in _readable(source) if isinstance(record, Message)), default=0)


def _remove(folder: BagFolder) -> None:
    for item in folder.directory.iterdir():
        item.unlink()
    folder.directory.rmdir()


def _topic_info(channel: Channel, schemas: dict[int, Schema]) -> TopicInfo:
    schema = schemas[channel.schema_id]
    return TopicInfo(
        name=channel.topic,
        message_type=schema.name,
        schema=schema.data.decode(),
        type_hash=channel.metadata.get("topic_type_hash", ""),
        qos_profiles=parse_yaml(channel.metadata.get("offered_qos_profiles", ""), channel.topic) or [],
    )


def _is_whole(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            for _ in StreamReader(stream, validate_crcs=True).records:
                pass
    except BROKEN:
        return False
    return True


def _readable(path: Path, on_progress: Callable[[int], None] = lambda done_bytes: None) -> Iterator[object]:
    """Records up to the first that is cut off or damaged."""
    with path.open("rb") as stream:
        try:
            for number, record in enumerate(StreamReader(stream, validate_crcs=True).records):
                yield record
                if number % 1000 == 0:
                    on_progress(stream.tell())
        except BROKEN:
            return  # the end of what can be read
