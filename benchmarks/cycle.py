"""Tables of docs/cycle.md from the runs of benchmarks/cycle_runs.py.

    python -m benchmarks.cycle [--out DIR] [--results DIR]

Takes the runs that are finished, starts none. Leaves in --results (docs/results/cycle):

cases.csv       one row for each run: draft, swing, cycles, spectrum, residual, overlaps cases.md        the
same for reading, one row for each case; intervals of 95 % from the scatter between seeds thresholds.csv
travel between failures by the prominence that counts as one rhythm.csv      sprung shank against the locked
one's record passed through the linear shank: over time, and over
                the travel of the tip
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
from scipy.signal import periodogram
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

BEGIN_M, END_M = 0.45, 1.95
"""Travel of the trolley that counts, the same in all cases: from the tip well inside the bin on (chosen). A
window by the tip's place would open in the throw after a failure, always at the same phase of a cycle."""

IN_WORK_M, AT_TIP_M = 0.25, 0.05
"""Contacts this near to the tip are in work, or the most loaded ones (chosen: a rupture distance of 0.18 m
of depth and more; the width of the share)."""

SPRING, ANGLE = "spring.H9_spring.force_newton", "body.shank.angle_rad"

STEP_S = 1e-4
"""Of the shank on such soil (chosen: a hundredth of its shortest period)."""

TRAVEL_MODELS = {"20 kN/m": 2.0e4, "200 kN/m": 2.0e5, "1000 kN/m": 1.0e6}
"""Stiffness [N/m] at the tip with which soil that has not failed unloads and is loaded again."""


class Run:
    """A finished run and its window."""

    def __init__(self, case: Case, summary: Summary) -> None:
        self.case, self.summary = case, summary
        self.folder = Path(summary["folder"])
        self.series: Series = read_series_csv(self.folder / "series.csv")
        self.scene = load_scene(self.folder / "scene.yaml")
        trolley = self.series["body.trolley.x_m"]
        travel = trolley - trolley[0]
        self.rows = (travel >= BEGIN_M) & (travel <= END_M)

    @property
    def draft_mean_newton(self) -> float:
        """Over the window."""
        return float(self.series["draft_newton"][self.rows].mean())

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

    def periodogram(self, values: Values) -> tuple[Values, Values]:
        """Frequencies [Hz] and one-sided density of values (n,) over the window, trend removed, Hann's
        window."""
        frequency, density = periodogram(values, 1.0 / step_s(self.series), "hann", detrend="linear")
        return frequency, density


def overlaps(run: Run) -> dict[str, float]:
    """99 % quantile of the overlap over the radius, of the contacts in work and of those at the tip."""
    soil = run.scene.scene.particle_soil
    path = tip_path_m(run.series, run.scene.scene)
    assert soil is not None
    assert path is not None
    radius, times = soil.particles.mean_volume_radius_m, run.series["time_s"]
    first, last = times[run.rows][[0, -1]]
    found: dict[float, list[Values]] = {IN_WORK_M: [], AT_TIP_M: []}
    for cloud in open_record(run.folder / "bag").clouds(run.scene.timing.interval_ns):
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
    largest = run.series["soil.largest_overlap_m"][run.rows] / radius
    return {
        "overlap_in_work_99_percent": float(in_work),
        "overlap_at_tip_99_percent": float(at_tip),
        "largest_overlap_mean": float(largest.mean()),
        "largest_overlap_most": float(largest.max()),
        "largest_tool_overlap": float(run.series["soil.largest_tool_overlap_m"][run.rows].max()) / radius,
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
        "particles": run.summary["particle_count"],
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
        row[f"{name}_98_percent_range"] = None if values is None else _quantile_range(values)
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
        "residual_ratio": run.summary["interface_residual_ratio"],
        **overlaps(run),
        "wall_s": run.summary["wall_s"],
        "scene_hash": run.summary["scene_hash"],
    }


def _quantile_range(values: Values) -> float:
    return float(np.ptp(np.quantile(values, QUANTILES)))


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
            f"{100.0 * mean('overlap_at_tip_99_percent'):.0f}; {100.0 * mean('largest_overlap_most'):.0f} %",
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


