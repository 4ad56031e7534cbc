"""Loads, findings and the reproduction table, from series with known numbers."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.analysis.findings import Findings
from subsoil_ros.analysis.loads import draft_work, loads_of
from subsoil_ros.analysis.reproduction import phase, reproduction
from subsoil_ros.analysis.reproduction_table import COLUMNS, cells, markdown, write_reproduction
from subsoil_ros.analysis.series import Series
from subsoil_ros.analysis.steadiness import steadiness
from subsoil_ros.analysis.window import Window
from subsoil_ros.scene.loader import ResolvedScene, load_scene

SCENES = Path(__file__).parents[2] / "config/scenes"
ROWS = 2001
STEP_S = 0.001


@pytest.fixture(scope="module")
def machine() -> ResolvedScene:
    """The paper's machine with wheels as tools."""
    return load_scene(SCENES / "subsoiler_1s300.yaml")


def made_up(resolved: ResolvedScene) -> Series:
    """Steady pull at 0.5 m/s: every part carries a known share of the machine, the draft swings by a sine."""
    scene = resolved.scene
    times = STEP_S * (1 + np.arange(ROWS))
    columns = {"time_s": times, "draft_newton": 700.0 + 300.0 * np.sin(2.0 * math.pi * 2.0 * times)}
    level = np.ones(ROWS)
    for name, body in scene.mechanism.bodies.items():
        columns[f"body.{name}.x_m"] = body.position_m[0] + 0.5 * times
        columns[f"body.{name}.z_m"] = body.position_m[1] * level
        columns[f"body.{name}.angle_rad"] = body.angle_rad * level
        columns[f"body.{name}.velocity_x_m_per_s"] = 0.5 * level
    for name, (force_x, force_z) in {
        "shank": (-600.0, -200.0), "wheel_left": (-50.0, 600.0), "wheel_right": (-50.0, 610.0)
    }.items():  # fmt: skip
        columns |= {
            f"tool.{name}.force_x_newton": force_x * level, f"tool.{name}.force_z_newton": force_z * level,
            f"tool.{name}.torque_y_newton_m": 4.0 * level, f"tool.{name}.velocity_x_m_per_s": 0.5 * level,
            f"tool.{name}.velocity_z_m_per_s": 0.1 * level,
            f"tool.{name}.angular_velocity_rad_per_s": -2.5 * level,
        }  # fmt: skip
    columns["joint.H1_rail.force_z_newton"] = 1300.0 * level
    columns["coordinate_spring.chain.force_newton"] = 5.0 * level
    spring = scene.mechanism.forces["H9_spring"]
    force = 2.5 * columns["draft_newton"]
    columns["spring.H9_spring.force_newton"] = force
    columns["spring.H9_spring.length_m"] = spring.free_length_m - force / spring.stiffness_newton_per_m
    return Series(columns, "run", 1.0)


def whole(series: Series) -> Window:
    """A window of all rows."""
    return Window(np.ones(len(series), dtype=bool), "all", False)


def findings_of(series: Series, resolved: ResolvedScene, window: Window) -> Findings:
    """Without soil."""
    steady = steadiness(series["time_s"], series["draft_newton"])
    loads = loads_of(series, resolved, window)
    return Findings(loads, {"draft_newton": steady}, {}, None, None, None, {}, {}, None)


def test_weight_is_carried_by_all_parts(machine):
    """Weight of 271 kg = soil on share, wheels and hitch + rest; each by its own sign."""
    series = made_up(machine)
    found = loads_of(series, machine, whole(series)).metrics
    weight = 9.81 * (35.2 + 2.0 * 25.0 + 7.8 + 100.0 + 10.0 + 68.0)
    assert found["vertical.weight_newton"] == pytest.approx(weight)
    assert found["vertical.share_newton_mean"] == pytest.approx(-200.0)
    assert found["vertical.wheels_newton_mean"] == pytest.approx(1210.0)
    assert found["vertical.hitch_newton_mean"] == pytest.approx(1305.0)
    assert found["vertical.rest_newton"] == pytest.approx(weight + 200.0 - 1210.0 - 1305.0)


def test_power_and_energy(machine):
    """Draft times speed; the soil takes -(F v + M w) of a tool, M about phi being minus the torque."""
    series = made_up(machine)
    found = loads_of(series, machine, whole(series)).metrics
    assert found["power.draft_watt_mean"] == pytest.approx(0.5 * float(series["draft_newton"].mean()))
    assert found["power.shank_watt_mean"] == pytest.approx(-(-600.0 * 0.5 - 200.0 * 0.1 + 4.0 * 2.5))
    work, way = draft_work(series, machine.scene, np.ones(ROWS, dtype=bool))
    assert way == pytest.approx(0.5 * (ROWS - 1) * STEP_S)
    assert work == pytest.approx(700.0 * way, rel=1e-9)  # four whole cycles of the sine
    assert found["specific.energy_joule_per_m"] == pytest.approx(700.0, rel=1e-9)


def test_specific_draft(machine):
    """Over the 60 mm of the share; and the tip is as deep as the scene mounts it."""
    series = made_up(machine)
    found = loads_of(series, machine, whole(series)).metrics
    assert found["specific.share_width_m"] == pytest.approx(0.060)
    assert found["specific.draft_newton_per_m"] == pytest.approx(float(series["draft_newton"].mean()) / 0.060)
    assert found["tip_depth_m_mean"] == pytest.approx(-machine.scene.report.tip_m[1])


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
    table = reproduction(machine.scene, "0" * 64, series, window, findings_of(series, machine, window))
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
    from subsoil_ros.analysis.spectra import spectrum

    series = made_up(machine)
    rows = series["time_s"] <= 1.0
    window = Window(rows, "short", False)
    name = "spring.H9_spring.force_newton"
    findings = findings_of(series, machine, window)
    findings.spectra[name] = spectrum(STEP_S, series[name][rows])
    table = reproduction(machine.scene, "0" * 64, series, window, findings)
    row = next(row for row in table.rows if row.quantity == "period of the spring force")
    assert "do not hold 8 periods" in row.remark
