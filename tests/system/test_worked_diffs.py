"""The examples of CONTRIBUTING.md for a joint, a force element and a run option, in a copy of the sources."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SECTIONS = ("Add a joint", "Add a force element", "Add a run option")
SCENE = """
name: gear_and_drag
duration_s: 0.5
gravity_m_per_s2: 0.0
mechanism:
  bodies:
    first: {mass_kg: 1.0, inertia_kg_m2: 0.1, position_m: [0.0, 0.0]}
    second: {mass_kg: 1.0, inertia_kg_m2: 0.1, position_m: [1.0, 0.0]}
    sled: {mass_kg: 2.0, inertia_kg_m2: 0.1, position_m: [0.0, 1.0], velocity_m_per_s: [3.0, 4.0]}
  joints:
    first_pin: {kind: revolute, body_a: ground, body_b: first, point_m: [0.0, 0.0]}
    second_pin: {kind: revolute, body_a: ground, body_b: second, point_m: [1.0, 0.0]}
    motor: {kind: driver, body: first, coordinate: angle, speed: {kind: constant, value: 2.0}}
    gear: {kind: gear, body_a: first, body_b: second, ratio: -1.5}
  forces:
    air: {kind: drag, body: sled, coefficient_newton_s2_per_m2: 0.8}
"""
PROGRAM = """
import json, sys
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
resolved = load_scene(sys.argv[1])
engine = MechanismEngine(resolved.scene, resolved.timing)
for tick in range(resolved.timing.tick_count):
    engine.advance(tick, ())
end_ns = resolved.timing.tick_count * resolved.timing.communication_step_ns
state = engine.state("run", tick, end_ns)
bodies = {body.name: body for body in state.bodies}
print(json.dumps({
    "time_s": 1e-9 * end_ns,
    "angles": [bodies[name].angle_rad for name in ("first", "second")],
    "sled": [bodies["sled"].velocity_x_m_per_s, bodies["sled"].velocity_z_m_per_s],
    "dissipated": state.dissipated_joule,
    "reported": [[force.name, force.rate, force.load] for force in state.forces],
    "free": engine.topology.freedom_count,
}))
"""
OPTIONS = """
import argparse
from pathlib import Path
from subsoil_ros.cli.run import add_arguments
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.ros.process.node_plan import nodes_of
parser = argparse.ArgumentParser()
add_arguments(parser)
assert parser.parse_args(["scene", "--out", "out", "--niceness", "5"]).niceness == 5
run = RunSettings(load_scene("config/scenes/tine.yaml"), niceness=7)
given = {node.name: node.parameters.get("niceness") for node in nodes_of(run, Path("tine.yaml"))}
assert given == {"soil": 7, "recorder": None, "coupler": None}, given
from subsoil_ros.ros.process.parameters import PARAMETERS
assert PARAMETERS["niceness"].limits == (0, 19)
"""


def hunks(section: str) -> list[tuple[str, list[str]]]:
    """Files of a section's diff, with signed lines: an anchor (context, removal) and what is added at it."""
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (text,) = re.findall(rf"^## {section}\n.*?^```text\n(.*?)^```$", page, re.S | re.M)
    found: list[tuple[str, list[str]]] = []
    file, anchored = "", False
    for line in text.splitlines():
        if header := re.fullmatch(r" ((?:subsoil_ros|docs)/[^\s,]+)(, \w+| \(new\))?", line):
            file = header[1]
            found.append((file, []))
            anchored = False
        elif line:
            if anchored and line[0] != "+" and found[-1][1][-1][0] == "+":
                found.append((file, []))
            anchored = line[0] != "+" or bool(found[-1][1] and anchored)
            found[-1][1].append(line)
    return found


def apply(section: str, folder: Path) -> set[str]:
    """Apply a section's diff to the sources in `folder`; return its files."""
    for file, lines in hunks(section):
        path = folder / file
        old, new = ("".join(f"{line[1:]}\n" for line in lines if line[0] != sign) for sign in "+-")
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        assert text.count(old) == 1, (file, old)
        path.write_text(text.replace(old, new), encoding="utf-8")
    return {file for file, _ in hunks(section)}


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources with all examples applied."""
    folder = tmp_path_factory.mktemp("sources")
    for name in ("subsoil_ros", "config", "docs", "msg_defs"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for section in SECTIONS:
        assert len(apply(section, folder)) <= 3
    (folder / "scene.yaml").write_text(SCENE)
    return folder


def python(folder: Path, *arguments: str) -> str:
    """Output of another process that imports the changed sources; it keeps its kernels beside them."""
    paths = filter(None, (str(folder), os.environ.get("PYTHONPATH")))
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        "NUMBA_CACHE_DIR": str(folder / "kernels"),
    }
    done = subprocess.run(
        [sys.executable, *arguments], env=environment, cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_run_option_is_offered_everywhere(changed: Path) -> None:
    """Command line, settings, parameters of the node that takes it, and of no other; the docs' table."""
    python(changed, "-c", OPTIONS)
    assert "| `niceness` |" in (changed / "docs/ros.md").read_text(encoding="utf-8")


def test_the_scene_knows_the_new_kinds(changed: Path) -> None:
    """Its schema has them, with their keys."""
    schema = python(changed, "-m", "subsoil_ros.cli.main", "schema")
    assert all(f'"{word}"' in schema for word in ("gear", "ratio", "drag", "coefficient_newton_s2_per_m2"))


@pytest.mark.full
def test_a_machine_has_the_new_joint_and_the_new_force(changed: Path) -> None:
    """Angles in the ratio of the gear; v = v0 / (1 + c v0 t / m), and the energy that the drag took."""
    found = json.loads(python(changed, "-c", PROGRAM, "scene.yaml").splitlines()[-1])
    angle = 2.0 * found["time_s"]
    assert found["angles"] == pytest.approx([angle, -1.5 * angle], rel=1e-9)
    speed = 5.0 / (1.0 + 0.8 * 5.0 * found["time_s"] / 2.0)
    assert found["sled"] == pytest.approx([0.6 * speed, 0.8 * speed], rel=1e-4)
    assert found["dissipated"] == pytest.approx(0.5 * 2.0 * (25.0 - speed**2), rel=1e-4)
    assert found["reported"] == [
        ["air", pytest.approx(speed, rel=1e-4), pytest.approx(0.8 * speed**2, rel=1e-3)]
    ]
    assert found["free"] == 3
