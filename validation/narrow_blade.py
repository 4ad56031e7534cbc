"""Flat blades that stand out of the surface of loam, against the closed forms of narrow tines.

    python -m validation.narrow_blade [--rakes 45 60 90] [--widths-mm 40 80] [--depths-mm 100 140 200]
        [--speeds 0.5] [--radius-mm 10] [--soil loam] [--seeds 1] [--processes 2] [--json FILE]

Cohesion, friction angle and density are those that the element tests of the material found; the friction on
metal is that of its law, a blade on which spheres slide. The sides are periodic, and farther apart than the
crescents of Godwin and O'Dogherty. Means are over the travel from 0.75 to 2.25 depths. Exit status 1 where

- the draft is further than ACCEPTED from both Perumpral's and Godwin and O'Dogherty's;
- it grows with depth by an exponent further than EXPONENT from both of theirs;
- the loosened surface is wider or narrower than Godwin and O'Dogherty's crescents by more than WIDTH_PART;
- the vertical force has another sign than theirs.

A row is also compared with McKyes and Ali, which is reported only.
"""

import argparse
import itertools
import json
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import trimesh

from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.loading.material import read_material
from subsoil_ros.loading.shipped import shipped_material
from subsoil_ros.messages import ToolMotion
from subsoil_ros.scene.material import Material

from .blades import Blade, Force, Soil, godwin_odogherty, mckyes_ali, perumpral
from .laboratory import Laboratory
from .wide_blade import strength_of

ACCEPTED, EXPONENT, WIDTH_PART = 0.40, 0.25, 0.30
"""Average deviations of the closed forms from blades in soil are 25 to 66 % (Onwualu and Watts, Soil Till.
Res. 48 (1998) 239-253)."""

RELIEF_M = 0.03
"""Thickness of the blade at its top; at its tip it is sharp, and nothing of it is below (chosen)."""

FIRST, LAST = 0.75, 2.25
"""Travel over the depth, of the means: from where the first crescent is whole (chosen)."""

BEHIND_M = 0.03
"""Of the tip behind the end wall at the start (chosen: more than a radius)."""

BELOW = 0.5
"""Soil below the tip over its depth (chosen)."""

ROOM, USUAL_WIDTH_M, USUAL_RAKES = 1.4, 0.08, (math.radians(45.0), 0.5 * math.pi)
"""Width of the bin over that of the widest crescents: wider ones than WIDTH_PART allows are seen."""

LOOSE_PART = 0.5
"""A particle of the surface is loosened when it moved by so many radii."""


@dataclass(frozen=True)
class Row:
    """One blade; forces on it [N], downward positive; means over the seeds."""

    rake_deg: float
    width_m: float
    depth_m: float
    speed_m_per_s: float
    bin_width_m: float
    particles: int
    draft_newton: float
    vertical_newton: float
    loosened_m: float  # width of the loosened surface
    theories: dict[str, Force]
    crescents_m: float  # width of Godwin and O'Dogherty's at the surface

    def deviations(self) -> dict[str, float]:
        """Of the draft from each theory, as a part of it."""
        return {name: self.draft_newton / force.draft_newton - 1.0 for name, force in self.theories.items()}


def soil_of(material: Material) -> Soil:
    """For the closed forms."""
    strength, density = strength_of(material)
    return Soil(
        max(strength.cohesion_pa, 0.0), math.radians(strength.friction_angle_deg), density,
        math.radians(material.soil.metal_friction_angle_deg),
    )  # fmt: skip


def crescents_m(soil: Soil, blade: Blade) -> float:
    """Width of the crescents at the surface: of radius m d about the blade, from where their chord is
    cot(rake)."""
    radius = godwin_odogherty(soil, blade).rupture_m
    behind = blade.depth_m / math.tan(blade.rake_rad)
    return blade.width_m + 2.0 * math.sqrt(max(radius**2 - behind**2, 0.0))


