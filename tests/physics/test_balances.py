"""Balances that a run reports, from its own series: they close within round-off."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import subsoil_ros as subsoil
from subsoil_ros.analysis.loads import vertical_parts
from subsoil_ros.analysis.series import Series, read_series
from subsoil_ros.api.read import Run
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.messages import ToolWrench

MASSES = {"frame": 40.0, "arm": 10.0, "slider": 6.0, "lid": 3.0}
G = 9.81
ENERGIES = (
    "kinetic_energy", "gravity_energy", "spring_energy", "dissipated", "driver_work", "external_work",
    "energy_residual",
)  # fmt: skip


def spring(**more: Any) -> dict[str, Any]:
    return {
        "kind": "spring_damper", "stiffness_newton_per_m": 4e3, "damping_newton_s_per_m": 30.0,
        "free_length_m": 0.3, **more,
    }  # fmt: skip


def constant(value: float) -> dict[str, Any]:
    return {"kind": "constant", "value": value}


MACHINE: dict[str, Any] = {
    "name": "every way of carrying",
    "duration_s": 0.3,
    "gravity_m_per_s2": G,
    "mechanism": {
        "initial": {"translate_x_m": 0.4},  # points on the ground move along
        "bodies": {
            "frame": {"mass_kg": 40.0, "inertia_kg_m2": 4.0, "position_m": [0.0, 0.5]},
            "arm": {"mass_kg": 10.0, "inertia_kg_m2": 0.5, "position_m": [0.6, 0.5]},
            "slider": {"mass_kg": 6.0, "inertia_kg_m2": 0.1, "position_m": [-0.8, 0.6]},
            "lid": {"mass_kg": 3.0, "inertia_kg_m2": 0.1, "position_m": [-0.8, 0.9]},
        },
        "joints": {
            "hinge": {"kind": "revolute", "body_a": "frame", "body_b": "arm", "point_m": [0.3, 0.5]},
            "guide": {
                "kind": "point_on_line", "body_a": "ground", "body_b": "slider", "point_m": [-0.8, 0.5],
                "axis": [1.0, 2.0], "friction": {"preload_newton": 20.0, "coefficient": 0.1},
                "stops": {"lower_m": -0.02, "stiffness_newton_per_m": 2e4, "damping_newton_s_per_m": 40.0},
            },
            "pin": {
                "kind": "point_on_line", "body_a": "lid", "body_b": "ground", "point_m": [-0.7, 0.9],
                "axis": [2.0, 1.0], "friction": {"preload_newton": 5.0},
            },
            "lift": {
                "kind": "driver", "body": "lid", "coordinate": "z", "relative_to": "ground",
                "speed": {"kind": "sine", "amplitude": 0.2, "frequency_hz": 3.0},
            },
        },
        "forces": {
            "strut": spring(body_a="ground", point_a_m=[0.5, 0.1], body_b="arm", point_b_m=[0.8, 0.5]),
            "rope": spring(body_a="frame", point_a_m=[-0.2, 0.5], body_b="ground", point_b_m=[-0.5, 1.0]),
            "inner": spring(body_a="frame", point_a_m=[-0.3, 0.6], body_b="slider", point_b_m=[-0.8, 0.8]),
            "chain": {
                "kind": "coordinate_spring", "body": "frame", "coordinate": "z", "acts_in": "pull_up",
                "stiffness_newton_per_m": 2e3, "target": constant(0.55),
            },
            "sideways": {
                "kind": "coordinate_spring", "body": "frame", "coordinate": "x",
                "stiffness_newton_per_m": 500.0, "target": constant(0.0),
            },
            "push": {
                "kind": "point_load", "body": "arm", "point_m": [0.9, 0.5],
                "force_z_newton": {
                    "kind": "sum",
                    "terms": [
                        {"kind": "sine", "amplitude": 60.0, "frequency_hz": 7.0},
                        {"kind": "half_sine", "peak": -80.0, "start_s": 0.1, "duration_s": 0.05},
                    ],
                },
            },
            "wheel": {
                "kind": "wheel_contact", "body": "frame", "radius_m": 0.51, "stiffness_newton_per_m": 2e4,
                "damping_newton_s_per_m": 100.0, "friction": 0.3,
            },
        },
    },
    "record": {"series_ticks": 1},
}  # fmt: skip


@pytest.fixture(scope="module")
def carried(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """0.3 s of a machine that everything carries at once: joints, drivers, springs, loads, a wheel."""
    return subsoil.run(MACHINE, tmp_path_factory.mktemp("carried") / "out")


def series_of(run: Run) -> Series:
    assert run.folder is not None
    return read_series(run.folder / "bag", run.scene.scene)


def test_what_carries_a_machine_is_its_weight_in_every_row(carried: Run) -> None:
    """From t = 0 on, stops, friction, rope and knock included: weight = all parts, to round-off."""
    parts = vertical_parts(series_of(carried), carried.scene)
    weight = G * sum(MASSES.values())
    assert set(parts) == {f"{name}_newton" for name in ("hitch", "wheels", "tethers", "loads", "inertia")}
    assert all(np.ptp(values) > 0.01 * weight for values in parts.values())
    largest = max(np.abs(values).max() for values in parts.values())
    np.testing.assert_allclose(sum(parts.values()), weight, atol=1e-9 * largest)
    vertical = carried.summary["loads"]["vertical"]
    assert abs(vertical["rest_newton"]) < 1e-9 * largest


def test_energy_closes_from_the_first_row(carried: Run) -> None:
    """What is stored and lost since t = 0, less the work done on the machine, is the residual."""
    series = carried.series
    column = {name: series[f"mechanism.{name}_joule"].to_numpy() for name in ENERGIES}
    held = sum(column[name] for name in ENERGIES[:4])
    appeared = held - column["driver_work"] - column["external_work"]
    assert series["time_s"].iloc[0] == 0.0
    turned_over = max(np.ptp(values) for values in column.values())
    np.testing.assert_allclose(appeared - appeared[0], column["energy_residual"], atol=1e-10 * turned_over)


def test_rest_with_soil_is_the_force_of_one_tick(tmp_path: Path) -> None:
    """The machine of a row has moved under the soil's answer to the tick before; draft and weight differ from
    the row's own forces by just that change, and not at all at t = 0."""
    run = subsoil.run(
        "subsoiler_1s300_wedge",
        tmp_path / "out",
        overrides={"duration_s": 0.4, "record.series_ticks": 1, "mechanism.initial.translate_x_m": 0.4},
    )
    series, scene = series_of(run), run.scene.scene
    assert scene.mechanism is not None
    parts = vertical_parts(series, run.scene)
    weight = G * sum(body.mass_kg for body in scene.mechanism.bodies.values())
    soil = {axis: sum(series[f"tool.{name}.force_{axis}_newton"] for name in scene.tools) for axis in "xz"}
    assert np.abs(np.diff(soil["x"])).max() > 1.0
    rest = weight - sum(parts.values())
    np.testing.assert_allclose(rest[1:], -np.diff(soil["z"]), atol=1e-8 * weight)
    assert abs(rest[0]) < 1e-8 * weight
    inertia = sum(
        body.mass_kg * series[f"body.{name}.acceleration_x_m_per_s2"]
        for name, body in scene.mechanism.bodies.items()
    )
    held = np.concatenate([soil["x"][:1], soil["x"][:-1]])
    np.testing.assert_allclose(series["draft_newton"] + held, inertia, atol=1e-8 * weight)


def test_the_initial_state_bears_the_first_answer(mechanism_engine: Callable[..., MechanismEngine]) -> None:
    """a = F / m - g and alpha = -T / J of a free body at t = 0; the engine goes on as if it was not asked."""
    body = {"mass_kg": 4.0, "inertia_kg_m2": 0.5, "position_m": [0.1, 0.2]}
    asked, other = (mechanism_engine({"bodies": {"block": body}}, tools=["block"]) for _ in range(2))
    wrench = ToolWrench("block_tool", 8.0, 0.0, 20.0, 0.0, 3.0, 0.0, 0.0, 1)
    (found,) = asked.initial_state("run", (wrench,)).bodies
    assert found.acceleration_x_m_per_s2 == pytest.approx(2.0, rel=1e-14)
    assert found.acceleration_z_m_per_s2 == pytest.approx(5.0 - G, rel=1e-14)
    assert found.angular_acceleration_rad_per_s2 == pytest.approx(-6.0, rel=1e-14)
    for tick in range(2):
        for name, array in other.state_arrays().items():
            np.testing.assert_array_equal(asked.state_arrays()[name], array, err_msg=name)
        assert asked.advance(tick, (wrench,)) == other.advance(tick, (wrench,))
