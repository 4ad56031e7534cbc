"""Checkpoints on the disk: a folder each, its parts as .npz files, valid once its manifest is there.

Each process writes its part of a run's state (`write_part`), with a note of size, time and checksum beside
it. One process then writes the manifest (`commit`), which names all parts with their checksums. Every file
is written under another name, flushed to the disk, and renamed. So a run that is killed at any moment leaves
either the whole checkpoint or none, and the one before remains.
"""

import hashlib
import io
import json
import os
import time
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from .._version import __version__
from ..errors import InputError, RecordingError
from ..source_digest import law_digests
from ..yaml_document import Document

FORMAT = 3
"""Version of the format, increased when older checkpoints cannot be read any more."""

KEPT = 2
"""Number of checkpoints kept: the newest, and the one before in case it is damaged."""

MANIFEST = "manifest.json"
_END = "end"
_PREFIX = "tick_"

Arrays = Mapping[str, NDArray[Any]]
"""A state: arrays by name."""


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint whose manifest and parts have been verified."""

    path: Path
    tick: int  # the state is that at the end of it
    time_s: float  # simulated, at the end of `tick`
    run_id: str
    coupling: Document  # the coupling's part, as it was committed
    parts: dict[str, Document]  # by name: file, bytes, write_s, sha256

    @property
    def size_bytes(self) -> int:
        """Size of all parts [bytes]."""
        return sum(part["bytes"] for part in self.parts.values())

    def read_part(self, name: str) -> dict[str, NDArray[Any]]:
        """Read the arrays of a part; they are writable.

        Raises:
            InputError: there is no such part, or it is damaged.
        """
        if name not in self.parts:
            raise InputError(f"{self.path}: has no part '{name}', only {', '.join(self.parts)}")
        content = _verified(self.path, self.parts[name])
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}


def state_sha256(arrays: Arrays) -> str:
    """sha256 hex of a state: that of the part file it would be written to."""
    stream = _Hashing(None)
    _write_arrays(stream, arrays)
    return stream.digest.hexdigest()


def document_sha256(document: Document) -> str:
    """sha256 hex of a JSON document, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def write_part(directory: Path, tick: int, name: str, arrays: Arrays) -> None:
    """Write one part of the checkpoint of `tick`; it has no effect until it is committed.

    Raises:
        RecordingError: the disk cannot be written.
    """
    start = time.monotonic()
    folder = _folder(directory, tick)
    path = folder / f"{name}.npz"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".npz.tmp")
        with partial.open("wb") as file:
            stream = _Hashing(file)
            _write_arrays(stream, arrays)
            size = file.tell()
            file.flush()
            os.fsync(file.fileno())
        note = {"file": path.name, "bytes": size, "write_s": time.monotonic() - start}
        _write_document(folder / f"{name}.json", note | {"sha256": stream.digest.hexdigest()})
        partial.replace(path)
        _sync_folder(folder)
    except OSError as error:
        raise _refused(path, error) from error


def has_parts(directory: Path, tick: int, names: Sequence[str]) -> bool:
    """Whether all parts of the checkpoint of `tick` are on the disk."""
    return all((_folder(directory, tick) / f"{name}.npz").is_file() for name in names)


def commit(directory: Path, tick: int, names: Sequence[str], facts: Document) -> Path:
    """Make the checkpoint of `tick` valid, once its parts are on the disk; remove all but the newest KEPT.

    Args:
        facts: other contents of the manifest: time_s, run_id, scene_hash, coupling.

    Raises:
        RecordingError: the disk cannot be written, or a part is missing.
    """
    folder = _folder(directory, tick)
    try:
        parts = {name: json.loads((folder / f"{name}.json").read_text(encoding="utf-8")) for name in names}
        code = {"package_version": __version__, "laws": law_digests()}
        document = {"format": FORMAT, **code, "tick": tick, **facts, "parts": parts}
        _write_document(folder / MANIFEST, document | {"sha256": document_sha256(document)})
        _sync_folder(folder)
        _sync_folder(directory)
    except OSError as error:
        raise _refused(folder / MANIFEST, error) from error
    _drop_old(directory)
    return folder


def note_end(directory: Path, tick: int, name: str, sha256: str) -> None:
    """Write the digest of a part's state at the end of the run, where no checkpoint is needed.

    Raises:
        RecordingError: the disk cannot be written.
    """
    path = directory / _END / f"{name}.json"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _write_document(path, {"tick": tick, "sha256": sha256})
    except OSError as error:
        raise _refused(path, error) from error


def end_digests(directory: Path) -> dict[str, str]:
    """Read the digests that `note_end` has written, by name of the part."""
    return {
        path.stem: json.loads(path.read_text(encoding="utf-8"))["sha256"]
        for path in sorted((directory / _END).glob("*.json"))
    }