def blade_mesh(folder: Path, blade: Blade) -> str:
    """A prism: its face from the tip (0, 0) up and back at the rake, its back less steep."""
    length = (blade.depth_m + 0.15) / math.sin(blade.rake_rad)
    top = length * np.array((-math.cos(blade.rake_rad), math.sin(blade.rake_rad)))
    section = np.array(((0.0, 0.0), top, top - (RELIEF_M, 0.0)))
    corners = [(x, side * 0.5 * blade.width_m, z) for x, z in section for side in (-1.0, 1.0)]
    path = folder / f"blade_{blade.rake_rad:.3f}_{blade.width_m:g}_{blade.depth_m:g}.stl"
    trimesh.Trimesh(vertices=corners).convex_hull.export(path)
    return str(path)


def measured(soil: str, radius_m: float, blade: Blade, seed: int) -> tuple[float, float, float, float, int]:
    """Draft, vertical force, width of the loosened surface, width of the bin, particles."""
    material = read_material(shipped_material(Path(soil)), soil)
    depth = blade.depth_m
    theory = soil_of(material)
    widest = Blade(max(blade.width_m, USUAL_WIDTH_M), depth, 0.5 * math.pi)  # all narrower share a bed
    rupture = max(godwin_odogherty(theory, Blade(0.08, depth, rake)).rupture_m for rake in USUAL_RAKES)
    box = {
        "length_m": round(LAST * depth + 1.1 * rupture, 2),
        "width_m": round(ROOM * crescents_m(theory, widest), 2),
        "depth_m": round((1.0 + BELOW) * depth, 3),
        "sides": "periodic",
    }
    with tempfile.TemporaryDirectory() as folder:
        mesh = blade_mesh(Path(folder), blade)
        scene = Laboratory(Path(folder)).resolve(
            {
                "name": "blade",
                "duration_s": 1.0,
                "tools": {"blade": {"path": {}, "groups": {"blade": {"mesh": mesh}}}},
                "soil": {
                    "material": soil,
                    "bin": box,
                    "particles": {"radius_m": radius_m},
                    "bed": {"seed": seed},
                },
            }
        )
        engine = SoilEngine(scene)
        step = blade.speed_m_per_s * scene.timing.communication_step_s

        def at(x: float, speed: float) -> tuple[ToolMotion, ...]:
            return (ToolMotion("blade", x - BEHIND_M, 0.0, -depth, 0.0, speed, 0.0, 0.0),)

        engine.start(at(0.0, 0.0))
        forces = []
        for tick in range(round((LAST * depth + BEHIND_M) / step)):
            wrench = engine.advance(tick, at(step * (tick + 1), blade.speed_m_per_s))[0]
            forces.append((-wrench.force_x_newton, -wrench.force_z_newton))
    window = np.array(forces[round((FIRST * depth + BEHIND_M) / step) :])
    moved = engine.displacements_m()
    top = engine.positions_m()[:, 2] - moved[:, 2] > -2.0 * radius_m
    loose = top & (np.linalg.norm(moved, axis=1) > LOOSE_PART * radius_m)
    sideways = np.abs(engine.positions_m()[loose, 1])
    width = 2.0 * float(np.percentile(sideways, 99.0)) if loose.any() else 0.0
    assert engine.bed.period_m is not None
    draft, vertical = window.mean(axis=0).tolist()
    return draft, vertical, width, engine.bed.period_m, engine.particle_count


def compare(args: argparse.Namespace) -> Iterator[Row]:
    """A row for each blade, as they are done."""
    soil = soil_of(read_material(shipped_material(Path(args.soil)), args.soil))
    blades = [
        Blade(1e-3 * width, 1e-3 * depth, math.radians(rake), speed)
        for depth, rake, width, speed in itertools.product(
            args.depths_mm, args.rakes, args.widths_mm, args.speeds
        )
    ]
    with ProcessPoolExecutor(args.processes) as pool:
        jobs = [
            [pool.submit(measured, args.soil, 1e-3 * args.radius_mm, blade, seed) for seed in args.seeds]
            for blade in blades
        ]
        for blade, job in zip(blades, jobs, strict=True):
            found = [one.result() for one in job]
            draft, vertical, width = np.mean([one[:3] for one in found], axis=0).tolist()
            theories = {
                "Perumpral": perumpral(soil, blade),
                "Godwin and O'Dogherty": godwin_odogherty(soil, blade),
                "McKyes and Ali": mckyes_ali(soil, blade),
            }
            yield Row(
                math.degrees(blade.rake_rad), blade.width_m, blade.depth_m, blade.speed_m_per_s, found[0][3],
                found[0][4], draft, vertical, width, theories, crescents_m(soil, blade),
            )  # fmt: skip


