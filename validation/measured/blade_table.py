"""Tables of flat blades that were drawn: template.csv."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from subsoil_ros.loading.material_file import read_material

from ..blades import Blade, Soil, godwin_odogherty, mckyes_ali, perumpral
from ..narrow_blade import pulled, soil_of
from .table import Kind, Row

HEAP_M = 0.05
"""A blade stands out of the surface by its depth and this, so that no heap flows over it."""

FORMS = {"Perumpral": perumpral, "Godwin and O'Dogherty": godwin_odogherty, "McKyes and Ali": mckyes_ali}


def blade_of(row: Mapping[str, str | float]) -> Blade:
    """Raises ValueError for a blade that cannot be."""
    width, depth, rake, speed = (
        float(row[key]) for key in ("width_m", "depth_m", "rake_deg", "speed_m_per_s")
    )
    return Blade(width, depth, math.radians(rake), speed)


def printed_soil(row: Mapping[str, str | float]) -> Soil:
    """The soil as the laboratory gives it."""
    return Soil(
        float(row["cohesion_pa"]), math.radians(float(row["friction_angle_deg"])),
        float(row["bulk_density_kg_per_m3"]), math.radians(float(row["metal_friction_angle_deg"])),
    )  # fmt: skip


def theory(row: Row) -> float:
    """Perumpral's draft with the strength of the laboratory [N]."""
    return perumpral(printed_soil(row), blade_of(row)).draft_newton


def drawn(
    rows: Sequence[Row], soil: Path, radius_m: float, seed: int, travel_m: tuple[float, float] | None
) -> list[dict[str, float]]:
    """Simulated blades, and closed forms with the strength that the particles were found to have.

    travel_m: from where to where means are taken (default: as narrow_blade.pulled).
    """
    found = []
    for row in rows:
        depth, blade = float(row["depth_m"]), blade_of(row)
        way = {} if travel_m is None else {"first_m": travel_m[0], "depths": travel_m[1] / depth}
        pull = pulled(str(soil.resolve()), radius_m, blade, seed=seed, above_m=depth + HEAP_M, **way)
        strength = soil_of(read_material(soil, str(soil)))
        values = (
            *pull.draft, pull.vertical[0], pull.particles,
            *(form(strength, blade).draft_newton for form in FORMS.values()),
        )  # fmt: skip
        found.append(dict(zip(BLADES.results, values, strict=True)))
    return found


BLADES = Kind(
    columns=(
        "rake_deg", "width_m", "depth_m", "speed_m_per_s", "draft_newton", "draft_error_newton",
        "vertical_newton",
    ),
    measured="draft_newton",
    unit="N",
    optional=("draft_error_newton", "vertical_newton"),
    results=(
        "simulated_newton", "simulated_error_newton", "simulated_vertical_newton", "particles",
        "perumpral_newton", "godwin_odogherty_newton", "mckyes_ali_newton",
    ),
    place=("rake_deg", "width_m", "depth_m", "speed_m_per_s"),
    theory=("Perumpral", theory),
    group=lambda row: tuple(row.values()),
    simulate=drawn,
)  # fmt: skip
