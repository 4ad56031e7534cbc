"""A flat disc that rolls freely, at disc and tilt angles, against published trends.

    python -m validation.disc [--angles-deg 15 25 35 45 60 -45] [--tilts-deg 0 15 30] [--radius-mm 10]
        [--metres 1.5] [--processes 2]

A disc as in examples/tilted_disc is pulled DEPTH_M deep through a field of dry_sand (a soil.window with
held sides) and turned by the soil. The disc angle is that between the disc and its travel, seen from above;
positive, the soil pushes the disc to the left (+y). The tilt leans the face that pushes soil back from the
upright; of a negative disc angle everything is the mirror image. Means are over the travel from FIRST_M on,
with 95 % intervals. Trends:

- the side force has the sign of the disc angle, and mirror images have mirrored forces: symmetry;
- more tilt raises the draft and lowers the side force: N.H. Abu-Hamdeh, R.C. Reeder, Soil Till. Res. 74
  (2003) 115-124, on a disc plough, tilt 15 to 25 degrees;
- the disc angle of least draft: about 45 degrees for plough discs (E.D. Gordon, Agric. Eng. 22 (1941)
  205-208, as R.A. Kepner, R. Bainer, E.L. Barger, Principles of Farm Machinery, 3rd ed. 1978, report it), but
  a small one for a disc harrow (H.P. Harrison, Trans. ASAE 20 (1977) 836-838: largest draft at 35 degrees,
  and per width of cut at 45). These discs are concave and the sources disagree, so the command prints
  the angle without a verdict.

Exit status 1 where a trend is contradicted.
"""

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.dem.build import build_engine
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.mbd.tool_paths import PathEngine

from .laboratory import Laboratory

RADIUS_M, THICKNESS_M, INERTIA_KG_M2 = 0.10, 0.008, 0.0099
"""Of the disc of examples/tilted_disc: steel."""

DEPTH_M, SPEED_M_PER_S = 0.06, 0.5
"""Of the lowest point of the rim, as in the example."""

BEHIND_M, FIRST_M, ROW_M, AHEAD_M = 0.05, 0.3, 0.005, 2.0
"""Of the rim behind the start of the field at first; travel from which on means count, five depths (chosen:
the furrow and the heap beside it are whole); travel of a row; field beyond the pull (no window reaches its
end)."""

WIDTH_M, BED_M, WINDOW_M = 0.56, 0.12, 0.4
"""Of the field (chosen: three depths of soil beside the disc on each side, and one below it), and of the soil
ahead of the disc (chosen: with half of it, soil moved up to the end of the window)."""

LEAST_METRES = 1.0
"""Chosen: a stretch for the intervals of five times FIRST_M's depths."""


@dataclass(frozen=True)
class Row:
    """One disc: means and half-widths of 95 % intervals."""

    angle_deg: float
    tilt_deg: float
    draft: tuple[float, float]
    side: tuple[float, float]  # to the left
    vertical: tuple[float, float]  # up
    rolling: float  # rim speed over that of rolling without slip, v cos(angle)
    cpu_s: float

    @property
    def cut_m(self) -> float:
        """Width of cut: the chord in the surface, seen along the travel."""
        deep = DEPTH_M / math.cos(math.radians(self.tilt_deg))
        return 2.0 * math.sqrt(deep * (2.0 * RADIUS_M - deep)) * math.sin(math.radians(abs(self.angle_deg)))


def rotation(angle_deg: float, tilt_deg: float) -> Rotation:
    """From a disc whose axis is y and that faces sideways: leant back by the tilt, then yawed."""
    lean = -math.copysign(math.radians(tilt_deg), angle_deg)
    return Rotation.from_rotvec((0.0, 0.0, math.radians(angle_deg))) * Rotation.from_rotvec((lean, 0.0, 0.0))


