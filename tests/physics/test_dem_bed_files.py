"""Beds as files: the same bed comes back, from the cache or by name, and an unfit file is one clear error."""

import contextlib
import shutil

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.packing.bed_file import bed_path, read_bed, write_bed
from subsoil_ros.errors import SceneError


def with_bed(maker, bed, **changes):
    """The small scene with another bed; `changes` replace keys of its soil."""
    soil = maker.scene().document["soil"]
    return maker.scene(soil={**soil, "bed": bed, **changes})


DENSE = {"kind": "dense_random", "seed": 3}


@pytest.fixture
def cache(tmp_path_factory, monkeypatch):
    """An empty cache folder of the user."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder / "subsoil_ros" / "beds"


@pytest.fixture
def saved(soil, tmp_path_factory):
    """A scene and the bed file of its own grid."""
    scene = soil.scene()
    path = tmp_path_factory.mktemp("beds") / "grid.npz"
    write_bed(path, build_engine(scene).bed, scene.scene.soil)
    return scene.scene.soil, path


def changed(path, **arrays):
    """The file with other arrays in it."""
    with np.load(path) as file:
        content = dict(file)
    np.savez_compressed(path, **{**content, **arrays})
    return path


def test_a_second_run_takes_the_same_bed_from_the_cache(soil, cache, monkeypatch):
    """Bit for bit, nothing is settled again, and one file stands in the cache."""
    scene = with_bed(soil, DENSE)
    first = build_engine(scene).bed
    assert [path.name for path in cache.iterdir()] == [bed_path(scene).name]
    monkeypatch.setattr(SoilEngine, "damp", None)  # settling would call it
    again = build_engine(with_bed(soil, DENSE)).bed
    assert_array_equal(again.positions_m, first.positions_m)
    assert (again.lower_m, again.upper_m) == (first.lower_m, first.upper_m)


def test_the_cache_key_follows_what_makes_the_bed_and_nothing_else(soil, cache):
    """Seed, law, bin and gravity make a bed; step, skin and alarm bound do not."""
    path = bed_path(with_bed(soil, DENSE))
    assert bed_path(with_bed(soil, DENSE, skin_m=0.002, time_step_s=2e-5)) == path
    others = [
        with_bed(soil, {**DENSE, "seed": 4}),
        with_bed(soil, DENSE, bin={"length_m": 0.12, "width_m": 0.1, "depth_m": 0.11}),
        soil.scene(
            "soil.law.particle.cohesive_stiffness_newton_per_m=6999",
            soil=with_bed(soil, DENSE).document["soil"],
        ),
        soil.scene("gravity_m_per_s2=9.8", soil=with_bed(soil, DENSE).document["soil"]),
    ]
    assert len({path, *(bed_path(scene) for scene in others)}) == 5


def test_a_damaged_file_in_the_cache_is_prepared_again(soil, cache):
    """Half a file, as an interrupted copy leaves it, is replaced by a whole one."""
    scene = with_bed(soil, DENSE)
    first = build_engine(scene).bed
    path = bed_path(scene)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert_array_equal(build_engine(scene).bed.positions_m, first.positions_m)
    assert_array_equal(read_bed(path, scene.scene.soil).positions_m, first.positions_m)


def test_a_saved_bed_is_run_as_it_was(soil, saved):
    """Positions and walls of the file, wherever the scene stands; its bytes are in the scene's hash."""
    _, path = saved
    scene = with_bed(soil, {"kind": "saved", "file": str(path)})
    assert_array_equal(build_engine(scene).bed.positions_m, build_engine(soil.scene()).bed.positions_m)
    beside = shutil.copy(path, soil.folder / "beside.npz")
    relative = with_bed(soil, {"kind": "saved", "file": "beside.npz"})
    assert relative.document["soil"]["bed"]["file"] == str(beside)
    assert relative.scene_hash == scene.scene_hash
    changed(beside, kinetic_energy_joule=np.array(1.0))
    assert with_bed(soil, {"kind": "saved", "file": "beside.npz"}).scene_hash != scene.scene_hash


