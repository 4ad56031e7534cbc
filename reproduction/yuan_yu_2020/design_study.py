"""Study of springs that save draft, and of whether vibration causes the saving.

    python -m reproduction.yuan_yu_2020.design_study \
        [--stage springs depth angles exchange particles] [--out DIR]

On the wedge model (seconds a run), with `subsoil sweep` where it can, three seeds each:

springs   stiffness, preload (as the spring's length without force) and damping, every combination, against
          the shank locked in its nominal place
depth     depth and speed of the declared machine, against the same
angles    the shank locked at other angles: the draft of a share that does not move on its spring
exchange  the declared and the recommended spring with shorter and longer exchange, against the shank locked
          at their own mean angles: a saving counts only if it persists
particles the same comparison with 5,600 particles of r = 25 mm (draft_saving.py), with shorter steps
          and longer exchange. The spring is so long that the share works upright: pushed back, it makes the
          grid change into a denser state at some time, and beds differ by a third

A spring also sets the angle at which the share works, and that alone changes the draft. design_study.png and
springs_at_own_angle.csv therefore compare every spring with the locked shank at its own mean angle, seed by
seed.
"""

import argparse
import math
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.run_cache import FailedRun, Summary, kept_run, read_rows, write_rows, write_scene
from subsoil_ros.analysis.intervals import Interval, mean_interval
from subsoil_ros.analysis.summary import MEAN_DRAFT
from subsoil_ros.figures.plotting import COLOURS, new_figure, save_figure
from subsoil_ros.loading.loader import load_scene

from . import SCENES
from .draft_saving import mean_angle_rad, run_seed
from .fit_machine import COARSE_BIN_M
from .machine_variants import (
    at_depth,
    at_rest,
    coarse_soil,
    locked_shank,
    on_plain_ground,
)

SCENE, PARTICLES = SCENES / "subsoiler_1s300_wedge.yaml", SCENES / "subsoiler_1s300.yaml"
SPRING = "mechanism.forces.H9_spring"
SPEED = "mechanism.joints.H10_drive.speed"
LOCKED = (f"{SPRING}.locked=true", "mechanism.initial.coordinates.shank.angle_rad=null")

STIFFNESS = (0.9e5, 1.3e5, 1.765e5, 2.5e5, 5.0e5)
"""[N/m], half to three times the declared one."""

FREE_LENGTH_M = (0.37235, 0.38735, 0.40235, 0.41735)
"""The declared one and 15 mm to each side, 30 mm for more preload: the lug is 0.40 m from the frame's."""

DAMPING = (200.0, 1000.0, 3000.0)
"""[N s/m], the range of the fit."""

DEPTHS_M = (0.18, 0.22, 0.26, 0.30)
SPEEDS = (0.3, 0.5, 0.8)
ANGLES_RAD = tuple(round(-0.50 + 0.05 * i, 2) for i in range(13))
INTERVALS_NS = (125_000, 250_000, 500_000, 1_000_000, 2_000_000)

UPRIGHT_FREE_LENGTH_M = 0.433
"""5.8 kN at 33 mm of the declared spring: what 2350 N on the share ask, and then the shank is upright."""

COARSE_RADIUS_M = 0.025
_MEAN = ("soil.time_step_s=auto", "coupling.force=tick_mean")
ON_PARTICLES = {
    "as declared: every step of 80 us": (),
    "every step of 40 us": ("soil.time_step_s=4e-5", "record.series_ticks=40"),
    "exchange of 1.6 ms": (*_MEAN, "coupling.communication_step_ns=1600000", "record.series_ticks=1"),
    "exchange of 0.4 ms": (*_MEAN, "coupling.communication_step_ns=400000", "record.series_ticks=4"),
}
"""Coarser and finer exchange and step."""

UNBOUND = ("coupling.residual_bound=1e9",)
"""Lets a run go on whose exchange makes energy, to see what it would have shown."""

Changes = tuple[str, ...]
Pair = tuple[float, float]
"""Mean draft of the sprung and of the locked machine [N]."""


def sweep(scene: Path, out: Path, words: list[str], args: argparse.Namespace) -> Path:
    """Runs `subsoil sweep`; its folder."""
    command = [sys.executable, "-m", "subsoil_ros.cli.main", "sweep", str(scene), "--out", str(out), *words]
    command += ["--seeds", args.seeds, *(["--workers", str(args.workers)] if args.workers else [])]
    for control in LOCKED:
        command += ["--control", control]
    print("subsoil " + " ".join(command[3:]), flush=True)
    subprocess.run(command, check=True)
    return out


def springs(args: argparse.Namespace) -> None:
    """Every spring."""
    values = {"stiffness_newton_per_m": STIFFNESS, "free_length_m": FREE_LENGTH_M,
              "damping_newton_s_per_m": DAMPING}  # fmt: skip
    words = []
    for key, given in values.items():
        words += ["--vary", f"{SPRING}.{key}={','.join(map(str, given))}"]
    sweep(SCENE, args.out / "springs", words, args)