def disc_scene(
    folder: Path, angle_deg: float, tilt_deg: float, radius_m: float, metres: float
) -> ResolvedScene:
    """A disc at the start of its field."""
    mesh = trimesh.creation.cylinder(radius=RADIUS_M, height=THICKNESS_M, sections=48)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.5 * math.pi, (1.0, 0.0, 0.0)))
    mesh.export(folder / "disc.stl")
    turn = rotation(angle_deg, tilt_deg)
    lowest = float(turn.apply(mesh.vertices)[:, 2].min())
    box = {"length_m": round(metres + AHEAD_M, 2), "width_m": WIDTH_M, "depth_m": BED_M, "sides": "held"}
    rolling = SPEED_M_PER_S * math.cos(math.radians(angle_deg)) / RADIUS_M
    path = {
        "start_x_m": -BEHIND_M - RADIUS_M,
        "start_z_m": -DEPTH_M - lowest,
        "speed_x_m_per_s": {"kind": "constant", "value": SPEED_M_PER_S},
        "turn": {
            "start_rotation_rad": turn.as_rotvec().tolist(),
            "axis": [0.0, 1.0, 0.0],
            "free": {"inertia_kg_m2": INERTIA_KG_M2, "start_speed_rad_per_s": rolling},
        },
    }
    soil = {
        "material": "dry_sand",
        "bin": box,
        "window": {"ahead_m": WINDOW_M},
        "particles": {"radius_m": radius_m},
    }
    return Laboratory(folder).resolve(
        {
            "name": "disc",
            "duration_s": (metres + BEHIND_M + RADIUS_M) / SPEED_M_PER_S,
            "soil": {**soil, "bed": {"seed": 1}},
            "tools": {"disc": {"path": path, "groups": {"disc": {"mesh": "disc.stl"}}}},
        }
    )


