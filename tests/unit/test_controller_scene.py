"""Scenes with a controller: what is refused, and with which words."""

import json
from pathlib import Path

import pytest

from subsoil_ros.cli.main import main
from subsoil_ros.errors import SceneError
from subsoil_ros.loading.loader import load_scene

SCENE = Path(__file__).parents[2] / "config/scenes/mechanism_only.yaml"
CONTROL = {
    "driver": "H10_drive", "interval_ticks": 20, "lowest_speed": 0.1, "highest_speed": 0.5,
    "max_acceleration": 1.0,
    "law": {"kind": "draft_limit", "draft_limit_newton": 500.0, "gain_per_kg": 0.01},
}  # fmt: skip
GIVEN = [f"controller={json.dumps(CONTROL)}"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("controller.driver=H9_spring", "controller.driver: no driver 'H9_spring'; drivers are H10_drive"),
        (
            "controller.interval_ticks=5",
            "interval_ticks: given 5, allowed are multiples of record.series_ticks",
        ),
        ("controller.lowest_speed=0.5", "highest_speed 0.5 must be larger"),
        (
            "controller.highest_speed=0.4",
            "speed.value: given 0.5, outside of the controller's speeds",
        ),
        ("mechanism.joints.H10_drive.coordinate=angle", "'draft_limit' answers with a speed in m/s"),
        ("mechanism.draft_driver=null", "'draft_limit' needs mechanism.draft_driver"),
        (
            "mechanism.joints.H10_drive.speed={kind: ramp, end_value: 0.5, end_s: 1.0}",
            "given a law of kind 'ramp', .* it must be 'constant'",
        ),
    ],
)
def test_what_does_not_fit_is_refused(change: str, words: str) -> None:
    """Another driver, a rate between states, speeds that exclude the start, no draft, a law."""
    load_scene(SCENE, [*GIVEN, "record.series_ticks=10"])
    with pytest.raises(SceneError, match=words):
        load_scene(SCENE, [*GIVEN, "record.series_ticks=10", change])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--paused"], "--paused: a direct run has no services"),
        (
            ["--set", GIVEN[0], "--set", "controller.law={kind: external}"],
            "'external' is a node of its own",
        ),
    ],
)
def test_a_direct_run_refuses_what_needs_nodes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    """Exit 2, and nothing is written."""
    out = tmp_path / "out"
    assert main(["run", str(SCENE), "--out", str(out), "--mode", "direct", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()
