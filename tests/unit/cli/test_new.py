"""`subsoil new`: a folder with a scene that loads and runs at once; shipped scenes by name."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from subsoil_ros.cli.main import main
from subsoil_ros.loading.files import config_folder, shipped_names
from subsoil_ros.loading.loader import load_scene


@pytest.fixture
def subsoil(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Callable[..., tuple[int, str, str]]:
    """Runs the command in the test's folder: exit status, standard output and error."""
    monkeypatch.chdir(tmp_path)

    def run(*words: object) -> tuple[int, str, str]:
        return main(list(map(str, words))), *capsys.readouterr()

    return run


@pytest.mark.parametrize("template", shipped_names("templates"))
def test_new_scene_is_sound(template, subsoil, tmp_path):
    """Every template gives a folder of its own whose scene is sound as it is, and says how to run it."""
    status, out, err = subsoil("new", "my_scene", "--template", template)
    assert status == 0, err
    folder = tmp_path / "my_scene"
    names = {path.name for path in folder.iterdir()}
    assert names == {"scene.yaml", "meshes", "scene.schema.json"}
    assert "subsoil run my_scene/scene.yaml --out runs/my_scene" in out
    assert load_scene(folder / "scene.yaml").scene.name == "my_scene"
    status, _, err = subsoil("check", "my_scene/scene.yaml")
    assert status == 0, err


@pytest.mark.parametrize(
    "template",
    [
        name if name == "wedge" else pytest.param(name, marks=pytest.mark.full)
        for name in shipped_names("templates")
    ],
)
def test_new_scene_runs(template, subsoil, tmp_path):
    """It runs, too; particles need kernels that no other test does."""
    assert subsoil("new", "my_scene", "--template", template)[0] == 0
    command = ["run", "my_scene/scene.yaml", "--out", "runs/my_scene", "--mode", "direct"]
    status, _, err = subsoil(*command, "--set", "duration_s=0.01")
    assert status == 0, err
    summary = json.loads((tmp_path / "runs/my_scene/summary.json").read_text())
    assert summary["run"]["complete"]
    assert "draft_newton" in summary["series"]


def test_nothing_is_written_over(subsoil, tmp_path):
    """A folder that is there stays as it is."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/scene.yaml").write_text("name: mine\n")
    status, _, err = subsoil("new", "mine")
    assert status == 2
    assert "exists already" in err
    assert [path.name for path in tmp_path.rglob("*")] == ["mine", "scene.yaml"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a b"], "allowed are letters"),
        (["mine", "--template", "plough"], "allowed are machine, tine, wedge"),
    ],
)
def test_bad_words(words, message, subsoil, tmp_path):
    """One message, and nothing is left behind."""
    status, _, err = subsoil("new", *words)
    assert status == 2
    assert message in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_shipped_scene_by_name(tmp_path, monkeypatch):
    """A bare name means the shipped scene, unless a file of that name is there."""
    monkeypatch.chdir(tmp_path)
    assert load_scene("tine").path == config_folder() / "scenes/tine.yaml"
    (tmp_path / "tine").write_text((config_folder() / "scenes/mechanism_only.yaml").read_text())
    with pytest.raises(Exception, match="subsoiler_1s300_quick"):  # its base is not here
        load_scene("tine")
