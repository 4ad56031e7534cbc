"""A run that ends once its mean is known: where it ends, what it leaves, what is refused."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pandas as pd
import pytest
import yaml

import subsoil_ros as subsoil
from subsoil_ros.analysis.known_mean import KnownMean
from subsoil_ros.analysis.metrics_window import metrics_window
from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.api.read import Run
from subsoil_ros.cli.main import main
from subsoil_ros.errors import InterruptedRunError, SceneError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import Command, Grant, ToolMotion, ToolMotions, ToolWrench, ToolWrenches
from subsoil_ros.recording.bag_info import describe
from subsoil_ros.recording.bag_reader import BagReader
from tests.unit.analysis.made_up_series import pulled, two_ranks

ROOT = Path(__file__).parents[3]
STEP_NS, CHECK_TICKS, BIN_TICKS = 2_000_000, 50, 5
WANTED = {"relative_interval": 0.08, "at_most_m": 60.0}
DOCUMENT: dict[str, Any] = {
    "base": str(ROOT / "config/scenes/tine.yaml"),
    "duration_s": 8.0,
    "soil": {
        "model": "wedge",
        "bin": {"length_m": 100.0, "width_m": 1.0, "depth_m": 0.4},
        "values": {
            "density_kg_per_m3": 1300.0,
            "cohesion_pa": 8e3,
            "friction_angle_rad": 0.5,
            "adhesion_pa": 1e3,
            "tool_friction_angle_rad": 0.3,
        },
    },
    "coupling": {"communication_step_ns": STEP_NS, "residual_bound": 0.5},
    "record": {"series_ticks": 10},
    "stop_when": WANTED,
}


def scene(path: Path, **changes: Any) -> Path:
    """A tine on a wedge model in a field, its stop_when changed."""
    path = path / "scene.yaml"
    keys = {key: value for key, value in (WANTED | changes).items() if value is not None}
    path.write_text(yaml.safe_dump(DOCUMENT | {"stop_when": keys}))
    return path


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run that ends early, its mean being known."""
    folder = tmp_path_factory.mktemp("ended")
    return subsoil.run(scene(folder), folder / "out")


def last_tick(found: Run) -> int:
    """The tick with which a run has ended."""
    return int(found.summary["run"]["ticks"]) - 1


