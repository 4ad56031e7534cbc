"""Figure of soil tests."""

import math
from dataclasses import astuple
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from ...figures.plotting import COLOURS, new_figure, save_figure
from .curves import SoilTests
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
    for colour, name, (c, phi), fit, stresses in (
        ("main", "peak", ("c", "phi"), strength.peak, [curve.peak() for curve in tests.shear]),
        ("share", "residual", ("c", "phi"), strength.residual, [curve.residual() for curve in tests.shear]),
        ("wheels", "on metal", ("c_a", "delta"), strength.plate, [curve.residual() for curve in tests.plate]),
    ):
        if fit is None:
            continue
        x, y = 1e-3 * np.array(stresses).T
        ends = np.array([0.0, x.max()])
        cohesion, cohesion_error, angle, angle_error, r_squared = astuple(fit)
        words = (
            f"{name}: ${c}$ = {1e-3 * cohesion:.1f} $\\pm$ {1e-3 * cohesion_error:.1f} kPa,\n"
            f"$\\{phi}$ = {angle:.1f} $\\pm$ {angle_error:.1f} deg, $R^2$ = {r_squared:.4f}"
        )
        height = 1e-3 * cohesion + math.tan(math.radians(angle)) * ends
        line.plot(ends, height, color=COLOURS[colour], label=words)
        line.plot(x, y, "o", color=COLOURS[colour])
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
        pull.axhline(rumpf, color=COLOURS["reference"], ls="--", label=f"Rumpf {rumpf:.1f} kPa")
        _label(pull, "opening [mm]", "tension [kPa]", "tension")
    save_figure(figure, path)


def _label(axes: Axes, x: str, y: str, title: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
