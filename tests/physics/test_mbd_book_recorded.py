"""The balance of energy of a machine, closed from its series.csv alone."""

from pathlib import Path

import pandas as pd
import pytest
import yaml
from numpy.testing import assert_allclose
from scipy.integrate import cumulative_trapezoid

import subsoil_ros as subsoil
from subsoil_ros.analysis.summary import Summary
from subsoil_ros.run_results import summary_facts

DAMPING, LOAD, TURNING = 3.0, 40.0, 2.0

SCENE = {
    "name": "recorded_book",
    "duration_s": 0.5,
    "coupling": {"communication_step_ns": 500_000},
    "record": {"series_ticks": 1},
    "mechanism": {
        "bodies": {
            "crank": {"mass_kg": 1.0, "inertia_kg_m2": 0.1, "position_m": [0.0, 0.2]},
            "rod": {"mass_kg": 2.0, "inertia_kg_m2": 0.2, "position_m": [0.5, 0.4]},
        },
        "joints": {
            "main": {"kind": "revolute", "body_a": "ground", "body_b": "crank", "point_m": [0.0, 0.0]},
            "knee": {"kind": "revolute", "body_a": "crank", "body_b": "rod", "point_m": [0.0, 0.4]},
            "motor": {"kind": "driver", "body": "crank", "coordinate": "angle",
                      "speed": {"kind": "constant", "value": TURNING}},
        },
        "forces": {
            "damper": {"kind": "torsion_spring", "body_a": "crank", "body_b": "rod",
                       "stiffness_newton_m_per_rad": 50.0, "damping_newton_m_s_per_rad": DAMPING},
            "pull": {"kind": "point_load", "body": "rod", "point_m": [0.5, 0.4],
                     "force_x_newton": {"kind": "constant", "value": LOAD}},
        },
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def series(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """Of a crank that turns a rod on a damped spring, pulled by a load."""
    folder: Path = tmp_path_factory.mktemp("book")
    scene = folder / "scene.yaml"
    scene.write_text(yaml.safe_dump(SCENE))
    subsoil.run(scene, folder / "out")
    return pd.read_csv(folder / "out" / "series.csv")


def test_the_balance_closes_from_the_series(series: pd.DataFrame) -> None:
    """What is stored and dissipated, less all work, stays, but for the residual that is recorded too."""
    of = {name: series[f"mechanism.{name}_joule"] for name in (
        "kinetic_energy", "gravity_energy", "spring_energy", "dissipated", "driver_work", "external_work",
        "energy_residual")}  # fmt: skip
    stored = of["kinetic_energy"] + of["gravity_energy"] + of["spring_energy"]
    balance = stored + of["dissipated"] - of["driver_work"] - of["external_work"]
    turned = of["driver_work"].abs().max()
    assert turned > 1.0
    assert of["dissipated"].iloc[-1] > 0.1
    assert abs(of["external_work"].iloc[-1]) > 1.0
    opened = of["energy_residual"] - of["energy_residual"].iloc[0]
    assert_allclose(balance - balance.iloc[0], opened, atol=1e-12 * turned)
    assert_allclose(opened, 0.0, atol=1e-6 * turned)


def test_its_terms_are_powers_over_time(series: pd.DataFrame) -> None:
    """Damper: damping times rate squared. Load: force times speed. Driver: its moment times its speed."""
    time = series["time_s"]
    powers = {
        "dissipated": DAMPING * series["torsion_spring.damper.rate_rad_per_s"] ** 2,
        "external_work": LOAD * series["body.rod.velocity_x_m_per_s"],
        "driver_work": TURNING * series["joint.motor.moment_newton_m"],
    }
    for name, power in powers.items():
        recorded = series[f"mechanism.{name}_joule"]
        integral = cumulative_trapezoid(power, time, initial=0.0)
        # trapezoids of 500 us: (w h)^2 / 12 of the work, w below 30 rad/s
        assert_allclose(recorded - recorded.iloc[0], integral, atol=5e-5 * abs(recorded).max())


def test_a_run_says_how_many_parts_its_steps_took(tmp_path: Path) -> None:
    """The same at a step of 0.1 s: its number of parts is in series.csv and in the lines of its report."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(yaml.safe_dump(SCENE | {"coupling": {"communication_step_ns": 100_000_000}}))
    subsoil.run(scene, tmp_path / "out")
    series = pd.read_csv(tmp_path / "out" / "series.csv")
    count = int(series["mechanism.part_count"].iloc[-1])
    assert count > 20
    lines = summary_facts(Summary.model_validate_json((tmp_path / "out" / "summary.json").read_text()))
    assert any(f"; {count} parts of steps, for mechanism.tolerance" in line for line in lines)
