"""Tables of cycle.md from the runs of cycle_runs.py.

    python -m reproduction.yuan_yu_2020.cycle [--out DIR] [--results DIR]

Takes the runs that are finished, starts none. Leaves in --results (results/cycle beside this file):

cases.csv       one row for each run: draft, swing, cycles, spectrum, residual, overlaps
cases.md        the same for reading, one row for each case; intervals of 95 % from the scatter between seeds
thresholds.csv  travel between failures by the prominence that counts as one
frequency.csv   sprung shank against the locked one's record passed through the linear shank
saving.json     sprung less locked draft, bed by bed
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.run_cache import write_rows
from subsoil_ros.analysis.failure_cycles import SMOOTHED_S
from subsoil_ros.analysis.intervals import t_quantile
from subsoil_ros.analysis.run_statistics import MOVING_S
from subsoil_ros.analysis.window import tip_path_m
from subsoil_ros.recording.joined import open_record

from . import RESULTS
from .cycle_frequency import frequency_rows
from .cycle_record import ANGLE, QUANTILES, SPRING, Run, Values, quantile_range
from .cycle_runs import cases, find_case
from .paired import paired_difference

THRESHOLDS = (0.5, 1.0, 1.5)
"""Prominence of a failure in standard deviations."""

IN_WORK_M, AT_TIP_M = 0.25, 0.05
"""Contacts this near to the tip are in work, or the most loaded ones (chosen: a rupture distance of 0.18 m
of depth and more; the width of the share)."""


def overlaps(run: Run) -> dict[str, float]:
    """99 % quantile of the overlap over the radius, of the contacts in work and of those at the tip."""
    soil = run.scene.scene.particle_soil
    path = tip_path_m(run.series, run.scene.scene)
    assert soil is not None
    assert path is not None
    radius, times = soil.particles.mean_volume_radius_m, run.series["time_s"]
    first, last = times[run.rows][[0, -1]]
    found: dict[float, list[Values]] = {IN_WORK_M: [], AT_TIP_M: []}
    for cloud in open_record(run.folder / "bag").clouds(run.scene.timing.communication_step_ns):
        now = cloud.end_time_ns * 1e-9
        if not first <= now <= last:
            continue
        tip = [np.interp(now, times, path[0]), 0.0, np.interp(now, times, path[1])]
        positions = np.asarray(cloud.positions_m, np.float64)
        for reach, values in found.items():
            near = positions[((positions - tip) ** 2).sum(axis=1) < reach**2]
            pairs = cKDTree(near).query_pairs(2.0 * radius, output_type="ndarray")
            values.append(2.0 * radius - np.linalg.norm(near[pairs[:, 0]] - near[pairs[:, 1]], axis=1))
    in_work, at_tip = (np.quantile(np.concatenate(values), 0.99) / radius for values in found.values())
    largest = run.series["soil.max_overlap_m"][run.rows] / radius
    return {
        "overlap_in_work_99_percent": float(in_work),
        "overlap_at_tip_99_percent": float(at_tip),
        "max_overlap_mean": float(largest.mean()),
        "max_overlap": float(largest.max()),
        "max_tool_overlap": float(run.series["soil.max_tool_overlap_m"][run.rows].max()) / radius,
    }


def case_row(run: Run) -> dict[str, Any]:
    """One row of cases.csv."""
    draft = run.column("draft_newton", MOVING_S)
    cycles = run.cycles(1.0)
    frequency, density = run.periodogram(run.series["draft_newton"][run.rows])
    low, high = np.quantile(draft, QUANTILES)
    path = tip_path_m(run.series, run.scene.scene)
    assert path is not None
    row: dict[str, Any] = {
        "case": run.case.name,
        "seed": run.case.seed,
        "particles": run.summary["particles.count"],
        "draft_mean_newton": run.draft_mean_newton,
        "draft_deviation_newton": float(run.column("draft_newton", SMOOTHED_S).std()),
        "draft_1_percent_newton": float(low),
        "draft_99_percent_newton": float(high),
        "soil_lifts_share_newton": float(run.series["tool.shank.force_z_newton"][run.rows].mean()),
    }
    for name, column in (("angle_rad", ANGLE), ("spring_newton", SPRING)):
        held = run.case.locked or column not in run.series
        values = None if held else run.column(column, MOVING_S)
        row[f"{name}_range"] = None if values is None else float(np.ptp(values))
        row[f"{name}_98_percent_range"] = None if values is None else quantile_range(values)
        row[f"{name}_least"] = None if values is None else float(values.min())
    return row | {
        "cycles": cycles.count if cycles else 0,
        "travel_m": cycles.travel.mean if cycles else None,
        "travel_deviation_m": float(cycles.travel_m.std(ddof=1)) if cycles else None,
        "time_s": float(cycles.time_s.mean()) if cycles else None,
        "loading_fraction": cycles.loading_fraction if cycles else None,
        "unloading_over_loading": cycles.unloading_over_loading if cycles else None,
        "strongest_hz": float(frequency[1 + np.argmax(density[1:])]),
        "resolution_hz": float(frequency[1]),
        "tip_depth_m": -float(path[1][run.rows].mean()),
        "residual_ratio": run.summary["energy.residual_ratio"],
        **overlaps(run),
        "wall_s": run.summary["run.wall_s"],
        "scene_hash": run.summary["scene.hash"],
    }


def pooled_scatter(rows: Sequence[dict[str, Any]], key: str) -> tuple[float, int]:
    """Standard deviation of a quantity between seeds over its mean, of all cases with several, and its
    degrees of freedom."""
    squares, freedoms = 0.0, 0
    for group in _by_case(rows).values():
        values = np.array([row[key] for row in group if row[key] is not None])
        if len(values) > 1:
            squares += float((((values - values.mean()) / values.mean()) ** 2).sum())
            freedoms += len(values) - 1
    return (float(np.sqrt(squares / freedoms)), freedoms) if freedoms else (np.nan, 0)


def _by_case(rows: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(row["case"], []).append(row)
    return groups


def case_table(rows: Sequence[dict[str, Any]]) -> str:
    """cases.md: means over the seeds of a case, with what the scatter of seeds leaves open."""
    heads = (
        "case", "runs", "draft [N]", "1 %, 99 % [N]", "deviation [N]", "angle [rad]", "spring [kN]",
        "travel between failures [mm]", "loading", "unloading rate", "strongest [Hz]", "depth [mm]",
        "soil lifts share [N]", "residual",
        "overlap: 99 % in work, at the tip; largest",
    )  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for case, group in _by_case(rows).items():

        def mean(key: str, group: Sequence[dict[str, Any]] = group) -> float:
            values = [row[key] for row in group if row[key] is not None]
            return float(np.mean(values)) if values else np.nan

        def interval(key: str, scale: float, digits: int, group: Sequence[dict[str, Any]] = group) -> str:
            scatter, freedoms = pooled_scatter(rows, key)
            half = t_quantile(freedoms) * scatter / np.sqrt(len(group))
            return f"{scale * mean(key):.{digits}f} +- {scale * abs(mean(key)) * half:.{digits}f}"

        swings = not np.isnan(mean("angle_rad_range"))
        cells = (
            case,
            str(len(group)),
            interval("draft_mean_newton", 1.0, 0),
            f"{mean('draft_1_percent_newton'):.0f}, {mean('draft_99_percent_newton'):.0f}",
            interval("draft_deviation_newton", 1.0, 0),
            interval("angle_rad_98_percent_range", 1.0, 3) if swings else "",
            interval("spring_newton_98_percent_range", 1e-3, 1) if swings else "",
            f"{interval('travel_m', 1e3, 0)} ({sum(row['cycles'] for row in group)})",
            f"{mean('loading_fraction'):.2f}",
            f"{mean('unloading_over_loading'):.1f}",
            f"{mean('strongest_hz'):.1f}",
            f"{1e3 * mean('tip_depth_m'):.0f}",
            f"{mean('soil_lifts_share_newton'):.0f}",
            f"{mean('residual_ratio'):.0e}",
            f"{100.0 * mean('overlap_in_work_99_percent'):.1f}, "
            f"{100.0 * mean('overlap_at_tip_99_percent'):.0f}; {100.0 * mean('max_overlap'):.0f} %",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def threshold_rows(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Rows of thresholds.csv."""
    rows = []
    for run in runs:
        for threshold in THRESHOLDS:
            found = run.cycles(threshold)
            rows.append(
                {
                    "case": run.case.name,
                    "seed": run.case.seed,
                    "threshold_deviations": threshold,
                    "threshold_newton": found.threshold_newton if found else None,
                    "cycles": found.count if found else 0,
                    "travel_m": found.travel.mean if found else None,
                    "travel_deviation_m": float(found.travel_m.std(ddof=1)) if found else None,
                    "loading_fraction": found.loading_fraction if found else None,
                }
            )
    return rows


