"""What soil tests say: the line of Mohr and Coulomb and the numbers beside it, as JSON, CSV and figure."""

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...analysis.plotting import COLOURS, new_figure, save_figure
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
    """Writes soil_test.json, shear.csv, tension.csv and soil_test.png into `folder`.

    facts: what else the JSON file is to say (scene, its hash).
    """
    strength = SoilStrength.of(tests)
    content = facts | {"size_m": tests.size_m, "strength": asdict(strength), "tests": shear_rows(tests)}
    (folder / "soil_test.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    with (folder / "shear.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("nominal_normal_pa", "displacement_m", "shear_pa", "normal_pa", "rise_m"))
        for curve in tests.shear:
            columns = (curve.displacement_m, curve.shear_pa, curve.normal_pa, curve.rise_m)
            for row in zip(*(column.tolist() for column in columns), strict=True):
                writer.writerow((repr(curve.nominal_pa), *map(repr, row)))
    if tests.tension is not None:
        with (folder / "tension.csv").open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(("opening_m", "tension_pa"))
            pairs = (tests.tension.opening_m.tolist(), tests.tension.tension_pa.tolist())
            writer.writerows((repr(a), repr(b)) for a, b in zip(*pairs, strict=True))
    draw_tests(tests, strength, str(facts.get("scene", "")), folder / "soil_test.png")


def draw_tests(tests: SoilTests, strength: SoilStrength, title: str, path: Path) -> None:
    """Curves of shear and tension, and the points with the fitted lines, as one PNG."""
    figure = new_figure(13.0, 4.4)
    figure.suptitle(f"Soil tests: {title}", fontsize=11)
    curves, line, pull = figure.subplots(1, 3)
    for k, curve in enumerate(tests.shear):
        shade = 1.0 - 0.7 * k / max(1, len(tests.shear) - 1)
        label = f"{1e-3 * curve.nominal_pa:g} kPa"
        curves.plot(
            1e3 * curve.displacement_m, 1e-3 * curve.shear_pa, color=COLOURS["main"], alpha=shade, label=label
        )
    _label(curves, "shear displacement [mm]", "shear stress [kPa]", "direct shear, by normal stress")
    for name, fit, stresses in (
        ("main", strength.peak, [curve.peak() for curve in tests.shear]),
        ("share", strength.residual, [curve.residual() for curve in tests.shear]),
    ):
        x, y = 1e-3 * np.array(stresses).T
        ends = np.array([0.0, x.max()])
        slope = math.tan(math.radians(fit.friction_angle_deg))
        words = (
            f"{'peak' if name == 'main' else 'residual'}: c = {1e-3 * fit.cohesion_pa:.1f} $\\pm$ "
            f"{1e-3 * fit.cohesion_error_pa:.1f} kPa,\n$\\phi$ = {fit.friction_angle_deg:.1f} $\\pm$ "
            f"{fit.friction_angle_error_deg:.1f} deg, $R^2$ = {fit.r_squared:.4f}"
        )
        line.plot(ends, 1e-3 * fit.cohesion_pa + slope * ends, color=COLOURS[name], label=words)
        line.plot(x, y, "o", color=COLOURS[name])
    _label(line, "normal stress [kPa]", "shear stress [kPa]", "Mohr-Coulomb line")
    line.set_xlim(left=0.0)
    line.set_ylim(bottom=min(0.0, line.get_ylim()[0]))
    if tests.tension is None:
        pull.axis("off")
    else:
        strongest = 1e-3 * tests.tension.strength_pa
        pull.plot(
            1e3 * tests.tension.opening_m, 1e-3 * tests.tension.tension_pa, color=COLOURS["main"],
            label=f"largest {strongest:.1f} kPa",
        )  # fmt: skip
        rumpf = 1e-3 * strength.rumpf_strength_pa
        pull.axhline(rumpf, color=COLOURS["paper"], ls="--", label=f"Rumpf {rumpf:.1f} kPa")
        _label(pull, "opening [mm]", "tension [kPa]", "tension")
    save_figure(figure, path)


def _label(axes: Axes, x: str, y: str, title: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
