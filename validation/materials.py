"""The shipped materials in cells of one size, with seeds that they were not fitted on.

    python -m validation.materials [--soils loam] [--radii-mm 10 15] [--cell-m EDGE] [--json FILE]
    python -m validation.materials --soils dry_sand --solid-fractions 0.57 0.6 0.63 [--radii-mm 10]
        [--frictions 0.3 0.6] [--rolling 0.1 0.3] [--seeds 3]

Every soil is tested at every radius in endless cells of one edge (12 of the largest diameters, unless
--cell-m says another), in plane strain. Exit status 1 where, of the mean over the seeds, the cohesion is off
by more than 1 kPa and 10 %, the friction angle by more than 2 degrees, or the density by more than 3 %.

With --solid-fractions the particles of a material, fitted at the solid fraction of its soil, are tested in
looser and denser cells, up to the critical state: strength at the peak and in that state, with the range of
its angle over the seeds, the solid fraction that the cell has then, and the slope of a small heap.
--frictions and --rolling replace the particles' own. These are reported only.
"""

import argparse
import itertools
import json
import math
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
from subsoil_ros.experiments.strength_tests import repose_rad
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


def tested(soil: str, radius_m: float, edge_m: float, seed: int) -> Found:
    """A soil in a cell."""
    box = {"length_m": edge_m, "width_m": edge_m, "depth_m": edge_m}
    parts = {"material": soil, "bin": box, "particles": {"radius_m": radius_m}, "bed": {"seed": seed}}
    scene = load_scene({"name": soil, "duration_s": 1.0, "soil": parts})
    cell = prepare_cell(scene, edge_m=edge_m)
    curves = [plane_strain(cell, least) for least in LEAST_PA]
    strength = fit_strength(*zip(*(curve.peak_pa() for curve in curves), strict=True))
    density = float(np.mean([curve.density_kg_per_m3 for curve in curves]))
    return Found(*strength, density, max(curve.held_to for curve in curves))


class Sand(NamedTuple):
    """Particles of a shipped material in a bed of another solid fraction; None: the material's own."""

    soil: str
    radius_m: float
    solid_fraction: float
    friction: float | None = None
    rolling: float | None = None

    def section(self, seed: int) -> Document:
        """Keys of a scene's soil, without its bin."""
        section = read_material(shipped_material(Path(self.soil)), self.soil).section(self.radius_m)
        particle: Document = dict(section["law"]["particle"])
        if self.friction is not None:
            particle |= {"static_friction": self.friction, "sliding_friction": self.friction}
        if self.rolling is not None:
            particle |= {"rolling_friction": self.rolling}
        return section | {
            "bed": section["bed"] | {"seed": seed, "solid_fraction": self.solid_fraction},
            "law": section["law"] | {"particle": particle},
        }


class AtFraction(NamedTuple):
    """Of one cell of a given solid fraction."""

    peak: Strength
    critical: Strength
    critical_fraction: float
    repose_deg: float


def at_fraction(sand: Sand, seed: int) -> AtFraction:
    """A soil in a cell of CELL_DIAMETERS, strained as far as the critical state."""
    edge = CELL_DIAMETERS * 2.0 * (1.0 + RADIUS_SPREAD) * sand.radius_m
    soil = sand.section(seed) | {"bin": {"length_m": edge, "width_m": edge, "depth_m": edge}}
    scene = load_scene({"name": sand.soil, "duration_s": 1.0, "soil": soil})
    cell = prepare_cell(scene)
    curves = [plane_strain(cell, least, CRITICAL_STRAIN, to_peak=False) for least in LEAST_PA]
    peak = fit_strength(*zip(*(curve.peak_pa() for curve in curves), strict=True))
    critical = fit_strength(*zip(*(curve.critical_pa() for curve in curves), strict=True))
    grown = [curve.volume_strain[curve.strain > 0.9 * CRITICAL_STRAIN].mean() for curve in curves]
    at_end = sand.solid_fraction / (1.0 + float(np.mean(grown)))
    return AtFraction(peak, critical, at_end, math.degrees(repose_rad(scene)))


def report_fractions(args: argparse.Namespace) -> None:
    """Prints the strength at each solid fraction."""
    print("| soil | r mm | fraction | friction | rolling | c kPa, phi deg | critical | fraction | heap deg |")
    print("|---" * 9 + "|")
    cases = itertools.product(
        args.soils, args.radii_mm, args.solid_fractions, args.frictions or [None], args.rolling or [None]
    )
    with ProcessPoolExecutor(args.processes) as pool:
        jobs = {
            sand: [pool.submit(at_fraction, sand, seed) for seed in SEEDS[: args.seeds]]
            for soil, radius, *rest in cases
            for sand in [Sand(soil, 1e-3 * radius, *rest)]
        }
        for sand, job in jobs.items():
            cells = [one.result() for one in job]
            found = np.array(
                [(*one.peak, *one.critical, one.critical_fraction, one.repose_deg) for one in cells]
            )
            (c, phi, c_end, phi_end, end, heap) = found.mean(axis=0)
            spread = np.ptp(found, axis=0)
            own = ["own" if value is None else f"{value:g}" for value in (sand.friction, sand.rolling)]
            print(
                f"| {sand.soil} | {1e3 * sand.radius_m:g} | {sand.solid_fraction:g} | {' | '.join(own)} "
                f"| {1e-3 * c:.2f}, {phi:.1f} ({spread[1]:.1f}) | {1e-3 * c_end:.2f}, {phi_end:.1f} "
                f"({spread[3]:.1f}) | {end:.3f} | {heap:.1f} |",
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
    parser.add_argument("--frictions", nargs="+", type=float)
    parser.add_argument("--rolling", nargs="+", type=float)
    parser.add_argument("--seeds", type=int, default=len(SEEDS), choices=range(1, len(SEEDS) + 1))
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
