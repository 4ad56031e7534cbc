"""What soil tests say: the line of Mohr and Coulomb and the numbers beside it, as JSON and CSV."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from .options import LEAST_POINTS
from .runs import SoilTests, rumpf_strength_pa


@dataclass(frozen=True)
class CoulombFit:
    """tau = c + sigma tan(phi), least squares over the tests, with standard errors."""

    cohesion_pa: float
    cohesion_error_pa: float
    friction_angle_deg: float
    friction_angle_error_deg: float
    r_squared: float


def fit_coulomb(normal_pa: Sequence[float], shear_pa: Sequence[float]) -> CoulombFit:
    """Straight line through (normal, shear) stresses.

    The error of the angle is that of the slope over 1 + slope^2.

    Raises:
        InputError: fewer than LEAST_POINTS points, or all at one normal stress.
    """
    x, y = np.asarray(normal_pa, np.float64), np.asarray(shear_pa, np.float64)
    n = len(x)
    spread = float(((x - x.mean()) ** 2).sum()) if n else 0.0
    if n < LEAST_POINTS or spread == 0.0:
        raise InputError(
            f"normal stresses: {n} given for the fit of c and phi, needed are at least {LEAST_POINTS} "
            "different ones"
        )
    slope = float(((x - x.mean()) * (y - y.mean())).sum()) / spread
    intercept = float(y.mean()) - slope * float(x.mean())
    left = float(((y - intercept - slope * x) ** 2).sum())
    variance = left / (n - 2)
    total = float(((y - y.mean()) ** 2).sum())
    return CoulombFit(
        cohesion_pa=intercept,
        cohesion_error_pa=math.sqrt(variance * (1.0 / n + float(x.mean()) ** 2 / spread)),
        friction_angle_deg=math.degrees(math.atan(slope)),
        friction_angle_error_deg=math.degrees(math.sqrt(variance / spread) / (1.0 + slope**2)),
        r_squared=1.0 - left / total if total > 0.0 else 1.0,
    )


@dataclass(frozen=True)
class SoilStrength:
    """Results of one soil."""

    particle_count: int
    density_kg_per_m3: float
    solid_fraction: float
    coordination: float
    settlement_modulus_pa: (
        float  # d stress / d strain of the height under the loads; glued walls carry a part
    )
    peak: CoulombFit
    residual: CoulombFit
    tensile_strength_pa: float | None
    break_height: float | None
    rumpf_strength_pa: float

    @staticmethod
    def of(tests: SoilTests) -> "SoilStrength":
        """Fits over all shear tests. Raises InputError as fit_coulomb."""
        specimen = tests.specimen
        nominal = [curve.nominal_pa for curve in tests.shear]
        peak = fit_coulomb(*zip(*(curve.peak() for curve in tests.shear), strict=True))
        residual = fit_coulomb(*zip(*(curve.residual() for curve in tests.shear), strict=True))
        softness = np.polyfit(nominal, [curve.settled for curve in tests.shear], 1)[0]
        pull = tests.tension
        return SoilStrength(
            particle_count=len(specimen.bed.positions_m),
            density_kg_per_m3=specimen.density_kg_per_m3,
            solid_fraction=specimen.solid_fraction,
            coordination=specimen.coordination,
            settlement_modulus_pa=float(1.0 / softness),
            peak=peak,
            residual=residual,
            tensile_strength_pa=pull.strength_pa if pull else None,
            break_height=pull.break_height if pull else None,
            rumpf_strength_pa=rumpf_strength_pa(specimen),
        )


def shear_rows(tests: SoilTests) -> list[dict[str, float]]:
    """One row for each shear test."""
    rows = []
    for curve in tests.shear:
        (peak_normal, peak_shear), (last_normal, last_shear) = curve.peak(), curve.residual()
        rows.append(
            {
                "nominal_normal_pa": curve.nominal_pa,
                "peak_normal_pa": peak_normal,
                "peak_shear_pa": peak_shear,
                "peak_displacement_m": float(curve.displacement_m[np.argmax(curve.shear_pa)]),
                "residual_normal_pa": last_normal,
                "residual_shear_pa": last_shear,
                "settled_strain": curve.settled,
                "speed_m_per_s": curve.speed_m_per_s,
                "normal_error": curve.normal_error,
                "force_imbalance": curve.imbalance,
            }
        )
    return rows


def write_results(tests: SoilTests, facts: dict[str, Any], folder: Path) -> None:
    """Writes soil_test.json, shear.csv and tension.csv into `folder`.

    facts: what else the JSON file is to say (scene, its hash).
    """
    import pandas as pd

    strength = asdict(SoilStrength.of(tests))
    content = facts | {"size_m": tests.size_m, "strength": strength, "tests": shear_rows(tests)}
    (folder / "soil_test.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    columns = ["nominal_pa", "displacement_m", "shear_pa", "normal_pa", "rise_m"]
    shear = pd.concat([pd.DataFrame(vars(curve), columns=columns) for curve in tests.shear])
    shear.rename(columns={"nominal_pa": "nominal_normal_pa"}).to_csv(folder / "shear.csv", index=False)
    if tests.tension is not None:
        tension = pd.DataFrame(vars(tests.tension), columns=["opening_m", "tension_pa"])
        tension.to_csv(folder / "tension.csv", index=False)
