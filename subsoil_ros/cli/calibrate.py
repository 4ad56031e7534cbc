"""subsoil calibrate FILE: fits particles to a laboratory's soil, or a wedge model to runs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..extras import require
from .output import say, stdout_console, table

if TYPE_CHECKING:
    from ..experiments.wedge_fit import WedgeFit
    from ..limits.stable_steps import Timing

LARGEST_RADIUS_M = 0.1
"""Largest radius for a calibration: such spheres are 0.2 m wide, the share of a subsoiler 0.06 m."""

CORRELATED = 0.95
"""Correlation of two fitted values above which a note is printed: the part of either's variance that
the other does not explain is then below 10 %."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "design",
        type=Path,
        metavar="FILE",
        help="soil of a laboratory (.yaml, docs/soils.md) or its shipped name, or a design "
        "(docs/calibrate.md)",
    )
    parser.add_argument(
        "--radius",
        type=float,
        metavar="R",
        default=None,
        help="mean radius [m] of the particles that a laboratory's soil is fitted at",
    )
    parser.add_argument(
        "--law",
        choices=("cohesive_linear", "elasto_plastic_adhesive", "bonded"),
        help="of the particles of a laboratory's soil: springs that attract (default), spheres that yield "
        "and stick, or dry ones with bonds that break for good",
    )
    parser.add_argument(
        "--out",
        required=True,
        type=Path,
        metavar="FILE",
        help="material (soil) or soil file (wedge) to write; must not exist",
    )
    parser.add_argument(
        "--runs",
        type=Path,
        metavar="DIR",
        default=None,
        help="where finished runs are kept, by the hash of their scene (default: the user's cache)",
    )
    parser.add_argument(
        "--threads",
        type=int,
        default=1,
        metavar="N",
        help="of the soil engine; for a laboratory's soil, tests that run at once (default: 1)",
    )


def run(args: argparse.Namespace) -> int:
    """Run what has not been run, fit, print, write."""
    from ..cache_folders import user_cache_folder
    from ..experiments.pulls import bed_density_kg_per_m3, measure
    from ..experiments.wedge_design import base_scene, read_design
    from ..experiments.wedge_fit import FITTED, fit_wedge
    from ..loading.files import shipped_soil
    from ..loading.soil_file import write_soil_file
    from ..yaml_document import read_document
    from .progress import KernelAnnouncer, working

    args.design = shipped_soil(args.design)
    of_laboratory = read_document(args.design, str(args.design)).get("model") == "laboratory"
    if of_laboratory != (args.radius is not None):
        raise InputError(
            f"--radius: is {'needed for' if of_laboratory else 'only for'} a laboratory's soil "
            "(model: laboratory)"
        )
    if args.law is not None and not of_laboratory:
        raise InputError("--law: is only for a laboratory's soil (model: laboratory)")
    if args.out.exists():
        raise InputError(f"--out {args.out}: exists already; results are never written over, name another")
    if not args.out.parent.is_dir():
        raise InputError(f"--out {args.out}: its folder is not there; make it, or name another")
    if of_laboratory:
        return _material(args)
    design = read_design(args.design)
    folder = args.runs or user_cache_folder() / "calibration"
    scene = base_scene(args.design, design)
    with KernelAnnouncer():
        measured = measure(scene, design, folder, args.threads, _progress)
        with working("preparing the bed"):
            density = bed_density_kg_per_m3(scene, args.threads)
        say(f"fitting {len(FITTED)} values to {sum(item.used for item in measured)} points")
        with working("fitting"):
            fit = fit_wedge(scene, design, density, measured)
    write_soil_file(args.out, fit.soil)
    _print(fit, args.out)
    return 0


