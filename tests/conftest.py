"""Machines for the tests of the mechanism engine, built from plain dictionaries."""

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from subsoil_ros.mbd.engine import MechanismEngine
from subsoil_ros.scene.limits import Timing
from subsoil_ros.scene.model import Scene

VALUES = {
    "stiffness_newton_per_m": 1e4,
    "tangential_stiffness_newton_per_m": 8e3,
    "damping_newton_s_per_m": 20.0,
    "tangential_damping_newton_s_per_m": 20.0,
    "adhesion_newton_per_m": 7e3,
    "static_friction": 0.5,
    "sliding_friction": 0.5,
    "rolling_friction": 0.3,
    "rest_overlap_m": 0.002,
    "reach_m": 0.002,
}
SOIL = {
    "bin": {"length_m": 1.0, "width_m": 0.5, "depth_m": 0.2},
    "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
    "bed": {"kind": "grid", "spacing_m": 0.018},
    "law": {"kind": "wet", "particle": VALUES, "boundary": VALUES},
}


def _engine(
    mechanism: dict[str, Any],
    interval_ns: int = 1_000_000,
    steps: int = 1,
    tools: Sequence[str] = (),
    gravity_m_per_s2: float = 9.81,
) -> MechanismEngine:
    """Engine of a mechanism; `tools` are bodies that soil may push (no soil is simulated)."""
    document: dict[str, Any] = {
        "name": "machine",
        "duration_s": 1.0,
        "gravity_m_per_s2": gravity_m_per_s2,
        "mechanism": mechanism,
    }
    if tools:
        document["soil"] = SOIL
        document["tools"] = {
            f"{body}_tool": {"body": body, "lateral_m": 0.1 * i, "groups": {"all": {"mesh": "none.stl"}}}
            for i, body in enumerate(tools)
        }
    timing = Timing(interval_ns, tick_count=1, soil_steps=1 if tools else 0, mechanism_steps=steps)
    return MechanismEngine(Scene.model_validate(document), timing)


@pytest.fixture(scope="session")
def mechanism_engine() -> Callable[..., MechanismEngine]:
    """Factory: (mechanism, interval_ns, steps, tools, gravity_m_per_s2) -> engine at time 0."""
    return _engine


def _revolute(body_a: str, body_b: str, x: float, z: float) -> dict[str, Any]:
    return {"kind": "revolute", "body_a": body_a, "body_b": body_b, "point_m": (x, z)}


def _body(mass: float, inertia: float, x: float, z: float, **rest: Any) -> dict[str, Any]:
    return {"mass_kg": mass, "inertia_kg_m2": inertia, "position_m": (x, z), **rest}


@pytest.fixture
def subsoiler() -> dict[str, Any]:
    """The seven bodies of the 1S-300 on wheel contacts, at rest, pulled at 0.5 m/s."""
    wheel = _body(25.0, 0.5585, 0.55, 0.20, angular_velocity_rad_per_s=-2.5)
    contact = {
        "kind": "wheel_contact",
        "radius_m": 0.2,
        "stiffness_newton_per_m": 60_000.0,
        "damping_newton_s_per_m": 1500.0,
        "friction": 0.4,
    }
    return {
        "bodies": {
            "shank": _body(35.2, 2.662, 0.02, 0.15),
            "wheel_left": wheel,
            "wheel_right": wheel,
            "lower_link": _body(7.8, 0.3104, 1.145, 0.425),
            "trolley": _body(100.0, 8e4, 1.60, 0.68),
            "upper_link": _body(10.0, 0.1896, 1.0872, 0.885),
            "frame": _body(68.0, 7.022, 0.35, 0.52),
        },
        "joints": {
            "H1": {
                "kind": "prismatic",
                "body_a": "ground",
                "body_b": "trolley",
                "point_m": (1.60, 0.68),
                "axis": (1.0, 0.0),
            },
            "H2": _revolute("trolley", "lower_link", 1.49, 0.45),
            "H3": _revolute("trolley", "upper_link", 1.3244, 0.91),
            "H4": _revolute("lower_link", "frame", 0.80, 0.40),
            "H5": _revolute("upper_link", "frame", 0.85, 0.86),
            "H6": _revolute("frame", "wheel_right", 0.55, 0.20),
            "H7": _revolute("frame", "wheel_left", 0.55, 0.20),
            "H8": _revolute("frame", "shank", 0.0, 0.40),
            "H10": {
                "kind": "driver",
                "body": "trolley",
                "coordinate": "x",
                "speed": {"kind": "constant", "value": 0.5},
            },
        },
        "forces": {
            "H9": {
                "kind": "spring_damper",
                "body_a": "frame",
                "point_a_m": (0.40, 0.65),
                "body_b": "shank",
                "point_b_m": (0.0, 0.65),
                "stiffness_newton_per_m": 176_500.0,
                "damping_newton_s_per_m": 1000.0,
                "free_length_m": 0.38735,
            },
            "left": {**contact, "body": "wheel_left"},
            "right": {**contact, "body": "wheel_right"},
        },
        "draft_driver": "H10",
        "initial": {"static_equilibrium": True},
    }
