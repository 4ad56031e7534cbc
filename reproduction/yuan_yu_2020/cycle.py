"""Tables of cycle.md from the runs of cycle_runs.py.

    python -m reproduction.yuan_yu_2020.cycle [--out DIR] [--results DIR]

Reads finished runs, starts none. Writes to --results (results/cycle beside this file):

cases.csv       one row for each run: draft, swing, cycles, spectrum, residual, overlap
cases.md        the same for reading; intervals are of 95 %
phases.md       when spring, angle, height and the soil's own force follow the draft
thresholds.csv  travel between failures by the prominence that counts as one
frequency.csv   sprung shank against the locked one's record passed through the linear shank
saving.json     locked less sprung draft, field by field, for each soil with two fields or more
cycle.png       draft over two metres, its spectra over time and travel, travel between failures
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import detrend

from benchmarks.run_cache import write_rows
from subsoil_ros.analysis.columns import DRAFT, Body, Wrench
from subsoil_ros.analysis.failure_cycles import SMOOTHED_S
from subsoil_ros.analysis.series import step_s
from subsoil_ros.analysis.spectra import spectrum
from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.analysis.summarize import MOVING_S

from . import RESULTS
from .cycle_frequency import frequency_rows
from .cycle_record import ANGLE, QUANTILES, SPRING, Run, Values, quantile_range
from .cycle_runs import LONG_S, cases, find_case
from .paired import paired_difference
from .ship_results import ship_picture

THRESHOLDS = (0.5, 1.0, 1.5)
"""Prominence of a failure in standard deviations."""

LOCKED = {
    "loam": "locked",
    "brittle loam": "brittle locked",
    "loose sandy loam": "loose sandy loam locked",
    "dense sandy loam": "dense sandy loam locked",
}
"""Soils that both machines were drawn through, sprung and with the shank held: their cases."""

PAIRED_M = 10.5
"""End of the travel in which sprung and locked are compared, on the same places of a field."""


def of_mean(values: Values) -> dict[str, float]:
    """Mean and deviation about the trend of (n,) values, with half-widths."""
    found = stationarity(np.arange(len(values), dtype=np.float64), values)
    assert found is not None
    return {
        "mean_newton": found.mean,
        "mean_half_width_newton": found.mean_half_width,
        "deviation_newton": found.deviation,
        "deviation_half_width_newton": found.deviation_half_width,
        "drift": found.drift,
        "drift_half_width": found.drift_half_width,
    }


def unbalanced_newton(run: Run) -> float:
    """Root mean square [N] of what is left of the driver's force after the soil's on the shank and the sum of
    mass times acceleration along x: the wheels' friction."""
    mechanism, series = run.scene.scene.mechanism, run.series
    assert mechanism is not None
    left = series[DRAFT] + series[Wrench("shank").force_x_newton]
    for name, body in mechanism.bodies.items():
        left = left - body.mass_kg * series[Body(name).acceleration_x_m_per_s2]
    return float(np.sqrt((left[run.rows] ** 2).mean()))


def case_row(run: Run) -> dict[str, Any]:
    """One row of cases.csv."""
    draft = run.column(DRAFT, MOVING_S)
    cycles = run.cycles(1.0)
    over_time = spectrum(step_s(run.series), run.series[DRAFT][run.rows])
    metres, laid = run.over_travel(run.column(DRAFT, SMOOTHED_S))
    over_travel = spectrum(metres, laid)
    assert over_time is not None
    assert over_travel is not None
    low, high = np.quantile(draft, QUANTILES)
    row: dict[str, Any] = {
        "case": run.case.name,
        "seed": run.case.seed,
        "particles": run.summary["particles.count"],
        "travel_counted_m": float(np.ptp(run.tip_m[0][run.rows])),
        **{f"draft_{key}": value for key, value in of_mean(run.column(DRAFT, SMOOTHED_S)).items()},
        "draft_1_percent_newton": float(low),
        "draft_99_percent_newton": float(high),
        "draft_least_newton": float(draft.min()),
        "soil_lifts_share_newton": float(run.series[Wrench("shank").force_z_newton][run.rows].mean()),
        "unbalanced_newton": unbalanced_newton(run),
    }
    held = run.case.locked
    angle, spring = (None if held else run.column(name, MOVING_S) for name in (ANGLE, SPRING))
    row |= {
        "angle_mean_rad": None if angle is None else float(angle.mean()),
        "angle_rad_range": None if angle is None else float(np.ptp(angle)),
        "angle_rad_98_percent_range": None if angle is None else quantile_range(angle),
        "spring_mean_newton": None if spring is None else float(spring.mean()),
        "spring_newton_98_percent_range": None if spring is None else quantile_range(spring),
        "spring_least_newton": None if spring is None else float(spring.min()),
        "spring_largest_newton": None if spring is None else float(spring.max()),
    }
    soil = run.scene.scene.particle_soil
    assert soil is not None
    overlap = run.series["soil.max_overlap_m"][run.rows] / soil.particles.mean_volume_radius_m
    loads = np.diff(run.column(DRAFT, SMOOTHED_S)) / step_s(run.series)
    return row | {
        "cycles": cycles.count if cycles else 0,
        "travel_m": cycles.travel.mean if cycles else None,
        "travel_half_width_m": cycles.travel.half_width if cycles else None,
        "travel_deviation_m": float(cycles.travel_m.std(ddof=1)) if cycles else None,
        "time_s": float(cycles.time_s.mean()) if cycles else None,
        "loading_fraction": cycles.loading_fraction if cycles else None,
        "unloading_over_loading": cycles.unloading_over_loading if cycles else None,
        "loading_newton_per_s": float(loads[loads > 0.0].mean()),
        "unloading_newton_per_s": float(-loads[loads < 0.0].mean()),
        "strongest_hz": over_time.dominant_hz,
        "stands_out": over_time.significant,
        "resolution_hz": over_time.resolution_hz,
        "strongest_m": 1.0 / over_travel.dominant_hz,
        "stands_out_over_travel": over_travel.significant,
        "tip_depth_m": -float(run.tip_m[1][run.rows].mean()),
        "residual_ratio": run.summary["energy.residual_ratio"],
        "max_overlap_mean": float(overlap.mean()),
        "max_overlap": float(overlap.max()),
        "wall_s": run.summary["run.wall_s"],
        "scene_hash": run.summary["scene.hash"],
    }


