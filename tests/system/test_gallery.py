"""The gallery: every scene has its picture and its words, its meshes are those of the script, and it runs."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

import subsoil_ros as subsoil
from dev.gallery import FILMS, FOLDER, scenes
from examples.gallery.make_meshes import MESHES

PAGE = (FOLDER / "README.md").read_text()
SHORT = {"duration_s": 0.004, "soil.particles.radius_m": 0.02, "record.cloud_hz": None}


def test_every_scene_is_on_the_page():
    """At least twenty examples; each scene has a picture or film of its own, and three sentences or so."""
    shown = re.findall(r"!\[\]\(pictures/([\w.]+)\) \| \*\*`(\w+)`\*\*\. (.+) \|", PAGE)
    assert sorted(name for _, name, _ in shown) == scenes()
    for picture, name, words in shown:
        assert picture == f"{name}.{'gif' if name in FILMS else 'png'}"
        assert (FOLDER / "pictures" / picture).is_file()
        assert words.count(". ") >= 1
    others = set(re.findall(r"\]\(\.\./(\w+)/README\.md\)", PAGE))
    assert others == {path.parent.name for path in FOLDER.parent.glob("*/README.md")} - {"gallery"}
    assert len(shown) + len(others) >= 20


@pytest.mark.parametrize("make", MESHES, ids=lambda make: make.__name__)
def test_meshes_are_those_of_the_script(make):
    """What make_meshes.py writes is what is in the folder."""
    stored, made = trimesh.load(FOLDER / "meshes" / f"{make.__name__}.stl"), make()
    assert stored.is_watertight
    np.testing.assert_allclose(stored.volume, made.volume, rtol=1e-5)
    np.testing.assert_allclose(stored.bounds, made.bounds, atol=1e-6)


@pytest.mark.parametrize("name", scenes())
def test_scene_is_whole(name):
    """The command `check` finds no fault."""
    assert subsoil.check(FOLDER / f"{name}.yaml", SHORT)


@pytest.mark.full
@pytest.mark.parametrize("name", scenes())
def test_scene_runs(name):
    """With larger particles and for a short time, every scene runs to its end."""
    run = subsoil.run(FOLDER / f"{name}.yaml", overrides=SHORT)
    assert run.failure is None
    assert run.summary["run"]["complete"]
    assert Path(FOLDER / f"{name}.yaml").stem == run.summary["scene"]["name"]
