"""The paper's ranges under two readings: a steady self-excited cycle, or entry, drift and end of the bin.

    python -m reproduction.yuan_yu_2020.two_readings \
        [--out DIR] [--case NAME ...] [--coarse RADIUS_M] [--threads N] [--list]

Runs the machine over a matrix of starts, depths, beds and friction limits, long enough for 6 s of steady
work, and judges each case: whether the draft is steady (drift test), whether it is periodic and with which
period, the ranges of spring, angle and height inside the window and outside, and where the draft is negative.
`--coarse 0.02`: particles of that radius in a narrow bin, wheels on plain ground; minutes a case. Without it
every case takes days. Finished runs are kept.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.run_cache import FailedRun, Summary, kept_run, write_rows, write_scene
from subsoil_ros.analysis.columns import DRAFT, TIME, Body, spring_element
from subsoil_ros.analysis.dead_centre import past_dead_centre_s
from subsoil_ros.analysis.series import read_series_csv
from subsoil_ros.analysis.summarize import MOVING
from subsoil_ros.analysis.summary import MEAN_DRAFT, path_of
from subsoil_ros.errors import SubsoilError
from subsoil_ros.loading.loader import load_scene

from . import SCENES, printed
from .machine_variants import at_depth, at_rest, coarse_soil, on_plain_ground

SCENE = SCENES / "subsoiler_1s300.yaml"

STEADY_S = 6.0
"""Steady work in the window: six of the paper's periods."""

START_M = 0.2
"""Where the tip of a machine that is let down begins."""

ENTRY_M = 1.3
"""Way of the tip until the machine has settled at depth, from either start (chosen: end of lowering and 0.5
m)."""

INSIDE_M = 0.7
"""Before the end of the bin (prototypes: drafts rise from there on)."""

PERIODS_S = (0.4, 2.0)
"""Of a cycle of the paper's kind (chosen around 0.5 and 1 s)."""

REGULAR = 0.5
"""Correlation of the draft with itself a period later from which it is periodic (chosen: a sine has 1, 40
records of red noise with correlation times of 0.01 to 0.2 s had up to 0.5)."""

RANGE_PART = 0.5
"""Part of a printed range from which a swing counts as the paper's; a smaller one counts as quiet."""

SPRING, ANGLE, HEIGHT = spring_element("H9_spring").load, Body("shank").angle_rad, Body("shank").z_m


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
    first = load_scene(SCENE, [f"initial_condition={case.start}"])
    document = at_depth(first, case.depth_m, from_above=case.start == "lowered")
    speed = printed.SPEED_M_PER_S
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

    def moving(name: str, measure: str, part: str = "") -> float:
        return float(summary[f"series.{name}{part}.{MOVING}.{measure}"])

    series = read_series_csv(Path(summary["folder"]) / "series.csv")
    times = series[TIME]
    inside = (times >= summary["window.start_s"]) & (times <= summary["window.end_s"])
    period_s, regularity = repeat_period(times[inside], series[DRAFT][inside])
    steady = path_of(DRAFT, "stationarity")
    row = {
        **case._asdict(),
        "draft_mean_newton": summary[MEAN_DRAFT],
        "draft_half_width_newton": summary.get(f"{steady}.mean_half_width"),
        "drift": summary.get(f"{steady}.verdict", ""),
        "drift_over_window": summary.get(f"{steady}.drift"),
        "draft_min_newton": moving(DRAFT, "min"),
        "draft_max_newton": moving(DRAFT, "max"),
        "run_draft_min_newton": moving(DRAFT, "min", ".run"),
        "run_draft_max_newton": moving(DRAFT, "max", ".run"),
        "period_s": period_s,
        "regularity": regularity,
        "spring_range_newton": moving(SPRING, "range"),
        "run_spring_range_newton": moving(SPRING, "range", ".run"),
        "spring_min_newton": moving(SPRING, "min"),
        "angle_range_rad": moving(ANGLE, "range"),
        "run_angle_range_rad": moving(ANGLE, "range", ".run"),
        "height_range_m": moving(HEIGHT, "range"),
        "run_height_range_m": moving(HEIGHT, "range", ".run"),
        "folded_s": past_dead_centre_s(load_scene(scene).scene, series.columns),
        "scene_hash": summary["scene.hash"],
    }
    swing = printed.ANGLE_RANGE_RAD
    if row["folded_s"] is not None:
        row["work"] = "the soil folds the shank back"
    elif row["angle_range_rad"] < RANGE_PART * swing:
        row["work"] = "quiet"
    elif regularity < REGULAR:
        row["work"] = "swings without a period"
    elif not PERIODS_S[0] <= period_s <= PERIODS_S[1]:
        row["work"] = f"cycle of {period_s:.2f} s"
    else:
        row["work"] = "steady cycle" if row["drift"] == "no drift seen" else "cycle that does not stay"
    only_outside = {
        "negative draft": row["run_draft_min_newton"] < 0.0 <= row["draft_min_newton"],
        "height": row["run_height_range_m"] >= RANGE_PART * printed.HEIGHT_RANGE_M > row["height_range_m"],
    }
    row["outside_of_it_only"] = ", ".join(name for name, found in only_outside.items() if found)
    return row


def repeat_period(times_s: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Lag of the first high peak of the autocorrelation after its first zero [s], and its height.

    High: nine tenths of the highest. About the trend; each lag divided by the number of its products. The
    longest lag is a third of the record.
    """
    count = len(values)
    about = values - np.polyval(np.polyfit(times_s, values, 1), times_s)
    spectrum = np.fft.rfft(about, 2 * count)
    products = np.fft.irfft(spectrum * spectrum.conj())[: count // 3] / np.arange(
        count, count - count // 3, -1
    )
    correlation = products / products[0]
    below = np.flatnonzero(correlation < 0.0)
    if len(below) == 0:
        return 0.0, 0.0
    later = correlation[below[0] :]
    high = np.flatnonzero(later[:-1] >= 0.9 * later.max())  # first of them, then up to its top
    first = int(high[0]) if len(high) and later.max() > 0.0 else int(np.argmax(later))
    while first + 1 < len(later) and later[first + 1] > later[first]:
        first += 1
    best = int(below[0]) + first
    return best * float(times_s[1] - times_s[0]), float(correlation[best])


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
    write_rows(args.out / "two_readings.csv", rows)


if __name__ == "__main__":
    main()
