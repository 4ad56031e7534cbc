"""Units in names: every column and message field carries the unit of its physical quantity."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import subsoil_ros
from subsoil_ros.api.read import Run
from subsoil_ros.errors import SceneError
from subsoil_ros.scene.scene import Scene
from tests.units import field_lines, unit_of


def _body(x: float, z: float) -> dict[str, Any]:
    return {"mass_kg": 2.0, "inertia_kg_m2": 0.05, "position_m": [x, z]}


def _constant(value: float) -> dict[str, Any]:
    return {"kind": "constant", "value": value}


_SLIDING = {
    "friction": {"preload_newton": 1.0},
    "stops": {"upper_m": 1.0, "stiffness_newton_per_m": 1000.0},
}
_TURNING = {
    "friction": {"preload_newton_m": 0.1},
    "stops": {"upper_rad": 1.0, "stiffness_newton_m_per_rad": 100.0},
}
MACHINE: dict[str, Any] = {
    "bodies": {
        "carriage": _body(0.0, 0.5), "arm": _body(0.3, 0.5), "plate": _body(0.6, 0.5),
        "wheel": _body(0.0, 0.2), "lift": _body(1.0, 1.0), "slide": _body(2.0, 0.5),
        "follower": _body(0.2, 0.8),
    },
    "joints": {
        "rail": {"kind": "prismatic", "body_a": "ground", "body_b": "carriage", "point_m": [0.0, 0.5],
                 "axis": [1.0, 0.0], **_SLIDING},
        "hinge": {"kind": "revolute", "body_a": "carriage", "body_b": "arm", "point_m": [0.15, 0.5],
                  **_TURNING},
        "weld": {"kind": "fixed", "body_a": "arm", "body_b": "plate", "point_m": [0.45, 0.5]},
        "axle": {"kind": "revolute", "body_a": "carriage", "body_b": "wheel", "point_m": [0.0, 0.2]},
        "guide": {"kind": "point_on_line", "body_a": "ground", "body_b": "slide", "point_m": [2.0, 0.5],
                  "axis": [0.0, 1.0], **_SLIDING},
        "pull": {"kind": "driver", "body": "carriage", "coordinate": "x", "speed": _constant(0.5)},
        "raise": {"kind": "driver", "body": "lift", "coordinate": "z", "speed": _constant(0.1)},
        "turn": {"kind": "driver", "body": "lift", "coordinate": "angle", "speed": _constant(0.2)},
        "ahead": {"kind": "driver", "body": "follower", "coordinate": "x", "relative_to": "carriage",
                  "speed": _constant(0.1)},
        "above": {"kind": "driver", "body": "follower", "coordinate": "z", "relative_to": "carriage",
                  "speed": _constant(0.1)},
        "spin": {"kind": "driver", "body": "wheel", "coordinate": "angle", "relative_to": "carriage",
                 "speed": _constant(-2.5)},
    },
    "forces": {
        "strut": {"kind": "spring_damper", "body_a": "carriage", "point_a_m": [0.0, 0.5], "body_b": "lift",
                  "point_b_m": [1.0, 1.0], "stiffness_newton_per_m": 100.0, "free_length_m": 1.0},
        "link": {"kind": "spring_damper", "body_a": "ground", "point_a_m": [2.0, 1.0], "body_b": "slide",
                 "point_b_m": [2.0, 0.5], "free_length_m": 0.5, "stiffness_newton_per_m": 1.0,
                 "locked": True},
        "coil": {"kind": "torsion_spring", "body_a": "carriage", "body_b": "arm", "rest_angle_rad": 0.1,
                 "stiffness_newton_m_per_rad": 50.0, "damping_newton_m_s_per_rad": 1.0},
        "clamp": {"kind": "torsion_spring", "body_a": "carriage", "body_b": "follower",
                  "stiffness_newton_m_per_rad": 1.0, "locked": True},
        "hold_x": {"kind": "coordinate_spring", "body": "lift", "coordinate": "x", "target": _constant(1.1),
                   "stiffness_newton_per_m": 100.0},
        "hold_z": {"kind": "coordinate_spring", "body": "arm", "coordinate": "z", "target": _constant(0.5),
                   "stiffness_newton_per_m": 100.0},
        "hold_angle": {"kind": "coordinate_spring", "body": "slide", "coordinate": "angle",
                       "target": _constant(0.1), "stiffness_newton_m_per_rad": 20.0,
                       "damping_newton_m_s_per_rad": 0.5},
        "load": {"kind": "point_load", "body": "arm", "point_m": [0.3, 0.5],
                 "moment_newton_m": _constant(1.0)},
        "ground": {"kind": "wheel_contact", "body": "wheel", "radius_m": 0.201, "friction": 0.5,
                   "stiffness_newton_per_m": 1e4, "damping_newton_s_per_m": 10.0},
    },
    "draft_driver": "pull",
}  # fmt: skip
"""A machine with every kind of joint, driver and force element."""

TRANSLATION = {"force": "newton", "rate": "m_per_s"}
ROTATION = {"moment": "newton_m", "angle": "rad", "rate": "rad_per_s"}
ELEMENTS = {
    "spring.strut": {**TRANSLATION, "length": "m"},
    "spring.link": {**TRANSLATION, "length": "m"},
    "torsion_spring.coil": ROTATION,
    "torsion_spring.clamp": ROTATION,
    "coordinate_spring.hold_x": {**TRANSLATION, "x": "m"},
    "coordinate_spring.hold_z": {**TRANSLATION, "z": "m"},
    "coordinate_spring.hold_angle": ROTATION,
    "wheel_contact.ground": {**TRANSLATION, "penetration": "m"},
    "joint.rail.friction": {**TRANSLATION, "distance": "m"},
    "joint.rail.stops": {**TRANSLATION, "distance": "m"},
    "joint.guide.friction": {**TRANSLATION, "distance": "m"},
    "joint.guide.stops": {**TRANSLATION, "distance": "m"},
    "joint.hinge.friction": ROTATION,
    "joint.hinge.stops": ROTATION,
}
"""Columns of every force element: quantity and unit."""

MOTION = {
    "x": "m", "z": "m", "angle": "rad", "velocity_x": "m_per_s", "velocity_z": "m_per_s",
    "angular_velocity": "rad_per_s",
}  # fmt: skip
FORCE = {"force_x": "newton", "force_y": "newton", "force_z": "newton"}
KINDS: dict[str, dict[str, str]] = {
    "body": {
        **MOTION, "acceleration_x": "m_per_s2", "acceleration_z": "m_per_s2",
        "angular_acceleration": "rad_per_s2",
    },
    "joint": {"force_x": "newton", "force_z": "newton", "moment": "newton_m"},
    "tool": {
        **MOTION, **FORCE, "torque_x": "newton_m", "torque_y": "newton_m", "torque_z": "newton_m",
        "contact": "count",
    },
    "group": FORCE,
    "spring": ELEMENTS["spring.strut"],
    "coordinate_spring": ELEMENTS["coordinate_spring.hold_z"],
    "wheel_contact": ELEMENTS["wheel_contact.ground"],
    "draft": {"share": "newton", "wheels": "newton"},
    "mechanism": {
        "kinetic_energy": "joule", "gravity_energy": "joule", "spring_energy": "joule", "dissipated": "joule",
        "driver_work": "joule", "external_work": "joule", "position_residual": "m",
        "velocity_residual": "m_per_s", "energy_residual": "joule", "part": "count",
    },
    "soil": {
        "particle": "count", "contact": "count", "lost_particle": "count", "broken_bond": "count",
        "rebuild": "count",
        "kinetic_energy": "joule", "rms_speed": "m_per_s", "rms_angular_velocity": "rad_per_s",
        "max_overlap": "m", "max_tool_overlap": "m",
    },
    "coupling": {"residual": "joule", "absolute_work": "joule", "residual_ratio": ""},
    "": {"time": "s", "draft": "newton"},
}  # fmt: skip
"""Columns of everything else, by kind: quantity and unit."""


MESSAGE_FILES = sorted((Path(__file__).parents[2] / "msg_defs" / "msg").glob("*.msg"))
MESSAGES = {
    "BodyState": KINDS["body"],
    "JointReaction": KINDS["joint"],
    "MechanismState": {**KINDS["mechanism"], "draft": "newton"},
    "SoilState": KINDS["soil"],
    "CouplingReport": {
        **KINDS["coupling"], "mechanism_work": "joule", "soil_work": "joule", "wall_time": "s",
    },
    "ToolMotion": {"angle": "rad"},
    "LostParticle": {"x": "m", "y": "m", "z": "m"},
    "ToolWrench": {"work": "joule"},
}  # fmt: skip
"""Numbers of messages with the unit in the name: quantity and unit."""

BY_KIND = {
    "ForceState": {"coordinate": "[m, or rad", "rate": "[m/s, or rad/s", "load": "[N, or N m"},
    "DriverCommand": {"speed": "[m/s for a length, rad/s for an angle]"},
}
"""Numbers of messages whose unit depends on the kind of element, and how the comment names it."""


def _table(column: str, scene: Scene) -> tuple[dict[str, str], str]:
    """The quantities of what a column belongs to, and the quantity with its unit."""
    owner, _, last = column.rpartition(".")
    if owner in ELEMENTS:
        return ELEMENTS[owner], last
    kind, _, name = owner.partition(".")
    if kind == "tool" and name not in scene.tools:
        kind = "group"
    return KINDS[kind], last


def _wrong(run: Run) -> list[str]:
    """Columns whose name has another unit than the table."""
    found = []
    for column in run.series.columns:
        quantities, name = _table(column, run.scene.scene)
        unit = unit_of(name)
        if quantities.get(name.removesuffix(f"_{unit}")) != unit:
            found.append(column)
    return found


@pytest.fixture(scope="module")
def machine() -> Run:
    """20 ms of the machine of every element."""
    document = {
        "name": "every_element", "duration_s": 0.02, "mechanism": MACHINE,
        "coupling": {"communication_step_ns": 1_000_000}, "record": {"series_ticks": 1},
    }  # fmt: skip
    return subsoil_ros.run(document)


def test_columns_of_every_element_have_its_unit(machine: Run) -> None:
    """No column of the machine of every element has a unit of another dimension, and none is missing."""
    assert not _wrong(machine)
    expected = {
        f"{owner}.{quantity}_{unit}" for owner, table in ELEMENTS.items() for quantity, unit in table.items()
    }
    assert expected <= set(machine.series.columns)


def test_columns_of_soil_and_tools_have_their_unit(machine_bag: Path) -> None:
    """The same of a run with particles and tools."""
    assert not _wrong(subsoil_ros.read_run(machine_bag.parent))


@pytest.mark.parametrize("path", MESSAGE_FILES, ids=lambda path: path.stem)
def test_message_fields_have_the_unit_of_their_quantity(path: Path) -> None:
    """Every number of a message names the unit of its dimension, in its name or, if the unit depends on the
    kind of element, in its comment.
    """
    table = MESSAGES.get(path.stem, {})
    for kind, name, comment in field_lines(path.read_text()):
        if kind != "float64":
            continue
        unit = unit_of(name)
        if unit or name in table:
            assert table.get(name.removesuffix(f"_{unit}")) == unit, name
        else:
            assert BY_KIND[path.stem][name] in comment, name


def test_angles_and_moments_are_angles_and_moments(machine: Run) -> None:
    """The columns in rad, rad/s and N m follow from the angles of the bodies and the scene's N m/rad."""
    columns = machine.series
    coil, hold = "torsion_spring.coil", "coordinate_spring.hold_angle"
    angle = columns["body.arm.angle_rad"] - columns["body.carriage.angle_rad"]
    np.testing.assert_allclose(columns[f"{coil}.angle_rad"], angle, atol=1e-12)
    np.testing.assert_allclose(
        columns[f"{coil}.moment_newton_m"],
        50.0 * (0.1 - angle) - columns[f"{coil}.rate_rad_per_s"],
        atol=1e-9,
    )
    np.testing.assert_allclose(columns[f"{hold}.angle_rad"], columns["body.slide.angle_rad"], atol=1e-12)
    np.testing.assert_allclose(
        columns[f"{hold}.rate_rad_per_s"], columns["body.slide.angular_velocity_rad_per_s"], atol=1e-12
    )
    np.testing.assert_allclose(
        columns[f"{hold}.moment_newton_m"],
        20.0 * (0.1 - columns[f"{hold}.angle_rad"]) - 0.5 * columns[f"{hold}.rate_rad_per_s"],
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"stiffness_newton_per_m": 1.0},
            "stiffness_newton_per_m: does not go with coordinate 'angle'; give stiffness_newton_m_per_rad",
        ),
        (
            {"damping_newton_s_per_m": 1.0},
            "damping_newton_s_per_m: does not go with coordinate 'angle'; give damping_newton_m_s_per_rad",
        ),
        ({"coordinate": "x"}, "_per_rad: does not go with coordinate 'x'"),
        ({"stiffness_newton_m_per_rad": None}, "stiffness_newton_m_per_rad: is missing"),
    ],
)
def test_a_stiffness_of_the_other_dimension_is_refused(change: dict[str, Any], words: str) -> None:
    """A coordinate spring takes N/m along an axis and N m/rad on an angle."""
    spring = {**MACHINE["forces"]["hold_angle"], **change}
    document = {
        "name": "spring", "duration_s": 0.02,
        "mechanism": {**MACHINE, "forces": {**MACHINE["forces"], "hold_angle": spring}},
    }  # fmt: skip
    with pytest.raises(SceneError, match=words):
        subsoil_ros.load_scene(document)
