"""Steady self-excited cycle, or entry, drift and end of the bin? The paper's ranges, read both ways.

    python -m benchmarks.two_readings [--out DIR] [--case NAME ...] [--coarse RADIUS_M] [--threads N] [--list]

Runs the machine over a matrix of starts, depths, beds and friction limits, long enough for 6 s of steady
work, and judges each case: is the draft steady (drift test), does a rhythm stand out of red noise and how
slow is it, how far do spring, angle and height range inside the window and outside, where is the draft
negative. `--coarse 0.02`: particles of that radius in a narrow bin, wheels on plain ground; minutes a case.
Without it every case takes days. Finished runs are kept.
"""

import argparse
import csv
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.kept_runs import FailedRun, Summary, kept_run, write_scene
from subsoil_ros.analysis import paper
from subsoil_ros.analysis.levers import past_dead_centre_s
from subsoil_ros.analysis.machine_variants import at_depth, at_rest, coarse_soil, on_plain_ground
from subsoil_ros.errors import SubsoilError
from subsoil_ros.scene.loader import load_scene

SCENE = Path(__file__).parents[1] / "config" / "scenes" / "subsoiler_1s300.yaml"

STEADY_S = 6.0
"""Steady work in the window: six of the paper's periods."""

START_M = 0.2
"""Where the tip of a machine that is let down begins."""

ENTRY_M = 1.3
"""Way of the tip until the machine has settled at depth, from either start (chosen: end of lowering and 0.5
m)."""

INSIDE_M = 0.7
"""Before the end of the bin (prototypes: drafts rise from there on)."""

SLOW_HZ = (0.5, 2.5)
"""A rhythm of the paper's kind: periods of 0.4 to 2 s (chosen around 0.5 and 1 s)."""

RANGE_PART = 0.5
"""Of the printed range that a steady cycle must show to be that of the paper (chosen)."""


class Case(NamedTuple):
    """One cell of the matrix."""

    start: str
    depth_m: float
    bed: str
    friction: str

    @property
    def name(self) -> str:
        """For folders and tables."""
        return f"{self.start}_{1e3 * self.depth_m:.0f}mm_{self.bed}_{self.friction}"


def matrix() -> Iterator[Case]:
    """Every case. Limit `weakening`: as `total`, but what slides holds half (the one strength that falls
    with strain; none falls with speed)."""
    for start in ("lowered", "end_wall"):
        for friction in ("total", "repulsive", "absolute"):
            for depth in (0.18, 0.22, 0.26, 0.30):
                yield Case(start, depth, "grid", friction)
        for depth in (0.18, 0.30):
            yield Case(start, depth, "dense_random", "total")
            yield Case(start, depth, "dense_random", "absolute")
            yield Case(start, depth, "grid", "weakening")


def scene_of(case: Case, out: Path, coarse_radius_m: float | None) -> Path:
    """Scene file of a case; with a radius of its own in a narrow bin, wheels on plain ground."""
    first = load_scene(SCENE, [f"start={case.start}"])
    document = at_depth(first, case.depth_m, from_above=case.start == "lowered")
    speed = paper.SPEED_M_PER_S
    length = START_M + ENTRY_M + speed * STEADY_S + INSIDE_M
    soil = document["soil"]
    width = soil["bin"]["width_m"]
    if coarse_radius_m is not None:
        document = coarse_soil(on_plain_ground(document), coarse_radius_m, (length, 0.72, 0.4))
    else:
        soil["bin"].update(length_m=length, width_m=width)
    soil = document["soil"]
    law = soil["law"]
    law["friction_normal"] = "total" if case.friction == "weakening" else case.friction
    if case.friction == "weakening":
        for row in (law["particle"], law["boundary"]):
            row["sliding_friction"] = 0.5 * row["static_friction"]
    if case.bed == "dense_random":
        soil["bed"] = {"kind": "dense_random", "seed": 0}
    document["duration_s"] = (length - INSIDE_M + 0.4) / speed + 0.5
    document["record"] = {**document.get("record", {}), "cloud_hz": 2.0, "checkpoint_s": 0.0}
    document["report"].update(window_inside_m=INSIDE_M, settle_s=ENTRY_M / speed)
    document["name"] = case.name + ("_coarse" if coarse_radius_m is not None else "")
    path = write_scene(document, out / "scenes" / f"{document['name']}.yaml")
    if case.start == "lowered":
        write_scene(at_rest(document, load_scene(path)), path)
    return path


