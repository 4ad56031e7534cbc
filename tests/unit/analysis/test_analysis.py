"""Series, window and summary of a run, from bags with known content."""

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.analysis.metrics_window import metrics_window, tip_paths_m, tip_x_m
from subsoil_ros.analysis.series import Series, read_series, running_mean, write_series_csv
from subsoil_ros.analysis.summarize import summarize
from subsoil_ros.errors import RecordingError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import (
    CouplingReport,
    MechanismState,
    SoilState,
    ToolMotions,
    ToolWrenches,
)
from tests.unit.analysis.made_up_runs import INTERVAL_NS, SCENES, TICKS, Run, full_machine, tine
from tests.unit.analysis.made_up_series import pulled, two_ranks


@pytest.fixture(scope="module")
def machine(tmp_path_factory) -> tuple[Run, Path]:
    """The full machine, recorded."""
    run = Run(full_machine())
    return run, run.write(tmp_path_factory.mktemp("machine") / "run")


def test_series_are_the_numbers_of_the_engines(machine):
    """Each column of a bag with a mechanism and soil holds exactly what was recorded."""
    run, directory = machine
    series = read_series(directory / "bag", run.resolved.scene)
    ticks = run.series_ticks()
    assert next(iter(series.columns)) == "time_s"
    np.testing.assert_array_equal(series["time_s"], [(tick + 1) * INTERVAL_NS * 1e-9 for tick in ticks])
    expected = {
        "draft_newton": (MechanismState, lambda s: s.draft_newton),
        "draft.share_newton": (ToolWrenches, lambda w: -w.tools[0].force_x_newton),
        "draft.wheels_newton": (
            ToolWrenches, lambda w: -(w.tools[1].force_x_newton + w.tools[2].force_x_newton)
        ),
        "spring.H9_spring.force_newton": (MechanismState, lambda s: s.forces[0].load),
        "body.shank.z_m": (MechanismState, lambda s: s.bodies[0].z_m),
        "body.frame.angular_velocity_rad_per_s": (
            MechanismState, lambda s: s.bodies[6].angular_velocity_rad_per_s,
        ),
        "joint.H8_shank_hinge.force_z_newton": (MechanismState, lambda s: s.joints[7].force_z_newton),
        "mechanism.driver_work_joule": (MechanismState, lambda s: s.driver_work_joule),
        "tool.wheel_left.angle_rad": (ToolMotions, lambda m: m.tools[1].angle_rad),
        "tool.shank.torque_y_newton_m": (ToolWrenches, lambda w: w.tools[0].torque_y_newton_m),
        "tool.shank.blade.force_x_newton": (ToolWrenches, lambda w: w.tools[0].groups[1].force_x_newton),
        "soil.kinetic_energy_joule": (SoilState, lambda s: s.kinetic_energy_joule),
        "soil.particle_count": (SoilState, lambda s: s.particle_count),
        "coupling.residual_ratio": (CouplingReport, lambda c: c.residual_ratio),
    }  # fmt: skip
    for name, (kind, take) in expected.items():
        np.testing.assert_array_equal(series[name], run.column(kind, take), err_msg=name)


def test_series_have_no_wall_time(machine):
    """Equal runs have equal series: no column depends on how fast the computer was."""
    run, directory = machine
    series = read_series(directory / "bag", run.resolved.scene)
    assert not [name for name in series.columns if "wall" in name]
    assert series.wall_time_s == 0.5 * (TICKS - 1)


def test_csv_gives_back_the_same_bits(machine, tmp_path):
    """series.csv read by another reader has the bits of every number, and counts stay integers."""
    run, directory = machine
    series = read_series(directory / "bag", run.resolved.scene)
    write_series_csv(series, tmp_path / "series.csv")
    with (tmp_path / "series.csv").open() as stream:
        heading, *rows = csv.reader(stream)
    assert heading == list(series.columns)
    assert len(rows) == len(run.series_ticks())
    for place, name in enumerate(heading):
        np.testing.assert_array_equal([float(row[place]) for row in rows], series[name])
    assert {row[heading.index("soil.particle_count")] for row in rows} == {"300"}


