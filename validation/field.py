"""A rigid tine pulled through a field of loam: soil and cost per metre must be the same along the field.

    python -m validation.field pull FILE.csv [--metres M] [--radius-mm R] [--seed N] [--speed V] [--sides S]
                                             [--width W] [--ends FACTOR] [--bin LENGTH]
    python -m validation.field table FILE.csv ...
    python -m validation.field coverage FILE.csv ... [--metres M ...]
    python -m validation.field echo [--radius-mm R]

`pull` drives the tine of config/scenes/field_tine.yaml, 0.20 m deep, through a window of soil, or with --bin
through a bin of that length, and writes a row per ROW_M of travel, and at the end the loosened section to
FILE_section.csv. --ends multiplies the lengths of the window ahead and behind. `table` judges such files from
START_M on: mean draft, vertical force and loosened section with their 95 % intervals; the trend of the draft;
its correlation at the length of a block, and at the period of the field if the pull is twice as long; CPU
time per metre and memory of the process, less the places kept for the section, late against early. Exit
status 1 where one is not within TREND, CORRELATION, COST or MEMORY. A folder of `subsoil run` may stand for a
file; cost is then left out.
`echo` kicks the soil below a tool at rest, in the usual window and in one twice as long, and prints how far
the two differ near the kick: the waves that the nearer ends reflect.
`coverage` cuts STRETCHES of each length from such pulls and counts how many 95 % intervals of a stretch's
mean draft hold the mean of the whole pull: 90 to 98 % should; likewise of pulls that stop at a known mean.
"""

import argparse
import csv
import math
import sys
import time
from pathlib import Path

import numpy as np
import psutil

from subsoil_ros.analysis.columns import TIME, Wrench
from subsoil_ros.analysis.disturbance import Places, disturbance_between, write_section_csv
from subsoil_ros.analysis.metrics_window import tip_x_m
from subsoil_ros.analysis.series import moving_mean
from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.api.read import read_run
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.field import ACROSS, ALONG
from subsoil_ros.dem.packing.bed_geometry import sample_edge_m
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import ToolMotion

SCENE = Path(__file__).parents[1] / "config/scenes/field_tine.yaml"
TIP_M, HEIGHT_M, FIRST_TIP_M = 0.12, 0.10, -0.05
"""Of the tine: x of the tip in its mesh, height of the mesh for a depth of 0.20 m, where the tip begins."""

ROW_M = 0.01
"""Travel of a row (chosen: less than a particle)."""

SPEED_M_PER_S = 0.5
"""Of the shipped scenes."""

START_M, LEAVE_M = 1.0, 0.5
"""From where on the draft counts: one window; and before the end of a bin."""

KICK_M_PER_S, KICKED_M, LISTEN_S = 1.0, 0.06, 0.08
"""Speed of a kick, radius of the ball that is kicked, how long is listened (chosen: until what the ends send
back has passed)."""

CLOUD_ROWS, REAR_M = 10, 0.4
"""Rows between two clouds; and how far behind the tip soil has come to rest (chosen: two depths)."""

TREND, CORRELATION, COST, MEMORY = 0.05, 0.2, 0.05, 0.02
"""Allowed of the draft over the whole way, of its correlation, of CPU time per metre, of memory (asked)."""

STRETCHES, COVERED = 400, (0.90, 0.98)
"""Stretches of a pull, overlapping, and the part of intervals that should hold the mean (asked)."""

STOP_AT, LOOK_ROWS, LONGEST_M = (0.05, 0.03), 5, 11.0
"""Relative intervals that end a pull (scene.stop_when), rows between two looks, and the longest such pull."""

COLUMNS = (
    "tip_x_m", "draft_newton", "vertical_newton", "particles", "cpu_s", "memory_bytes", "block_m", "period_m",
)  # fmt: skip


