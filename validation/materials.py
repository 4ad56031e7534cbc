"""The shipped materials in cells of one size, with seeds that they were not fitted on.

    python -m validation.materials [--soils loam] [--radii-mm 10 15] [--cell-m EDGE] [--json FILE]

Every soil is tested at every radius in endless cells of one edge (12 of the largest diameters, unless
--cell-m says another), in plane strain. Exit status 1 where, of the mean over the seeds, the cohesion is off
by more than 1 kPa and 10 %, the friction angle by more than 2 degrees, or the density by more than 3 %.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from subsoil_ros.experiments.soil_tests.element import (
    CELL_DIAMETERS,
    LEAST_PA,
    fit_strength,
    plane_strain,
    prepare_cell,
)
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.material import read_material
from subsoil_ros.loading.shipped import material_names, shipped_material
from subsoil_ros.scene.material import RADIUS_SPREAD

SEEDS = (1, 2, 3)
"""Other than experiments.calibration.material.SEEDS."""

COHESION_PA, COHESION_PART, ANGLE_DEG, DENSITY_PART = 1e3, 0.1, 2.0, 0.03
"""Accepted."""


class Found(NamedTuple):
    """Of one cell."""

    cohesion_pa: float
    friction_angle_deg: float
    density_kg_per_m3: float
    held_to: float  # largest part by which a least stress missed its value


def tested(soil: str, radius_m: float, edge_m: float, seed: int) -> Found:
    """A soil in a cell."""
    box = {"length_m": edge_m, "width_m": edge_m, "depth_m": edge_m}
    scene = load_scene(
        {"name": soil, "duration_s": 1.0,
         "soil": {"material": soil, "bin": box, "particles": {"radius_m": radius_m}, "bed": {"seed": seed}}}
    )  # fmt: skip
    cell = prepare_cell(scene, edge_m=edge_m)
    curves = [plane_strain(cell, least) for least in LEAST_PA]
    strength = fit_strength(*zip(*(curve.peak_pa() for curve in curves), strict=True))
    density = float(np.mean([curve.density_kg_per_m3 for curve in curves]))
    return Found(*strength, density, max(curve.held_to for curve in curves))


def off(soil: str, found: Sequence[Found]) -> tuple[float, float, float, bool]:
    """How far the means are off: cohesion [Pa], angle [deg], density (part); and whether that is accepted."""
    wanted = read_material(shipped_material(Path(soil)), soil).soil
    cohesion, angle, density, _ = np.mean(found, axis=0)
    by = (
        float(cohesion) - wanted.cohesion_pa,
        float(angle) - wanted.friction_angle_deg,
        float(density) / wanted.bulk_density_kg_per_m3 - 1.0,
    )
    good = abs(by[0]) <= max(COHESION_PA, COHESION_PART * wanted.cohesion_pa)
    return *by, good and abs(by[1]) <= ANGLE_DEG and abs(by[2]) <= DENSITY_PART


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table. Returns 1 if a soil is not what its file says."""
    parser = argparse.ArgumentParser(prog="python -m validation.materials", description=main.__doc__)
    parser.add_argument("--soils", nargs="+", default=material_names())
    parser.add_argument("--radii-mm", nargs="+", type=float, default=[10.0, 15.0])
    parser.add_argument("--cell-m", type=float)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args(arguments)
    edge = args.cell_m or CELL_DIAMETERS * 2e-3 * (1.0 + RADIUS_SPREAD) * max(args.radii_mm)
    print("| soil | radius mm | c kPa | phi deg | density kg/m3 | off by | least stress held to |")
    print("|---|---|---|---|---|---|---|")
    rows, all_good = [], True
    with ProcessPoolExecutor(args.processes) as pool:
        jobs = {
            (soil, radius): [pool.submit(tested, soil, 1e-3 * radius, edge, seed) for seed in SEEDS]
            for soil in args.soils
            for radius in args.radii_mm
        }
        for (soil, radius), job in jobs.items():
            found = [one.result() for one in job]
            means, spread = np.mean(found, axis=0), np.std(found, axis=0, ddof=1)
            cohesion, angle, density, good = off(soil, found)
            all_good &= good
            rows.append(
                {"soil": soil, "radius_m": 1e-3 * radius, "cell_m": edge, "found": found, "good": good}
            )
            print(
                f"| {soil} | {radius:g} | {means[0] * 1e-3:.2f} +- {spread[0] * 1e-3:.2f} "
                f"| {means[1]:.1f} +- {spread[1]:.1f} | {means[2]:.0f} "
                f"| {cohesion * 1e-3:+.2f} kPa, {angle:+.1f} deg, {density:+.1%}{'' if good else ': too far'}"
                f" | {max(one.held_to for one in found):.1%} |",
                flush=True,
            )
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))
    return int(not all_good)


if __name__ == "__main__":
    sys.exit(main())
