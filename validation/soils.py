"""Two soils of particles at one solid fraction, with and without adhesion."""

from .laboratory import Document

RADIUS_M, SOLID_FRACTION, DENSITY = 0.0075, 0.60, 2600.0

STIFFNESS = 7.5e4  # [N/m]: overlaps of 0.4 % of the radius at 10 kPa
ROW = {
    "stiffness_newton_per_m": STIFFNESS, "tangential_stiffness_newton_per_m": 0.8 * STIFFNESS,
    "damping_newton_s_per_m": 3.0, "tangential_damping_newton_s_per_m": 1.5,
}  # fmt: skip
"""Damping ratio 0.11, restitution 0.7 (chosen); tangential values are usual parts of the normal ones."""

SAND = ROW | {"static_friction": 0.5, "sliding_friction": 0.5, "rolling_friction": 0.1}  # chosen
LOAM = SAND | {
    "cohesive_stiffness_newton_per_m": 2600.0,  # chosen: some kPa of cohesion
    "equilibrium_overlap_m": 0.00004,
    "cohesion_range_m": 0.0004,  # chosen: a twentieth of the radius
}
LAWS = {
    "sand": ("linear", SAND, {}),
    "loam": ("cohesive_linear", LOAM, {"cohesive_stiffness_newton_per_m": 0.0}),
}


def soil_section(
    soil: str, friction: float, seed: int, box: Document, radius_m: float = RADIUS_M
) -> Document:
    """The soil section of a scene; `friction` at walls and tools, which soil does not stick to.

    Of another radius, the law is scaled: the same soil.
    """
    kind, row, at_metal = LAWS[soil]
    metal = {"static_friction": friction, "sliding_friction": friction}
    return {
        "bin": box,
        "bed": {"kind": "tiled", "seed": seed, "solid_fraction": SOLID_FRACTION},
        "particles": {
            "radius_m": radius_m,
            "reference_radius_m": RADIUS_M,
            "density_kg_per_m3": DENSITY,
        },
        "law": {"kind": kind, "particle": row, "boundary": row | at_metal | metal},
        "skin_m": 0.2 * radius_m,
    }