def pull(args: argparse.Namespace) -> Places:
    """Drives the tine and writes the rows as they come; where particles were first and last."""
    (file,), (metres,) = args.files, args.metres or (12.0,)
    length = args.bin or metres + 1.0
    scene = load_scene(SCENE)
    depth = scene.document["soil"]["bin"]["depth_m"]
    box = {"length_m": length, "width_m": args.width, "depth_m": depth, "sides": args.sides}
    changes = {"soil.bin": box, "soil.window": {}, "soil.particles.radius_m": 1e-3 * args.radius_mm}
    changes["soil.bed.seed"] = args.seed
    if args.bin:
        changes |= {"soil.window": None, "soil.bin": box | {"sides": "walls"}}
    scene = load_scene(SCENE, changes)
    if args.ends != 1.0:
        window = scene.scene.particle_soil.window
        longer = {key: args.ends * getattr(window, key) for key in ("ahead_m", "behind_m")}
        scene = load_scene(SCENE, changes | {"soil.window": longer})
    engine = build_engine(scene, args.threads)
    tick_s, process = scene.timing.communication_step_s, psutil.Process()

    def at(time_s: float) -> tuple[ToolMotion, ...]:
        x = FIRST_TIP_M - TIP_M + args.speed * time_s
        return (ToolMotion("tine", x, 0.0, HEIGHT_M, 0.0, args.speed, 0.0, 0.0),)

    block, period = repeats_m(scene)
    engine.start(at(0.0))
    places = Places()
    places.see(engine.cloud(0, 0))
    ticks_of_row = max(1, round(ROW_M / (args.speed * tick_s)))
    with file.open("w", newline="") as rows_file:
        table = csv.writer(rows_file)
        table.writerow(COLUMNS)
        forces, rows = [], 0
        for tick in range(round((metres - FIRST_TIP_M) / (args.speed * tick_s))):
            wrench = engine.advance(tick, at((tick + 1) * tick_s))[0]
            forces.append((-wrench.force_x_newton, wrench.force_z_newton))
            if len(forces) < ticks_of_row:
                continue
            draft, vertical = np.mean(forces, axis=0).tolist()
            tip = FIRST_TIP_M + args.speed * (tick + 1) * tick_s
            row = (round(tip, 6), round(draft, 3), round(vertical, 3), engine.particle_count)
            own = places.first_m.nbytes + places.last_m.nbytes + places._row_of.nbytes
            cpu, memory = time.process_time(), process.memory_info().rss - own
            table.writerow((*row, round(cpu, 2), memory, round(block, 9), round(period, 9)))
            rows_file.flush()
            forces, rows = [], rows + 1
            if rows % CLOUD_ROWS == 0:
                places.see(engine.cloud(tick, 0))
    radius = scene.scene.particle_soil.particles.mean_volume_radius_m
    slab = (START_M, (metres - LEAVE_M if args.bin else metres) - REAR_M)
    loosened = disturbance_between(places.first_m, places.last_m, slab, radius)
    if loosened is not None:
        write_section_csv(loosened, section_of(file))
    lost = engine.state("", 0, 0).lost_particle_count
    print(f"{file}: {metres:g} m, {lost} particles lost")
    return places


def velocities(engine: SoilEngine, identity: np.ndarray) -> np.ndarray:
    """(n, 3) [m/s] of particles by identity."""
    p = engine.particles()
    row = np.empty(int(p.identity.max()) + 1, np.int64)
    row[p.identity] = np.arange(p.count)
    return np.array(p.velocity[row[identity]])


def echo(radius_m: float) -> None:
    """Kicks the soil in two windows and prints what comes back from the ends of the shorter one."""
    base = load_scene(SCENE, {"soil.particles.radius_m": radius_m})
    window = base.scene.particle_soil.window
    doubled = {key: 2.0 * getattr(window, key) for key in ("ahead_m", "behind_m")}
    engines = []
    x = 3.0
    above = (ToolMotion("tine", x - TIP_M, 0.0, 0.25, 0.0, 0.0, 0.0, 0.0),)
    for longer in (1.0, 2.0):
        box = {key: longer / 2.0 * value for key, value in doubled.items()}
        scene = load_scene(SCENE, {"soil.particles.radius_m": radius_m, "soil.window": box})
        engine = build_engine(scene)
        engine.start(above)
        p = engine.particles()
        ball = np.linalg.norm(p.position - (x, 0.0, -0.1), axis=1) < KICKED_M
        p.velocity[ball, 0] += KICK_M_PER_S
        engines.append(engine)
        near = np.sort(p.identity[ball & ~p.held])
    tick_s = base.timing.communication_step_s
    first, largest, when = 0.0, 0.0, 0.0
    for tick in range(round(LISTEN_S / tick_s)):
        for engine in engines:
            engine.advance(tick, above)
        here, there = (velocities(engine, near) for engine in engines)
        first = max(first, float(np.sqrt((there**2).sum(axis=1).mean())))
        back = float(np.sqrt(((here - there) ** 2).sum(axis=1).mean()))
        if back > largest:
            largest, when = back, (tick + 1) * tick_s
    print(
        f"kick of {first:.2f} m/s (rms, {len(near)} particles); from the ends {largest:.2g} m/s at most, "
        f"{largest / first:.1%}, after {1e3 * when:.0f} ms"
    )


def section_of(file: Path) -> Path:
    """Where the loosened section of a pull stands."""
    return file.with_name(f"{file.stem}_section.csv")


def repeats_m(scene: ResolvedScene) -> tuple[float, float]:
    """Travel from one copy of the block to the next one, and the period of the field [m]; NaN for a bin."""
    soil = scene.scene.particle_soil
    if soil.window is None:
        return math.nan, math.nan
    ahead, aside = (ALONG if soil.bin.sides == "periodic" else ACROSS)[0]
    edge, blocks = sample_edge_m(soil), math.hypot(ahead, aside)
    return edge * ahead / blocks, edge * blocks


