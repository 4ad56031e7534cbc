"""A wide upright blade pushed through a slice of soil, against passive earth pressure.

    python -m validation.wide_blade [--soils dry_sand loam] [--radii-mm 7.5] [--seeds N] [--json FILE]

The slice is one period of an endless bed, so nothing holds the soil at its sides. Theory is
validation.blades.log_spiral, which is the plane wedge for a smooth blade. Cohesion, friction angle and
density are those that the element tests of the shipped material found. The soil that the blade has swept
by the middle of FIRST_M to LAST_M of travel acts as a surcharge on the wedge, spread over its rupture
distance. Coulomb's force is the largest that the soil bears, so the largest draft within LAST_M of travel is
compared with theory at the peak strength. A soil that softens is not at its peak everywhere at once: its
draft lies between theory at the peak and at the critical strength; the mean from FIRST_M on stands beside
it. Exit status 1 where the largest is off by more than ACCEPTED.
"""

import argparse
import dataclasses
import itertools
import json
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from subsoil_ros.dem.build import build_engine
from subsoil_ros.experiments.element_tests import Strength
from subsoil_ros.loading.files import shipped_material
from subsoil_ros.loading.material_file import read_material
from subsoil_ros.messages import ToolMotion
from subsoil_ros.scene.material import Material

from .blades import GRAVITY_M_PER_S2, Blade, Soil, log_spiral
from .laboratory import Document, Laboratory, box_mesh

SOILS, RADIUS_M = ("dry_sand", "loam"), 0.0075
DEPTH_M = 0.15
"""Of the blade: ten diameters."""

BED: Document = {"length_m": 0.75, "width_m": 0.15, "depth_m": 0.25, "sides": "periodic"}
SPEED_M_PER_S = 0.05
"""Inertial number 0.007 at half the depth, in a band of ten diameters: quasi-static."""

FIRST_M, LAST_M = 0.05 * DEPTH_M, 0.2 * DEPTH_M
"""Of travel: from where the wedge slides."""

LARGEST_OVER_M = 0.002
"""Travel over which a draft is averaged before its largest is taken (chosen: a seventh of a diameter)."""

THICKNESS_M = 0.02  # of the blade, more than a diameter: no particle comes behind it

ACCEPTED = 0.15
"""Part by which the largest draft may differ from theory (asked of the soil)."""

BLADES = {"smooth": 0.0, "rough": 0.3}
"""Friction of soil on metal."""


@dataclass(frozen=True)
class Row:
    """One blade in one soil; forces by width [N/m], over the seeds."""

    soil: str
    radius_m: float
    blade: str
    cohesion_pa: float
    friction_deg: float
    theory: float  # at the peak strength
    critical_theory: float  # at the critical one
    largest: tuple[float, ...]
    mean: tuple[float, ...]

    @property
    def deviation(self) -> float:
        """Of the largest draft from theory, as a part of it."""
        return float(np.mean(self.largest)) / self.theory - 1.0


def soil_section(material: Material, radius_m: float, friction: float, seed: int) -> Document:
    """The soil of a scene, with this friction on metal; spheres slide there and do not roll."""
    section = material.section(radius_m)
    keys = ("static_friction", "sliding_friction", "rolling_friction")
    boundary = section["law"]["boundary"] | dict.fromkeys(keys, friction)
    return section | {
        "bin": BED,
        "bed": section["bed"] | {"seed": seed},
        "law": section["law"] | {"boundary": boundary},
        "skin_m": 0.2 * radius_m,
    }


def drafts(
    laboratory: Laboratory, material: Material, radius_m: float, friction: float, seed: int
) -> tuple[float, float]:
    """Largest and mean draft by width of a blade [N/m]."""
    mesh = box_mesh(laboratory.folder, THICKNESS_M, BED["width_m"] + 0.2, 2.0 * DEPTH_M)
    blade = {"blade": {"path": {}, "groups": {"blade": {"mesh": mesh}}}}
    section = soil_section(material, radius_m, friction, seed)
    scene = laboratory.resolve(
        {"name": material.soil.name, "duration_s": 1.0, "soil": section, "tools": blade}
    )
    engine = build_engine(scene)
    step = SPEED_M_PER_S * scene.timing.communication_step_s
    start = 0.5 * THICKNESS_M

    def at(x: float, speed: float) -> tuple[ToolMotion, ...]:
        return (ToolMotion("blade", start + x, 0.0, 0.0, 0.0, speed, 0.0, 0.0),)

    engine.start(at(0.0, 0.0))
    force = [
        -engine.advance(tick, at(step * (tick + 1), SPEED_M_PER_S))[0].force_x_newton
        for tick in range(round(LAST_M / step))
    ]
    assert engine.bed.period_m is not None
    window = np.ones(max(1, round(LARGEST_OVER_M / step)))
    largest = float(np.convolve(force, window / window.sum(), "valid").max())
    mean = float(np.mean(force[round(FIRST_M / step) :]))
    return largest / engine.bed.period_m, mean / engine.bed.period_m


