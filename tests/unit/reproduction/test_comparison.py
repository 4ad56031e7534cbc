"""The paper's numbers beside a run, from series with known numbers."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from reproduction.yuan_yu_2020 import compare
from reproduction.yuan_yu_2020.compare import COLUMNS, cells, markdown, write_reproduction
from reproduction.yuan_yu_2020.comparison import falls, most_at_tip, phase, reproduction
from subsoil_ros.analysis.disturbance import SpeedZones
from subsoil_ros.analysis.metrics_window import Window
from subsoil_ros.analysis.series import Series
from subsoil_ros.analysis.spectra import spectrum
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from tests.unit.analysis.made_up_runs import Run, full_machine
from tests.unit.analysis.made_up_series import STEP_S, made_up, statistics_of, whole

SCENES = Path(__file__).parents[3] / "config/scenes"


@pytest.fixture(scope="module")
def machine() -> ResolvedScene:
    """The paper's machine with wheels as tools."""
    return load_scene(SCENES / "subsoiler_1s300.yaml")


def test_order_of_speeds():
    """The paper's order: tip, blade, then less and less ahead and sideways."""
    falling = (0.3, 0.2, 0.1, 0.05)
    assert most_at_tip(SpeedZones(0.5, 0.4, falling, falling))
    assert not most_at_tip(SpeedZones(0.3, 0.4, falling, falling))
    assert falls(falling)
    assert not falls((0.3, 0.2, 0.25, 0.1))
    assert falls((0.3, 0.2, float("nan"), 0.1))


def test_phase_of_draft_and_spring_energy(machine):
    """+1 where the spring stores while the draft rises, -1 where it gives."""
    series = made_up(machine)
    window = whole(series)
    assert phase(machine.scene, series, window) > 0.95  # energy goes with the square of the force
    spring = machine.scene.mechanism.forces["H9_spring"]
    shifted = 3500.0 - series["spring.H9_spring.force_newton"]
    turned = {
        **series.columns,
        "spring.H9_spring.length_m": spring.free_length_m - shifted / spring.stiffness_newton_per_m,
    }
    assert phase(machine.scene, Series(turned, "run", 1.0), window) < -0.9


def test_reproduction_compares_inside_and_outside(machine, tmp_path):
    """Window and rest stand beside the printed value with their differences, and files hold the same rows."""
    series = made_up(machine)
    rows = series["time_s"] > 1.0
    window = Window(rows, "late", False)
    early = {**series.columns, "draft_newton": np.where(rows, series["draft_newton"], -331.06)}
    series = Series(early, "run", 1.0)
    table = reproduction(machine.scene, "0" * 64, series, window, statistics_of(series, machine, window))
    found = {(row.quantity, row.measure): row for row in table.rows}
    mean = found["draft, cycle", "mean"]
    assert mean.published == 681.5
    assert mean.inside == pytest.approx(700.0, rel=1e-2)
    assert mean.difference_inside == pytest.approx((mean.inside - 681.5) / 681.5)
    assert mean.agrees == "window"
    least = found["draft, run", "least"]
    assert least.outside == pytest.approx(-331.06)
    assert least.agrees == "outside"
    assert least.difference_outside == pytest.approx(0.0, abs=1e-9)
    top = found["draft, cycle", "largest"]
    assert top.raw_inside == pytest.approx(1000.0, rel=1e-4)
    assert top.inside < top.raw_inside  # the moving mean cuts peaks
    assert found["height of the shank's centre of mass", "peak to peak"].agrees == "no"
    write_reproduction(table, tmp_path)
    document = json.loads((tmp_path / "reproduction.json").read_text())
    assert len(document["rows"]) == len(table.rows)
    assert any(not item["holds"] for item in document["statements"])
    text = (tmp_path / "reproduction.md").read_text()
    assert text == markdown(table)
    assert "Impossible: 181 mm of height" in text
    assert len((tmp_path / "reproduction.csv").read_text().splitlines()) == 1 + len(table.rows)
    assert all(len(cells(row)) == len(COLUMNS) for row in table.rows)


def test_periods_that_the_window_cannot_hold_are_said(machine):
    """A window of one second shows no period of one second."""
    series = made_up(machine)
    rows = series["time_s"] <= 1.0
    window = Window(rows, "short", False)
    name = "spring.H9_spring.force_newton"
    statistics = statistics_of(series, machine, window)
    statistics.spectra[name] = spectrum(STEP_S, series[name][rows])
    table = reproduction(machine.scene, "0" * 64, series, window, statistics)
    row = next(row for row in table.rows if row.quantity == "period of the spring force")
    assert "do not hold 8 periods" in row.remark


def test_command_writes_the_table(tmp_path, capsys, monkeypatch):
    """The paper's numbers beside ours on the screen and as files, and what cannot hold."""
    directory = Run(full_machine()).write(tmp_path / "run")
    monkeypatch.setattr(sys, "argv", ["compare", str(directory)])
    compare.main()
    assert "Impossible: 181 mm of height" in capsys.readouterr().out
    document = json.loads((directory / "reproduction.json").read_text())
    assert {row["quantity"] for row in document["rows"]} >= {"draft, cycle", "draft, run", "spring force"}
    for end in ("csv", "md", "png"):
        assert (directory / f"reproduction.{end}").is_file()
