"""Runs that end early, in every way and resumed, in fresh processes: the same last tick, the same bits."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.system.conftest import lockstep_ticks, messages
from tests.system.test_modes import without_wall_time

SCENES = Path(__file__).parents[2] / "config" / "scenes"
VALUES = {
    "density_kg_per_m3": 1300.0, "cohesion_pa": 8e3, "friction_angle_rad": 0.5, "adhesion_pa": 1e3,
    "tool_friction_angle_rad": 0.3,
}  # fmt: skip
TINE = {
    "base": str(SCENES / "tine.yaml"),
    "duration_s": 8.0,
    "soil": {
        "model": "wedge",
        "bin": {"length_m": 100.0, "width_m": 1.0, "depth_m": 0.4},
        "values": VALUES,
    },
    "coupling": {"communication_step_ns": 2_000_000, "residual_bound": 0.5},
    "record": {"series_ticks": 10, "checkpoint_s": 0.7},
    "stop_when": {"relative_interval": 0.08, "at_most_m": 60.0},
}
"""A path and wedges; ends because its mean is known."""
MACHINE = {
    "base": str(SCENES / "subsoiler_1s300_wedge.yaml"),
    "duration_s": 0.8,
    "mechanism": {"initial": {"translate_x_m": 0.4}},
    "stop_when": {"metric": "draft.share_newton", "relative_interval": 1e-6, "at_most_m": 0.02},
}
"""A mechanism and wedges; ends by its travel."""
PARTICLES = {
    "base": str(SCENES / "tine.yaml"),
    "duration_s": 0.3,
    "soil": {"bin": {"length_m": 0.4, "width_m": 0.1, "depth_m": 0.25}},
    "coupling": {"communication_step_ns": 300_000},
    "record": {"series_ticks": 3, "cloud_hz": 13},
    "report": {"window_inside_m": 0.05},
    "stop_when": {"relative_interval": 1e-6, "at_most_m": 0.04},
}
"""A path and particles, whose clouds do not come at the tick with which it ends; ends by its travel."""
CASES = {"tine": TINE, "machine": MACHINE, "particles": PARTICLES}


def run(folder: Path, document: dict, mode: str, *more: str) -> Path:
    """A run as a user starts it; its folder."""
    folder.mkdir(parents=True)
    (folder / "scene.yaml").write_text(yaml.safe_dump(document))
    out = folder / "out"
    command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", str(folder / "scene.yaml")]
    command += ["--mode", mode, "--out", str(out), *more]
    result = subprocess.run(command, capture_output=True, text=True, env=dict(os.environ), check=False)
    assert result.returncode == 0, result.stderr
    assert "stop_when: " in result.stdout
    return out


def facts(out: Path) -> dict:
    """What does not depend on how the run was made."""
    found = json.loads((out / "summary.json").read_text())["run"]
    return {key: found[key] for key in ("complete", "ticks", "stop_when", "state_sha256")}


@pytest.fixture(scope="module")
def direct(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Result folders of direct runs, by case."""
    return {name: run(tmp_path_factory.mktemp(name) / "direct", CASES[name], "direct") for name in CASES}


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "mode"),
    [("tine", "nodes"), ("machine", "composed"), ("particles", "composed"), ("particles", "nodes")],
)
def test_every_mode_ends_at_the_same_tick(
    direct: dict[str, Path], tmp_path: Path, name: str, mode: str
) -> None:
    """Before its duration; series, every message of the bag, what is known of the mean and the full state."""
    out = run(tmp_path / mode, CASES[name], mode)
    assert facts(out) == facts(direct[name])
    assert (out / "series.csv").read_bytes() == (direct[name] / "series.csv").read_bytes()
    assert without_wall_time(out) == without_wall_time(direct[name])


@pytest.mark.parametrize("name", CASES)
def test_the_bag_ends_with_a_series_tick(direct: dict[str, Path], name: str) -> None:
    """Before the duration: each lockstep message once, at the end a report, and a cloud of particles."""
    found, document = facts(direct[name]), CASES[name]
    step_ns = document.get("coupling", {}).get("communication_step_ns", 1_000_000)
    assert found["complete"]
    assert found["ticks"] * step_ns * 1e-9 < document["duration_s"] - 0.05
    bag = direct[name] / "bag"
    assert all(ticks == list(range(found["ticks"])) for ticks in lockstep_ticks(bag, step_ns).values())
    at_end = {topic for topic, time_ns, _ in messages(bag) if time_ns == found["ticks"] * step_ns}
    assert any(topic.endswith("coupling_report") for topic in at_end)
    assert any(topic.endswith("soil/points") for topic in at_end) == (name == "particles")


@pytest.mark.full
@pytest.mark.parametrize("mode", ["direct", "nodes"])
def test_a_resumed_run_ends_at_the_same_tick(direct: dict[str, Path], tmp_path: Path, mode: str) -> None:
    """From a checkpoint before the end, and from that of the check tick that ends the run."""
    whole = direct["tine"]
    resumed = run(tmp_path / "resumed", TINE, mode, "--resume", str(whole))
    check_s = (facts(whole)["ticks"] - 1) * 2e-3  # at the end of the check tick
    last = TINE | {"record": TINE["record"] | {"checkpoint_s": check_s}}
    first = run(tmp_path / "first", last, "direct")
    after_check = run(tmp_path / "after_check", last, mode, "--resume", str(first))
    start = json.loads((after_check / "summary.json").read_text())["run"]["resumed_from"]["tick"]
    assert start == facts(whole)["ticks"] - 2
    for out in (resumed, after_check):
        assert facts(out) == facts(whole)
        assert (out / "series.csv").read_bytes() == (whole / "series.csv").read_bytes()


@pytest.mark.full
def test_threads_give_the_same_end(direct: dict[str, Path], tmp_path: Path) -> None:
    """Of the soil engine, two in place of one."""
    environment = os.environ.get("NUMBA_NUM_THREADS")
    if environment is not None and int(environment) < 2:
        pytest.skip("NUMBA_NUM_THREADS allows one thread only")
    out = run(tmp_path / "two", PARTICLES, "direct", "--threads", "2")
    assert facts(out) == facts(direct["particles"])
