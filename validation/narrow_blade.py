"""Flat blades that stand out of the surface of a field, against the closed forms of narrow tines.

    python -m validation.narrow_blade [--rakes 45 60 90] [--widths-mm 40 80] [--depths-mm 100 140 200]
        [--noses-mm 0] [--speeds 0.5] [--radius-mm 10] [--setback-mm 0] [--soil loam] [--seeds 1]
        [--depths 6] [--processes 2] [--json FILE]

Cohesion, friction angle and density are those that the element tests of the material found; the friction on
metal is that of its law, a blade on which spheres slide. Blades go through a soil.window, its held
sides farther apart than the crescents of Godwin and O'Dogherty. Means are over the travel from FIRST to
--depths times the depth, with 95 % intervals. A nose is the height over which the tip is cut off upright.
Exit status 1 where, of blades without a nose,

- the draft is further than ACCEPTED from both Perumpral's and Godwin and O'Dogherty's;
- it grows with depth by an exponent further than EXPONENT from both of theirs;
- the loosened surface is wider or narrower than Godwin and O'Dogherty's crescents by more than WIDTH_PART;
- the vertical force has another sign than theirs;
- its growth with speed differs from the term of inertia by more than the interval.

Theory at the critical strength, that of soil after large shear, is printed beside it; like the formula of
McKyes and Ali, it is reported only.
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
from numpy.typing import NDArray

from subsoil_ros.analysis.disturbance import Places
from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.dem.build import build_engine
from subsoil_ros.loading.files import shipped_material
from subsoil_ros.loading.material_file import read_material
from subsoil_ros.messages import ToolMotion
from subsoil_ros.scene.material import Material

from .blades import Blade, Force, Soil, godwin_odogherty, mckyes_ali, perumpral
from .laboratory import Laboratory
from .wide_blade import strength_of

ACCEPTED, EXPONENT, WIDTH_PART = 0.40, 0.25, 0.30
"""Average deviations of the closed forms from blades in soil are 25 to 66 % (Onwualu and Watts, Soil Till.
Res. 48 (1998) 239-253)."""

RELIEF_M = 0.03
"""Thickness of the blade at its top, more than a diameter of the default particles. At its tip it is sharp,
and no part of it is below the tip."""

FIRST, DEPTHS, BEHIND = 1.5, 6.0, 2.0
"""Over the depth: travel from which on means count, when the first crescent is complete, and up to which;
and how far behind the tip the surface has come to rest."""

BEHIND_M, ROW_M, CLOUD_M = 0.03, 0.005, 0.1
"""Of the tip behind the end wall at the start (chosen: more than a radius); travel of a row, and between two
looks at where particles are (less than a window)."""

BELOW = 0.5
"""Soil below the tip over its depth; with less, the floor is nearer to the tip."""

ROOM, AHEAD_M = 1.4, 2.0
"""Width of the field over that of the crescents (wider ones than WIDTH_PART allows are seen); field beyond
the end of the pull (no window reaches its end)."""

LOOSE_PART = 0.5
"""A particle of the surface is loosened when it moved by so many radii."""

MOVED_M = (0.010, 0.005, 0.002, 0.001, 0.0005)
"""Motions beside that one, to see whether the width depends on it."""


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
    half_widths: tuple[float, float] = (0.0, 0.0)  # of the 95 % intervals of draft and vertical force [N]
    critical_newton: float = math.nan  # Perumpral's draft at the critical strength
    nose_m: float = 0.0
    widths_m: tuple[float, ...] = ()  # of the surface that moved by more than MOVED_M

    def deviations(self) -> dict[str, float]:
        """Of the draft from each theory, as a part of it."""
        return {name: self.draft_newton / force.draft_newton - 1.0 for name, force in self.theories.items()}


@dataclass(frozen=True)
class Pull:
    """What one seed gave."""

    draft: tuple[float, float]  # mean and half-width of its 95 % interval [N]
    vertical: tuple[float, float]
    loosened_m: float
    bin_width_m: float
    particles: int
    widths_m: tuple[float, ...]  # of the surface that moved by more than MOVED_M


def soil_of(material: Material, state: str = "") -> Soil:
    """For the closed forms: at the peak, or in the state `critical_`."""
    strength, density = strength_of(material, state)
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


def blade_mesh(folder: Path, blade: Blade, nose_m: float = 0.0, above_m: float = 0.15) -> str:
    """A prism: its face from the tip (0, 0), or from the upper end of its nose, up and back at the rake, its
    back less steep. It stands `above_m` out of the surface."""
    length = (blade.depth_m - nose_m + above_m) / math.sin(blade.rake_rad)
    top = length * np.array((-math.cos(blade.rake_rad), math.sin(blade.rake_rad))) + (0.0, nose_m)
    section = np.array(((0.0, 0.0), (0.0, nose_m), top, top - (RELIEF_M, 0.0)))
    corners = [(x, side * 0.5 * blade.width_m, z) for x, z in section for side in (-1.0, 1.0)]
    path = folder / "blade.stl"
    trimesh.Trimesh(vertices=corners).convex_hull.export(path)
    return str(path)


def pulled(
    soil: str,
    radius_m: float,
    blade: Blade,
    nose_m: float = 0.0,
    seed: int = 1,
    depths: float = DEPTHS,
    first_m: float | None = None,
    above_m: float = 0.15,
    setback_m: float = 0.0,
) -> Pull:
    """A blade through a field of soil.

    depths: way, over the depth. first_m: travel from which on means count (default: FIRST depths).
    """
    material = read_material(shipped_material(Path(soil)), soil)
    depth, wide = blade.depth_m, round(ROOM * crescents_m(soil_of(material), blade), 2)
    box = {
        "length_m": round(depths * depth + AHEAD_M, 2),
        "width_m": wide,
        "depth_m": round((1.0 + BELOW) * depth, 3),
        "sides": "held",
    }
    particles, bed = {"radius_m": radius_m}, {"seed": seed}
    parts = {"material": soil, "bin": box, "window": {}, "particles": particles, "bed": bed}
    with tempfile.TemporaryDirectory() as folder:
        mesh = blade_mesh(Path(folder), blade, nose_m, above_m)
        tools = {"blade": {"path": {}, "groups": {"blade": {"mesh": mesh}}, "setback_m": setback_m}}
        document = {"name": "blade", "duration_s": 1.0, "tools": tools, "soil": parts}
        scene = Laboratory(Path(folder)).resolve(document)
        engine = build_engine(scene)
        step = blade.speed_m_per_s * scene.timing.communication_step_s

        def at(tick: int) -> tuple[ToolMotion, ...]:
            x = step * (tick + 1) - BEHIND_M
            return (ToolMotion("blade", x, 0.0, -depth, 0.0, blade.speed_m_per_s, 0.0, 0.0),)

        engine.start(at(-1))
    places, forces, most = Places(), [], 0
    for tick in range(round((depths * depth + BEHIND_M) / step)):
        if tick % round(CLOUD_M / step) == 0:
            places.see(engine.cloud(tick, 0))
            most = max(most, engine.particle_count)
        wrench = engine.advance(tick, at(tick))[0]
        forces.append((-wrench.force_x_newton, -wrench.force_z_newton))
    places.see(engine.cloud(tick, 0))
    first_m = FIRST * depth if first_m is None else first_m
    first, per_row = round((first_m + BEHIND_M) / step), max(1, round(ROW_M / step))
    counted = np.asarray(forces[first : first + (len(forces) - first) // per_row * per_row])
    rows: NDArray[np.float64] = counted.reshape(-1, per_row, 2).mean(axis=1)
    travel = np.arange(len(rows), dtype=np.float64) * ROW_M
    known = [stationarity(travel, values) for values in rows.T]
    if None in known:
        raise SystemExit(f"--depths: {depths:g} given; allowed is at least {FIRST + 2.0:g}, pull farther")
    before, way = places.first_m, places.last_m - places.first_m
    passed = (before[:, 0] > FIRST * depth) & (before[:, 0] < (depths - BEHIND) * depth)
    top = passed & (before[:, 2] > -2.0 * radius_m)
    moved = np.linalg.norm(way, axis=1)

    def width_m(least_m: float) -> float:
        sideways = np.abs(before[top & (moved > least_m), 1])
        return 2.0 * float(np.percentile(sideways, 99.0)) if len(sideways) else 0.0

    loosened, widths = width_m(LOOSE_PART * radius_m), tuple(width_m(least) for least in MOVED_M)
    draft, vertical = [(one.mean, one.mean_half_width) for one in known if one is not None]
    return Pull(draft, vertical, loosened, wide, most, widths)


def compare(args: argparse.Namespace) -> Iterator[Row]:
    """A row for each blade, as they are done."""
    material = read_material(shipped_material(Path(args.soil)), args.soil)
    soil, critical = soil_of(material), soil_of(material, "critical_")
    blades = [
        (Blade(1e-3 * width, 1e-3 * depth, math.radians(rake), speed), 1e-3 * nose)
        for depth, rake, width, nose, speed in itertools.product(
            args.depths_mm, args.rakes, args.widths_mm, args.noses_mm, args.speeds
        )
    ]
    with ProcessPoolExecutor(args.processes) as pool:
        radius, back = 1e-3 * args.radius_mm, 1e-3 * args.setback_mm
        jobs = [
            [
                pool.submit(pulled, args.soil, radius, *blade, seed, args.depths, setback_m=back)
                for seed in args.seeds
            ]
            for blade in blades
        ]
        for (blade, nose), job in zip(blades, jobs, strict=True):
            found = [one.result() for one in job]
            draft, vertical = mean_of([one.draft for one in found]), mean_of([one.vertical for one in found])
            theories = {
                "Perumpral": perumpral(soil, blade),
                "Godwin and O'Dogherty": godwin_odogherty(soil, blade),
                "McKyes and Ali": mckyes_ali(soil, blade),
            }
            yield Row(
                math.degrees(blade.rake_rad), blade.width_m, blade.depth_m, blade.speed_m_per_s,
                found[0].bin_width_m, found[0].particles, draft[0], vertical[0],
                float(np.mean([one.loosened_m for one in found])), theories, crescents_m(soil, blade),
                (draft[1], vertical[1]), perumpral(critical, blade).draft_newton, nose,
                tuple(np.mean([one.widths_m for one in found], axis=0).tolist()),
            )  # fmt: skip


def mean_of(found: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean of means of equal weight, and its half-width."""
    means, halves = np.array(found).T
    return float(means.mean()), float(np.linalg.norm(halves) / len(halves))