def depth(args: argparse.Namespace) -> None:
    """The declared machine, mounted for every depth and drawn at every speed: the same way in each."""
    first = load_scene(SCENE)
    still_s = 0.45  # the trolley stands while the wheels settle
    way_m = 0.5 * (first.scene.duration_s - 0.1 - still_s)  # the wheels must not leave the bin
    laws = ",".join(
        f"{{kind: table, times_s: [0.0, 0.4, 0.5], values: [0.0, 0.0, {speed}]}}" for speed in SPEEDS
    )
    times = ",".join(f"{still_s + way_m / speed:.3f}" for speed in SPEEDS)
    for depth_m in DEPTHS_M:
        document = at_depth(first, depth_m)
        path = write_scene(document, args.out / "scenes" / f"{document['name']}.yaml")
        write_scene(at_rest(document, load_scene(path)), path)
        words = ["--pair", f"{SPEED}={laws}", "--pair", f"duration_s={times}"]
        sweep(path, args.out / f"depth_{1e3 * depth_m:.0f}mm", words, args)


def locked_at(angle_rad: float, seed: int, out: Path, overrides: tuple[str, ...] = ()) -> Summary:
    """A run of the shank locked at an angle against the frame, on the soil of a seed."""
    first = load_scene(SCENE, [f"soil.seed={seed}", *overrides])
    path = write_scene(locked_shank(first, angle_rad), out / "scenes" / f"locked_{angle_rad:.6f}_{seed}.yaml")
    return kept_run(path, out / "runs")


def angles(args: argparse.Namespace) -> None:
    """Draft over the angle of a locked shank."""
    rows = []
    for angle in ANGLES_RAD:
        for seed in map(int, args.seeds.split(",")):
            found = locked_at(angle, seed, args.out)
            rows.append(
                {
                    "angle_rad": angle,
                    "seed": seed,
                    "draft_newton": found[MEAN_DRAFT],
                    "tip_depth_m": found["loads.tip_depth_m.mean"],
                }
            )
    write_rows(args.out / "angles.csv", rows)


