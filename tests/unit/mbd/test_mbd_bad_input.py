"""`subsoil check` on bad machines: exit status 2 and one message with file, scene path and joint."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from subsoil_ros.cli.main import main

MACHINE: dict[str, Any] = {
    "name": "crank",
    "duration_s": 0.1,
    "mechanism": {
        "bodies": {
            "crank": {"mass_kg": 1.0, "inertia_kg_m2": 0.1, "position_m": [0.0, 0.5]},
            "rod": {"mass_kg": 1.0, "inertia_kg_m2": 0.1, "position_m": [0.5, 1.0]},
        },
        "joints": {
            "main": {"kind": "revolute", "body_a": "ground", "body_b": "crank", "point_m": [0.0, 0.0]},
            "big": {"kind": "revolute", "body_a": "crank", "body_b": "rod", "point_m": [0.0, 1.0]},
        },
        "forces": {},
    },
}
SPEED = {"kind": "constant", "value": 1.0}


@pytest.fixture
def message(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[[dict[str, Any]], str]:
    """Runs `subsoil check` on a scene and gives its one line on stderr."""

    def run(document: dict[str, Any]) -> str:
        path = tmp_path / "machine.yaml"
        path.write_text(yaml.safe_dump(document))
        assert main(["check", str(path)]) == 2
        shown = capsys.readouterr()
        assert shown.out == ""
        lines = shown.err.strip().splitlines()
        assert len(lines) == 1, shown.err
        assert lines[0].startswith(f"subsoil check: {path}: ")
        return lines[0]

    return run


CASES: dict[str, tuple[str, Any, list[str]]] = {
    "unknown body": ("joints.big.body_b", "rodd", ["mechanism.joints.big", "'rodd'", "rod"]),
    "unknown joint kind": ("joints.big.kind", "revolut", ["mechanism.joints.big", "revolut", "revolute"]),
    "unknown force kind": (
        "forces.push",
        {"kind": "gas_spring", "body": "rod"},
        ["mechanism.forces.push", "gas_spring", "spring_damper"],
    ),
    "zero mass": ("bodies.rod.mass_kg", 0.0, ["mechanism.bodies.rod.mass_kg", "0"]),
    "negative inertia": ("bodies.rod.inertia_kg_m2", -1.0, ["mechanism.bodies.rod.inertia_kg_m2", "-1"]),
    "another unit": ("bodies.rod.mass_g", 1000.0, ["mechanism.bodies.rod.mass_g", "mass_kg"]),
    "a length in millimetres": (
        "joints.big.point_mm",
        [0.0, 1000.0],
        ["mechanism.joints.big.point_mm", "point_m"],
    ),
    "unassemblable pose": (
        "joints.foot",
        {
            "kind": "revolute",
            "body_a": "ground",
            "body_b": "rod",
            "point_m": [9.0, 0.0],
            "point_b_m": [1.0, 1.0],
        },
        ["cannot be assembled", "joints.foot by", " m"],
    ),
    "a spring without length": (
        "forces.spring",
        {
            "kind": "spring_damper",
            "body_a": "ground",
            "body_b": "rod",
            "point_a_m": [0.5, 1.0],
            "point_b_m": [0.5, 1.0],
            "stiffness_newton_per_m": 10.0,
            "free_length_m": 0.1,
        },
        ["mechanism.forces.spring", "two points coincide", "free_length_m: 0"],
    ),
    "an empty name": (
        "bodies.",
        {"mass_kg": 1.0, "inertia_kg_m2": 0.1, "position_m": [0.0, 0.0]},
        ["mechanism.bodies", "''", "it must be a letter"],
    ),
    "contradictory drivers": (
        "joints.second",
        {"kind": "driver", "body": "crank", "coordinate": "angle", "speed": {**SPEED, "value": 2.0}},
        ["mechanism.joints", "motor, second", "contradict"],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_bad_machine_gets_one_message(message: Callable[[dict[str, Any]], str], case: str) -> None:
    """Where it is, what was given, and what is allowed, in one line."""
    where, value, words = CASES[case]
    document = copy.deepcopy(MACHINE)
    if case == "contradictory drivers":
        document["mechanism"]["joints"]["motor"] = {
            "kind": "driver",
            "body": "crank",
            "coordinate": "angle",
            "speed": SPEED,
        }
    part = document["mechanism"]
    *folders, key = where.split(".")
    for folder in folders:
        part = part[folder]
    part[key] = value
    text = message(document)
    for word in words:
        assert word in text, text