def of_run(directory: Path) -> dict[str, np.ndarray]:
    """The same of a folder of `subsoil run`, over the travel of the tip, without CPU time and memory."""
    run = read_run(directory)
    scene, series = run.scene.scene, {name: run.series[name].to_numpy() for name in run.series}
    tip = np.maximum.accumulate(tip_x_m(series, scene)) + 1e-9 * np.arange(len(series[TIME]))
    share = next(name for name, tool in scene.tools.items() if tool.is_tillage)
    rows = np.arange(ROW_M * math.ceil(tip[0] / ROW_M), tip[-1], ROW_M)
    found = {name: np.full(len(rows), math.nan) for name in COLUMNS} | {"tip_x_m": rows}
    for name, column in (
        ("draft_newton", "draft_newton"),
        ("vertical_newton", Wrench(share).force_z_newton),
    ):
        found[name] = np.interp(rows, tip, moving_mean(series, column, ROW_M / SPEED_M_PER_S))
    found["block_m"][:], found["period_m"][:] = repeats_m(run.scene)
    return found


def read(path: Path) -> dict[str, np.ndarray]:
    """Columns of a file of `pull`, or of a run."""
    if path.is_dir():
        return of_run(path)
    rows = np.genfromtxt(path, delimiter=",", names=True)
    return {name: rows[name] for name in COLUMNS}


def loosened_text(path: Path) -> str:
    """Loosened section [cm2] with its interval, where it is known."""
    if path.is_dir():
        found = read_run(path).summary.get("disturbance", {})
        if "area_half_width_m2" not in found:
            return "-"
        return f"{1e4 * found['area_m2']:.0f} +- {1e4 * found['area_half_width_m2']:.0f}"
    if not section_of(path).is_file():
        return "-"
    slices = np.genfromtxt(section_of(path), delimiter=",", names=True)
    along = stationarity(slices["x_m"], 1e4 * slices["area_m2"])
    return "-" if along is None else f"{along.mean:.0f} +- {along.mean_half_width:.0f}"


def judged(path: Path) -> tuple[str, bool]:
    """A row of the table, and whether all that was asked for holds."""
    found = read(path)
    tip, period = found["tip_x_m"], float(found["period_m"][0])
    counts = tip >= START_M
    if math.isnan(period):
        counts &= tip <= tip[-1] - LEAVE_M
    x, draft = tip[counts], found["draft_newton"][counts]
    steady, vertical = stationarity(x, draft), stationarity(x, found["vertical_newton"][counts])
    if steady is None or vertical is None:
        raise SystemExit(f"{path}: only {len(x)} rows from {START_M:g} m on; pull farther")
    told = [
        path.stem, f"{x[-1]:.2f}", f"{steady.mean:.0f} +- {steady.mean_half_width:.0f}",
        f"{vertical.mean:.0f} +- {vertical.mean_half_width:.0f}",
        loosened_text(path),
        f"{steady.drift:+.1%} +- {steady.drift_half_width:.1%}",
    ]  # fmt: skip
    good = abs(steady.drift) < TREND
    if math.isnan(period):
        return "| " + " | ".join([*told, "-", "-", "-"]) + " |", good
    block = float(found["block_m"][0])
    at_block, noise = correlation(draft, round(block / ROW_M), steady.length_over_correlation)
    repeats = f"{at_block:+.2f} +- {noise:.2f}"
    if len(draft) * ROW_M > 2.0 * period > 3.0 * block:
        again, noise = correlation(draft, round(period / ROW_M), 0.5 * steady.length_over_correlation)
        repeats += f"; {again:+.2f} +- {noise:.2f} at {period:.1f} m"
    good &= at_block < CORRELATION
    if path.is_dir():
        return "| " + " | ".join([*told, repeats, "-", "-"]) + " |", good
    early, late = thirds(tip, found["cpu_s"]), np.array_split(found["memory_bytes"][counts], 3)
    cost = early[1] / early[0] - 1.0
    memory = float(np.median(late[2]) / np.median(late[0])) - 1.0
    told += [repeats, f"{early[0]:.0f} s, {cost:+.1%}"]
    told.append(f"{np.median(late[0]) / 1e6:.0f} MB, {memory:+.1%}")
    good &= abs(cost) < COST and abs(memory) < MEMORY
    return "| " + " | ".join(told) + " |", good