def test_draft_without_mechanism_is_the_pull_against_the_soil(tmp_path):
    """A tool on a path is pulled with minus the soil's force, and there are no wheels to split off."""
    run = Run(tine())
    series = read_series(run.write(tmp_path / "run") / "bag", run.resolved.scene)
    pull = run.column(ToolWrenches, lambda w: -w.tools[0].force_x_newton)
    np.testing.assert_array_equal(series["draft_newton"], pull)
    np.testing.assert_array_equal(series["draft.share_newton"], pull)
    assert "draft.wheels_newton" not in series


def test_a_run_cut_short_has_its_complete_rows(tmp_path):
    """Series end with the last complete series tick; the summary says that the run is not complete."""
    run = Run(tine())
    directory = run.write(tmp_path / "run", count=14)
    series = read_series(directory / "bag", run.resolved.scene)
    np.testing.assert_array_equal(series["time_s"], [tick * INTERVAL_NS * 1e-9 for tick in (4, 8, 12)])
    summary = summarize(directory / "bag", run.resolved, {})
    assert (summary.run.complete, summary.run.ticks, summary.run.steps) == (False, 12, 12)


def test_a_bag_without_a_series_tick_is_an_error(tmp_path):
    """A run that ended before its first series tick is told so, not given empty statistics."""
    run = Run(tine())
    directory = run.write(tmp_path / "run", count=2)
    with pytest.raises(RecordingError, match="not one complete series tick"):
        read_series(directory / "bag", run.resolved.scene)


def test_tip_moves_with_the_shank(machine):
    """The tip's place is the reference arm turned by the shank's angle, about its centre of mass."""
    run, directory = machine
    scene = run.resolved.scene
    series = read_series(directory / "bag", scene)
    shank, (tip_x, tip_z) = scene.mechanism.bodies["shank"], scene.report.tip_m
    arm = complex(tip_x - shank.position_m[0], tip_z - shank.position_m[1])
    turned = arm * np.exp(1j * (series["body.shank.angle_rad"] - shank.angle_rad))  # phi from x to z
    np.testing.assert_allclose(tip_x_m(series, scene), series["body.shank.x_m"] + turned.real, rtol=1e-14)


def test_window_is_where_the_tip_is_inside_and_the_wheels_are_clear(machine):
    """Rows count from the tip's entry plus the margin until the wheels come to the end of the bin."""
    run, directory = machine
    scene = run.resolved.scene
    scene = scene.model_copy(update={"report": scene.report.model_copy(update={"window_inside_m": 0.15})})
    bin_ = scene.soil.bin.model_copy(update={"length_m": 1.0})
    scene = scene.model_copy(update={"soil": scene.soil.model_copy(update={"bin": bin_})})
    series = read_series(directory / "bag", scene)
    window = metrics_window(series, dataclasses.replace(run.resolved, scene=scene))
    tip, wheel = tip_x_m(series, scene), series["tool.wheel_left.x_m"]
    expected = (tip >= 0.15) & (tip <= 0.85) & (wheel <= 0.75)
    assert expected.any()
    assert not expected.all()
    np.testing.assert_array_equal(window.rows, expected)
    assert not window.whole_run


def test_window_is_where_the_tips_of_all_tools_are_inside(tmp_path):
    """Two ranks, 1 m apart: from the entry of the rear one until the front one comes to the end."""
    resolved = two_ranks(tmp_path)
    series = pulled(resolved, 0.003 + 0.01 * np.arange(800), (0.5, 0.5), 1000.0)
    window = metrics_window(series, resolved)
    front, rear = (series[f"tool.{name}.x_m"] + 0.12 for name in ("front", "rear"))
    np.testing.assert_array_equal(window.rows, (rear >= 0.2) & (front <= 2.8))
    assert series["draft_newton"][window.rows].mean() == pytest.approx(2000.0)
    assert window.rule == "tips of all tools 0.2 m or more inside both ends of the bin"


