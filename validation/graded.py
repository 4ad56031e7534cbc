"""Graded beds (soil.particles.coarse) against uniform ones, in the loam of field_tine.yaml.

    python -m validation.graded bed                        # solid fraction, contacts, settlement
    python -m validation.graded pull graded.csv            # 6 m; and migration of small particles
    python -m validation.graded pull uniform.csv --coarse 0
    python -m validation.graded table uniform.csv graded.csv

`bed` requires a solid fraction within 2 % of the soil's in slices one coarse diameter thick across both
interfaces, and prints contacts a particle around the tool and how far the soil sinks by itself. `pull`
drives the tine; then, of particles within two coarse diameters of an interface, how much farther the small
ones moved out of the core than the large ones beside them, where the tine broke the soil and where it did
not. `table` compares pulls over the same travel with the first one. The ground of a graded bed takes some ten
minutes to prepare, once.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from subsoil_ros.analysis.disturbance import Places
from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.dem.beds.field import Field
from subsoil_ros.dem.beds.ground import kept_ground
from subsoil_ros.dem.engine import SoilEngine, build_engine
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import ToolMotion
from subsoil_ros.yaml_document import Document

from . import field

TIMES = 22.0 / 15.0
RADIUS_MM = 15.0
DENSE = 0.02
"""Part by which the solid fraction of a slice may differ (asked)."""

POINTS = 400_000
"""Random points in a slice: its fraction is then known to 0.13 % (one standard deviation of counting)."""

ABOUT_M = (0.09, 0.22, 0.03)
"""Half width, greatest and least depth of the soil around the tool (chosen: three shares wide, down to 20 mm
below the tip, without the uneven surface)."""

SLICE_M = 0.25
"""Length of the pieces of the travel whose means count as independent (chosen: half a window)."""

ALONE_S = 1.0
"""How long the soil is left alone to sink by itself."""


def scene_of(radius_mm: float, coarse: Document | None, seed: int = 1) -> ResolvedScene:
    """The field of the tine, graded where `coarse` is given."""
    changes: Document = {"soil.particles.radius_m": 1e-3 * radius_mm, "soil.bed.seed": seed}
    return load_scene(field.SCENE, changes | ({"soil.particles.coarse": coarse} if coarse else {}))


def fraction(places: np.ndarray, radii: np.ndarray, low: tuple[float, ...], high: tuple[float, ...]) -> float:
    """Part of a box that spheres fill."""
    at = np.random.default_rng(1).uniform(low, high, (POINTS, 3))
    distance, nearest = cKDTree(places).query(at, k=10)
    return float((distance < radii[nearest]).any(axis=1).mean())


def touching(places: np.ndarray, radii: np.ndarray, low: tuple[float, ...], high: tuple[float, ...]) -> float:
    """Mean number of spheres that those in a box touch."""
    inside = np.flatnonzero(((places > low) & (places < high)).all(axis=1))
    near = cKDTree(places).query_ball_point(places[inside], radii[inside] + radii.max())
    counts = [
        (np.linalg.norm(places[others] - places[one], axis=1) < radii[others] + radii[one]).sum() - 1
        for one, others in zip(inside, map(np.asarray, near), strict=True)
    ]
    return float(np.mean(counts))


def bed(scene: ResolvedScene, radius_mm: float) -> int:
    """Print what a bed is like before a tool comes; return 1 where a slice is not as dense as asked."""
    soil = scene.scene.particle_soil
    assert soil is not None
    coarse = soil.particles.coarse
    laid = Field(kept_ground(scene, SoilEngine), soil)
    places, radii, _ = laid.arrays
    aside, deep, shallow = ABOUT_M
    middle = (0.1, -aside, -deep), (laid.period_m - 0.1, aside, -shallow)
    print(
        f"around the tool ({2.0 * aside:g} m wide, {shallow:g} to {deep:g} m deep): "
        f"solid fraction {fraction(places, radii, *middle):.4f}, "
        f"{touching(places, radii, *middle):.2f} contacts a particle"
    )
    if coarse is None:
        return 0
    assert coarse.beyond_m is not None
    assert coarse.below_m is not None
    thick, end = 2e-3 * radius_mm * coarse.times, laid.period_m
    good = True
    print("| slice | from the interface m | solid fraction |")
    print("|---|---|---|")
    for k in range(-2, 2):
        y, z = coarse.beyond_m + k * thick, -coarse.below_m - k * thick
        deep = (-coarse.below_m + 0.02, -0.06)
        sides = [(y, y + thick), (-y - thick, -y)]
        beside = [fraction(places, radii, (0.1, a, deep[0]), (end - 0.1, b, deep[1])) for a, b in sides]
        rows = [("beside", float(np.mean(beside)))]
        if z - thick > -soil.bin.depth_m - thick:
            half = coarse.beyond_m - 0.03
            rows.append(("below", fraction(places, radii, (0.1, -half, z - thick), (end - 0.1, half, z))))
        for name, found in rows:
            good &= abs(found / soil.bed.solid_fraction - 1.0) < DENSE
            print(f"| {name} | {k * thick:+.3f} to {(k + 1) * thick:+.3f} | {found:.4f} |")
    engine = build_engine(scene)
    above = (ToolMotion("tine", 3.0, 0.0, 0.25 + field.HEIGHT_M, 0.0, 0.0, 0.0, 0.0),)
    engine.start(above)
    for tick in range(round(ALONE_S / scene.timing.communication_step_s)):
        engine.advance(tick, above)
    p, way = engine.particles(), engine.displacements_m()[np.argsort(np.argsort(engine.particles().identity))]
    low, high = engine.bed.lower_m[0] + 0.15, engine.bed.upper_m[0] - 0.15
    free = ~p.held & (p.position[:, 0] > low) & (p.position[:, 0] < high)
    for k, grade in enumerate(soil.particles.grades):
        sunk = -1e3 * way[free & (p.material == k), 2]
        print(
            f"alone for {ALONE_S:g} s, size {1e3 * grade.mean_volume_radius_m:.3g} mm: sinks by "
            f"{sunk.mean():.4f} mm (mean), {sunk.max():.4f} mm at most"
        )
    return int(not good)


def migration(places: Places, scene: ResolvedScene, to_m: float) -> None:
    """Prints how much farther small particles moved out of the core than the large ones beside them."""
    soil = scene.scene.particle_soil
    assert soil is not None
    coarse = soil.particles.coarse
    assert coarse is not None
    assert coarse.beyond_m is not None
    assert coarse.below_m is not None
    small = places.radius_m < soil.particles.grades[0].bounds_m[1] * (1.0 + 1e-5)
    first, way, radius = places.first_m, places.last_m - places.first_m, soil.particles.mean_volume_radius_m
    near = 4.0 * coarse.times * radius
    beside = (np.abs(np.abs(first[:, 1]) - coarse.beyond_m) < near) & (first[:, 2] > -coarse.below_m)
    below = (np.abs(first[:, 2] + coarse.below_m) < near) & (np.abs(first[:, 1]) < coarse.beyond_m)
    broken = np.linalg.norm(way, axis=1) > radius
    out = {"beside": way[:, 1] * np.sign(first[:, 1]), "below": -way[:, 2]}
    print("| interface | soil | small farther out than large, mm | small, large particles |")
    print("|---|---|---|---|")
    for name, there in (("beside", beside), ("below", below)):
        for told, state in (("not broken", ~broken), ("broken", broken)):
            differences, counts = [], np.zeros(2, np.int64)
            for start in np.arange(field.START_M, to_m - SLICE_M + 1e-9, SLICE_M):
                here = there & state & (first[:, 0] >= start) & (first[:, 0] < start + SLICE_M)
                parts = out[name][here & small], out[name][here & ~small]
                counts += [len(part) for part in parts]
                if min(map(len, parts)) >= 3:
                    differences.append(1e3 * (parts[0].mean() - parts[1].mean()))
            if len(differences) < 3:
                continue
            half = 2.0 * np.std(differences, ddof=1) / np.sqrt(len(differences))
            mean = f"{np.mean(differences):+.3f} +- {half:.3f}"
            print(f"| {name} | {told} | {mean} | {counts[0]}, {counts[1]} |")


def table(files: list[Path]) -> None:
    """Prints pulls beside the first one, over the travel that all have."""
    pulls = [field.read(path) for path in files]
    end = min(float(found["tip_x_m"][-1]) for found in pulls)
    print(
        "| pull | particles | CPU s per m | draft N | vertical N | draft less first | vertical less first |"
    )
    print("|---" * 7 + "|")
    base = None
    for path, found in zip(files, pulls, strict=True):
        tip = found["tip_x_m"]
        counts = (tip >= field.START_M) & (tip <= end + 1e-9)
        x = tip[counts]
        forces = [found[name][counts] for name in ("draft_newton", "vertical_newton")]
        base = base or forces
        cost = float(np.polyfit(x, found["cpu_s"][counts], 1)[0])
        cells = [path.stem, f"{found['particles'][counts].mean():.0f}", f"{cost:.1f}"]
        for values in forces:
            steady = stationarity(x, values)
            assert steady is not None
            cells.append(f"{steady.mean:.0f} +- {steady.mean_half_width:.0f}")
        for values, others in zip(forces, base, strict=True):
            apart = stationarity(x, values - others) if values is not others else None
            cells.append("-" if apart is None else f"{apart.mean:+.0f} +- {apart.mean_half_width:.0f}")
        print("| " + " | ".join(cells) + " |")


def main() -> int:
    """Exit status: 1 where something asked for is missed."""
    parser = argparse.ArgumentParser(prog="python -m validation.graded", description=main.__doc__)
    parser.add_argument("part", choices=["bed", "pull", "table"])
    parser.add_argument("files", type=Path, nargs="*", metavar="FILE.csv")
    parser.add_argument("--radius-mm", type=float, default=RADIUS_MM)
    parser.add_argument("--coarse", type=float, default=TIMES, metavar="TIMES", help="0: of one size")
    parser.add_argument("--beyond-m", type=float, help="half width of the core (default: as in a scene)")
    parser.add_argument("--below-m", type=float, help="depth of the core (default: as in a scene)")
    parser.add_argument("--seed", type=int, default=1, help="of the bed")
    parser.add_argument("--metres", type=float, default=6.0)
    args = parser.parse_args()
    core = {"times": args.coarse, "beyond_m": args.beyond_m, "below_m": args.below_m}
    args.coarse = {key: value for key, value in core.items() if value is not None} if args.coarse else None
    if args.part == "bed":
        return bed(scene_of(args.radius_mm, args.coarse, args.seed), args.radius_mm)
    if args.part == "table":
        table(args.files)
        return 0
    args.metres, metres = [args.metres], args.metres
    vars(args).update(speed=field.SPEED_M_PER_S, width=0.6, ends=1.0, threads=1, sides="held", bin=None)
    places = field.pull(args)
    if args.coarse:
        migration(places, scene_of(args.radius_mm, args.coarse, args.seed), metres - field.REAR_M)
    return 0


if __name__ == "__main__":
    sys.exit(main())