HEADS = (
    "case", "seed", "metres", "draft [N]", "1 %, 99 % [N]", "deviation [N]", "angle [rad]", "spring [kN]",
    "travel between failures [mm]", "loading", "unloading rate", "strongest [Hz]", "over travel [mm]",
    "depth [mm]", "soil lifts share [N]", "residual", "largest overlap: mean; at all",
)  # fmt: skip


def case_text(row: dict[str, Any]) -> str:
    """One row of cases.md."""
    swings = row["angle_rad_98_percent_range"] is not None

    def told(value: Any, scale: float, digits: int) -> str:
        return "" if value is None else f"{scale * value:.{digits}f}"

    cells = (
        row["case"],
        str(row["seed"]),
        f"{row['travel_counted_m']:.1f}",
        f"{row['draft_mean_newton']:.0f} +- {row['draft_mean_half_width_newton']:.0f}",
        f"{row['draft_1_percent_newton']:.0f}, {row['draft_99_percent_newton']:.0f}",
        f"{row['draft_deviation_newton']:.0f} +- {row['draft_deviation_half_width_newton']:.0f}",
        told(row["angle_rad_98_percent_range"], 1.0, 3),
        f"{1e-3 * row['spring_mean_newton']:.1f}; {1e-3 * row['spring_newton_98_percent_range']:.1f}"
        if swings
        else "",
        f"{told(row['travel_m'], 1e3, 0)} +- {told(row['travel_half_width_m'], 1e3, 0)} "
        f"({told(row['travel_deviation_m'], 1e3, 0)}; {row['cycles']})",
        told(row["loading_fraction"], 1.0, 2),
        told(row["unloading_over_loading"], 1.0, 1),
        f"{row['strongest_hz']:.1f}{'' if row['stands_out'] else ' (noise)'}",
        f"{1e3 * row['strongest_m']:.0f}{'' if row['stands_out_over_travel'] else ' (noise)'}",
        f"{1e3 * row['tip_depth_m']:.0f}",
        f"{row['soil_lifts_share_newton']:.0f}",
        f"{row['residual_ratio']:.0e}",
        f"{100.0 * row['max_overlap_mean']:.0f}; {100.0 * row['max_overlap']:.0f} %",
    )
    return f"| {' | '.join(cells)} |"


PHASED = {
    "soil's force on the tool": Wrench("shank").force_x_newton,
    "spring force": SPRING,
    "share angle": ANGLE,
    "height of the shank": Body("shank").z_m,
}
"""What is laid beside the draft: quantity, column."""

LONGEST_LAG_S = 0.25
"""Between the draft and what follows it (chosen: half a cycle)."""


def phases(run: Run) -> list[dict[str, Any]]:
    """Correlation with the draft at no lag, and the largest in size with its lag: positive after it."""
    step = step_s(run.series)
    draft = detrend(run.column(DRAFT, MOVING_S))
    lags = np.arange(-round(LONGEST_LAG_S / step), round(LONGEST_LAG_S / step) + 1)
    found = []
    for name, column in PHASED.items():
        other = detrend(run.column(column, MOVING_S))
        inner = slice(-lags[0], len(draft) - lags[-1])
        own = draft[inner]
        all_of = np.array([np.corrcoef(own, np.roll(other, -lag)[inner])[0, 1] for lag in lags])
        at = int(np.argmax(np.abs(all_of)))
        found.append(
            {
                "case": run.case.name,
                "seed": run.case.seed,
                "quantity": name,
                "correlation": float(all_of[-lags[0]]),
                "largest": float(all_of[at]),
                "lag_s": float(lags[at] * step),
            }
        )
    return found