def test_the_tips_of_other_tools_are_those_of_their_meshes():
    """Three shanks of one kind on one frame: the outer tips beside the one that the scene names."""
    resolved = load_scene(SCENES / "three_shanks_wedge.yaml")
    columns = {}
    for name, body in resolved.scene.mechanism.bodies.items():
        for kind in ("body", "tool"):
            columns[f"{kind}.{name}.x_m"] = body.position_m[0] + np.arange(3.0)
            columns[f"{kind}.{name}.z_m"] = body.position_m[1] + np.zeros(3)
            columns[f"{kind}.{name}.angle_rad"] = body.angle_rad + np.array((0.0, 0.1, -0.1))
    paths = tip_paths_m(Series(columns, "run", 1.0), resolved)
    assert list(paths) == ["shank", "shank_left", "shank_right"]
    for name in ("shank_left", "shank_right"):
        np.testing.assert_allclose(paths[name], paths["shank"], atol=0.001)


def test_empty_window_means_the_whole_run_and_says_so(machine):
    """A bin too short for the margin leaves no row; the summary then covers the run, and tells."""
    run, directory = machine
    summary = summarize(directory / "bag", run.resolved, {})
    assert summary.window.whole_run
    assert summary.window.rows == len(run.series_ticks())
    draft = summary.series["draft_newton"]
    assert draft.mean == draft.run.mean


def test_settling_is_left_out(tmp_path):
    """Metrics start after report.settle_s; extremes of the whole run stay available."""
    run = Run(tine("report.settle_s=0.0008", "report.tip_m=null"))
    directory = run.write(tmp_path / "run")
    series = read_series(directory / "bag", run.resolved.scene)
    summary = summarize(directory / "bag", run.resolved, {"mode": "direct"}, series)
    late = series["time_s"] > 0.0008
    assert 0 < late.sum() < len(series)
    draft = series["draft_newton"]
    found = summary.series["draft_newton"]
    for part, values in ((found, draft[late]), (found.run, draft)):
        assert (part.mean, part.std) == (np.mean(values), np.std(values))
        assert (part.min, part.max) == (values.min(), values.max())
    wall_s = 0.5 * (TICKS - 1)
    facts = summary.run
    assert (facts.mode, facts.wall_s, summary.particles.count) == ("direct", wall_s, 300)
    assert facts.real_time_factor == pytest.approx(TICKS * INTERVAL_NS * 1e-9 / wall_s, rel=1e-12)
    summary.write(tmp_path / "summary.json")
    assert json.loads((tmp_path / "summary.json").read_text()) == summary.document()


def test_running_mean_keeps_straight_lines():
    """Centred means leave the inside of a straight line where it is, and a constant everywhere."""
    line = np.arange(20.0)
    np.testing.assert_allclose(running_mean(line, 5)[2:-2], line[2:-2], rtol=1e-13)
    np.testing.assert_allclose(running_mean(np.full(20, 7.0), 6), 7.0, rtol=1e-13)
    assert running_mean(np.array([3.0]), 9) == [3.0]


@pytest.mark.parametrize("count", [1, 2, 3, 6, 11, 40, 41, 90])
def test_running_mean_by_hand(count):
    """Of the values within half of `count`, those that are there at the ends; never wider than the series."""
    values = 1e4 + np.random.default_rng(2).normal(size=40)
    half = min(count // 2, 19)
    by_hand = [values[max(0, k - half) : k + half + 1].mean() for k in range(40)]
    np.testing.assert_allclose(running_mean(values, count), by_hand, rtol=1e-14)
    gap = np.where(np.arange(40) == 20, np.nan, values)
    np.testing.assert_array_equal(np.isnan(running_mean(gap, count)), np.isnan(gap) & (count < 2))
