"""Checkpoint files: whole or not there, two kept, checksums of everything."""

from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.errors import InputError, RecordingError
from subsoil_ros.recording.checkpoint import (
    KEPT,
    commit,
    has_parts,
    newest_valid,
    read_checkpoint,
    state_sha256,
    write_part,
)

FACTS = {"time_s": 0.5, "run_id": "run", "scene_hash": "hash", "coupling": {"work": 1.0 / 3.0}}
ARRAYS = {
    "float": np.array([0.1, -0.0, np.nan, np.inf]),
    "single": np.float32([[1.5, 2.5]]),
    "whole": np.arange(6, dtype=np.int32).reshape(2, 3),
    "flags": np.array([True, False]),
    "nothing": np.empty((0, 3)),
    "number": np.array(7),
}


def keep(directory: Path, tick: int, **arrays: np.ndarray) -> Path:
    """A whole checkpoint of one part."""
    write_part(directory, tick, "soil", arrays or ARRAYS)
    return commit(directory, tick, ["soil"], FACTS)


def test_arrays_come_back_bit_for_bit(tmp_path: Path) -> None:
    """Values, shapes and kinds, writable; the digest of the state is the checksum of the file."""
    found = read_checkpoint(keep(tmp_path, 3), "hash")
    assert (found.tick, found.time_s, found.coupling) == (3, 0.5, FACTS["coupling"])
    part = found.read_part("soil")
    assert list(part) == sorted(ARRAYS)
    for name, array in ARRAYS.items():
        assert (part[name].dtype, part[name].shape) == (array.dtype, array.shape)
        assert part[name].tobytes() == array.tobytes()
        assert part[name].flags.writeable
    assert found.parts["soil"]["sha256"] == state_sha256(dict(reversed(ARRAYS.items())))
    assert found.size_bytes == (found.path / "soil.npz").stat().st_size


def test_two_are_kept(tmp_path: Path) -> None:
    """Older ones go when a newer one is valid, and so does what was begun and never committed."""
    write_part(tmp_path, 0, "soil", ARRAYS)
    folders = [keep(tmp_path, tick) for tick in (1, 2, 10, 100)]
    write_part(tmp_path, 200, "soil", ARRAYS)
    assert sorted(path for path in tmp_path.iterdir() if (path / "manifest.json").exists()) == folders[-KEPT:]
    assert len(list(tmp_path.iterdir())) == KEPT + 1
    assert newest_valid(tmp_path) == (read_checkpoint(folders[-1]), [])


def test_parts_without_manifest_are_no_checkpoint(tmp_path: Path) -> None:
    """A set that was never completed is not seen."""
    write_part(tmp_path, 1, "soil", ARRAYS)
    assert has_parts(tmp_path, 1, ["soil"])
    assert not has_parts(tmp_path, 1, ["soil", "mechanism"])
    with pytest.raises(RecordingError, match="cannot be written"):
        commit(tmp_path, 1, ["soil", "mechanism"], FACTS)
    with pytest.raises(InputError, match="no checkpoint there"):
        newest_valid(tmp_path)


def test_a_refusing_disk_is_named(tmp_path: Path) -> None:
    """Where the folder should be is a file."""
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot be written"):
        write_part(tmp_path / "file", 1, "soil", ARRAYS)


def test_every_bit_counts(tmp_path: Path) -> None:
    """Any byte of manifest or part that changes is noticed."""
    folder = keep(tmp_path, 1, array=np.arange(3.0))
    for path in (folder / "manifest.json", folder / "soil.npz"):
        whole = path.read_bytes()
        for place in range(0, len(whole), 7):
            if whole[place : place + 1].isspace():
                continue  # JSON does not mind which
            damaged = bytearray(whole)
            damaged[place] ^= 4
            path.write_bytes(damaged)
            with pytest.raises(InputError, match="checkpoint"):
                read_checkpoint(folder)
        path.write_bytes(whole)
    read_checkpoint(folder)
