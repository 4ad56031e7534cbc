"""Shapes of mesh files in the cache: equal to those that are read, and never those of another file."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_array_equal

from subsoil_ros.scene import kept_shapes
from subsoil_ros.scene.kept_shapes import Shape, sound_shape
from subsoil_ros.scene.tool_mesh import _checked


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of the test's own."""
    monkeypatch.setattr(kept_shapes, "user_cache_folder", lambda: tmp_path)
    return tmp_path / "shapes"


def refused() -> Shape:
    raise AssertionError("was read again")


def test_a_kept_shape_is_the_one_that_was_read(cache: Path) -> None:
    """To the bit; for every file of the same content, and the same kind."""
    file = cache.parent / "ball.stl"
    trimesh.creation.icosphere(2, 0.1).export(file)
    read = _checked(file, 1.0, "mesh")
    assert_array_equal(sound_shape(file, lambda: read)[0], read[0])
    file.rename(cache.parent / "other.STL")
    for kept, given in zip(sound_shape(cache.parent / "other.STL", refused), read, strict=True):
        assert_array_equal(kept, given)
        assert kept.dtype == given.dtype
    (cache.parent / "other.STL").write_bytes(b"changed")
    with pytest.raises(AssertionError, match="was read again"):
        sound_shape(cache.parent / "other.STL", refused)


@pytest.mark.parametrize("damage", [b"", b"PK", bytes(200)])
def test_a_damaged_one_is_read_again(cache: Path, damage: bytes) -> None:
    file, shape = cache.parent / "a.stl", (np.zeros((3, 3)), np.zeros((1, 3), dtype=np.int64))
    file.write_bytes(b"content")
    sound_shape(file, lambda: shape)
    (kept,) = cache.iterdir()
    kept.write_bytes(damage)
    assert_array_equal(sound_shape(file, lambda: shape)[1], shape[1])
    assert_array_equal(sound_shape(file, refused)[1], shape[1])


def test_without_a_cache_it_is_read(cache: Path) -> None:
    """A file in the folder's place: nothing can be kept, and nothing is lost."""
    cache.touch()
    file, shape = cache.parent / "a.stl", (np.zeros((3, 3)), np.zeros((1, 3), dtype=np.int64))
    file.write_bytes(b"content")
    assert_array_equal(sound_shape(file, lambda: shape)[1], shape[1])
    with pytest.raises(AssertionError, match="was read again"):
        sound_shape(file, refused)


def test_a_file_that_is_missing_is_refused_where_it_is_read(cache: Path) -> None:
    with pytest.raises(AssertionError, match="was read again"):
        sound_shape(cache.parent / "none.stl", refused)