def as_text(row: Row) -> str:
    """A row of the table."""
    off = row.deviations()
    narrow = row.theories["Perumpral"]
    cells = [
        f"{row.rake_deg:.0f} | {1e3 * row.width_m:.0f} | {1e3 * row.depth_m:.0f} | {1e3 * row.nose_m:.0f}",
        f"{row.speed_m_per_s:g} | {row.draft_newton:.0f} +- {row.half_widths[0]:.0f}",
        *(f"{off[name]:+.0%}" for name in ("Perumpral", GODWIN, "McKyes and Ali")),
        f"{row.draft_newton / row.critical_newton - 1.0:+.0%}",
        f"{row.vertical_newton:+.0f} +- {row.half_widths[1]:.0f} / {narrow.vertical_newton:+.0f}",
        f"{row.loosened_m:.2f} / {row.crescents_m:.2f} | {row.bin_width_m:.2f}",
    ]
    return "| " + " | ".join(cells) + " |"


GODWIN = "Godwin and O'Dogherty"
NARROW = ("Perumpral", GODWIN)


def exponents(rows: Sequence[Row]) -> Iterator[tuple[str, float, dict[str, float]]]:
    """Of draft over depth, for each rake, width and speed: found, and of each theory."""

    def key(row: Row) -> tuple[float, float, float, float]:
        return row.rake_deg, row.width_m, row.speed_m_per_s, row.nose_m

    for (rake, width, speed, _), group in itertools.groupby(sorted(rows, key=key), key):
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


