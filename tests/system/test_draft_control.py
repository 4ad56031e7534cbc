"""The example examples/draft_control: its law, and a short run of it as a user starts it."""

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import BodyState, DriverCommand, MechanismState
from subsoil_ros.recording.bag_reader import BagReader

EXAMPLE = Path(__file__).parents[2] / "examples" / "draft_control"
INTERVAL_S = 0.02
SLOPE_NEWTON_PER_M = 5000.0


@pytest.fixture(scope="module")
def controller() -> ModuleType:
    """The example's module."""
    spec = importlib.util.spec_from_file_location("draft_controller", EXAMPLE / "controller.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses ask for it
    spec.loader.exec_module(module)
    return module


def drive(controller: ModuleType, depth_m: float, target: float, duration_s: float) -> np.ndarray:
    """Draft [N] and commanded speed [m/s] of a soil with F = slope x depth, (n, 2), interval by interval."""
    keys = load_scene(EXAMPLE / "toolbar.yaml").scene.controller
    law = controller.DraftControl(keys, controller.Targets(target, target, 0.0), INTERVAL_S)
    speed, found = 0.0, []
    for tick in range(1, round(duration_s / INTERVAL_S)):
        draft = SLOPE_NEWTON_PER_M * depth_m
        state = MechanismState("run", tick - 1, 0, draft, *[0.0] * 9, 0, bodies=(BodyState("b", *[0.0] * 9),))
        command = law.command(tick, state)
        depth_m -= 0.5 * (speed + command.speed) * INTERVAL_S  # the ramp of the driver; speed is upward
        speed = command.speed
        found.append((draft, speed))
    return np.array(found)


def test_the_draft_goes_to_its_target_as_the_loop_says(controller: ModuleType) -> None:
    """From either side, without overshoot, at the rate of the slower mode of the sampled loop.

    Depth d, filtered draft f and last speed v, interval by interval: f' = f + a (S d - f), v' = G f',
    d' = d - (v + v') H / 2. Of the faster mode a hundredth is left where the rate is measured.
    """
    slope, gain = SLOPE_NEWTON_PER_M, controller.GAIN_M_PER_NEWTON_S
    part = INTERVAL_S / (controller.FILTER_S + INTERVAL_S)
    filtered = np.array([part * slope, 1.0 - part, 0.0])
    depth = np.array([1.0, 0.0, 0.0]) - 0.5 * INTERVAL_S * (np.array([0.0, 0.0, 1.0]) + gain * filtered)
    modes = np.linalg.eigvals(np.array([depth, filtered, gain * filtered]))
    assert np.abs(modes.imag).max() == 0.0
    assert 0.0 < modes.real.max() < 1.0
    rate = -np.log(modes.real.max()) / INTERVAL_S
    for depth_m in (0.2, 0.3):
        error = drive(controller, depth_m, 1250.0, 6.0)[:, 0] - 1250.0
        assert (error[0] * error > 0.0).all()
        first, span = int(np.argmax(np.abs(error) < 20.0)) + 20, 25
        measured = np.log(error[first] / error[first + span]) / (span * INTERVAL_S)
        assert measured == pytest.approx(rate, rel=0.01)


def test_the_hitch_is_asked_for_what_it_can(controller: ModuleType) -> None:
    """Speeds and their changes stay within the scene's limits, however far the draft is off."""
    keys = load_scene(EXAMPLE / "toolbar.yaml").scene.controller
    assert keys is not None
    speeds = np.concatenate([[0.0], drive(controller, 0.3, 400.0, 2.0)[:, 1]])
    assert speeds.max() == keys.highest_speed
    change = np.abs(np.diff(speeds)).max()
    assert change <= keys.max_acceleration * INTERVAL_S * (1.0 + 1e-12)


def test_it_holds_still_before_the_share_meets_soil(controller: ModuleType) -> None:
    """Without draft the hitch does not dive."""
    assert (drive(controller, 0.01, 1300.0, 1.0)[:, 1] == 0.0).all()


@pytest.mark.full
def test_the_example_runs(tmp_path: Path) -> None:
    """As its README says, in real time for 1.8 s: a command every 20 ms, the draft goes to its target."""
    out = tmp_path / "out"
    done = subprocess.run(
        [
            sys.executable, str(EXAMPLE / "run.py"), "--out", str(out), "--target", "1100", "--step-at", "9",
            "--set", "duration_s=1.8", "--real-time",
        ],
        capture_output=True, text=True, timeout=240.0, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    late = re.search(r"^real time: the run was at most (\d+\.\d) ms late$", done.stdout, re.MULTILINE)
    assert late, done.stdout
    wall_s = json.loads((out / "summary.json").read_text())["run"]["wall_s"]
    assert wall_s > 1.8 - 3 * INTERVAL_S  # never ahead of the clock, which begins with the first command
    resolved = load_scene(out / "scene.yaml")
    ticks = [command.tick for command in BagReader(out / "bag").records(DriverCommand)]
    assert ticks == list(range(20, resolved.timing.tick_count, 20))
    head, *rows = (out / "series.csv").read_text().splitlines()
    draft = [float(row.split(",")[head.split(",").index("draft_newton")]) for row in rows]
    assert np.mean(draft[-20:]) == pytest.approx(1100.0, abs=150.0)
    assert (out / "draft_control.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.full
def test_the_example_runs_in_particles(tmp_path: Path) -> None:
    """The other scene, 0.1 s of it in a small bin: the share stands in soil, commanded all the same."""
    out = tmp_path / "out"
    small = [
        "duration_s=0.1", "soil.bin.length_m=0.5", "soil.bin.width_m=0.12",
        "mechanism.initial.translate_x_m=0.0",
    ]  # fmt: skip
    words = [word for change in small for word in ("--set", change)]
    done = subprocess.run(
        [
            sys.executable, str(EXAMPLE / "run.py"), "--scene", "toolbar_particles.yaml", "--out", str(out),
            "--step-at", "0.05", *words,
        ],
        capture_output=True, text=True, timeout=240.0, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    resolved = load_scene(out / "scene.yaml")
    every, count = resolved.scene.controller.interval_ticks, resolved.timing.tick_count
    assert [command.tick for command in BagReader(out / "bag").records(DriverCommand)] == list(
        range(every, count, every)
    )
    summary = json.loads((out / "summary.json").read_text())
    assert summary["particles"]["count"] > 1000
    assert summary["series"]["draft_newton"]["run"]["max"] > 100.0
