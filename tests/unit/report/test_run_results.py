"""What is printed of a run, and the values of a reference beside it."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.analysis.summarize import summarize
from subsoil_ros.analysis.summary import StationarityMetrics, Summary
from subsoil_ros.run_results import (
    heading_rows,
    print_summary,
    reference_lines,
    reference_rows,
    results_of,
    summary_facts,
    write_reference_csv,
    write_results_csv,
)
from tests.unit.analysis.made_up_runs import TICKS, Run, full_machine, tine
from tests.unit.loading.test_reference import FIELD, reference


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
        "draft [N]", "of it tillage tools [N]", "of it wheels [N]", "spring force", "share angle [rad]",
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
    assert "of it" not in text  # the draft is the pull of the only tool


def test_results_have_interval_and_unit(tmp_path):
    """In results.csv is what the run has, with all digits; what it has not is absent; drift is a warning."""
    run = Run(tine())
    summary = summarize(run.write(tmp_path / "run") / "bag", run.resolved, {"soil": "loam"})
    times = np.arange(600.0)
    steady = stationarity(times, 100.0 + times + np.random.default_rng(1).standard_normal(600))
    draft = summary.series["draft_newton"].model_copy(
        update={"stationarity": StationarityMetrics.model_validate(steady, from_attributes=True)}
    )
    summary = summary.model_copy(update={"series": summary.series | {"draft_newton": draft}})
    write_results_csv(results_of(summary, run.resolved), tmp_path / "results.csv")
    with (tmp_path / "results.csv").open() as stream:
        rows = {row.pop("quantity"): row for row in csv.DictReader(stream)}
    forces = ["draft", "vertical force, up +", "side force, to the left +", "moment about y", "mean power"]
    assert list(rows) == forces
    half_width = str(steady.mean_half_width)
    assert rows["draft"] == {"value": str(draft.mean), "half_width": half_width, "unit": "N"}
    assert rows["moment about y"]["unit"] == "N m"
    assert rows["mean power"]["half_width"] == ""
    (warned,) = [line for line in summary_facts(summary) if line.startswith("WARNING: draft")]
    assert warned.endswith(": drifts")
    rows = dict(heading_rows(summary, replace(run.resolved, preset="coarse")))
    assert rows["preset"] == "coarse"
    assert (rows["soil"], rows["particle radius"]) == ("loam", "10 mm")


def test_rows_stand_beside_those_of_the_run(tmp_path):
    """Difference over the value, verdict by the band; what the run lacks is named with the nearest name."""
    found = reference(FIELD, tmp_path)
    summary = {
        "series": {"draft_newton": {"mean": 2220.0, "max": -195.0}},
        "loads": {"tip_depth_m": {"mean": 0.19}, "power": {"draft_watt": {"mean": 450.0}}},
    }
    rows = {row.quantity: row for row in reference_rows(found, summary)}
    assert rows["series.draft_newton.mean"].difference == pytest.approx(0.2)
    verdicts = [row.agrees for row in rows.values()]
    assert verdicts == ["above", "yes", "below", "", ""]
    assert rows["series.draft_newton.max"].given.band == pytest.approx((-220.0, -180.0))
    assert rows["loads.tip_depth_m.mean"].difference is None
    assert rows["loads.power.draft_watt.mean"].difference == pytest.approx(-0.5)
    assert rows["series.draft_newton.mean"].cells()[3:7] == ["1850", "1700 to 2000", "+20 %", "above"]
    assert reference_lines(found, summary) == [
        "Wet.", "this run has no series.draft_newton.meen; the nearest is series.draft_newton.mean",
    ]  # fmt: skip
    write_reference_csv(list(rows.values()), tmp_path / "reference.csv")
    with (tmp_path / "reference.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert lines[0]["ours"] == "2220.0"
    assert [line["agrees"] for line in lines] == verdicts