def exchange(args: argparse.Namespace) -> None:
    """What two springs save, over the interval of the exchange."""
    seeds = [int(seed) for seed in args.seeds.split(",")]
    rows = []
    for name, spring in (("declared", {}), ("recommended", recommended(args.out))):
        changes = tuple(f"{key}={value}" for key, value in spring.items())
        for communication_step_ns in INTERVALS_NS:
            series = max(1, 10_000_000 // communication_step_ns)
            timing = (
                f"coupling.communication_step_ns={communication_step_ns}",
                f"record.series_ticks={series}",
            )

            def pair(
                seed: int, more: tuple[str, ...], timing: Changes = timing, changes: Changes = changes
            ) -> Pair:
                given = (f"soil.seed={seed}", *timing, *changes, *more)
                sprung = kept_run(SCENE, args.out / "runs", given)
                angle = mean_angle_rad(sprung, load_scene(SCENE, given))
                locked = locked_at(angle, seed, args.out, (*timing, *more))
                return sprung[MEAN_DRAFT], locked[MEAN_DRAFT]

            rows += judged({"spring": name, "interval_s": 1e-9 * communication_step_ns}, pair, seeds)
    write_rows(args.out / "exchange.csv", rows)


def particles(args: argparse.Namespace) -> None:
    """What the declared spring saves on coarse particles, over exchange and step."""
    seeds = [int(seed) for seed in args.seeds.split(",")]
    document = at_depth(load_scene(PARTICLES, ["initial_condition=lowered"]), DEPTHS_M[-1], from_above=True)
    document = coarse_soil(on_plain_ground(document), COARSE_RADIUS_M, COARSE_BIN_M)
    document["mechanism"]["forces"]["H9_spring"]["free_length_m"] = UPRIGHT_FREE_LENGTH_M
    path = write_scene(document, args.out / "scenes" / "particles.yaml")
    write_scene(at_rest(document, load_scene(path)), path)
    rows = []
    for name, changes in ON_PARTICLES.items():

        def pair(seed: int, more: tuple[str, ...], changes: Changes = changes) -> Pair:
            found = run_seed(path, [*changes, *more], seed, args.out / "particles", threads=1)
            drafts = {name: one[MEAN_DRAFT] for name, one in found.items()}
            return drafts["sprung"], drafts["locked, mean angle"]

        rows += judged({"exchange": name}, pair, seeds)
    write_rows(args.out / "particles.csv", rows)


def judged(
    what: dict[str, Any], pair: Callable[[int, tuple[str, ...]], Pair], seeds: Sequence[int]
) -> list[dict[str, Any]]:
    """Rows of what is saved; where the residual stops a run, one that says so, and one without that bound."""
    rows = []
    for bound, more in (("on", ()), ("off", UNBOUND)):
        row = {
            **what,
            "residual_bound": bound,
            "draft_newton": "",
            "saving": "",
            "half_width": "",
            "ended": "",
        }
        try:
            drafts = np.array([pair(seed, more) for seed in seeds])
        except FailedRun as error:
            row["ended"] = str(error).splitlines()[-1].split(";")[0].partition("subsoil run: ")[2]
        else:
            saving = mean_interval(1.0 - drafts[:, 0] / drafts[:, 1])
            row |= {"draft_newton": float(drafts[:, 0].mean()), "saving": saving.mean,
                    "half_width": saving.half_width}  # fmt: skip
        rows.append(row)
        print(row, flush=True)
        if not row["ended"]:
            break
    return rows


def recommended(out: Path) -> dict[str, float]:
    """Keys and values of the spring that the ranking recommends.

    Raises:
        SystemExit: it recommends none: no spring saves beyond the scatter of the seeds.
    """
    rows = read_rows(out / "springs" / "ranking.csv")
    best = next((row for row in rows if row["recommended"] == "True"), None)
    if best is None:
        raise SystemExit(f"{out}/springs/ranking.csv recommends no spring, so there is none to refine")
    return {key: float(value) for key, value in best.items() if key.startswith(SPRING)}


def at_own_angle(out: Path) -> list[dict[str, Any]]:
    """Every spring of the sweep beside the locked shank at the same mean angle, seed by seed."""
    locked: dict[int, list[tuple[float, float]]] = defaultdict(list)
    for row in read_rows(out / "angles.csv"):
        locked[int(row["seed"])].append((float(row["angle_rad"]), float(row["draft_newton"])))
    resolved = load_scene(SCENE)
    found: dict[tuple[float, ...], list[tuple[float, float, float]]] = defaultdict(list)
    for row in read_rows(out / "springs" / "sweep.csv"):
        if row["failure"] or row[f"{SPRING}.stiffness_newton_per_m"] == "":
            continue
        spring = tuple(float(row[key]) for key in row if key.startswith(SPRING))
        angle = mean_angle_rad(row, resolved)
        at, drafts = np.array(sorted(locked[int(row["seed"])])).T
        draft = float(row[MEAN_DRAFT])
        found[spring].append((angle, draft, float(np.interp(angle, at, drafts, math.nan, math.nan))))
    rows = []
    for spring, runs in found.items():
        saving: Interval = mean_interval([1.0 - draft / other for _, draft, other in runs])
        rows.append(
            {
                "stiffness_newton_per_m": spring[0],
                "free_length_m": spring[1],
                "damping_newton_s_per_m": spring[2],
                "mean_angle_rad": float(np.mean([run[0] for run in runs])),
                "draft_newton": float(np.mean([run[1] for run in runs])),
                "locked_there_newton": float(np.mean([run[2] for run in runs])),
                "saving": saving.mean,
                "saving_half_width": saving.half_width,
            }
        )
    return rows


def draw(rows: list[dict[str, Any]], out: Path) -> Path:
    """Draft over mean angle: springs, and the line of locked shanks."""
    figure = new_figure(9.0, 5.2)
    axes = figure.subplots()
    by_angle: dict[float, list[float]] = defaultdict(list)
    for row in read_rows(out / "angles.csv"):
        by_angle[float(row["angle_rad"])].append(float(row["draft_newton"]))
    at = sorted(by_angle)
    axes.plot(at, [np.mean(by_angle[a]) for a in at], "-", color=COLOURS["reference"], label="locked")
    for k, marker in zip(STIFFNESS, "vos^D", strict=True):
        shown = [row for row in rows if row["stiffness_newton_per_m"] == k]
        axes.plot(
            [row["mean_angle_rad"] for row in shown], [row["draft_newton"] for row in shown], marker, ms=5,
            label=f"{1e-3 * k:g} kN/m",
        )  # fmt: skip
    axes.set_xlabel("mean angle of the shank against the frame [rad]; less: share pushed back, steeper")
    axes.set_ylabel("mean draft [N]")
    axes.grid(alpha=0.3)
    axes.legend()
    return save_figure(figure, out / "design_study.png")


STAGES = {"springs": springs, "depth": depth, "angles": angles, "exchange": exchange, "particles": particles}


def main() -> None:
    """Runs the stages that are asked for, then compares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--stage", nargs="+", choices=STAGES, default=list(STAGES))
    parser.add_argument("--out", type=Path, default=Path("runs/design_study"))
    parser.add_argument("--seeds", default="0,1,2")
    parser.add_argument("--workers", type=int, help="of `subsoil sweep`")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.stage:
        STAGES[name](args)
    if (args.out / "angles.csv").is_file() and (args.out / "springs" / "sweep.csv").is_file():
        rows = at_own_angle(args.out)
        write_rows(args.out / "springs_at_own_angle.csv", rows)
        print(draw(rows, args.out))


if __name__ == "__main__":
    main()
