"""Results of soil tests as JSON and CSV: the Mohr-Coulomb line and further numbers."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from .curves import ShearCurve, SoilTests
from .options import LEAST_POINTS, NORMAL_TOLERANCE
from .runs import rumpf_strength_pa


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
    from scipy.stats import linregress

    if len(normal_pa) < LEAST_POINTS or len(set(normal_pa)) == 1:
        raise InputError(
            f"normal stresses: {len(normal_pa)} given for the fit of c and phi; there must be at least "
            f"{LEAST_POINTS} different ones"
        )
    line = linregress(normal_pa, shear_pa)
    return CoulombFit(
        cohesion_pa=float(line.intercept),
        cohesion_error_pa=float(line.intercept_stderr),
        friction_angle_deg=math.degrees(math.atan(line.slope)),
        friction_angle_error_deg=math.degrees(line.stderr / (1.0 + line.slope**2)),
        r_squared=float(line.rvalue**2),
    )


@dataclass(frozen=True)
class PlateFit:
    """tau = c_a + sigma tan(delta) of soil that slides on metal, as CoulombFit."""

    adhesion_pa: float
    adhesion_error_pa: float
    delta_deg: float
    delta_error_deg: float
    r_squared: float


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
    plate: PlateFit | None  # None: not tested
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
        plate = None
        if tests.plate:
            slid = fit_coulomb(*zip(*(curve.residual() for curve in tests.plate), strict=True))
            plate = PlateFit(*astuple(slid))
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
            plate=plate,
            tensile_strength_pa=pull.strength_pa if pull else None,
            break_height=pull.break_height if pull else None,
            rumpf_strength_pa=rumpf_strength_pa(specimen),
        )


def shear_rows(curves: Sequence[ShearCurve]) -> list[dict[str, float]]:
    """One row for each test, of direct shear or over a plate."""
    rows = []
    for curve in curves:
        (peak_normal, peak_shear), (last_normal, last_shear) = curve.peak(), curve.residual()
        rows.append(
            {
                "nominal_normal_pa": curve.nominal_pa,
                "peak_normal_pa": peak_normal,
                "peak_shear_pa": peak_shear,
                "peak_displacement_m": float(curve.displacement_m[np.argmax(curve.shear_pa)]),
                "residual_normal_pa": last_normal,
                "residual_shear_pa": last_shear,
                "residual_dilatancy": curve.residual_dilatancy,
                "settled_strain": curve.settled,
                "speed_m_per_s": curve.speed_m_per_s,
                "normal_error": curve.normal_error,
                "force_imbalance": curve.imbalance,
            }
        )
    return rows


def strength_warnings(tests: SoilTests) -> list[str]:
    """Warnings about normal stresses that were not held."""
    return [
        f"{name} at {curve.nominal_pa:g} Pa: normal stress held to {100.0 * curve.normal_error:.2g} % "
        f"({100.0 * NORMAL_TOLERANCE:g} % allowed); the fit takes the stress that was met; give a "
        "smaller --inertial-number, or a longer and wider specimen"
        for name, curves in (("direct shear", tests.shear), ("plate", tests.plate))
        for curve in curves
        if curve.normal_error > NORMAL_TOLERANCE
    ]


def write_results(tests: SoilTests, facts: dict[str, Any], folder: Path) -> None:
    """Write soil_test.json, shear.csv, plate.csv and tension.csv into `folder`.

    facts: further entries of the JSON file (scene, its hash).
    """
    import pandas as pd

    strength = asdict(SoilStrength.of(tests))
    content = facts | {
        "size_m": tests.size_m,
        "strength": strength,
        "tests": shear_rows(tests.shear),
        "plate_tests": shear_rows(tests.plate),
        "warnings": strength_warnings(tests),
    }
    (folder / "soil_test.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    columns = ["nominal_pa", "displacement_m", "shear_pa", "normal_pa", "rise_m"]
    for name, curves in (("shear", tests.shear), ("plate", tests.plate)):
        if curves:
            table = pd.concat([pd.DataFrame(vars(curve), columns=columns) for curve in curves])
            table = table.rename(columns={"nominal_pa": "nominal_normal_pa"})
            table.to_csv(folder / f"{name}.csv", index=False)
    if tests.tension is not None:
        tension = pd.DataFrame(vars(tests.tension), columns=["opening_m", "tension_pa"])
        tension.to_csv(folder / "tension.csv", index=False)
