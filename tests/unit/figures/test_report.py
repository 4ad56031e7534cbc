"""What is printed, drawn and written of a run, by `subsoil report` and `subsoil bag`."""

import argparse
import json
import math
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from rich.console import Console

from subsoil_ros.analysis.series import read_series, running_mean
from subsoil_ros.analysis.summarize import summarize
from subsoil_ros.analysis.summary import Summary
from subsoil_ros.cli import bag as bag_verb
from subsoil_ros.cli import report as report_verb
from subsoil_ros.errors import InputError
from subsoil_ros.figures.run_figures import draw_figures
from subsoil_ros.figures.soil_cut import nearest_times_ns
from subsoil_ros.messages import ToolMotion
from subsoil_ros.report.result_tables import print_summary
from subsoil_ros.scene.tool_mesh import ToolMesh, posed_vertices_m
from tests.unit.analysis.made_up_runs import TICKS, Run, full_machine, machine_alone, tine


@pytest.fixture(scope="module")
def machine(tmp_path_factory) -> tuple[Run, Path]:
    """The full machine, recorded."""
    run = Run(full_machine())
    return run, run.write(tmp_path_factory.mktemp("machine") / "run")


def printed(summary: Summary, run: Run, directory: Path) -> str:
    """What print_summary prints, on one line."""
    console = Console(width=200, record=True, file=(directory / "printed.txt").open("w"))
    print_summary(summary, run.resolved.scene, directory, console, reference=run.resolved.reference)
    return " ".join(console.export_text().split())


def test_printed_summary_names_everything_asked_for(machine):
    """Metrics, counts, times, residual, the values of the reference beside, and where the files are."""
    run, directory = machine
    summary = summarize(directory / "bag", run.resolved, {"whole_wall_s": 99.0})
    text = printed(summary, run, directory)
    for piece in (
        "draft [N]", "of it share [N]", "of it wheels [N]", "spring force", "share angle [rad]",
        "height [mm]", "300 particles", f"{TICKS} steps", "20.5 s wall time (99.0 s with start-up)",
        "real-time factor", "residual",
        "beside Yuan & Yu (2020)", "series.draft_newton.moving_10ms.min", "272.2 to 453.8",
        "contradicts itself",
        "no row of it lies in the window", str(directory / "bag"),
        "figures",
    ):  # fmt: skip
        assert piece in text, piece