def soil_moment_newton_m(run: Run, levers: Levers) -> Values:
    """Moment (n,) of the soil on the shank about its hinge, positive where it presses the spring."""
    series = run.series
    shank = run.scene.scene.mechanism.bodies["shank"] if run.scene.scene.mechanism else None
    assert shank is not None
    arm = np.array(shank.position_m) - np.array(levers.hinge_m)
    turn = series[ANGLE] - shank.angle_rad
    x = np.cos(turn) * arm[0] - np.sin(turn) * arm[1]
    z = np.sin(turn) * arm[0] + np.cos(turn) * arm[1]
    # the planar moment is about -y, and the spring is pressed where the shank is turned back, clockwise
    return -np.asarray(
        x * series["tool.shank.force_z_newton"]
        - z * series["tool.shank.force_x_newton"]
        - series["tool.shank.torque_y_newton_m"]
    )


def through_the_shank(locked: Run, levers: Levers, damping_newton_s_per_m: float) -> Values:
    """Spring force (n,) [N] of the linear shank under the moment that the soil puts on the locked one, over
    time.

    J a'' + C r^2 a' + k r^2 a = M(t) about the hinge, from rest under the first moment; force k r a + C r
    a'. The soil does not feel the shank give way: no feedback.
    """
    times, lever = locked.series["time_s"], levers.spring_arm_m
    moment = soil_moment_newton_m(locked, levers)
    stiffness, damping = levers.stiffness_newton_m_per_rad, damping_newton_s_per_m * lever**2

    def rates(time: float, state: Values) -> list[float]:
        load = float(np.interp(time, times, moment))
        return [state[1], (load - damping * state[1] - stiffness * state[0]) / levers.inertia_kg_m2]

    start = [float(moment[0]) / stiffness, 0.0]
    found = solve_ivp(rates, (times[0], times[-1]), start, t_eval=times, max_step=2e-3, rtol=1e-6)
    return np.asarray((stiffness * found.y[0] + damping * found.y[1]) / lever)


def over_the_travel(
    locked: Run, levers: Levers, damping_newton_s_per_m: float, soil_newton_per_m: float
) -> Values:
    """Spring force (n,) [N] of the same shank, its soil as strong at each place as the locked tool found it.

    The tip is at s = v t - h a, h the lever of the tip. Where it has never been farther, the moment is that
    of the locked record at s; behind its farthest place the soil unloads, M(s_most) - h K (s_most - s) with
    K `soil_newton_per_m`, and never pulls. Semi-implicit Euler; STEP_S is a hundredth of the period of the
    shank on the stiffest soil.
    """
    path = tip_path_m(locked.series, locked.scene.scene)
    assert path is not None
    times, place = locked.series["time_s"], np.maximum.accumulate(path[0])
    moment, tip = soil_moment_newton_m(locked, levers), levers.tip_lever_m
    arm, inertia = levers.spring_arm_m, levers.inertia_kg_m2
    stiffness, damping = levers.stiffness_newton_m_per_rad, damping_newton_s_per_m * arm**2
    speed = float((place[-1] - place[0]) / (times[-1] - times[0]))
    steps = np.arange(times[0], times[-1], STEP_S)
    angle, rate, most = float(moment[0]) / stiffness, 0.0, float(place[0])
    shift = float(place[0]) + tip * angle
    force = np.empty_like(steps)
    for k, time in enumerate(steps):
        at = shift + speed * (time - steps[0]) - tip * angle
        most = max(most, at)
        load = float(np.interp(most, place, moment)) - tip * soil_newton_per_m * (most - at)
        load = max(load, 0.0) if most > at else load
        rate += STEP_S * (load - damping * rate - stiffness * angle) / inertia
        angle += STEP_S * rate
        force[k] = (stiffness * angle + damping * rate) / arm
    return np.interp(times, steps, force)


