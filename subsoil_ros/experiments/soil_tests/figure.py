"""Figure of soil tests."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from ...figures.plotting import COLOURS, new_figure, save_figure
from .runs import SoilTests
from .strength import SoilStrength


def draw_tests(tests: SoilTests, title: str, path: Path) -> None:
    """Curves of shear and tension, and the points with the fitted lines, as one PNG."""
    strength = SoilStrength.of(tests)
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
