"""Parts of machines, and the seven bodies of the 1S-300, for cases, tests and benchmarks."""

from subsoil_ros.yaml_document import Document


def body(x: float, z: float, mass: float = 1.0, inertia: float = 0.1, **rest: object) -> Document:
    """A body."""
    return {"mass_kg": mass, "inertia_kg_m2": inertia, "position_m": [x, z], **rest}


def pin(body_a: str, body_b: str, x: float, z: float, **rest: object) -> Document:
    """A revolute joint."""
    return {"kind": "revolute", "body_a": body_a, "body_b": body_b, "point_m": [x, z], **rest}


def rail(name: str, x: float, z: float, axis: tuple[float, float] = (1.0, 0.0)) -> Document:
    """A prismatic joint to the ground."""
    return {"kind": "prismatic", "body_a": "ground", "body_b": name, "point_m": [x, z], "axis": list(axis)}


def motor(name: str, speed: float) -> Document:
    """A driver of an angle."""
    law = {"kind": "constant", "value": speed}
    return {"kind": "driver", "body": name, "coordinate": "angle", "speed": law}


def _wheel(body: str) -> Document:
    return {
        "kind": "wheel_contact",
        "body": body,
        "radius_m": 0.2,
        "stiffness_newton_per_m": 60_000.0,
        "damping_newton_s_per_m": 1500.0,
        "friction": 0.4,
    }


SEVEN_BODIES: Document = {
    "bodies": {
        "shank": body(0.02, 0.15, 35.2, 2.662),
        "wheel_left": body(0.55, 0.20, 25.0, 0.5585, angular_velocity_rad_per_s=-2.5),
        "wheel_right": body(0.55, 0.20, 25.0, 0.5585, angular_velocity_rad_per_s=-2.5),
        "lower_link": body(1.145, 0.425, 7.8, 0.3104),
        "trolley": body(1.60, 0.68, 100.0, 8e4),
        "upper_link": body(1.0872, 0.885, 10.0, 0.1896),
        "frame": body(0.35, 0.52, 68.0, 7.022),
    },
    "joints": {
        "H1": {
            "kind": "prismatic",
            "body_a": "ground",
            "body_b": "trolley",
            "point_m": (1.60, 0.68),
            "axis": (1.0, 0.0),
        },
        "H2": pin("trolley", "lower_link", 1.49, 0.45),
        "H3": pin("trolley", "upper_link", 1.3244, 0.91),
        "H4": pin("lower_link", "frame", 0.80, 0.40),
        "H5": pin("upper_link", "frame", 0.85, 0.86),
        "H6": pin("frame", "wheel_right", 0.55, 0.20),
        "H7": pin("frame", "wheel_left", 0.55, 0.20),
        "H8": pin("frame", "shank", 0.0, 0.40),
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
        "left": _wheel("wheel_left"),
        "right": _wheel("wheel_right"),
    },
    "draft_driver": "H10",
    "initial": {"static_equilibrium": True},
}
"""The seven bodies of the 1S-300 on wheel contacts, at rest, pulled at 0.5 m/s, the wheels rolling."""