def main() -> None:
    """Write the tables of all finished runs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs/cycle"), help="where the runs are")
    parser.add_argument("--results", type=Path, default=RESULTS / "cycle")
    args = parser.parse_args()
    runs = []
    for case in cases():
        summary = find_case(case, args.out)
        if summary is None:
            print(f"{case.key}: not run")
        else:
            runs.append(Run(case, summary))
    args.results.mkdir(parents=True, exist_ok=True)
    table = [case_row(run) for run in runs]
    write_rows(args.results / "cases.csv", table)
    (args.results / "cases.md").write_text(case_table(table), encoding="utf-8")
    write_rows(args.results / "thresholds.csv", threshold_rows(runs))
    sprung = {run.case.seed: run for run in runs if run.case.name == "as declared"}
    locked = {run.case.seed: run for run in runs if run.case.locked}
    seeds = sorted(sprung.keys() & locked.keys())
    rows = frequency_rows([sprung[seed] for seed in seeds], [locked[seed] for seed in seeds])
    columns = dict.fromkeys(key for row in rows for key in row)
    write_rows(args.results / "frequency.csv", [columns | row for row in rows])
    saving = paired_difference(
        *([runs[seed].draft_mean_newton for seed in seeds] for runs in (sprung, locked))
    )
    text = json.dumps({"seeds": seeds, **asdict(saving)}, indent=1)
    (args.results / "saving.json").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
