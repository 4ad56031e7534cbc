"""Tables of docs/cycle.md from the runs of benchmarks/cycle_runs.py.

    python -m benchmarks.cycle [--out DIR] [--results DIR]

Takes the runs that are finished, starts none. Leaves in --results (docs/results/cycle):

cases.csv       one row for each run: draft, swing, cycles, spectrum, residual, overlaps
cases.md        the same for reading, one row for each case; intervals of 95 % from the scatter between seeds
thresholds.csv  travel between failures by the prominence that counts as one
rhythm.csv      sprung shank against the locked one's record passed through the linear shank
saving.json     sprung less locked draft, bed by bed
"""

import argparse
import itertools
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial import cKDTree
from scipy.stats import f as f_distribution

from benchmarks.cycle_runs import SCENE, Case, cases, find_case
from benchmarks.kept_runs import Summary, write_rows
from subsoil_ros.analysis.failure_cycles import SMOOTHED_S, FailureCycles, failure_cycles
from subsoil_ros.analysis.findings import MOVING_S
from subsoil_ros.analysis.intervals import t_quantile
from subsoil_ros.analysis.levers import Levers, levers_of
from subsoil_ros.analysis.paired import paired_difference
from subsoil_ros.analysis.series import Series
from subsoil_ros.analysis.series_file import read_series_csv
from subsoil_ros.analysis.smoothing import moving_mean, running_mean, step_s
from subsoil_ros.analysis.spectra import Spectrum, spectrum
from subsoil_ros.analysis.window import tip_path_m
from subsoil_ros.recording.joined import open_record
from subsoil_ros.scene.loader import load_scene
from subsoil_ros.scene.mechanism import SpringDamper

Values = NDArray[np.float64]

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "cycle"

THRESHOLDS = (0.5, 1.0, 1.5)
"""Prominence of a failure in standard deviations."""

QUANTILES = (0.01, 0.99)
"""Of the 10 ms mean: the extremes of a record grow with its length."""

LOADED_M = 0.25
"""Contacts this near to the tip are in work (chosen: the rupture distance of a depth of 0.18 m and more)."""

SPRING, ANGLE = "spring.H9_spring.force_newton", "body.shank.angle_rad"


class Run:
    """A finished run and its window."""

    def __init__(self, case: Case, summary: Summary) -> None:
        self.case, self.summary = case, summary
        self.folder = Path(summary["folder"])
        self.series: Series = read_series_csv(self.folder / "series.csv")
        self.scene = load_scene(self.folder / "scene.yaml")
        times, window = self.series["time_s"], summary["window"]
        self.rows = (times >= window["start_s"]) & (times <= window["end_s"])

    def column(self, name: str, mean_s: float) -> Values:
        """A column over the window, its moving mean."""
        return moving_mean(self.series, name, mean_s)[self.rows]

    def cycles(self, threshold: float) -> FailureCycles | None:
        """Failure cycles of the draft."""
        return self.cycles_of(self.column("draft_newton", SMOOTHED_S), threshold)

    def cycles_of(self, values: Values, threshold: float = 1.0) -> FailureCycles | None:
        """Of any load (n,) over the window."""
        path = tip_path_m(self.series, self.scene.scene)
        assert path is not None
        return failure_cycles(self.series["time_s"][self.rows], path[0][self.rows], values, threshold)

    def spectrum(self, values: Values) -> Spectrum:
        """Of values (n,) over the window."""
        found = spectrum(step_s(self.series), values)
        assert found is not None
        return found


def overlaps(run: Run) -> tuple[float, float, float]:
    """Overlap over the radius of the contacts in work: 99 % quantile, largest, and part of them above 5 %."""
    soil = run.scene.scene.particle_soil
    path = tip_path_m(run.series, run.scene.scene)
    assert soil is not None
    assert path is not None
    radius, times = soil.particles.mean_volume_radius_m, run.series["time_s"]
    found = []
    window = run.summary["window"]
    for cloud in open_record(run.folder / "bag").clouds(run.scene.timing.interval_ns):
        now = cloud.end_time_ns * 1e-9
        if not window["start_s"] <= now <= window["end_s"]:
            continue
        tip = [np.interp(now, times, path[0]), 0.0, np.interp(now, times, path[1])]
        near = np.asarray(cloud.positions_m, np.float64)
        near = near[((near - tip) ** 2).sum(axis=1) < LOADED_M**2]
        pairs = cKDTree(near).query_pairs(2.0 * radius, output_type="ndarray")
        found.append(2.0 * radius - np.linalg.norm(near[pairs[:, 0]] - near[pairs[:, 1]], axis=1))
    relative = np.concatenate(found) / radius
    return float(np.quantile(relative, 0.99)), float(relative.max()), float((relative > 0.05).mean())


