"""Loads of a run, from series with known numbers."""

from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.analysis.loads import draft_work, loads_of
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from tests.unit.analysis.made_up_series import ROWS, STEP_S, made_up, pulled, two_ranks, whole

SCENES = Path(__file__).parents[3] / "config/scenes"


@pytest.fixture(scope="module")
def machine() -> ResolvedScene:
    """The paper's machine with wheels as tools."""
    return load_scene(SCENES / "subsoiler_1s300.yaml")


def test_weight_is_carried_by_all_parts(machine):
    """Weight of 271 kg = soil on share, wheels, hitch, tethers, inertia + rest; each by its own sign."""
    series = made_up(machine)
    found = loads_of(series, machine, whole(series))
    mass = 35.2 + 2.0 * 25.0 + 7.8 + 100.0 + 10.0 + 68.0
    weight = 9.81 * mass
    assert found["vertical"]["weight_newton"] == pytest.approx(weight)
    assert found["vertical"]["share_newton"]["mean"] == pytest.approx(-200.0)
    assert found["vertical"]["wheels_newton"]["mean"] == pytest.approx(1210.0)
    assert found["vertical"]["hitch_newton"]["mean"] == pytest.approx(1300.0)
    assert found["vertical"]["tethers_newton"]["mean"] == pytest.approx(5.0)
    assert found["vertical"]["inertia_newton"]["mean"] == pytest.approx(-0.2 * mass)
    assert found["vertical"]["rest_newton"] == pytest.approx(
        weight + 200.0 - 1210.0 - 1300.0 - 5.0 + 0.2 * mass
    )


def test_power_and_energy(machine):
    """Draft times speed; the soil takes -(F v + M w) of a tool, M about phi being minus the torque."""
    series = made_up(machine)
    found = loads_of(series, machine, whole(series))
    assert found["power"]["draft_watt"]["mean"] == pytest.approx(0.5 * float(series["draft_newton"].mean()))
    assert found["power"]["shank_watt"]["mean"] == pytest.approx(-(-600.0 * 0.5 - 200.0 * 0.1 + 4.0 * 2.5))
    work, way = draft_work(series, machine.scene, np.ones(ROWS, dtype=bool))
    assert way == pytest.approx(0.5 * (ROWS - 1) * STEP_S)
    assert work == pytest.approx(700.0 * way, rel=1e-9)  # four whole cycles of the sine
    assert found["specific"]["energy_joule_per_m"] == pytest.approx(700.0, rel=1e-9)


def test_specific_draft(machine):
    """Over the 60 mm of the share; and the tip is as deep as the scene mounts it."""
    series = made_up(machine)
    found = loads_of(series, machine, whole(series))
    assert found["specific"]["share_width_m"] == pytest.approx(0.060)
    assert found["specific"]["draft_newton_per_m"] == pytest.approx(
        float(series["draft_newton"].mean()) / 0.060
    )
    assert found["tip_depth_m"]["mean"] == pytest.approx(-machine.scene.report.tip_m[1])


def test_two_tools_have_the_width_of_two_shares(tmp_path):
    """1000 N each over 60 mm each, at one speed: work per metre is the draft of both."""
    resolved = two_ranks(tmp_path)
    series = pulled(resolved, 3.0 + STEP_S * np.arange(ROWS), (0.5, 0.5), 1000.0)
    found = loads_of(series, resolved, whole(series))["specific"]
    assert found["share_width_m"] == pytest.approx(0.120)
    assert found["draft_newton_per_m"] == pytest.approx(2000.0 / 0.120)
    assert found["energy_joule_per_m"] == pytest.approx(2000.0)


def test_each_tool_on_a_path_has_its_own_speed(tmp_path):
    """1000 N at 0.5 m/s and at 1 m/s: the draft's power is that of both, and there is no common metre."""
    resolved = two_ranks(tmp_path)
    series = pulled(resolved, 1.5 + STEP_S * np.arange(ROWS), (0.5, 1.0), 1000.0)
    found = loads_of(series, resolved, whole(series))
    power = {name: item["mean"] for name, item in found["power"].items()}
    assert power == pytest.approx({"draft_watt": 1500.0, "front_watt": 500.0, "rear_watt": 1000.0})
    assert "energy_joule_per_m" not in found["specific"]
