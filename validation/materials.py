"""The shipped materials in cells of one size, with seeds that they were not fitted on.

    python -m validation.materials [--soils loam] [--radii-mm 10 15] [--cell-m EDGE] [--json FILE]
    python -m validation.materials --soils dry_sand --solid-fractions 0.57 0.6 0.63 [--radii-mm 10]

Every soil is tested at every radius in endless cells of one edge (12 of the largest diameters, unless
--cell-m says another), in plane strain. Exit status 1 where, of the mean over the seeds, the cohesion is off
by more than 1 kPa and 10 %, the friction angle by more than 2 degrees, or the density by more than 3 %.

With --solid-fractions the particles of a material, fitted at the solid fraction of its soil, are tested in
looser and denser cells, up to the critical state: strength at the peak and in that state, and the solid
fraction that the cell has then. These are reported only.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from subsoil_ros.experiments.element_tests import (
    CELL_DIAMETERS,
    CRITICAL_STRAIN,
    LEAST_PA,
    Strength,
    fit_strength,
    plane_strain,
    prepare_cell,
)
from subsoil_ros.loading.files import shipped_material, shipped_names
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.material_file import read_material
from subsoil_ros.scene.material import RADIUS_SPREAD
from subsoil_ros.yaml_document import Document

SEEDS = (1, 2, 3)
"""Other than experiments.laboratory_fit.SEEDS."""

COHESION_PA, COHESION_PART, ANGLE_DEG, DENSITY_PART = 1e3, 0.1, 2.0, 0.03
"""Accepted."""


class Found(NamedTuple):
    """Of one cell."""

    cohesion_pa: float
    friction_angle_deg: float
    density_kg_per_m3: float
    held_to: float  # largest part by which a least stress missed its value


def document_of(soil: str, radius_m: float, edge_m: float, seed: int, bed: dict[str, float]) -> Document:
    """A scene of nothing but the soil."""
    box = {"length_m": edge_m, "width_m": edge_m, "depth_m": edge_m}
    particles = {"radius_m": radius_m}
    parts = {"material": soil, "bin": box, "particles": particles, "bed": {"seed": seed} | bed}
    return {"name": soil, "duration_s": 1.0, "soil": parts}


def tested(soil: str, radius_m: float, edge_m: float, seed: int) -> Found:
    """A soil in a cell."""
    scene = load_scene(document_of(soil, radius_m, edge_m, seed, {}))
    cell = prepare_cell(scene, edge_m=edge_m)
    curves = [plane_strain(cell, least) for least in LEAST_PA]
    strength = fit_strength(*zip(*(curve.peak_pa() for curve in curves), strict=True))
    density = float(np.mean([curve.density_kg_per_m3 for curve in curves]))
    return Found(*strength, density, max(curve.held_to for curve in curves))


class AtFraction(NamedTuple):
    """Of one cell of a given solid fraction."""

    peak: Strength
    critical: Strength
    critical_fraction: float


def at_fraction(soil: str, radius_m: float, fraction: float, seed: int) -> AtFraction:
    """A soil in a cell of CELL_DIAMETERS, strained as far as the critical state."""
    edge = CELL_DIAMETERS * 2.0 * (1.0 + RADIUS_SPREAD) * radius_m
    cell = prepare_cell(load_scene(document_of(soil, radius_m, edge, seed, {"solid_fraction": fraction})))
    curves = [plane_strain(cell, least, CRITICAL_STRAIN, to_peak=False) for least in LEAST_PA]
    peak = fit_strength(*zip(*(curve.peak_pa() for curve in curves), strict=True))
    critical = fit_strength(*zip(*(curve.critical_pa() for curve in curves), strict=True))
    grown = [curve.volume_strain[curve.strain > 0.9 * CRITICAL_STRAIN].mean() for curve in curves]
    return AtFraction(peak, critical, fraction / (1.0 + float(np.mean(grown))))


def report_fractions(args: argparse.Namespace) -> None:
    """Prints the strength at each solid fraction."""
    print("| soil | solid fraction | radius mm | c kPa | phi deg | critical c kPa | phi deg | fraction |")
    print("|---" * 8 + "|")
    cases = itertools.product(args.soils, args.solid_fractions, args.radii_mm)
    with ProcessPoolExecutor(args.processes) as pool:
        jobs = {
            (soil, fraction, radius): [
                pool.submit(at_fraction, soil, 1e-3 * radius, fraction, seed) for seed in SEEDS
            ]
            for soil, fraction, radius in cases
        }
        for (soil, fraction, radius), job in jobs.items():
            cells = [one.result() for one in job]
            found = np.array([(*cell.peak, *cell.critical, cell.critical_fraction) for cell in cells])
            (c, phi, c_end, phi_end, end), spread = found.mean(axis=0), found.std(axis=0, ddof=1)
            print(
                f"| {soil} | {fraction:g} | {radius:g} | {1e-3 * c:.2f} +- {1e-3 * spread[0]:.2f} "
                f"| {phi:.1f} +- {spread[1]:.1f} | {1e-3 * c_end:.2f} +- {1e-3 * spread[2]:.2f} "
                f"| {phi_end:.1f} +- {spread[3]:.1f} | {end:.3f} +- {spread[4]:.3f} |",
                flush=True,
            )


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
    parser.add_argument("--soils", nargs="+", default=shipped_names("materials"))
    parser.add_argument("--radii-mm", nargs="+", type=float, default=[10.0, 15.0])
    parser.add_argument("--cell-m", type=float)
    parser.add_argument("--solid-fractions", nargs="+", type=float)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args(arguments)
    if args.solid_fractions:
        report_fractions(args)
        return 0
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
