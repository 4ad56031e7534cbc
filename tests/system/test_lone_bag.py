"""A bag without its run folder: its scene is in it, report and pictures are made from it alone."""

import json
import os
import shutil
from pathlib import Path

import pytest

from subsoil_ros.api.read import read_run, recorded_run
from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.scene_bundle import pack, unpack_to_show
from subsoil_ros.recording.bag_folder import BagFolder
from subsoil_ros.recording.bag_reader import read_scene
from subsoil_ros.recording.recovery import recover
from tests.unit.analysis.test_summary_schema import check

Captured = pytest.CaptureFixture[str]
SCENES = Path(__file__).parents[2] / "config" / "scenes"


@pytest.fixture
def lone(machine_bag: Path, tmp_path: Path) -> Path:
    """The .mcap file of a run, sent without the rest."""
    (path,) = machine_bag.glob("*.mcap")
    return Path(shutil.copy(path, tmp_path / "field.mcap"))


def test_the_scene_of_a_bag_is_that_of_the_run(machine_bag: Path, lone: Path, tmp_path: Path) -> None:
    """The same by hash, meshes included, and no path of the sender is in it."""
    folder = tmp_path / "scene"
    folder.mkdir()
    expected = load_scene(machine_bag.parent / "scene.yaml")
    found = read_scene(lone, folder)
    assert found.scene_hash == expected.scene_hash == load_scene(folder / "scene.yaml").scene_hash
    assert found.timing == expected.timing
    text = (folder / "scene.yaml").read_text()
    assert str(SCENES.parent) not in text
    assert "0.stl" in text


def test_the_summary_of_particles_and_machine_fits_its_schema(machine_bag: Path) -> None:
    """The other kinds of runs: tests/unit/analysis/test_summary_schema.py."""
    check(json.loads((machine_bag.parent / "summary.json").read_text()))


def test_a_report_of_the_file_alone(
    machine_bag: Path, lone: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Series byte for byte as the run made them, figures, page with the scene; all of it beside the bag."""
    monkeypatch.chdir(lone.parent)
    assert main(["report", lone.name, "--html"]) == 0
    out = lone.with_name("field_report")
    assert (out / "series.csv").read_bytes() == (machine_bag.parent / "series.csv").read_bytes()
    assert (out / "figures/draft.png").is_file()
    assert "0.stl" in (out / "report.html").read_text()
    assert f"bag: {lone}" in capsys.readouterr().out
    assert {path.name for path in lone.parent.iterdir()} == {"field.mcap", "field_report"}
    whole = (out / "series.csv").read_text().splitlines(keepends=True)
    (out / "series.csv").write_text("".join(whole[:3]))  # of an earlier bag of that name
    assert len(read_run(lone).series) == len(whole) - 1


def test_the_bag_of_a_run_stands_for_the_run(machine_bag: Path) -> None:
    """Folder or file in it: results go to the folder of the run, as if that was named."""
    (path,) = machine_bag.glob("*.mcap")
    for given in (machine_bag.parent, machine_bag, path):
        with recorded_run(given) as found:
            assert found.directory.resolve() == machine_bag.parent.resolve()
            assert found.bag.resolve() == machine_bag.resolve()


def test_a_mended_bag_still_has_its_scene(machine_bag: Path, tmp_path: Path) -> None:
    """A cut file keeps what stands before its first message."""
    bag, folder = tmp_path / "bag", tmp_path / "scene"
    shutil.copytree(machine_bag, bag)
    folder.mkdir()
    (path,) = bag.glob("*.mcap")
    os.truncate(path, path.stat().st_size - 1000)  # its index is cut
    assert recover(bag).damaged_path is not None
    expected = load_scene(machine_bag.parent / "scene.yaml")
    assert read_scene(bag, folder).scene_hash == expected.scene_hash
    assert load_scene(folder / "scene.yaml").scene_hash == expected.scene_hash


def test_bag_info_names_what_is_attached(lone: Path, capsys: Captured) -> None:
    """Files by name, with their size, and the hash of the scene."""
    assert main(["bag", "info", str(lone)]) == 0
    text = capsys.readouterr().out
    assert "attached: scene.yaml, 0.stl, " in text
    assert "scene_hash: " in text


def test_a_damaged_lone_bag_names_its_cure(lone: Path, capsys: Captured) -> None:
    """As everywhere: `subsoil bag recover`."""
    os.truncate(lone, lone.stat().st_size - 1)
    assert main(["report", str(lone)]) == 3
    assert "subsoil bag recover" in capsys.readouterr().err


def test_a_saved_bed_is_left_out(tmp_path: Path) -> None:
    """It may be large, and no report needs it; the scene keeps the hash that it was run with."""
    (tmp_path / "bed.npz").write_bytes(b"bed")
    scene = load_scene(SCENES / "tine.yaml", [f"soil.bed={{kind: saved, file: {tmp_path / 'bed.npz'}}}"])
    bundle = pack(scene, with_bed=False)
    assert [data for name, data in bundle.files.items() if name.endswith(".npz")] == [b""]
    assert all(data for name, data in bundle.files.items() if name.endswith(".stl"))
    folder = tmp_path / "shown"
    folder.mkdir()
    assert unpack_to_show(bundle, folder).scene_hash == scene.scene_hash
    assert b"bed" in pack(scene).files.values()


def test_nothing_is_written_beside_the_folder(tmp_path: Path) -> None:
    """An attachment whose name is a path is not unpacked."""
    bundle = pack(load_scene(SCENES / "tine.yaml"))
    files = {"scene.yaml": bundle.text.encode(), **bundle.files, "../outside.stl": b"x"}
    BagFolder(tmp_path / "bag", notes={"scene_hash": bundle.scene_hash}, attachments=files).close()
    (tmp_path / "scene").mkdir()
    read_scene(tmp_path / "bag", tmp_path / "scene")
    assert not (tmp_path / "outside.stl").exists()


def test_a_scene_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    """Bag, scene, key."""
    files = {"scene.yaml": b"name: x\nduration_s: 1.0\nsoyl: {}\n"}
    BagFolder(tmp_path / "bag", notes={"scene_hash": "0" * 64}, attachments=files).close()
    (tmp_path / "scene").mkdir()
    with pytest.raises(InputError, match=r"bag_0\.mcap: the scene in it: .*soyl"):
        read_scene(tmp_path / "bag", tmp_path / "scene")