def growth(rows: Sequence[Row]) -> Iterator[tuple[str, float, float, float]]:
    """Draft above that at the lowest speed: where, found [N], half-width [N], Godwin and O'Dogherty's [N]."""

    def key(row: Row) -> tuple[float, float, float, float]:
        return row.rake_deg, row.width_m, row.depth_m, row.nose_m

    for (rake, width, depth, _), group in itertools.groupby(sorted(rows, key=key), key):
        slowest, *faster = sorted(group, key=lambda row: row.speed_m_per_s)
        for row in faster:
            where = f"rake {rake:.0f}, {1e3 * width:.0f} mm wide, {1e3 * depth:.0f} mm deep"
            where += f", {slowest.speed_m_per_s:g} to {row.speed_m_per_s:g} m/s"
            theory = row.theories[GODWIN].draft_newton - slowest.theories[GODWIN].draft_newton
            half = math.hypot(row.half_widths[0], slowest.half_widths[0])
            yield where, row.draft_newton - slowest.draft_newton, half, theory


def misses(rows: Sequence[Row]) -> list[str]:
    """What is further from theory than accepted, in words."""
    found = []
    rows = [row for row in rows if row.nose_m == 0.0]
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
    for where, more, half, inertia in growth(rows):
        if abs(more - inertia) > half:
            found.append(f"{where}: draft grows by {more:.0f} +- {half:.0f} N, inertia by {inertia:.0f} N")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table, exponents and misses. Returns 1 if there are misses."""
    parser = argparse.ArgumentParser(prog="python -m validation.narrow_blade", description=main.__doc__)
    parser.add_argument("--rakes", nargs="+", type=float, default=[45.0, 60.0, 90.0], metavar="DEG")
    parser.add_argument("--widths-mm", nargs="+", type=float, default=[40.0, 80.0])
    parser.add_argument("--depths-mm", nargs="+", type=float, default=[100.0, 140.0, 200.0])
    parser.add_argument("--noses-mm", nargs="+", type=float, default=[0.0])
    parser.add_argument("--speeds", nargs="+", type=float, default=[0.5])
    parser.add_argument("--radius-mm", type=float, default=10.0)
    parser.add_argument("--setback-mm", type=float, default=0.0)
    parser.add_argument("--soil", default="loam")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--depths", type=float, default=DEPTHS, help="travel over the depth")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args(arguments)
    print(
        "| rake deg | width mm | depth mm | nose mm | m/s | draft N | Perumpral | G-O'D | McKyes-Ali "
        "| Perumpral, critical | vertical N, down / Perumpral | loosened / crescents m | bin m |\n"
        + "|---" * 13
        + "|"
    )
    rows = []
    for row in compare(args):
        rows.append(row)
        print(as_text(row), flush=True)
    for row in rows:
        moved = ", ".join(f"{1e3 * moved:g}" for moved in MOVED_M)
        widths = ", ".join(f"{width:.2f}" for width in row.widths_m)
        print(
            f"rake {row.rake_deg:.0f}, {1e3 * row.width_m:.0f} mm wide, {1e3 * row.depth_m:.0f} mm deep: "
            f"surface that moved by more than {moved} mm: {widths} m wide"
        )
    for where, power, theory in exponents(rows):
        print(f"{where}: exponent {power:.2f}, " + ", ".join(f"{name} {n:.2f}" for name, n in theory.items()))
    for where, more, half, inertia in growth(rows):
        print(f"{where}: draft grows by {more:.0f} +- {half:.0f} N, by inertia alone by {inertia:.0f} N")
    found = misses(rows)
    print("\n".join(found) or "all within what is accepted")
    if args.json:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
