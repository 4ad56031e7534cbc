"""The terrain model against particles: a bucket penetrates, drags, curls and lifts.

    python -m validation.digs [--soils SOIL ...] [--digs A B C] [--cell-mm MM] [--tick-ms MS]
        [--particles CSV] [--scale TIMES]
    python -m validation.digs --radius-mm R [--setback-mm S]    # particles, five minutes a dig at 10 mm

The bucket of examples/bucket_arm, 0.2 m wide, takes soil along prescribed ways. The first command digs in
terrains and prints their mean forces beside those of particles of 10 mm, from validation/studies/digs.csv; in
digs_set_back.csv the bucket is set back by 7.5 mm. With --scale, bucket, ground and ways are so many times as
long, which takes its root times as long, and only the time is printed. The second prints rows of such a
table.
The model has no fitted number; validation/terrain.md says what was known when it was made.
"""

import argparse
import csv
import math
import sys
import time
from collections.abc import Iterator, Sequence
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from subsoil_ros.coupling.engines import build_soil
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.mbd.tool_paths import PathEngine

MESH = Path(__file__).parents[1] / "examples" / "bucket_arm" / "bucket.stl"

TABLE = Path(__file__).parent / "studies" / "digs.csv"
"""Mean forces of particles of 10 mm, as --radius-mm 10 prints them."""

Waypoint = tuple[float, float, float, float]
"""Time [s]; x and z of the bucket's pin [m]; pitch [rad]."""

DIGS: dict[str, tuple[Waypoint, ...]] = {
    # the lip goes down 70 mm, is drawn 0.26 m while the bucket levels, curled and lifted
    "A": ((0.0, 0.62, 0.25, -0.7), (0.6, 0.60, 0.12, -0.7), (1.8, 0.34, 0.12, -0.2), (2.4, 0.32, 0.18, 0.6),
          (3.0, 0.32, 0.40, 0.6)),
    # deeper and steeper: 100 mm, a short way
    "B": ((0.0, 0.60, 0.25, -0.9), (0.8, 0.58, 0.105, -0.9), (1.8, 0.40, 0.11, -0.3), (2.5, 0.38, 0.18, 0.6),
          (3.0, 0.38, 0.40, 0.6)),
    # shallow and long: 40 mm
    "C": ((0.0, 0.70, 0.25, -0.5), (0.5, 0.68, 0.145, -0.5), (2.1, 0.28, 0.13, -0.1), (2.5, 0.26, 0.18, 0.6),
          (3.0, 0.26, 0.40, 0.6)),
}  # fmt: skip
"""Ways of the bucket (chosen), from waypoint to waypoint along half cosines."""

PHASES = ("penetrate", "drag", "curl", "lift")
"""From waypoint to waypoint."""

BIN = {"length_m": 0.95, "width_m": 0.6, "depth_m": 0.25}
"""Two widths of the bucket of soil beside it, and as much below its deepest cut as that is deep."""

ROW_S, SAMPLE_S = 0.02, 0.05
"""Of the tables, and of the poses between which the paths interpolate."""


def poses(dig: str, scale: float = 1.0) -> dict[str, list[object]]:
    """The way of a dig as `path.poses`."""
    points = np.array(DIGS[dig]) * (math.sqrt(scale), scale, scale, 1.0)
    times = np.arange(0.0, points[-1, 0] + 1.5 * SAMPLE_S, SAMPLE_S)
    which = np.clip(np.searchsorted(points[:, 0], times, side="right") - 1, 0, len(points) - 2)
    part = np.clip((times - points[which, 0]) / np.diff(points[:, 0])[which], 0.0, 1.0)
    part = 0.5 - 0.5 * np.cos(math.pi * part)
    x, z, pitch = (points[which, 1:] + part[:, None] * np.diff(points[:, 1:], axis=0)[which]).T
    return {
        "times_s": times.tolist(),
        "positions_m": [[a, 0.0, b] for a, b in zip(x.tolist(), z.tolist(), strict=True)],
        "rotations_rad": [[0.0, angle, 0.0] for angle in pitch.tolist()],
    }


def scene_of(
    dig: str,
    soil: dict[str, object],
    tick_ms: float | None = None,
    setback_m: float = 0.0,
    scale: float = 1.0,
) -> ResolvedScene:
    """A dig in a soil."""
    box = {"sides": "walls"} | {key: scale * length for key, length in BIN.items()}
    step = {} if tick_ms is None else {"coupling": {"communication_step_ns": round(1e6 * tick_ms)}}
    return load_scene(
        {
            "name": f"dig_{dig}",
            **step,
            "duration_s": round(math.sqrt(scale) * DIGS[dig][-1][0], 2),
            "soil": {"bin": box, **soil},
            "tools": {
                "bucket": {
                    "path": {"poses": poses(dig, scale)},
                    "groups": {"bucket": {"mesh": str(MESH), "scale": scale}},
                    "setback_m": setback_m,
                }
            },
        }
    )


