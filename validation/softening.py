"""Direct shear of soil whose particles attract each other, and of bonded soil: the residual strength.

    python -m validation.softening [--soils loam loam_bonded] [--normal-kpa 5 10 20] [--json FILE]

Boxes of 12 x 8 x 8 of the largest diameters (docs/soil_tests.md). Attraction acts again wherever two
particles meet, so a part of the cohesion is left however far the soil is sheared; bonds break for good.
Exit status 1 where the cohesion that bonded soil has left is more than LEFT of its peak, or where soil
that is not bonded has lost as much.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from subsoil_ros.experiments.soil_tests.options import SHEAR_DIAMETERS
from subsoil_ros.experiments.soil_tests.runs import run_soil_tests
from subsoil_ros.experiments.soil_tests.strength import SoilStrength, strength_warnings
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.material import RADIUS_SPREAD

from .laboratory import Document

LEFT = 0.2
"""Part of the cohesion at the peak (chosen: a fit through three stresses tells no less)."""

RADIUS_M = 0.010


def sheared(soil: str, normal_pa: Sequence[float]) -> Document:
    """Peak, residual, and the curves, thinned."""
    diameter = 2.0 * (1.0 + RADIUS_SPREAD) * RADIUS_M
    size = tuple(count * diameter for count in SHEAR_DIAMETERS)
    box = dict(zip(("length_m", "width_m", "depth_m"), size, strict=True))
    parts = {"material": soil, "bin": box, "particles": {"radius_m": RADIUS_M}, "bed": {"seed": 1}}
    scene = load_scene({"name": soil, "duration_s": 1.0, "soil": parts})
    with tempfile.TemporaryDirectory() as folder:
        tests = run_soil_tests(scene, tuple(normal_pa), size, Path(folder), plate=False)
    strength = SoilStrength.of(tests)
    curves = [
        {
            "normal_pa": curve.nominal_pa,
            "displacement_m": curve.displacement_m[::10].tolist(),
            "shear_pa": curve.shear_pa[::10].tolist(),
        }
        for curve in tests.shear
    ]
    found = {
        name: {"cohesion_pa": fit.cohesion_pa, "friction_angle_deg": fit.friction_angle_deg}
        for name, fit in (("peak", strength.peak), ("residual", strength.residual))
    }
    return found | {"curves": curves, "warnings": strength_warnings(tests)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table. Returns 1 where a soil does not do what it should."""
    parser = argparse.ArgumentParser(prog="python -m validation.softening", description=main.__doc__)
    parser.add_argument("--soils", nargs="+", default=["loam", "loam_bonded"])
    parser.add_argument("--normal-kpa", nargs="+", type=float, default=[5.0, 10.0, 20.0])
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(arguments)
    head = "soil | peak: cohesion kPa | angle deg | residual: cohesion kPa | angle deg"
    print(f"| {head} |\n|---|---|---|---|---|")
    wrong, found = False, {}
    with ProcessPoolExecutor(args.processes) as pool:
        jobs = {
            soil: pool.submit(sheared, soil, [1e3 * normal for normal in args.normal_kpa])
            for soil in args.soils
        }
        for soil, job in jobs.items():
            found[soil] = job.result()
            peak, left = found[soil]["peak"], found[soil]["residual"]
            cells = [
                f"{1e-3 * fit['cohesion_pa']:.2f} | {fit['friction_angle_deg']:.1f}" for fit in (peak, left)
            ]
            print(f"| {soil} | {' | '.join(cells)} |", flush=True)
            for warning in found[soil]["warnings"]:
                print(warning, file=sys.stderr)
            bonded = soil.endswith("bonded")
            wrong |= bonded != (left["cohesion_pa"] < LEFT * peak["cohesion_pa"])
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
