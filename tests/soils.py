"""The soils of the tests with the features of their laws: each set of features is a compiled soil step.

A test that needs less than the features of a soil gives what it does without as NEGLIGIBLE. Besides there are
the two variants, without friction, with which a dense bed of each soil is prepared, and those, endless and
without a book, with which a tiled bed is.
"""

import copy
from typing import Any

from validation.laboratory import NEGLIGIBLE as NEGLIGIBLE
from validation.laboratory import WET_BOUNDARY as BOUNDARY
from validation.laboratory import WET_PARTICLE as PARTICLE

WET = {"kind": "cohesive_linear", "particle": PARTICLE, "boundary": BOUNDARY}
DRY = {
    "stiffness_newton_per_m": 1e5, "tangential_stiffness_newton_per_m": 8e4,
    "damping_newton_s_per_m": 5.0, "tangential_damping_newton_s_per_m": 5.0,
    "static_friction": 0.5, "sliding_friction": 0.4, "rolling_friction": 0.1,
}  # fmt: skip
LINEAR = {"kind": "linear", "particle": DRY, "boundary": DRY}
ELASTIC = {
    "youngs_modulus_pa": 1e7, "poisson_ratio": 0.25, "restitution": 0.5,
    "static_friction": 0.5, "sliding_friction": 0.4, "rolling_friction": 0.1,
}  # fmt: skip
HERTZ = {"kind": "hertz_mindlin", "particle": ELASTIC, "boundary": ELASTIC}
YIELDING = {
    "youngs_modulus_pa": 1e7, "poisson_ratio": 0.25, "contact_plasticity": 0.75,
    "surface_energy_joule_per_m2": 20.0, "static_friction": 0.5, "sliding_friction": 0.4,
}  # fmt: skip
PLASTIC = {"kind": "elasto_plastic_adhesive", "particle": YIELDING, "boundary": YIELDING}

BOOKED = {"monitors": {"max_energy_defect": 1e3}}
LAYERS = {"layers": [{"name": "top", "thickness_m": 0.04}, {"name": "heavy", "density_kg_per_m3": 2000.0}]}
TWO_SIZES = {"kind": "listed", "radii_m": [0.008, 0.01], "shares": [1.0, 1.0], "shares_are": "number"}
UNEQUAL = {
    "particles": {"sizes": TWO_SIZES, "density_kg_per_m3": 1800.0},
    "bed": {"kind": "dense_random", "seed": 0},
}
WETTED = ("cohesive_linear", "cohesion", "tangential", "rolling")
RUBBED = ("tangential", "rolling")

SOILS: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "wet": (WETTED, {"law": WET}),
    "wet, booked": ((*WETTED, "book"), {"law": WET, **BOOKED}),
    "periodic": ((*WETTED, "periodic"), {"law": WET, "bin.sides": "periodic"}),
    "sizes and layers": (
        (*WETTED, "book", "sizes", "materials"), {"law": WET, **BOOKED, **LAYERS, **UNEQUAL},
    ),
    "dry": (("linear", *RUBBED), {"law": LINEAR}),
    "hertz": (("hertz", *RUBBED, "book"), {"law": HERTZ, **BOOKED}),
    "plastic": (("elasto_plastic_adhesive", "tangential", "book"), {"law": PLASTIC, **BOOKED}),
}  # fmt: skip
"""Law and features of each soil, as numba compiles them, and the keys of a soil that has them."""


def warming_scene(name: str) -> dict[str, Any]:
    """A scene of one of the soils, of a few particles and ticks, with a tool far above it."""
    soil: dict[str, Any] = {
        "bin": {"length_m": 0.12, "width_m": 0.12, "depth_m": 0.1},
        "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
        "bed": {"kind": "grid", "spacing_m": "rest"},
        **copy.deepcopy(SOILS[name][1]),
    }
    soil["bin"]["sides"] = soil.pop("bin.sides", "walls")
    tool = {"path": {"start_z_m": 1.0}, "groups": {"share": {"mesh": "config/meshes/share.stl"}}}
    return {
        "name": "warming", "duration_s": 2e-3, "soil": soil, "tools": {"tool": tool},
        "record": {"series_ticks": 1},
    }  # fmt: skip
