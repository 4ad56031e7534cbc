"""A wide upright blade pushed through a slice of soil, against Coulomb's passive earth pressure.

    python -m validation.wide_blade [--soils sand loam] [--seeds N] [--json FILE]

The slice is one period of an endless bed, so nothing holds the soil at its sides. Theory is
validation.blades.log_spiral, the plane wedge before a smooth blade, with cohesion and friction angle of the
peak of the direct shear of the same soil. Beside it stands the same in plane strain, as the soil before the
blade is: a shear box shows cos(phi of its end) times that strength (P.W. Rowe, Geotechnique 19 (1969) 75-86).
Compared is the largest draught before the heave counts. Exit status 1 where a mean differs from the theory of
the shear box by more than ACCEPTED.
"""

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.experiments.soil_tests.runs import ShearCurve, run_soil_tests
from subsoil_ros.experiments.soil_tests.strength import CoulombFit, fit_coulomb
from subsoil_ros.messages import ToolMotion

from .blades import Blade, Soil, log_spiral
from .laboratory import Document, Laboratory, box_mesh

RADIUS_M, SOLID_FRACTION, DENSITY = 0.0075, 0.60, 2600.0
DEPTH_M = 0.15
"""Of the blade: ten diameters."""

BED: Document = {"length_m": 0.75, "width_m": 0.15, "depth_m": 0.25, "sides": "periodic"}
BOX_M = (0.24, 0.16, 0.12)
"""Of the shear test: 16 x 10.7 x 8 diameters."""

NORMAL_PA = (2e3, 4e3, 8e3)
"""Of the shear test: the weight of soil and lid is 1.2 kPa, passive stress at the tip 10 kPa."""

SPEED_M_PER_S = 0.05
TRAVEL_M = 0.2 * DEPTH_M
"""Beyond it the heave before the blade is part of the draught."""

THICKNESS_M = 0.02
SMOOTHED_M = 0.003
"""Of travel: over the noise of single contacts."""

ACCEPTED = 0.15

BLADES = {"smooth": 0.0, "rough": 0.3}
"""Friction of soil on metal."""

STIFFNESS = 7.5e4  # [N/m]: overlaps of 0.5 % of the radius at 10 kPa
ROW = {
    "stiffness_newton_per_m": STIFFNESS, "tangential_stiffness_newton_per_m": 0.8 * STIFFNESS,
    "damping_newton_s_per_m": 3.0, "tangential_damping_newton_s_per_m": 1.5,
}  # fmt: skip
SAND = ROW | {"static_friction": 0.5, "sliding_friction": 0.5, "rolling_friction": 0.1}
LOAM = SAND | {
    "cohesive_stiffness_newton_per_m": 2600.0,  # chosen: some kPa of cohesion
    "equilibrium_overlap_m": 0.00004,
    "cohesion_range_m": 0.0004,
}
LAWS = {
    "sand": ("linear", SAND, {}),
    "loam": ("cohesive_linear", LOAM, {"cohesive_stiffness_newton_per_m": 0.0}),
}


@dataclass(frozen=True)
class Row:
    """One blade in one soil; forces by width [N/m], over the seeds."""

    soil: str
    blade: str
    cohesion_pa: float
    friction_deg: float
    theory: float
    theory_plane_strain: float
    measured: tuple[float, ...]

    @property
    def deviation(self) -> float:
        """Of the mean from theory, as a part of it."""
        return float(np.mean(self.measured)) / self.theory - 1.0


def scene_soil(soil: str, friction: float, seed: int) -> Document:
    """The soil section of a scene."""
    kind, row, at_metal = LAWS[soil]
    metal = {"static_friction": friction, "sliding_friction": friction}
    return {
        "bin": BED,
        "bed": {"kind": "tiled", "seed": seed, "solid_fraction": SOLID_FRACTION},
        "particles": {"radius_m": RADIUS_M, "density_kg_per_m3": DENSITY},
        "law": {"kind": kind, "particle": row, "boundary": row | at_metal | metal},
        "skin_m": 0.2 * RADIUS_M,
    }


def strength(laboratory: Laboratory, soil: str, seeds: int) -> tuple[CoulombFit, CoulombFit]:
    """Peak and end of the direct shear of a soil, over all stresses and beds."""
    curves: list[ShearCurve] = []
    for seed in range(1, seeds + 1):
        section = scene_soil(soil, BLADES["rough"], seed)
        section["bed"] = section["bed"] | {"floor": "plane"}
        scene = laboratory.resolve({"name": soil, "duration_s": 1.0, "soil": section})
        folder = laboratory.folder / f"tests_{soil}_{seed}"
        curves += run_soil_tests(scene, NORMAL_PA, BOX_M, folder).shear
    peak, residual = ([getattr(curve, name)() for curve in curves] for name in ("peak", "residual"))
    return fit_coulomb(*zip(*peak, strict=True)), fit_coulomb(*zip(*residual, strict=True))