def test_writing_fails_whole(saved, tmp_path_factory):
    """A bed that cannot be written leaves neither a file nor a part of one."""
    soil_part, _ = saved
    folder = tmp_path_factory.mktemp("out")
    with pytest.raises(AttributeError):
        write_bed(folder / "bed.npz", None, soil_part)
    (folder / "taken.npz").mkdir()
    with pytest.raises(OSError, match="taken"):
        write_bed(folder / "taken.npz", Bed(np.zeros((1, 3)), (0, 0, 0), (1, 1)), soil_part)
    assert [path.name for path in folder.iterdir()] == ["taken.npz"]


def at(*places):
    """Positions."""
    return np.array(places, np.float64)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"version": np.array(1)}, r"has version 1, readable is 3"),
        ({"law_hash": np.array("0" * 64)}, r"prepared under another law.*hash 000000000000"),
        ({"format": np.array("a picture")}, r"damaged or no bed file.*its format is not"),
        ({"positions_m": np.zeros((3, 2))}, r"damaged or no bed file.*shape"),
        ({"upper_m": np.zeros(2, np.float32)}, r"damaged or no bed file.*'upper_m'"),
        ({"upper_m": np.array([0.5, 0.05])}, r"is a bed of 0.5 x .* soil.bin is 0.12 x 0.1 x 0.1 m"),
        ({"positions_m": at((0.05, 0, -0.05), (0.05, 0.2, -0.05))}, r"particle 1 at .* outside the bin"),
        ({"positions_m": at((np.nan, 0, -0.05))}, r"particle 0 at \[nan.* outside the bin"),
        ({"positions_m": at((0.05, 0, -0.05), (0.062, 0, -0.05))}, r"0 and 1 overlap by 0.006 m more"),
    ],
)  # fmt: skip
def test_an_unfit_file_is_refused(saved, arrays, message):
    """Version, law, kind, shape, bin, places and overlaps: each with the file and what to do."""
    soil_part, path = saved
    with pytest.raises(SceneError, match=message) as caught:
        read_bed(changed(path, **arrays), soil_part)
    assert str(caught.value).startswith(f"soil.bed.file: {path}: ")


@pytest.mark.parametrize("content", [b"", b"no bed", b"PK\x03\x04 and no more"])
def test_a_file_that_is_no_archive_is_refused(saved, content):
    """Never a traceback of the reader."""
    soil_part, path = saved
    path.write_bytes(content)
    with pytest.raises(SceneError, match="is damaged or no bed file"):
        read_bed(path, soil_part)


def test_every_damaged_byte_is_noticed(saved):
    """The archive's checksums stand over every array: a flipped byte never gives another bed."""
    soil_part, path = saved
    whole = path.read_bytes()
    bed = read_bed(path, soil_part)
    for at in range(40, len(whole), 97):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        with contextlib.suppress(SceneError):
            assert_array_equal(read_bed(path, soil_part).positions_m, bed.positions_m)


def test_a_missing_bed_file_is_refused_with_its_path(soil):
    """The scene does not load; the message says where the file was looked for."""
    with pytest.raises(SceneError, match=r"soil.bed.file: .*nowhere.npz: No such file"):
        with_bed(soil, {"kind": "saved", "file": "nowhere.npz"})


def test_a_grid_that_overlaps_too_far_is_refused(soil):
    """5 mm beyond rest is the bound for spheres of 10 mm."""
    build_engine(soil.scene("soil.bed.spacing_m=0.0131", "soil.time_step_s=3e-5"))
    with pytest.raises(SceneError, match=r"soil.bed.spacing_m: 0.0129 m .* at least 0.013 m"):
        build_engine(soil.scene("soil.bed.spacing_m=0.0129"))


def test_a_bed_denser_than_dense_needs_a_smaller_step(soil):
    """The limits of the scene assume 10.4 contacts; the coordination measured on the bed is looked at too."""
    with pytest.raises(SceneError, match=r"soil.time_step_s: 5e-05 s is above .* prepared bed .*14.1"):
        build_engine(soil.scene("soil.bed.spacing_m=0.0131"))