def test_the_run_ends_after_the_first_check_that_knows_the_mean(ended: Run) -> None:
    """The tick is predicted from the recorded forces and places."""
    assert ended.folder is not None
    reader = BagReader(ended.folder / "bag")
    draft = np.array([-r.tools[0].force_x_newton for r in reader.records(ToolWrenches) if r.tick >= 0])
    tip = np.array([r.tools[0].x_m for r in reader.records(ToolMotions) if r.tick >= 0]) + 0.12
    first = int(np.argmax(tip >= 0.2))  # report.window_inside_m
    predicted = None
    for tick in range(CHECK_TICKS - 2, len(draft), CHECK_TICKS):
        count = max(0, (tick + 1 - first) // BIN_TICKS)
        means = draft[first : first + count * BIN_TICKS].reshape(-1, BIN_TICKS).mean(axis=1)
        found = stationarity(np.arange(count) * BIN_TICKS * STEP_NS * 1e-9, means)
        if found is None or found.verdict != "no drift seen":
            continue
        if found.mean_half_width <= WANTED["relative_interval"] * found.mean:
            predicted, expected = tick + 1, found
            break
    assert predicted == last_tick(ended) < 3999
    result = ended.summary["run"]["stop_when"]
    assert result["reached"]
    assert result["mean"] == pytest.approx(expected.mean, rel=1e-12)
    assert result["half_width"] == pytest.approx(expected.mean_half_width, rel=1e-9)
    assert result["travel_m"] == pytest.approx(tip[predicted - 1] - tip[0], rel=1e-12)


def test_the_record_ends_with_the_last_tick(ended: Run) -> None:
    """Series, an END in the last grant, a complete run, a summary that its schema allows."""
    assert ended.folder is not None
    end_s = (last_tick(ended) + 1) * STEP_NS * 1e-9
    assert ended.series["time_s"].iloc[-1] == pytest.approx(end_s, rel=1e-12)
    grants = list(BagReader(ended.folder / "bag").records(Grant))
    assert [grant.tick for grant in grants if grant.command is Command.END] == [last_tick(ended)]
    assert grants[-1].command is Command.END
    assert ended.summary["run"]["complete"]
    assert describe(ended.folder / "bag").complete
    schema = json.loads((ROOT / "config/summary.schema.json").read_text())
    jsonschema.Draft202012Validator(schema).validate(ended.summary)


def test_a_resumed_run_ends_at_the_same_tick(ended: Run, tmp_path: Path) -> None:
    """Interrupted within a bin, and at the end of the check tick that ends the run: the same bits."""
    for number, done in enumerate((1003, last_tick(ended))):

        def interrupt(ticks: int, count: int, at: int = done) -> None:
            if ticks == at:
                raise KeyboardInterrupt

        first, second = tmp_path / f"first{number}", tmp_path / f"second{number}"
        with pytest.raises(InterruptedRunError):
            subsoil.run(scene(tmp_path), first, progress=interrupt)
        assert not subsoil.read_run(first).summary["run"]["complete"]
        resumed = subsoil.run(scene(tmp_path), second, resume=first)
        pd.testing.assert_frame_equal(resumed.series, ended.series, check_exact=True)
        for key in ("state_sha256", "stop_when", "complete"):
            assert resumed.summary["run"][key] == ended.summary["run"][key]


@pytest.mark.parametrize(
    ("changes", "overrides", "travel_m"),
    [({"at_most_m": 0.3}, [], 0.3), ({"at_most_m": None}, ["--set", "duration_s=0.55"], 0.274)],
    ids=["at_most_m", "duration_s"],
)
def test_a_mean_that_is_not_reached_is_said(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    changes: Mapping[str, Any],
    overrides: list[str],
    travel_m: float,
) -> None:
    """After the longest travel, or at the end of the time: exit status 0, a line, and in the summary."""
    out = tmp_path / "out"
    path = scene(tmp_path, relative_interval=1e-6, **changes)
    assert main(["run", str(path), "--mode", "direct", "--out", str(out), *overrides]) == 0
    assert "stop_when: WARNING: not reached after 0." in capsys.readouterr().out
    run = subsoil.read_run(out).summary["run"]
    assert run["complete"]
    assert not run["stop_when"]["reached"]
    assert travel_m <= run["stop_when"]["travel_m"] < travel_m + 0.5 * 0.1 + 0.001  # a check every 0.1 s


def test_the_mean_of_two_ranks_counts_in_the_metrics_window(tmp_path: Path) -> None:
    """From the first tick with both tips inside the margins to the last one, as the summary's mean does."""
    resolved = two_ranks(
        tmp_path, coupling={"communication_step_ns": 10_000_000}, stop_when={"relative_interval": 0.05}
    )
    series = pulled(resolved, 0.003 + 0.01 * np.arange(1, 801), (0.5, 0.5), 1000.0)
    window, rule, counted = metrics_window(series, resolved), KnownMean(resolved), []
    for tick in range(len(series)):
        row = {name: values[tick] for name, values in series.columns.items()}
        motions = [
            ToolMotion(name, row[f"tool.{name}.x_m"], 0.0, row[f"tool.{name}.z_m"], 0.0, 0.5, 0.0, 0.0)
            for name in resolved.scene.tools
        ]
        wrenches = [
            ToolWrench(name, row[f"tool.{name}.force_x_newton"], *[0.0] * 6, 1)
            for name in resolved.scene.tools
        ]
        rule.add(tick, tuple(motions), tuple(wrenches))
        counted.append(rule.state.started and not rule.state.ended)
    np.testing.assert_array_equal(counted, window.rows)
    assert set(rule.state.means) == {2000.0}


def test_confidence_widens_the_interval(ended: Run, tmp_path: Path) -> None:
    """At 0.99 the half-width is that of the wider t interval, so the run is longer."""
    longer = subsoil.run(scene(tmp_path, confidence=0.99))
    assert last_tick(longer) > last_tick(ended)
    assert longer.summary["run"]["stop_when"]["confidence"] == 0.99


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["stop_when.relative_interval=1.0"], "stop_when.relative_interval: .*1"),
        (["stop_when.relative_interval=0"], "stop_when.relative_interval: .*0"),
        (["stop_when.confidence=0.5"], "stop_when.confidence: .*0.5"),
        (["stop_when.at_most_m=0"], "stop_when.at_most_m: .*0"),
        (["stop_when.metric=draft"], "stop_when.metric: .*draft_newton"),
        (["tools.tine.role=wheel"], r"stop_when: tools are tine \(wheel\); one must be of role 'tillage'"),
        (["record.bag=false"], "stop_when: given with record.bag: false.*set record.bag: true"),
    ],
)
def test_what_cannot_work_is_refused(tmp_path: Path, overrides: list[str], message: str) -> None:
    """Where, what was given and what is allowed."""
    with pytest.raises(SceneError, match=message):
        load_scene(scene(tmp_path), overrides)


@pytest.mark.parametrize(
    ("name", "metric", "message"),
    [
        ("mechanism_only", "draft.share_newton", "stop_when: given without 'soil'"),
        ("subsoiler_1s300_wedge", "draft_newton", "stop_when.metric: .*give 'draft.share_newton'"),
        ("subsoiler_1s300_draft_limit", "draft.share_newton", "stop_when: given with 'controller'"),
    ],
)
def test_scenes_that_have_no_such_mean_are_refused(name: str, metric: str, message: str) -> None:
    """Without soil, with a draft that the tools alone do not give, with a controller."""
    with pytest.raises(SceneError, match=message):
        load_scene(
            ROOT / f"config/scenes/{name}.yaml",
            [f"stop_when={{metric: {metric}, relative_interval: 0.05}}"],
        )