def draught(laboratory: Laboratory, soil: str, friction: float, seed: int) -> float:
    """Largest draught by width of a blade [N/m], of means over SMOOTHED_M, within TRAVEL_M."""
    mesh = box_mesh(laboratory.folder, THICKNESS_M, BED["width_m"] + 0.2, 2.0 * DEPTH_M)
    blade = {"blade": {"path": {}, "groups": {"blade": {"mesh": mesh}}}}
    section = scene_soil(soil, friction, seed)
    scene = laboratory.resolve({"name": soil, "duration_s": 1.0, "soil": section, "tools": blade})
    engine = SoilEngine(scene)
    step = SPEED_M_PER_S * scene.timing.communication_step_s
    start = 0.5 * THICKNESS_M

    def at(x: float, speed: float) -> tuple[ToolMotion, ...]:
        return (ToolMotion("blade", start + x, 0.0, 0.0, 0.0, speed, 0.0, 0.0),)

    engine.start(at(0.0, 0.0))
    force = [
        -engine.advance(tick, at(step * (tick + 1), SPEED_M_PER_S))[0].force_x_newton
        for tick in range(round(TRAVEL_M / step))
    ]
    window = np.ones(round(SMOOTHED_M / step))
    means = np.convolve(force, window / window.sum(), "valid")
    assert engine.bed.period_m is not None
    return float(means.max()) / engine.bed.period_m


def theory(fit: CoulombFit, friction: float, larger: float = 1.0) -> float:
    """Draught by width [N/m] of the plane wedge or the log spiral, in a soil `larger` times as strong."""
    angle = math.atan(larger * math.tan(math.radians(fit.friction_angle_deg)))
    cohesion = larger * max(fit.cohesion_pa, 0.0)
    soil = Soil(cohesion, angle, SOLID_FRACTION * DENSITY, math.atan(friction))
    return log_spiral(soil, Blade(1.0, DEPTH_M, 0.5 * math.pi)).draught_newton


def compare(soils: Sequence[str], seeds: int, folder: Path) -> list[Row]:
    """A row for each soil and blade."""
    rows = []
    for soil in soils:
        laboratory = Laboratory(folder)
        fit, residual = strength(laboratory, soil, seeds)
        plane_strain = 1.0 / math.cos(math.radians(residual.friction_angle_deg))
        for name, friction in BLADES.items():
            both = theory(fit, friction), theory(fit, friction, plane_strain)
            forces = tuple(draught(laboratory, soil, friction, seed) for seed in range(1, seeds + 1))
            rows.append(Row(soil, name, fit.cohesion_pa, fit.friction_angle_deg, *both, forces))
            print(markdown(rows[-1:]).splitlines()[-1], flush=True)
    return rows


def markdown(rows: Sequence[Row]) -> str:
    """The table; the spread is the standard deviation over the seeds."""
    lines = [
        "| soil | blade | c kPa | phi deg | theory N/m | in plane strain N/m | measured N/m | from theory |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        spread = np.std(row.measured, ddof=1) if len(row.measured) > 1 else 0.0
        lines.append(
            f"| {row.soil} | {row.blade} | {row.cohesion_pa * 1e-3:.2f} | {row.friction_deg:.1f} "
            f"| {row.theory:.0f} | {row.theory_plane_strain:.0f} "
            f"| {np.mean(row.measured):.0f} +- {spread:.0f} | {row.deviation:+.0%} |"
        )
    return "\n".join(lines)


def main() -> int:
    """Prints the table. Returns 1 if a mean is outside ACCEPTED."""
    parser = argparse.ArgumentParser(prog="python -m validation.wide_blade", description=main.__doc__)
    parser.add_argument("--soils", nargs="+", choices=list(LAWS), default=list(LAWS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = compare(args.soils, args.seeds, Path(folder))
    print(markdown(rows))
    if args.json:
        args.json.write_text(
            json.dumps([asdict(row) | {"deviation": row.deviation} for row in rows], indent=1)
        )
    return int(any(abs(row.deviation) > ACCEPTED for row in rows))


if __name__ == "__main__":
    sys.exit(main())