def theory(strength: Strength, density: float, friction: float) -> float:
    """Draft by width [N/m] of the plane wedge or the log spiral; density [kg/m3]."""
    blade, angle = Blade(1.0, DEPTH_M, 0.5 * math.pi), math.radians(strength.friction_angle_deg)
    soil = Soil(max(strength.cohesion_pa, 0.0), angle, density, math.atan(friction))
    swept = 0.5 * (FIRST_M + LAST_M) * DEPTH_M
    heaved = density * GRAVITY_M_PER_S2 * swept / log_spiral(soil, blade).rupture_m
    return log_spiral(dataclasses.replace(soil, surcharge_pa=heaved), blade).draft_newton


def compare(soils: Sequence[str], radii_m: Sequence[float], seeds: int, folder: Path) -> Iterator[Row]:
    """A row for each soil, radius and blade."""
    laboratory = Laboratory(folder)
    for soil in soils:
        material = read_material(shipped_material(Path(soil)), soil)
        (found, density), (critical, _) = strength_of(material), strength_of(material, "critical_")
        for radius, (name, friction) in itertools.product(radii_m, BLADES.items()):
            runs = [drafts(laboratory, material, radius, friction, 1 + k) for k in range(seeds)]
            largest, mean = zip(*runs, strict=True)
            at_peak, softened = (theory(strength, density, friction) for strength in (found, critical))
            yield Row(
                soil,
                radius,
                name,
                found.cohesion_pa,
                found.friction_angle_deg,
                at_peak,
                softened,
                largest,
                mean,
            )


def strength_of(material: Material, state: str = "") -> tuple[Strength, float]:
    """Strength at the peak, or in the state `critical_`, and density [kg/m3] that element tests found."""
    measured = material.measured
    strength = Strength(measured[f"{state}cohesion_pa"].value, measured[f"{state}friction_angle_deg"].value)
    return strength, measured["bulk_density_kg_per_m3"].value


def as_text(row: Row) -> str:
    """A row of the table; the spread is the standard deviation over the seeds."""
    spread = np.std(row.largest, ddof=1) if len(row.largest) > 1 else 0.0
    return (
        f"| {row.soil} | {1e3 * row.radius_m:g} | {row.blade} | {row.cohesion_pa * 1e-3:.2f} "
        f"| {row.friction_deg:.1f} | {row.theory:.0f} | {row.critical_theory:.0f} "
        f"| {np.mean(row.largest):.0f} +- {spread:.0f} | {row.deviation:+.0%} | {np.mean(row.mean):.0f} |"
    )


def main() -> int:
    """Prints the table. Returns 1 if a largest draft is outside ACCEPTED."""
    parser = argparse.ArgumentParser(prog="python -m validation.wide_blade", description=main.__doc__)
    parser.add_argument("--soils", nargs="+", default=list(SOILS))
    parser.add_argument("--radii-mm", nargs="+", type=float, default=[1e3 * RADIUS_M])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    print(
        "| soil | radius mm | blade | c kPa | phi deg | theory N/m | critical N/m | largest N/m | deviation "
        "| mean N/m |"
    )
    print("|---" * 10 + "|")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        radii = [1e-3 * radius for radius in args.radii_mm]
        for row in compare(args.soils, radii, args.seeds, Path(folder)):
            rows.append(row)
            print(as_text(row), flush=True)
    if args.json:
        args.json.write_text(
            json.dumps([asdict(row) | {"deviation": row.deviation} for row in rows], indent=1)
        )
    return int(any(abs(row.deviation) > ACCEPTED for row in rows))


if __name__ == "__main__":
    sys.exit(main())