def case_row(run: Run) -> dict[str, Any]:
    """One row of cases.csv."""
    draft = run.column("draft_newton", MOVING_S)
    cycles, waves = run.cycles(1.0), run.spectrum(run.series["draft_newton"][run.rows])
    overlap_99, overlap_most, above = overlaps(run)
    low, high = np.quantile(draft, QUANTILES)
    row: dict[str, Any] = {
        "case": run.case.name,
        "seed": run.case.seed,
        "particles": run.summary["particle_count"],
        "draft_mean_newton": float(run.series["draft_newton"][run.rows].mean()),
        "draft_deviation_newton": float(run.column("draft_newton", SMOOTHED_S).std()),
        "draft_1_percent_newton": float(low),
        "draft_99_percent_newton": float(high),
    }
    for name, column in (("angle_rad", ANGLE), ("spring_newton", SPRING)):
        held = run.case.locked or column not in run.series
        values = np.zeros(1) if held else run.column(column, MOVING_S)
        row[f"{name}_range"] = float(np.ptp(values))
        row[f"{name}_98_percent_range"] = float(np.ptp(np.quantile(values, QUANTILES)))
    return row | {
        "spring_least_newton": float(run.column(SPRING, MOVING_S).min()) if SPRING in run.series else None,
        "cycles": cycles.count if cycles else 0,
        "travel_m": cycles.travel.mean if cycles else None,
        "travel_half_width_m": cycles.travel.half_width if cycles else None,
        "time_s": float(cycles.time_s.mean()) if cycles else None,
        "loading_fraction": cycles.loading_fraction if cycles else None,
        "unloading_over_loading": cycles.unloading_over_loading if cycles else None,
        "strongest_hz": waves.dominant_hz,
        "out_of_red_noise": waves.significant,
        "tip_depth_m": run.summary["tip_depth_m_mean"],
        "residual_ratio": run.summary["interface_residual_ratio"],
        "overlap_99_percent": overlap_99,
        "overlap_largest": overlap_most,
        "overlap_above_5_percent": above,
        "wall_s": run.summary["wall_s"],
        "scene_hash": run.summary["scene_hash"],
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
        "travel between failures [mm]", "loading", "unloading rate", "residual", "overlap, 99 % and largest",
    )  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for case, group in _by_case(rows).items():

        def mean(key: str, group: Sequence[dict[str, Any]] = group) -> float:
            values = [row[key] for row in group if row[key] is not None]
            return float(np.mean(values)) if values else np.nan

        def interval(key: str, scale: float, group: Sequence[dict[str, Any]] = group) -> str:
            scatter, freedoms = pooled_scatter(rows, key)
            half = t_quantile(freedoms) * scatter / np.sqrt(len(group))
            return f"{scale * mean(key):.3g} +- {scale * abs(mean(key)) * half:.2g}"

        swings = mean("angle_rad_range") > 0.0
        cells = (
            case,
            str(len(group)),
            interval("draft_mean_newton", 1.0),
            f"{mean('draft_1_percent_newton'):.0f}, {mean('draft_99_percent_newton'):.0f}",
            interval("draft_deviation_newton", 1.0),
            interval("angle_rad_98_percent_range", 1.0) if swings else "0",
            interval("spring_newton_98_percent_range", 1e-3) if swings else "",
            f"{interval('travel_m', 1e3)} ({sum(row['cycles'] for row in group)})",
            f"{mean('loading_fraction'):.2f}",
            f"{mean('unloading_over_loading'):.1f}",
            f"{mean('residual_ratio'):.0e}",
            f"{100.0 * mean('overlap_99_percent'):.1f} %, {100.0 * mean('overlap_largest'):.0f} %",
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


def through_the_shank(locked: Run, levers: Levers, damping_newton_s_per_m: float) -> Values:
    """Spring force (n,) [N] of the linear shank under the moment that the soil puts on the locked one.

    J a'' + C r^2 a' + k r^2 a = M(t) about the hinge, from rest under the first moment; force k r a + C r
    a'. The tool's work on the way is its own: the soil does not see the shank give way.
    """
    series = locked.series
    hinge = np.array(levers.hinge_m)
    shank = locked.scene.scene.mechanism.bodies["shank"] if locked.scene.scene.mechanism else None
    assert shank is not None
    arm = np.array(shank.position_m) - hinge
    turn = series[ANGLE] - shank.angle_rad
    x = np.cos(turn) * arm[0] - np.sin(turn) * arm[1]
    z = np.sin(turn) * arm[0] + np.cos(turn) * arm[1]
    # planar moment about -y, positive where it presses the spring: the soil turns the shank back
    moment = -(
        x * series["tool.shank.force_z_newton"]
        - z * series["tool.shank.force_x_newton"]
        - series["tool.shank.torque_y_newton_m"]
    )
    times, lever = series["time_s"], levers.spring_arm_m
    stiffness, damping = levers.stiffness_newton_m_per_rad, damping_newton_s_per_m * lever**2

    def rates(time: float, state: Values) -> list[float]:
        load = float(np.interp(time, times, moment))
        return [state[1], (load - damping * state[1] - stiffness * state[0]) / levers.inertia_kg_m2]

    start = [float(moment[0]) / stiffness, 0.0]
    found = solve_ivp(rates, (times[0], times[-1]), start, t_eval=times, max_step=2e-3, rtol=1e-6)
    return np.asarray((stiffness * found.y[0] + damping * found.y[1]) / lever)


def rhythm_rows(sprung: Sequence[Run], locked: Sequence[Run]) -> list[dict[str, Any]]:
    """Rows of rhythm.csv: the sprung shank, the passive one under the locked tool's record, and their
    ratio."""
    scene = load_scene(SCENE).scene
    levers = levers_of(scene)
    spring = scene.mechanism.forces["H9_spring"] if scene.mechanism else None
    assert levers is not None
    assert isinstance(spring, SpringDamper)
    forces = {
        "sprung": [run.series[SPRING][run.rows] for run in sprung],
        "locked tool through the linear shank": [
            through_the_shank(run, levers, spring.damping_newton_s_per_m)[run.rows] for run in locked
        ],
    }
    rows, waves = [], {}
    for name, records in forces.items():
        runs = sprung if name == "sprung" else locked
        spectra = [run.spectrum(values) for run, values in zip(runs, records, strict=True)]
        waves[name] = spectra
        for run, values, found in zip(runs, records, spectra, strict=True):
            count = max(1, round(SMOOTHED_S / step_s(run.series)))
            cycles = run.cycles_of(running_mean(values, count))
            rows.append(
                {
                    "record": name,
                    "seed": run.case.seed,
                    "spring_deviation_newton": float(values.std()),
                    "spring_98_percent_range_newton": float(np.ptp(np.quantile(values, QUANTILES))),
                    "travel_m": cycles.travel.mean if cycles else None,
                    "loading_fraction": cycles.loading_fraction if cycles else None,
                    "unloading_over_loading": cycles.unloading_over_loading if cycles else None,
                    "strongest_hz": found.dominant_hz,
                }
            )
    return rows + _ratio_rows(*waves.values())


def _ratio_rows(sprung: Sequence[Spectrum], passive: Sequence[Spectrum]) -> list[dict[str, Any]]:
    """Octaves in which the sprung shank's mean spectrum is compared with the passive one's: F test at 95 %
    for all octaves together."""
    frequency = sprung[0].frequency_hz
    own, other = (
        np.mean([np.interp(frequency, one.frequency_hz, one.density) for one in many], axis=0)
        for many in (sprung, passive)
    )
    rows, low = [], float(frequency[1])
    edges = [low * 2.0**k for k in range(6)]
    freedoms = [sum(one.degrees_of_freedom for one in many) for many in (sprung, passive)]
    level = float(f_distribution.ppf(1.0 - 0.05 / (len(edges) - 1), *freedoms))
    for start, end in itertools.pairwise(edges):
        inside = (frequency >= start) & (frequency < end)
        ratio = float(own[inside].sum() / other[inside].sum())
        rows.append(
            {
                "record": f"power, sprung over passive, {start:.2f} to {end:.2f} Hz",
                "ratio": ratio,
                "ratio_of_chance": level,
            }
        )
    return rows


def main() -> None:
    """Write the tables of all finished runs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs/cycle"), help="where the runs are")
    parser.add_argument("--results", type=Path, default=RESULTS)
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
    rows = rhythm_rows([sprung[seed] for seed in seeds], [locked[seed] for seed in seeds])
    columns = dict.fromkeys(key for row in rows for key in row)
    write_rows(args.results / "rhythm.csv", [columns | row for row in rows])
    saving = paired_difference(
        *([float(runs[seed].summary["draft_newton_mean"]) for seed in seeds] for runs in (sprung, locked))
    )
    text = json.dumps({"seeds": seeds, **asdict(saving)}, indent=1)
    (args.results / "saving.json").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