def rolled(angle_deg: float, tilt_deg: float, radius_m: float, metres: float) -> Row:
    """A disc through a field of soil."""
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        scene = disc_scene(Path(folder), angle_deg, tilt_deg, radius_m, metres)
        engine, paths = build_engine(scene), PathEngine(scene.scene, scene.timing)
        motions = paths.initial_motions()
        wrenches = engine.start(motions)
    axis = rotation(angle_deg, tilt_deg).apply((0.0, 1.0, 0.0))
    found, step = [], SPEED_M_PER_S * scene.timing.communication_step_s
    for tick in range(int((metres + BEHIND_M + RADIUS_M) / step)):
        motions = paths.advance(tick, wrenches)
        wrenches = engine.advance(tick, motions)
        felt = wrenches[0]
        rim = RADIUS_M * float(axis @ motions[0].spin_rad_per_s)
        found.append((-felt.force_x_newton, felt.force_y_newton, felt.force_z_newton, rim))
    first, per_row = round((FIRST_M + BEHIND_M + RADIUS_M) / step), max(1, round(ROW_M / step))
    counted = np.asarray(found[first : first + (len(found) - first) // per_row * per_row])
    rows = counted.reshape(-1, per_row, 4).mean(axis=1)
    travel = ROW_M * np.arange(len(rows), dtype=np.float64)
    means = []
    for values in rows.T[:3]:
        known = stationarity(travel, values)
        if known is None:
            raise SystemExit(
                f"--metres: {metres:g} given; allowed is at least {LEAST_METRES:g}, pull farther"
            )
        means.append((known.mean, known.mean_half_width))
    free = SPEED_M_PER_S * math.cos(math.radians(angle_deg))
    cpu = time.process_time() - begun
    return Row(angle_deg, tilt_deg, means[0], means[1], means[2], float(rows[:, 3].mean()) / free, cpu)


CONTRADICTED = 2.0
"""Half-widths beyond which the opposite of a trend counts (chosen: of fifty trends some three miss their 95 %
interval by chance, and none is off by twice as much)."""

Verdict = tuple[str, str]
"""A trend with its numbers; 'holds', 'not resolved' or 'CONTRADICTED'."""


def judged(trend: str, value: float, half: float) -> Verdict:
    """A trend by which `value` is positive."""
    verdict = "holds" if value > half else "not resolved"
    if value < -CONTRADICTED * half:
        verdict = "CONTRADICTED"
    return f"{trend}: {value:+.1f} +- {half:.1f} N", verdict


def verdicts(rows: Sequence[Row]) -> Iterator[Verdict]:
    """The trends that these discs can show."""
    by_place = {(row.angle_deg, row.tilt_deg): row for row in rows}
    for row in rows:
        where = f"disc angle {row.angle_deg:g}, tilt {row.tilt_deg:g}"
        yield judged(f"{where}: side force to the side that the angle says",
                     math.copysign(1.0, row.angle_deg) * row.side[0], row.side[1])  # fmt: skip
        mirrored = by_place.get((-row.angle_deg, row.tilt_deg))
        if mirrored is not None and row.angle_deg > 0.0:
            for name, sign in (("draft", 1.0), ("side", -1.0), ("vertical", 1.0)):
                one, other = getattr(row, name), getattr(mirrored, name)
                apart, half = one[0] - sign * other[0], math.hypot(one[1], other[1])
                verdict = "holds" if abs(apart) <= half else "not resolved"
                if abs(apart) > CONTRADICTED * half:
                    verdict = "CONTRADICTED"
                yield f"{where}: {name} less that of the mirror image: {apart:+.1f} +- {half:.1f} N", verdict
    for one in rows:
        steeper = [row for row in rows if row.angle_deg == one.angle_deg and row.tilt_deg > one.tilt_deg]
        if not steeper:
            continue
        other = min(steeper, key=lambda row: row.tilt_deg)
        where = f"disc angle {one.angle_deg:g}, tilt {one.tilt_deg:g} to {other.tilt_deg:g}"
        half = math.hypot(one.draft[1], other.draft[1])
        yield judged(f"{where}: draft rises", other.draft[0] - one.draft[0], half)
        half = math.hypot(one.side[1], other.side[1])
        yield judged(f"{where}: side force falls", abs(one.side[0]) - abs(other.side[0]), half)


def least(rows: Sequence[Row]) -> Iterator[str]:
    """Disc angles of least draft, tilt by tilt."""
    for tilt in sorted({row.tilt_deg for row in rows}):
        group = [row for row in rows if row.tilt_deg == tilt and row.angle_deg > 0.0]
        if len(group) < 3:
            continue
        whole = min(group, key=lambda row: row.draft[0])
        part = min(group, key=lambda row: row.draft[0] / row.cut_m)
        yield (
            f"tilt {tilt:g}: least draft at a disc angle of {whole.angle_deg:g} degrees, per width of cut at "
            f"{part.angle_deg:g} (published: about 45, Gordon 1941; the smallest, Harrison 1977)"
        )


def as_text(row: Row) -> str:
    """A row of the table."""
    cells = [f"{row.tilt_deg:g}", f"{row.angle_deg:g}"]
    cells += [f"{mean:.1f} +- {half:.1f}" for mean, half in (row.draft, row.side, row.vertical)]
    cells += [f"{row.draft[0] / row.cut_m:.0f}", f"{row.rolling:.2f}", f"{row.cpu_s:.0f}"]
    return "| " + " | ".join(cells) + " |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table and the trends. Returns 1 if one is contradicted."""
    parser = argparse.ArgumentParser(prog="python -m validation.disc", description=main.__doc__)
    parser.add_argument("--angles-deg", nargs="+", type=float, default=[15.0, 25.0, 35.0, 45.0, 60.0, -45.0])
    parser.add_argument("--tilts-deg", nargs="+", type=float, default=[0.0, 15.0, 30.0])
    parser.add_argument("--radius-mm", type=float, default=10.0)
    parser.add_argument("--metres", type=float, default=1.5)
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args(arguments)
    if any(not 0.0 < abs(angle) < 90.0 for angle in args.angles_deg):
        parser.error(
            f"--angles-deg: {args.angles_deg} given; allowed are 0 to 90 and -90 to 0, without the ends"
        )
    if any(not 0.0 <= tilt <= 45.0 for tilt in args.tilts_deg):
        parser.error(f"--tilts-deg: {args.tilts_deg} given; allowed are 0 to 45")
    if not 2.0 <= args.radius_mm <= 20.0:
        parser.error(f"--radius-mm: {args.radius_mm:g} given; allowed are 2 to 20, a third of the depth")
    if args.metres < LEAST_METRES:
        parser.error(f"--metres: {args.metres:g} given; allowed is at least {LEAST_METRES:g}")
    print(
        "| tilt deg | disc angle deg | draft N | side N, left | vertical N, up | draft over width of cut N/m "
        "| rim over rolling | CPU s |\n" + "|---" * 8 + "|"
    )
    rows = []
    with ProcessPoolExecutor(args.processes) as pool:
        jobs = [
            pool.submit(rolled, angle, tilt, 1e-3 * args.radius_mm, args.metres)
            for tilt in args.tilts_deg
            for angle in args.angles_deg
        ]
        for job in jobs:
            rows.append(job.result())
            print(as_text(rows[-1]), flush=True)
    found = list(verdicts(rows))
    print("\n".join([f"{trend}: {verdict}" for trend, verdict in found] + list(least(rows))))
    return int(any(verdict == "CONTRADICTED" for _, verdict in found))


if __name__ == "__main__":
    sys.exit(main())