def covered(path: Path, metres: float) -> tuple[str, bool]:
    """A row of the table of coverage, and whether it is within COVERED; a pull of five lengths is needed."""
    found = read(path)
    draft = found["draft_newton"][found["tip_x_m"] >= START_M]
    rows = round(metres / ROW_M)
    if len(draft) < 5 * rows:
        return f"| {path.stem} | {metres:g} | pull too short |", True
    starts = np.linspace(0, len(draft) - rows, STRETCHES).astype(int)
    judged = [stationarity(np.arange(rows) * ROW_M, draft[start : start + rows]) for start in starts]
    means = np.array([one.mean for one in judged if one is not None])
    half_widths = np.array([one.mean_half_width for one in judged if one is not None])
    part = float((np.abs(means - draft.mean()) <= half_widths).mean())
    of_mean = f"{np.median(half_widths) / draft.mean():.1%} | {means.std() / draft.mean():.1%}"
    return f"| {path.stem} | {metres:g} | {part:.1%} | {of_mean} |", COVERED[0] <= part <= COVERED[1]


def stopped(path: Path, relative: float) -> tuple[str, bool]:
    """The same of pulls that end with the first interval this narrow, if no drift is seen."""
    found = read(path)
    draft = found["draft_newton"][found["tip_x_m"] >= START_M]
    longest = round(LONGEST_M / ROW_M)
    held, metres = [], []
    for start in np.linspace(0, len(draft) - longest, STRETCHES // 2).astype(int):
        for rows in range(2 * LOOK_ROWS, longest, LOOK_ROWS):
            now = stationarity(np.arange(rows) * ROW_M, draft[start : start + rows])
            if now is None or now.verdict != "no drift seen":
                continue
            if now.mean_half_width <= relative * abs(now.mean):
                held.append(abs(now.mean - draft.mean()) <= now.mean_half_width)
                metres.append(rows * ROW_M)
                break
    part = float(np.mean(held))
    told = f"{part:.1%} | {np.median(metres):.2g} ({min(metres):.2g} to {max(metres):.2g})"
    return f"| {path.stem} | stopped at {relative:.0%} | {told} | |", COVERED[0] <= part <= COVERED[1]


def correlation(values: np.ndarray, lag: int, independent: float) -> tuple[float, float]:
    """Autocorrelation of (n,) values about their trend at a lag of rows, and its 95 % bound by chance."""
    rows = np.arange(len(values))
    about = values - np.polyval(np.polyfit(rows, values, 1), rows)
    if lag >= len(values):
        return math.nan, math.nan
    found = float(about[:-lag] @ about[lag:] / (len(values) - lag) / about.var())
    return found, 1.96 / math.sqrt(independent)


def thirds(tip_m: np.ndarray, cpu_s: np.ndarray) -> tuple[float, float]:
    """CPU time per metre in the first and the last third of the way from START_M on."""
    ends = np.linspace(START_M, tip_m[-1], 4)
    at = np.interp(ends, tip_m, cpu_s)
    per_metre = np.diff(at) / np.diff(ends)
    return float(per_metre[0]), float(per_metre[2])


def main() -> int:
    """Pulls a tine through a field, or judges such pulls. Returns 1 where something asked for is missed."""
    parser = argparse.ArgumentParser(prog="python -m validation.field", description=main.__doc__)
    parser.add_argument("part", choices=["pull", "table", "coverage", "echo"])
    parser.add_argument("files", type=Path, nargs="*", metavar="FILE.csv")
    parser.add_argument("--metres", type=float, nargs="+", help="to pull [m] (12), or of stretches (3 5 10)")
    for name, usual in (("radius-mm", 15.0), ("speed", SPEED_M_PER_S), ("width", 0.6), ("ends", 1.0)):
        parser.add_argument(f"--{name}", type=float, default=usual)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--sides", choices=["held", "periodic", "walls"], default="held")
    parser.add_argument("--bin", type=float, metavar="LENGTH")
    args = parser.parse_args()
    if args.part == "coverage":
        print("| pull | stretch m | intervals that hold the mean | half-width | scatter of means |")
        print("|---" * 5 + "|")
        rows = [covered(path, metres) for path in args.files for metres in args.metres or (3.0, 5.0, 10.0)]
        rows += [stopped(path, relative) for path in args.files for relative in STOP_AT]
        print("\n".join(text for text, _ in rows))
        return int(not all(good for _, good in rows))
    if args.part == "echo":
        echo(1e-3 * args.radius_mm)
        return 0
    args.files = [path for path in args.files if not path.stem.endswith("_section")]
    if not args.files:
        parser.error("FILE.csv: none given; name at least one")
    if args.part == "pull":
        pull(args)
        return 0
    columns = ["pull", "to m", "draft N", "vertical N", "loosened cm2"]
    columns += ["trend", "correlation", "CPU per metre", "memory"]
    print("| " + " | ".join(columns) + " |")
    print("|---" * 9 + "|")
    rows = [judged(path) for path in args.files]
    print("\n".join(text for text, _ in rows))
    return int(not all(good for _, good in rows))


if __name__ == "__main__":
    sys.exit(main())