def phase_table(rows: Sequence[dict[str, Any]]) -> str:
    """phases.md."""
    lines = [
        "| case | quantity | correlation with the draft | largest | after the draft by |",
        "|---" * 5 + "|",
    ]
    for row in rows:
        lines.append(
            f"| {row['case']} | {row['quantity']} | {row['correlation']:+.2f} | {row['largest']:+.2f} "
            f"| {1e3 * row['lag_s']:+.0f} ms |"
        )
    return "\n".join(lines) + "\n"


def draw(runs: Sequence[Run], path: Path) -> None:
    """Draft over travel, its spectra over time and travel, and travel between failures, for each run."""
    figure, axes = plt.subplots(2, 2, figsize=(11, 7), constrained_layout=True)
    for run in runs:
        smooth, label = run.column(DRAFT, SMOOTHED_S), run.case.name
        tip = run.tip_m[0][run.rows]
        shown = tip < tip[0] + 2.0
        axes[0, 0].plot(tip[shown], smooth[shown], lw=1, label=label)
        over_time = spectrum(step_s(run.series), run.series[DRAFT][run.rows])
        over_travel = spectrum(*run.over_travel(smooth))
        cycles = run.cycles(1.0)
        assert over_time is not None
        assert over_travel is not None
        assert cycles is not None
        for axis, found in ((axes[0, 1], over_time), (axes[1, 0], over_travel)):
            axis.loglog(found.frequency_hz[1:], found.density[1:], lw=1, label=label)
        axes[1, 1].hist(
            1e3 * cycles.travel_m, np.arange(0, 520, 20), density=True, histtype="step", label=label
        )
    for axis, x, y in zip(
        axes.flat,
        ("tip [m]", "frequency [Hz]", "cycles per metre", "travel between failures [mm]"),
        ("draft, 20 ms mean [N]", "draft [N²/Hz]", "draft [N² m]", "density [1/mm]"),
        strict=True,
    ):
        axis.set_xlabel(x)
        axis.set_ylabel(y)
    axes[0, 1].set_xlim(0.2, 30.0)
    axes[1, 0].set_xlim(0.4, 60.0)
    axes[0, 0].legend(fontsize="small")
    figure.savefig(path, dpi=110)
    plt.close(figure)


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
    parser.add_argument("--out", type=Path, default=Path("runs/cycle"), help="folder of the runs")
    parser.add_argument("--results", type=Path, default=RESULTS / "cycle")
    args = parser.parse_args()
    runs, ten_metres = [], {}
    for case in cases():
        summary = find_case(case, args.out)
        if summary is None:
            print(f"{case.key}: not run")
            continue
        runs.append(Run(case, summary))
        if case.name in (*LOCKED, *LOCKED.values()):
            ten_metres[case.name, case.seed] = Run(case, summary, PAIRED_M)
    if not runs:
        raise SystemExit(f"{args.out}: no finished run of these scenes there; make them with cycle_runs")
    args.results.mkdir(parents=True, exist_ok=True)
    table = [case_row(run) for run in runs]
    write_rows(args.results / "cases.csv", table)
    lines = [f"| {' | '.join(HEADS)} |", "|---" * len(HEADS) + "|", *map(case_text, table)]
    (args.results / "cases.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    long = [run for run in runs if run.case.duration_s == LONG_S]
    told = [row for run in long for row in phases(run)]
    (args.results / "phases.md").write_text(phase_table(told), encoding="utf-8")
    write_rows(args.results / "thresholds.csv", threshold_rows(runs))
    picture = args.results / "cycle.png"
    draw(long, picture)
    ship_picture(picture, picture)
    rows, savings = [], {}
    for soil, held in LOCKED.items():
        seeds = sorted(seed for name, seed in ten_metres if name == held and (soil, seed) in ten_metres)
        if not seeds:
            continue
        sprung, locked = ([ten_metres[name, seed] for seed in seeds] for name in (soil, held))
        rows += [{"soil": soil, **row} for row in frequency_rows(sprung, locked)]
        if len(seeds) > 1:
            drafts = ([run.draft_mean_newton for run in both] for both in (sprung, locked))
            savings[soil] = {"seeds": seeds, **asdict(paired_difference(*drafts))}
    columns = dict.fromkeys(key for row in rows for key in row)
    write_rows(args.results / "frequency.csv", [columns | row for row in rows])
    text = json.dumps(savings, indent=1)
    (args.results / "saving.json").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