def _material(args: argparse.Namespace) -> int:
    require("a calibration to a laboratory's soil", "dask", "distributed")
    from ..experiments.laboratory_fit import calibrate
    from ..loading.material_file import read_laboratory_soil, write_material

    soil = read_laboratory_soil(args.design)
    if not 0.0 < args.radius <= LARGEST_RADIUS_M:
        raise InputError(
            f"--radius: given {args.radius:g} m, allowed is up to {LARGEST_RADIUS_M:g} m: soil of larger "
            "spheres is coarser than any tool"
        )
    if args.threads < 1:
        raise InputError(f"--threads: given {args.threads}; it must be 1 or more")
    material = calibrate(soil, args.radius, args.threads, say, args.law or "cohesive_linear")
    write_material(args.out, material)
    console = stdout_console(highlight=True)
    wanted = soil.model_dump()
    title = f"{soil.name}, r = {args.radius * 1e3:g} mm"
    found = table(title, ("", "wanted", "found", "95 % confidence"))
    for key, interval in {**material.measured, **material.fitted}.items():
        asked = wanted.get(key)
        found.add_row(
            key,
            "" if asked is None else f"{asked:g}",
            f"{interval.value:.4g}",
            f"{interval.low:.4g} to {interval.high:.4g}",
        )
    console.print(found)
    low, high = material.radii_m
    console.print(f"written to {args.out}; for mean radii from {low:g} to {high:g} m")
    return 0


@contextmanager
def _progress(name: str, timing: Timing) -> Iterator[Callable[[int], None]]:
    from .progress import RunProgress

    say(f"running {name}")
    with RunProgress(name, timing) as progress:
        yield progress


def _print(fit: WedgeFit, out: Path) -> None:
    from ..analysis.intervals import t_quantile
    from ..experiments.wedge_fit import searched_by

    console = stdout_console(highlight=True)
    fitted = table("fitted values", ("value", "", "95 % confidence"), words=3)
    values = fit.soil.values
    shown = values.model_dump()
    shown["friction_part"] = math.tan(values.tool_friction_angle_rad) / math.tan(values.friction_angle_rad)
    shown["adhesion_part"] = values.adhesion_pa / values.cohesion_pa if values.cohesion_pa else 0.0
    for name in searched_by(fit.soil.values.theory):
        error = fit.soil.errors.get(name)
        confidence = "at its bound" if fit.freedoms else "not known: as many values as forces"
        if error is not None:
            confidence = f"+- {t_quantile(fit.freedoms) * error:.2g}"
        fitted.add_row(name, f"{shown[name]:.4g}", confidence)
    length = "period_m" if values.period_m else "period_factor"
    fitted.add_row("failure", values.failure, "by matching the fluctuation")
    for name in ("block_depth_m", "drop", "length_variation", length):
        fitted.add_row(name, f"{shown[name]:.4g}", "by matching the fluctuation")
    console.print(fitted)
    names = fit.names
    for i, one in enumerate(names):
        for j in range(i):
            if abs(fit.correlation[i, j]) > CORRELATED:
                console.print(
                    f"{one} and {names[j]} are hardly told apart by these runs (correlation "
                    f"{fit.correlation[i, j]:.2f})"
                )
    headings = (
        "point", "draft N", "", "upward N", "", "deviation N", "", "variance of means", "power by octave",
        "scatter of runs %",
    )  # fmt: skip
    points = table("particles and wedge model", headings)
    for item in fit.compared:
        cells = []
        for first, second in (item.draft_newton, item.upward_newton, item.deviation_newton):
            cells += [f"{first:.0f} / {second:.0f}", f"{100.0 * (second / first - 1.0):+.0f} %"]
        cells += [
            " ".join(f"{part:.2f}" for part in ratio) for ratio in (item.variance_ratio, item.power_ratio)
        ]
        scatter = (
            ", ".join(f"{100.0 * part:.0f}" for part in item.scatter) if item.replicates > 1 else "one run"
        )
        points.add_row(item.point.name + ("" if item.used else " (not fitted)"), *cells, scatter)
    console.print(points)
    console.print(
        f"residuals: {fit.chi_squared:.3g} of (3 % of the draft)^2 per freedom, {fit.freedoms} freedoms; "
        f"written to {out}"
    )