def dug(scene: ResolvedScene) -> tuple[NDArray[np.float64], float]:
    """Rows of end time [s] and mean force x, y, z [N]; CPU time of the ticks over their simulated time."""
    soil, paths = build_soil(scene, 1), PathEngine(scene.scene, scene.timing)
    assert soil is not None
    motions = paths.initial_motions()
    wrenches = soil.start(motions)
    step = scene.timing.communication_step_s
    per_row = round(ROW_S / step)
    forces = np.empty((round(scene.scene.duration_s / step) // per_row * per_row, 3))
    begun = time.process_time()
    for tick in range(len(forces)):
        motions = paths.advance(tick, wrenches)
        wrenches = soil.advance(tick, motions)
        one = wrenches[0]
        forces[tick] = one.force_x_newton, one.force_y_newton, one.force_z_newton
    cpu = (time.process_time() - begun) / (step * len(forces))
    means = forces.reshape(-1, per_row, 3).mean(axis=1)
    return np.column_stack([per_row * step * np.arange(1, len(means) + 1), means]), cpu


def phase_means(rows: NDArray[np.float64], dig: str) -> NDArray[np.float64]:
    """Mean force [N] of each phase (phases, 3)."""
    times = [point[0] for point in DIGS[dig]]
    return np.array([rows[(rows[:, 0] > a) & (rows[:, 0] <= b), 1:].mean(axis=0) for a, b in pairwise(times)])


JUDGED = (
    ("penetrate", 2, "up"),
    ("drag", 0, "back"),
    ("drag", 2, "up"),
    ("curl", 0, "back"),
    ("lift", 2, "up"),
)
"""Phase, axis and name of the mean forces that are compared."""


def of_particles(table: Path) -> dict[tuple[str, str], NDArray[np.float64]]:
    """Mean forces of particles [N] (phases, 3) by soil and dig."""
    with table.open(newline="") as file:
        _, *rows = csv.reader(file)
    return {
        key: np.array([row[3:] for row in group], dtype=np.float64)
        for key, group in ((key, list(group)) for key, group in groupby(rows, lambda row: (row[0], row[1])))
    }


def compared(
    soil: str, dig: str, particles: NDArray[np.float64], terrain: NDArray[np.float64]
) -> Iterator[str]:
    """Rows of the table for one dig."""
    for phase, axis, way in JUDGED:
        one, other = particles[PHASES.index(phase), axis], terrain[PHASES.index(phase), axis]
        yield f"| {soil} | {dig} | {phase}, {way} | {one:.1f} | {other:.1f} | {other / one:.2f} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Digs; prints the comparison, or rows of TABLE."""
    parser = argparse.ArgumentParser(prog="python -m validation.digs")
    parser.add_argument("--soils", nargs="+", default=["dry_sand", "sandy_loam", "loam"])
    parser.add_argument("--digs", nargs="+", default=list(DIGS), choices=DIGS)
    parser.add_argument("--cell-mm", type=float, default=10.0)
    parser.add_argument("--tick-ms", type=float, help="communication step; 1 ms unless given")
    parser.add_argument("--particles", type=Path, default=TABLE, metavar="CSV")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--radius-mm", type=float)
    parser.add_argument("--setback-mm", type=float, default=0.0, help="of the bucket, with particles")
    args = parser.parse_args(arguments)
    if args.setback_mm and args.radius_mm is None:
        parser.error("--setback-mm: is of particles; give --radius-mm as well")
    stored = of_particles(args.particles)
    if args.radius_mm is None:
        print("| soil | dig | force | particles N | terrain N | ratio |\n" + "|---" * 6 + "|")
    for soil in args.soils:
        for dig in args.digs:
            if args.radius_mm is not None:
                radius_m = 1e-3 * args.radius_mm
                particles = {"material": soil, "particles": {"radius_m": radius_m}}
                rows, _ = dug(scene_of(dig, particles, setback_m=1e-3 * args.setback_mm))
                for phase, forces in zip(PHASES, phase_means(rows, dig).tolist(), strict=True):
                    print(soil, dig, phase, *(f"{force:.6g}" for force in forces), sep=",", flush=True)
            elif (soil, dig) in stored:
                terrain = {"model": "terrain", "material": soil, "cell_m": 1e-3 * args.cell_mm}
                rows, cpu = dug(scene_of(dig, terrain, args.tick_ms, scale=args.scale))
                if args.scale == 1.0:
                    print("\n".join(compared(soil, dig, stored[soil, dig], phase_means(rows, dig))))
                print(f"| {soil} | {dig} | CPU time over simulated | | {cpu:.2f} | |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