def test_note_of_the_scene_is_printed(tmp_path):
    """A scene's warning cannot be overlooked."""
    run = Run(
        tine("report.note=not the paper [at all]", "soil.time_step_s=3e-5", "allow=[unstable_time_step]")
    )
    directory = run.write(tmp_path / "run")
    text = printed(summarize(directory / "bag", run.resolved, {}), run, directory)
    assert "NOTE: not the paper [at all]" in text
    assert "WARNING: the scene overrides refusals, allow: unstable_time_step" in text
    assert "contradicts" not in text


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (full_machine, {"draft", "spring_force", "share_angle", "shank_height", "over_travel", "soil_cut"}),
        (tine, {"draft", "over_travel", "soil_cut"}),
        (machine_alone, {"draft", "spring_force", "share_angle", "shank_height"}),
    ],
)
def test_figures_are_what_the_run_has(make, expected, tmp_path):
    """A run draws the figures it has data for, none of them blank; the others are absent."""
    run = Run(make())
    directory = run.write(tmp_path / "run")
    paths = draw_figures(directory / "bag", run.resolved, directory / "figures")
    assert {path.stem for path in paths} == expected
    assert sorted(paths) == sorted((directory / "figures").iterdir())
    for path in paths:
        image = matplotlib.image.imread(path)[:, :, :3]
        assert image.shape[0] > 400
        assert image.shape[1] > 400
        middle = image[image.shape[0] // 4 : -image.shape[0] // 4, image.shape[1] // 4 : -image.shape[1] // 4]
        coloured = np.ptp(middle, axis=2) > 0.2  # curves and particles; frame, grid and window are not
        assert coloured.sum() > 400


def test_cut_has_three_times():
    """The clouds nearest to start, middle and end are shown, or three of all if the window has fewer."""
    times = [100_000_000 * k for k in range(1, 11)]
    assert nearest_times_ns(times, (0.31, 0.78)) == [300_000_000, 500_000_000, 800_000_000]
    assert nearest_times_ns(times, (0.5, 0.5)) == [100_000_000, 500_000_000, 1_000_000_000]
    assert nearest_times_ns(times[:2], (0.0, 1.0)) == times[:2]
    assert nearest_times_ns([], (0.0, 1.0)) == []


def test_outline_is_turned_with_the_tool():
    """A quarter turn by phi takes the body's x axis up, and the turn is counted from the reference pose."""
    corner = np.array([[0.3, 0.1, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    facets = np.array([[0, 1, 2]], dtype=np.int32)
    mesh = ToolMesh(corner, facets, np.zeros(1, dtype=np.int32), ("share",))
    motion = ToolMotion("shank", 2.0, 0.35, 5.0, 0.2 + math.pi / 2, 0.0, 0.0, 0.0)
    world = posed_vertices_m(mesh, motion, 0.2)
    np.testing.assert_allclose(world, [[2.0, 0.1, 5.3], [2.0, 0.0, 5.0], [1.0, 0.0, 5.0]], atol=1e-15)


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


def verb(module, *words: str) -> int:
    """Runs one verb of the command line."""
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)
    return module.run(parser.parse_args(words))


def test_report_makes_everything_anew(tmp_path, capsys):
    """`subsoil report` writes series, summary and figures from bag and scene, and keeps the run's facts."""
    run = Run(tine())
    directory = run.write(tmp_path / "run")
    (directory / "summary.json").write_text(
        json.dumps({"run": {"whole_wall_s": 12.5, "mode": "nodes"}, "series": 1})
    )
    assert verb(report_verb, str(directory)) == 0
    summary = json.loads((directory / "summary.json").read_text())
    assert (summary["run"]["whole_wall_s"], summary["run"]["mode"]) == (12.5, "nodes")
    series = read_series(directory / "bag", run.resolved.scene)
    assert summary["series"]["draft_newton"]["run"]["mean"] == np.mean(series["draft_newton"])
    assert (directory / "series.csv").read_text().startswith("time_s,draft_newton,")
    assert (directory / "figures/draft.png").is_file()
    assert "draft [N]" in capsys.readouterr().out


def test_report_refuses_a_folder_without_a_run(tmp_path):
    """A wrong folder is bad input."""
    with pytest.raises(InputError, match="no folder of a run"):
        verb(report_verb, str(tmp_path))


def test_bag_verbs(tmp_path, capsys):
    """`subsoil bag info` lists topics with counts; `subsoil bag recover` mends a cut bag in its place."""
    run = Run(tine())
    directory = run.write(tmp_path / "run")
    assert verb(bag_verb, "info", str(directory)) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "/subsoil/tool_wrenches" in line)
    assert str(TICKS) in row
    assert verb(bag_verb, "recover", str(directory)) == 0
    assert "is complete" in capsys.readouterr().out
    (directory / "bag/metadata.yaml").unlink()
    path = next((directory / "bag").glob("*.mcap"))
    path.write_bytes(path.read_bytes()[:-40])
    assert verb(bag_verb, "recover", str(directory)) == 0
    assert "recovered" in capsys.readouterr().out
    assert verb(bag_verb, "info", str(directory)) == 0


def test_report_shows_the_reference(tmp_path, capsys):
    """The values that the scene's reference file gives: on the screen, as CSV, and in the page."""
    directory = Run(full_machine()).write(tmp_path / "run")
    assert verb(report_verb, str(directory), "--html") == 0
    assert "series.body.shank.z_m.run.moving_10ms.range" in capsys.readouterr().out
    rows = (directory / "reference.csv").read_text().splitlines()
    assert len(rows) == 11
    assert rows[1].startswith("series.draft_newton.moving_10ms.min,N,")
    page = (directory / "report.html").read_text()
    assert "<h2>Beside Yuan &amp; Yu (2020)</h2>" in page
    assert "contradicts itself" in page
