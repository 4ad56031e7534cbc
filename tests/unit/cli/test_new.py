"""`subsoil new`: a folder with a scene that loads and runs at once; shipped scenes by name."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.shipped import config_folder, template_names

ROOT = Path(__file__).parents[3]


def subsoil(folder: Path, *words: object) -> "subprocess.CompletedProcess[str]":
    """Runs the command in a folder, as a user would."""
    return subprocess.run(
        [sys.executable, "-m", "subsoil_ros.cli.main", *map(str, words)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("template", template_names())
def test_new_scene_runs(template, tmp_path):
    """Every template gives a folder of its own whose scene runs as it is, and says how."""
    made = subsoil(tmp_path, "new", "my_scene", "--template", template)
    assert made.returncode == 0, made.stderr
    folder = tmp_path / "my_scene"
    names = {path.name for path in folder.iterdir()}
    assert names == {"scene.yaml", "meshes", "scene.schema.json"}
    assert "subsoil run my_scene/scene.yaml --out runs/my_scene" in made.stdout
    assert load_scene(folder / "scene.yaml").scene.name == "my_scene"
    command = ["run", "my_scene/scene.yaml", "--out", "runs/my_scene", "--mode", "direct"]
    done = subsoil(tmp_path, *command, "--set", "duration_s=0.01")
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "runs/my_scene/summary.json").read_text())
    assert summary["run"]["complete"]
    assert "draft_newton" in summary["series"]


def test_nothing_is_written_over(tmp_path):
    """A folder that is there stays as it is."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/scene.yaml").write_text("name: mine\n")
    done = subsoil(tmp_path, "new", "mine")
    assert done.returncode == 2
    assert "exists already" in done.stderr
    assert [path.name for path in tmp_path.rglob("*")] == ["mine", "scene.yaml"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a b"], "allowed are letters"),
        (["mine", "--template", "plough"], "allowed are machine, tine, wedge"),
    ],
)
def test_bad_words(words, message, tmp_path):
    """One message, and nothing is left behind."""
    done = subsoil(tmp_path, "new", *words)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_shipped_scene_by_name(tmp_path, monkeypatch):
    """A bare name means the shipped scene, unless a file of that name is there."""
    monkeypatch.chdir(tmp_path)
    assert load_scene("tine").path == config_folder() / "scenes/tine.yaml"
    (tmp_path / "tine").write_text((config_folder() / "scenes/mechanism_only.yaml").read_text())
    with pytest.raises(Exception, match="subsoiler_1s300_quick"):  # its base is not here
        load_scene("tine")