def newest_valid(
    directory: Path, scene_hash: str | None = None, last_tick: int | None = None
) -> tuple[Checkpoint, list[str]]:
    """The newest checkpoint in `directory` that can be used, and why newer ones cannot, one line each.

    Args:
        scene_hash: hash that the scene must have; None: any.
        last_tick: last tick of the record, beyond which no checkpoint is used; None: no limit.

    Raises:
        InputError: there is none; the message has the reason for each.
    """
    refusals: list[str] = []
    for folder in reversed(_committed(directory)):
        try:
            found = read_checkpoint(folder, scene_hash)
            if last_tick is not None and found.tick > last_tick:
                raise InputError(f"{folder}: the record beside it ends before, with tick {last_tick}")
            return found, refusals
        except InputError as error:
            refusals.append(str(error))
    if refusals:
        raise InputError("; ".join(refusals) + ". No other checkpoint is there: start the run anew")
    raise InputError(f"{directory}: no checkpoint there; the run wrote none (record.checkpoint_s)")


def read_checkpoint(folder: Path, scene_hash: str | None = None) -> Checkpoint:
    """Read a checkpoint, and verify its manifest and the checksums of all parts.

    Raises:
        InputError: it is damaged, of another format, version or scene.
    """
    try:
        document = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        given = document.pop("sha256")
        if document["format"] != FORMAT:
            raise InputError(
                f"{folder}: checkpoint of format {document['format']}, this version reads format {FORMAT}"
            )
        if given != document_sha256(document):
            raise InputError(f"{folder}: the checkpoint is damaged (checksum of {MANIFEST})")
        found = Checkpoint(
            folder, document["tick"], document["time_s"], document["run_id"], document["coupling"],
            document["parts"],
        )  # fmt: skip
        version, laws, scene = document["package_version"], document["laws"], document["scene_hash"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{folder}: the checkpoint is damaged ({MANIFEST} cannot be read)") from error
    if version != __version__:
        raise InputError(f"{folder}: checkpoint of subsoil_ros {version}, this is {__version__}")
    if laws != law_digests():
        raise InputError(f"{folder}: checkpoint of other contact laws than those that are installed now")
    if scene_hash is not None and scene != scene_hash:
        raise InputError(
            f"{folder}: checkpoint of another scene (hash {scene[:12]}, given is {scene_hash[:12]}); give "
            "the scene.yaml beside it, with no other --set"
        )
    for part in found.parts.values():
        _verified(folder, part)
    return found


def _folder(directory: Path, tick: int) -> Path:
    return directory / f"{_PREFIX}{tick:012d}"


def _committed(directory: Path) -> list[Path]:
    """Folders with a manifest, oldest first."""
    return sorted(path.parent for path in directory.glob(f"{_PREFIX}*/{MANIFEST}"))


def _verified(folder: Path, part: Document) -> bytes:
    path = folder / part["file"]
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: the checkpoint is damaged ({error.strerror})") from error
    if len(content) != part["bytes"]:
        raise InputError(
            f"{path}: the checkpoint is damaged ({len(content)} bytes, written were {part['bytes']})"
        )
    if hashlib.sha256(content).hexdigest() != part["sha256"]:
        raise InputError(f"{path}: the checkpoint is damaged (checksum)")
    return content


class _Hashing:
    """A stream without seek; its digest is that of the bytes in the file."""

    def __init__(self, file: BinaryIO | None) -> None:
        self.digest = hashlib.sha256()
        self._file = file

    def write(self, data: bytes) -> int:
        self.digest.update(data)
        return len(data) if self._file is None else self._file.write(data)

    def flush(self) -> None:
        """Do nothing: writes are not buffered here."""


def _write_arrays(stream: _Hashing, arrays: Arrays) -> None:
    """Write as numpy.savez does, but in the order of the names, so that equal states give equal bytes."""
    with zipfile.ZipFile(cast(IO[bytes], stream), "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(arrays):
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(arrays[name]), allow_pickle=False)


def _write_document(path: Path, document: Document) -> None:
    partial = path.with_suffix(".json.tmp")
    with partial.open("w", encoding="utf-8") as file:
        json.dump(document, file, indent=1)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _drop_old(directory: Path) -> None:
    """Remove checkpoints older than the newest KEPT; the manifest first, so that no remains look valid."""
    oldest_kept = _committed(directory)[-KEPT:][0]
    for folder in sorted(directory.glob(f"{_PREFIX}*")):
        if folder < oldest_kept:
            with suppress(OSError):
                (folder / MANIFEST).unlink(missing_ok=True)
                for path in folder.iterdir():
                    path.unlink()
                folder.rmdir()


def _refused(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"{path}: the checkpoint cannot be written ({error.strerror}). Make room, or set "
        "record.checkpoint_s: 0"
    )