def as_text(row: Row) -> str:
    """A row of the table."""
    off = row.deviations()
    narrow = row.theories["Perumpral"]
    return (
        f"| {row.rake_deg:.0f} | {1e3 * row.width_m:.0f} | {1e3 * row.depth_m:.0f} | {row.speed_m_per_s:g} "
        f"| {row.draft_newton:.0f} | {off['Perumpral']:+.0%} | {off[GODWIN]:+.0%} "
        f"| {off['McKyes and Ali']:+.0%} | {row.vertical_newton:+.0f} / {narrow.vertical_newton:+.0f} "
        f"| {row.loosened_m:.2f} / {row.crescents_m:.2f} | {row.bin_width_m:.2f} |"
    )


GODWIN = "Godwin and O'Dogherty"
NARROW = ("Perumpral", GODWIN)


def exponents(rows: Sequence[Row]) -> Iterator[tuple[str, float, dict[str, float]]]:
    """Of draft over depth, for each rake, width and speed: found, and of each theory."""

    def key(row: Row) -> tuple[float, float, float]:
        return row.rake_deg, row.width_m, row.speed_m_per_s

    for (rake, width, speed), group in itertools.groupby(sorted(rows, key=key), key):
        series = list(group)
        depth = np.log([row.depth_m for row in series])
        if len(series) < 2:
            continue
        found = float(np.polyfit(depth, np.log([row.draft_newton for row in series]), 1)[0])
        theory = {
            name: float(np.polyfit(depth, np.log([row.theories[name].draft_newton for row in series]), 1)[0])
            for name in NARROW
        }
        yield f"rake {rake:.0f}, {1e3 * width:.0f} mm, {speed:g} m/s", found, theory


def misses(rows: Sequence[Row]) -> list[str]:
    """What is further from theory than accepted, in words."""
    found = []
    for row in rows:
        where = f"rake {row.rake_deg:.0f}, {1e3 * row.width_m:.0f} mm wide, {1e3 * row.depth_m:.0f} mm deep"
        off = row.deviations()
        if min(abs(off[name]) for name in NARROW) > ACCEPTED:
            found.append(f"{where}: draft {off['Perumpral']:+.0%} and {off[GODWIN]:+.0%}")
        if abs(row.loosened_m / row.crescents_m - 1.0) > WIDTH_PART:
            found.append(f"{where}: loosened {row.loosened_m:.2f} m wide, crescents {row.crescents_m:.2f} m")
        if row.vertical_newton * row.theories["Perumpral"].vertical_newton < 0.0:
            found.append(f"{where}: vertical force {row.vertical_newton:+.0f} N has the wrong sign")
    for where, power, theory in exponents(rows):
        if min(abs(power - value) for value in theory.values()) > EXPONENT:
            found.append(f"{where}: exponent over depth {power:.2f}")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table, exponents and misses. Returns 1 if there are misses."""
    parser = argparse.ArgumentParser(prog="python -m validation.narrow_blade", description=main.__doc__)
    parser.add_argument("--rakes", nargs="+", type=float, default=[45.0, 60.0, 90.0], metavar="DEG")
    parser.add_argument("--widths-mm", nargs="+", type=float, default=[40.0, 80.0])
    parser.add_argument("--depths-mm", nargs="+", type=float, default=[100.0, 140.0, 200.0])
    parser.add_argument("--speeds", nargs="+", type=float, default=[0.5])
    parser.add_argument("--radius-mm", type=float, default=10.0)
    parser.add_argument("--soil", default="loam")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args(arguments)
    print(
        "| rake deg | width mm | depth mm | m/s | draft N | Perumpral | G-O'D | McKyes-Ali "
        "| vertical N, down / Perumpral | loosened / crescents m | bin m |\n" + "|---" * 11 + "|"
    )
    rows = []
    for row in compare(args):
        rows.append(row)
        print(as_text(row), flush=True)
    for where, power, theory in exponents(rows):
        print(f"{where}: exponent {power:.2f}, " + ", ".join(f"{name} {n:.2f}" for name, n in theory.items()))
    found = misses(rows)
    print("\n".join(found) or "all within what is accepted")
    if args.json:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
