"""Soil tests of one soil made of particles of two sizes, with the law scaled and without: a table.

python benchmarks/soil_scaling.py [SEEDS]   (default 3; half an hour on one core;
reproduction/yuan_yu_2020/soil_tests.md shows it)
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from subsoil_ros.experiments.soil_tests.runs import run_soil_tests
from subsoil_ros.experiments.soil_tests.strength import SoilStrength
from subsoil_ros.loading.loader import load_scene

SCENE = Path(__file__).parents[1] / "config" / "scenes" / "subsoiler_1s300.yaml"
RADIUS_M = 0.010
SIZE_M = (0.30, 0.20, 0.15)  # the same for all: 10 diameters of the larger particles long, 5 high
NORMAL_PA = (5e3, 10e3, 20e3)
INERTIAL_NUMBER = 1e-2  # three times the usual one, to save time: the same for all
CASES = {  # radius and, where the law is scaled, the radius it holds for
    "r": (RADIUS_M, None),
    "1.5 r, law scaled": (1.5 * RADIUS_M, RADIUS_M),
    "1.5 r, law as it is": (1.5 * RADIUS_M, None),
}


def strength_of(radius_m: float, reference_radius_m: float | None, seed: int) -> dict[str, float]:
    """Results of one specimen."""
    overrides = [
        "initial_condition=lowered",
        f"soil.bed={{kind: dense_random, seed: {seed}}}",
        f"soil.particles.radius_m={radius_m}",
    ]
    if reference_radius_m is not None:
        overrides.append(f"soil.particles.reference_radius_m={reference_radius_m}")
    with tempfile.TemporaryDirectory() as folder:
        tests = run_soil_tests(
            load_scene(SCENE, overrides), NORMAL_PA, SIZE_M, Path(folder),
            inertial_number=INERTIAL_NUMBER, plate=False,
        )  # fmt: skip
    strength = SoilStrength.of(tests)
    return {
        "density_kg_per_m3": strength.density_kg_per_m3,
        "peak_cohesion_pa": strength.peak.cohesion_pa,
        "peak_friction_angle_deg": strength.peak.friction_angle_deg,
        "shear_strength_at_20_kpa_pa": tests.shear[2].peak()[1],
        "tensile_strength_pa": strength.tensile_strength_pa or 0.0,
        "settlement_modulus_pa": strength.settlement_modulus_pa,
    }


def main() -> None:
    """One line of JSON for each specimen, then mean and standard deviation over the seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("seeds", nargs="?", type=int, default=3, help="how many (default 3)")
    seeds = range(parser.parse_args().seeds)
    found: dict[str, list[dict[str, float]]] = {case: [] for case in CASES}
    for seed in seeds:
        for case, (radius_m, reference_radius_m) in CASES.items():
            result = strength_of(radius_m, reference_radius_m, seed)
            found[case].append(result)
            print(json.dumps({"case": case, "seed": seed} | result), flush=True)
    for case, results in found.items():
        for name in results[0]:
            values = np.array([result[name] for result in results])
            spread = values.std(ddof=1) if len(values) > 1 else 0.0
            print(f"{case:22s}{name:32s}{values.mean():12.5g} +- {spread:.3g}")


if __name__ == "__main__":
    main()
