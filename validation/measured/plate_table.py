"""Tables of round plates that were pressed into soil: template_plates.csv."""

import math
from collections.abc import Sequence
from pathlib import Path

from subsoil_ros.loading.material_file import read_material

from ..blades import Soil
from ..narrow_blade import soil_of
from .bearing import FORMS, vesic_pa
from .plates import discs, pressed_pa, pushed
from .table import Kind, Row

BEYOND_MM, THICK_MM = 2.0, 20.0
"""How far beyond the last sinkage a plate is pushed, and how far it then stands out of the surface."""


def theory(row: Row) -> float:
    """Vesic's pressure with the strength of the laboratory [Pa]."""
    soil = Soil(
        float(row["cohesion_pa"]), math.radians(float(row["friction_angle_deg"])),
        float(row["bulk_density_kg_per_m3"]),
    )  # fmt: skip
    diameter, sinkage = float(row["diameter_m"]), float(row["sinkage_m"])
    if not 0.001 <= sinkage < 2.0 * diameter:
        raise ValueError(f"sinkage_m: given {sinkage:g}; allowed is 0.001 to two diameters")
    return vesic_pa(soil, sinkage, diameter, 1.0)


def pressed(
    rows: Sequence[Row], soil: Path, radius_m: float, seed: int, _travel: object
) -> list[dict[str, float]]:
    """Pressures of one simulated push at the sinkages of the rows."""
    sinkages = [float(row["sinkage_m"]) for row in rows]
    diameter, deepest_mm = float(rows[0]["diameter_m"]), 1e3 * max(sinkages)
    (plate,) = discs(str(soil.resolve()), (1e3 * diameter,), deepest_mm + BEYOND_MM, deepest_mm + THICK_MM)
    run, particles = pushed(plate, radius_m, seed)
    strength = soil_of(read_material(soil, str(soil)))
    return [
        dict(
            zip(
                PLATES.results,
                (pressure, particles, *(form(strength, sinkage, diameter, 1.0) for form in FORMS.values())),
                strict=True,
            )
        )
        for sinkage, pressure in zip(sinkages, pressed_pa(run, plate, sinkages), strict=True)
    ]


PLATES = Kind(
    columns=("diameter_m", "sinkage_m", "pressure_pa", "pressure_error_pa"),
    measured="pressure_pa",
    unit="Pa",
    optional=("pressure_error_pa",),
    results=("simulated_pa", "particles", *(f"{name.lower()}_pa" for name in FORMS)),
    place=("diameter_m", "sinkage_m"),
    theory=("Vesic", theory),
    group=lambda row: (row["soil"], row["diameter_m"]),
    simulate=pressed,
)
