"""The contact law of docs/extending.md, installed from outside as the page says."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from subsoil_ros.cache_folders import kernel_cache_folder
from tests.system.test_modes import without_wall_time

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
SCENE = """
name: two_spheres
duration_s: 0.03
gravity_m_per_s2: 0.0
soil:
  bin: {length_m: 0.22, width_m: 0.14, depth_m: 0.15}
  particles: {radius_m: 0.01, density_kg_per_m3: 2000.0}
  bed: {kind: grid, spacing_m: 0.0199}
  time_step_s: 1.0e-5
  law:
    kind: hysteretic
    particle: &spring
      stiffness_newton_per_m: 10000.0
      unloading_stiffness_newton_per_m: 40000.0
      tangential_stiffness_newton_per_m: 8000.0
      static_friction: 0.5
      sliding_friction: 0.5
    boundary: *spring
"""
TINE = """
base: scene.yaml
name: tine
gravity_m_per_s2: 9.81
tools:
  tine:
    path: {start_x_m: -0.13, start_z_m: 0.2, speed_x_m_per_s: {kind: constant, value: 1.0}}
    groups:
      share: {mesh: MESHES/share.stl}
      blade: {mesh: MESHES/shank.stl}
report: {tip_m: [0.12, -0.30]}
""".replace("MESHES", str(PAGE.parents[1] / "config" / "meshes"))
PROGRAM = """
import json, sys
import numpy as np
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.step import drift_and_contacts
from subsoil_ros.loading.loader import load_scene
resolved = load_scene(sys.argv[1])
engine = build_engine(resolved)
found = {"restitution": []}
for speed in (0.5, 2.0):
    # the second stands before the first in the list once they are sorted
    engine.place([[0.112, 0.0, -0.1], [0.088, 0.0, -0.1]], [[-speed, 0.0, 0.0], [speed, 0.0, 0.0]])
    engine.start(())
    for tick in range(int(0.02 / speed / resolved.timing.communication_step_s)):
        engine.advance(tick, ())
    x, v = engine.positions_m()[:, 0], engine.velocities_m_per_s()[:, 0]
    found["restitution"].append(abs(float(v[0] - v[1])) / (2.0 * speed))
    found["apart"] = abs(float(x[0] - x[1]))
found["hits"] = sum(drift_and_contacts.stats.cache_hits.values())
found["misses"] = sum(drift_and_contacts.stats.cache_misses.values())
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as pip makes it, with the law's package and its metadata, and a scene."""
    folder = tmp_path_factory.mktemp("site")
    page = PAGE.read_text(encoding="utf-8")
    blocks = re.findall(r"<!-- not run: (\S+), which a test installs -->\n```\w+\n(.*?)```", page, re.S)
    for name, text in blocks:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    (folder / "hysteretic" / "__init__.py").touch()
    (entry,) = re.findall(r'^hysteretic = "(.*)"$', (folder / "pyproject.toml").read_text(), re.M)
    metadata = folder / "hysteretic-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: hysteretic\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[subsoil_ros.contact_laws]\nhysteretic = {entry}\n")
    (folder / "scene.yaml").write_text(SCENE)
    (folder / "tine.yaml").write_text(TINE)
    if kernel_cache_folder().is_dir():  # kernels without the law need not be compiled again
        shutil.copytree(kernel_cache_folder(), folder / "kernels")
    return folder


def python(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Another process that finds the packages of `folder`; it keeps its kernels there."""
    paths = filter(None, (str(folder), str(PAGE.parents[1]), os.environ.get("PYTHONPATH")))
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        "NUMBA_CACHE_DIR": str(folder / "kernels"),
    }
    return subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True)


def collided(folder: Path) -> dict:
    """What PROGRAM found."""
    done = python(folder, "-c", PROGRAM, str(folder / "scene.yaml"))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.full
def test_the_law_of_the_page_has_the_restitution_of_its_closed_form(installed: Path) -> None:
    """sqrt(k1 / k2), whatever the speed; a second process compiles nothing, an edit compiles anew."""
    first = collided(installed)
    # an impact has some 150 steps, and the scheme is of first order in them
    assert first["restitution"] == pytest.approx([0.5, 0.5], rel=0.02)
    assert first["apart"] > 0.02
    assert (first["hits"], first["misses"]) == (0, 1)
    again = collided(installed)
    assert (again["hits"], again["misses"]) == (1, 0)
    assert again["restitution"] == first["restitution"]
    kernel = installed / "hysteretic" / "kernel.py"
    text = kernel.read_text()
    kernel.write_text(text.replace("plastic = max(before,", "plastic = zero * max(before,"))
    edited = collided(installed)
    kernel.write_text(text)
    assert edited["misses"] == 1
    assert edited["restitution"] == pytest.approx([1.0, 1.0], rel=0.05)  # nothing yields any more


def test_a_scene_may_name_an_installed_law(installed: Path) -> None:
    """Wrong keys get the words that those of other laws get; the soil node says which sources it has."""
    scene = str(installed / "scene.yaml")
    checked = python(installed, "-m", "subsoil_ros.cli.main", "check", scene)
    assert checked.returncode == 0, checked.stderr
    override = "soil.law.particle.unloadin_stiffness_newton_per_m=1.0"
    wrong = python(installed, "-m", "subsoil_ros.cli.main", "check", scene, "--set", override)
    assert "did you mean 'unloading_stiffness_newton_per_m'?" in wrong.stderr
    said = python(
        installed, "-c", "from subsoil_ros.coupling.protocol import CAPABILITIES as c; print(c['soil'])"
    )
    assert re.search(r"'contact_law hysteretic [0-9a-f]{16}'", said.stdout), said.stderr


@pytest.mark.full
def test_nodes_and_a_direct_run_have_the_same_bits(installed: Path, tmp_path: Path) -> None:
    """A tool in soil: the series and every message, to the byte; the node processes find the law too."""
    one, other = tmp_path / "direct", tmp_path / "nodes"
    for out in (one, other):
        arguments = ("run", str(installed / "tine.yaml"), "--mode", out.name, "--out", str(out))
        done = python(installed, "-m", "subsoil_ros.cli.main", *arguments)
        assert done.returncode == 0, done.stderr
    head, *_, last = (one / "series.csv").read_text().splitlines()
    assert float(dict(zip(head.split(","), last.split(","), strict=True))["tool.tine.force_x_newton"]) < -1.0
    assert (one / "series.csv").read_bytes() == (other / "series.csv").read_bytes()
    assert without_wall_time(one) == without_wall_time(other)


def test_a_law_that_cannot_be_imported_stops_only_scenes_that_name_it(
    installed: Path, tmp_path: Path
) -> None:
    """The metadata without the package: the tine is checked, and the message says what is wrong."""
    metadata = installed / "hysteretic-1.0.dist-info"
    (tmp_path / metadata.name).mkdir()
    for file in metadata.iterdir():
        (tmp_path / metadata.name / file.name).write_text(file.read_text())
    tine = PAGE.parents[1] / "config" / "scenes" / "tine.yaml"
    assert python(tmp_path, "-m", "subsoil_ros.cli.main", "check", str(tine)).returncode == 0
    named = python(tmp_path, "-m", "subsoil_ros.cli.main", "check", str(installed / "scene.yaml"))
    assert "soil.law.kind: contact law 'hysteretic' is installed, but" in named.stderr
    assert "No module named 'hysteretic'" in named.stderr