def judge(case: Case, scene: Path, summary: Summary) -> dict[str, Any]:
    """One row of the verdict table; `scene` is the file that the summary is of."""
    spring, angle, height = "spring.H9_spring.force_newton", "body.shank.angle_rad", "body.shank.z_m"

    def span(prefix: str, name: str) -> float:
        return float(summary[f"{prefix}{name}_10ms_max"] - summary[f"{prefix}{name}_10ms_min"])

    hertz = summary.get("spectrum.draft_newton_dominant_hz")
    rhythm = bool(
        summary.get("spectrum.draft_newton_significant")
        and hertz is not None
        and SLOW_HZ[0] <= hertz <= SLOW_HZ[1]
    )
    swing = paper.ANGLE_RAD[1] - paper.ANGLE_RAD[0]
    wide = span("", angle) >= RANGE_PART * swing
    row = {
        **case._asdict(),
        "draft_mean_newton": summary["draft_newton_mean"],
        "draft_half_width_newton": summary.get("steady.draft_newton_mean_half_width"),
        "drift": summary.get("steady.draft_newton_verdict", ""),
        "drift_over_window": summary.get("steady.draft_newton_drift"),
        "draft_min_newton": summary["draft_newton_10ms_min"],
        "draft_max_newton": summary["draft_newton_10ms_max"],
        "run_draft_min_newton": summary["run.draft_newton_10ms_min"],
        "run_draft_max_newton": summary["run.draft_newton_10ms_max"],
        "dominant_hz": hertz,
        "rhythm_like_the_papers": rhythm,
        "spring_range_newton": span("", spring),
        "run_spring_range_newton": span("run.", spring),
        "spring_min_newton": summary[f"{spring}_10ms_min"],
        "angle_range_rad": span("", angle),
        "run_angle_range_rad": span("run.", angle),
        "height_range_m": span("", height),
        "run_height_range_m": span("run.", height),
    }
    entry = row["run_draft_min_newton"] < 0.0 <= row["draft_min_newton"]
    low = row["run_height_range_m"] >= RANGE_PART * paper.HEIGHT_TRAVEL_M > row["height_range_m"]
    row["folded_s"] = past_dead_centre_s(load_scene(scene).scene, columns(Path(summary["folder"])))
    if row["folded_s"] is not None:
        row["verdict"] = "none: the soil folds the shank back"
    elif rhythm and wide:
        steady = row["drift"] == "no drift seen"
        row["verdict"] = "steady cycle" if steady else "cycle that does not stay"
    elif entry or low:
        row["verdict"] = "entry: printed extremes outside of the steady work only"
    else:
        row["verdict"] = "neither"
    return row


def columns(folder: Path) -> dict[str, np.ndarray]:
    """Of a kept run's series."""
    with (folder / "series.csv").open(newline="", encoding="utf-8") as stream:
        rows = csv.reader(stream)
        names = next(rows)
        return dict(zip(names, np.array([[float(cell) for cell in row] for row in rows]).T, strict=True))


def main() -> None:
    """Runs the cases that are asked for and writes the verdict table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs/two_readings"))
    parser.add_argument("--case", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--coarse", type=float, metavar="RADIUS_M", help="larger particles, a narrow bin")
    parser.add_argument("--list", action="store_true", help="print the cases and end")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    cases = [case for case in matrix() if not args.case or case.name in args.case]
    if args.list:
        print("\n".join(case.name for case in cases))
        return
    rows = []
    for case in cases:
        try:
            path = scene_of(case, args.out, args.coarse)
            rows.append(judge(case, path, kept_run(path, args.out / "runs", (), args.threads)))
        except (FailedRun, SubsoilError) as error:
            print(f"{case.name}: {error}", file=sys.stderr, flush=True)
            continue
        print(json.dumps(rows[-1]), flush=True)
    if not rows:
        raise SystemExit("no case ended well")
    (args.out / "two_readings.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    with (args.out / "two_readings.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