def rhythm_rows(sprung: Sequence[Run], locked: Sequence[Run]) -> list[dict[str, Any]]:
    """Rows of rhythm.csv: the sprung shank, and the linear one on the soil that the locked tool found."""
    scene = load_scene(SCENE).scene
    levers = levers_of(scene)
    spring = scene.mechanism.forces["H9_spring"] if scene.mechanism else None
    assert levers is not None
    assert isinstance(spring, SpringDamper)
    damper = spring.damping_newton_s_per_m
    records = {
        "sprung": (sprung, [run.series[SPRING][run.rows] for run in sprung]),
        "locked record over time": (
            locked, [through_the_shank(run, levers, damper)[run.rows] for run in locked],
        ),
        **{
            f"locked record over travel, unloading {name}": (
                locked, [over_the_travel(run, levers, damper, soil)[run.rows] for run in locked],
            )
            for name, soil in TRAVEL_MODELS.items()
        },
    }  # fmt: skip
    own = _mean_density(*records["sprung"])
    rows = []
    for name, (runs, forces) in records.items():
        found = [
            run.cycles_of(running_mean(force, max(1, round(SMOOTHED_S / step_s(run.series)))))
            for run, force in zip(runs, forces, strict=True)
        ]
        cycles = [one for one in found if one is not None]
        frequency, density = _mean_density(runs, forces)
        rows.append(
            {
                "record": name,
                "spring_mean_newton": float(np.mean([force.mean() for force in forces])),
                "spring_deviation_newton": float(np.mean([force.std() for force in forces])),
                "spring_98_percent_range_newton": float(np.mean([_quantile_range(f) for f in forces])),
                "time_s": float(np.mean([one.time_s.mean() for one in cycles])),
                "loading_fraction": float(np.mean([one.loading_fraction for one in cycles])),
                "strongest_hz": float(frequency[1 + np.argmax(density[1:])]),
                **_octaves(frequency, own[1] / density),
            }
        )
    rows.append({"record": "of chance, 95 %", **_ratio_of_chance(own[0], len(sprung))})
    return rows


def _mean_density(runs: Sequence[Run], records: Sequence[Values]) -> tuple[Values, Values]:
    """Mean periodogram over beds, at the frequencies of the first."""
    found = [run.periodogram(values) for run, values in zip(runs, records, strict=True)]
    frequency = found[0][0]
    return frequency, np.mean([np.interp(frequency, *one) for one in found], axis=0)


OCTAVES_HZ = (0.6, 1.25, 2.5, 5.0, 10.0, 20.0)
"""Bounds of bands; the lowest bin that a window of 3 s holds twice is in the first."""

HANN_BINS = 1.5
"""Bins that one degree of Hann's window takes (equivalent noise bandwidth)."""


def _octaves(frequency: Values, ratio: Values) -> dict[str, float]:
    """Mean ratio (geometric) of densities by octave, sprung over this one."""
    found = {}
    for low, high in itertools.pairwise(OCTAVES_HZ):
        inside = (frequency >= low) & (frequency < high)
        found[f"sprung_over_this_{low:g}_to_{high:g}_hz"] = float(np.exp(np.log(ratio[inside]).mean()))
    return found


def _ratio_of_chance(frequency: Values, beds: int) -> dict[str, float]:
    """Ratio that two records of one process pass in an octave (or fall below its inverse) in one set of
    octaves of twenty: F quantile, two freedoms for each independent bin of each bed."""
    found, bands = {}, len(OCTAVES_HZ) - 1
    for low, high in itertools.pairwise(OCTAVES_HZ):
        bins = int(((frequency >= low) & (frequency < high)).sum())
        freedoms = 2.0 * max(1.0, bins / HANN_BINS) * beds
        level = float(f_distribution.ppf(1.0 - 0.025 / bands, freedoms, freedoms))
        found[f"sprung_over_this_{low:g}_to_{high:g}_hz"] = level
    return found


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
        *([runs[seed].draft_mean_newton for seed in seeds] for runs in (sprung, locked))
    )
    text = json.dumps({"seeds": seeds, **asdict(saving)}, indent=1)
    (args.results / "saving.json").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
