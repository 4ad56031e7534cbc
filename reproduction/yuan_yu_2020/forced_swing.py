"""Work of the soil on a shank driven by a sine: positive where soil excites the swing.

    python -m reproduction.yuan_yu_2020.forced_swing [SCENE] [--out DIR] [--frequencies-hz 1.5 3 4.5 7]
        [--amplitudes-rad 0.02 0.05] [--seeds 1] [--workers N] [--set KEY=VALUE ...]

SCENE (field_swing) runs as it is; then a joint takes the place of the shank's spring and turns it against the
frame by amplitude x sin(2 pi f t) about its mean angle. With the moment M of the soil on the shank about its
hinge and the rate w of the swing, over whole periods after BEGIN_M of travel of the tip:

    power P = <(M - <M>) w>,   the soil as a damper C = -P / <w w>

A swing grows by itself where the soil delivers more power than the shank's own damper dissipates,
C < -C_spring: self-excitation. Otherwise the failures of the soil force the shank to swing. Intervals are
95 %.
"""

import argparse
import cmath
import csv
import itertools
import math
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.run_cache import Summary, kept_run, write_scene
from subsoil_ros.analysis.columns import DRAFT, TIME, Body, PlanarTool, Wrench
from subsoil_ros.analysis.dead_centre import shank_spring
from subsoil_ros.analysis.metrics_window import tip_path_m
from subsoil_ros.analysis.series import Series, read_series_csv
from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.experiments.sweep_points import seed_key
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.scene.scene import Scene

from . import SCENES
from .draft_saving import mean_angle_rad
from .machine_variants import LOCK, locked_shank, shank_and_frame

Values = NDArray[np.float64]

BEGIN_M = 0.5
"""Travel of the tip from the end of the field on, from where periods count (chosen: three depths)."""


@dataclass(frozen=True)
class Swing:
    """What the soil does to one swing; half-widths are of 95 %."""

    periods: float
    power_watt: float
    power_half_width_watt: float
    damper_newton_m_s_per_rad: float
    damper_half_width_newton_m_s_per_rad: float
    draft_newton: float


def moment_of_soil(series: Series, scene: Scene, hinge: complex) -> Values:
    """(n,) [N m] of the soil on the shank about its hinge, x + i z [m], in the sense of the shank's angle."""
    shank = str(scene.report.shank)
    assert scene.mechanism is not None
    body = scene.mechanism.bodies[shank]
    arm = hinge - complex(*body.position_m)
    tool = next(name for name, item in scene.tools.items() if item.body == shank)
    turned = arm * np.exp(1j * (series[Body(shank).angle_rad] - body.angle_rad))
    x = series[PlanarTool(tool).x_m] - (series[Body(shank).x_m] + turned.real)
    z = series[PlanarTool(tool).z_m] - (series[Body(shank).z_m] + turned.imag)
    along, up = series[Wrench(tool).force_x_newton], series[Wrench(tool).force_z_newton]
    return np.asarray(x * up - z * along - series[Wrench(tool).torque_y_newton_m], np.float64)


def soil_on_swing(
    times_s: Values, rate_rad_per_s: Values, moment_newton_m: Values, frequency_hz: float
) -> tuple[float, float, float, float, float]:
    """Numbers of a Swing but the draft, over the whole periods at the end of (n,) values.

    Raises:
        ValueError: fewer than two periods.
    """
    step = float(np.median(np.diff(times_s)))
    periods = math.floor(len(times_s) * step * frequency_hz)
    rows = round(periods / frequency_hz / step)
    if periods < 2:
        raise ValueError(f"{len(times_s) * step:.3g} s hold fewer than two periods of {frequency_hz:g} Hz")
    last = slice(len(times_s) - rows, None)
    rate, moment = rate_rad_per_s[last], moment_newton_m[last] - moment_newton_m[last].mean()
    power = stationarity(times_s[last], moment * rate)
    assert power is not None
    square = float((rate**2).mean())
    half = power.mean_half_width
    return periods, power.mean, half, -power.mean / square, half / square


def read_swing(folder: Path, free: Scene) -> tuple[Values, Values, Values, Values, Values]:
    """Time, angle, rate, moment of the soil and draft of a run from BEGIN_M on; free: with the spring."""
    series, scene = read_series_csv(folder / "series.csv"), load_scene(folder / "scene.yaml").scene
    path = tip_path_m(series, scene)
    assert path is not None
    first = int(np.argmax(path[0] >= BEGIN_M))
    (shank, frame), found = shank_and_frame(free), shank_spring(free)
    assert found is not None
    columns = [series[TIME]]
    for name in ("angle_rad", "angular_velocity_rad_per_s"):
        columns.append(series[f"body.{shank}.{name}"] - series[f"body.{frame}.{name}"])
    columns += [moment_of_soil(series, scene, found.hinge), series[DRAFT]]
    times, angle, rate, moment, draft = (np.asarray(column, np.float64)[first:] for column in columns)
    return times, angle, rate, moment, draft


def swing_of(folder: Path, frequency_hz: float, free: Scene) -> Swing:
    """Of a finished run."""
    times, _, rate, moment, draft = read_swing(folder, free)
    return Swing(*soil_on_swing(times, rate, moment, frequency_hz), float(draft.mean()))


def swung_shank(resolved: ResolvedScene, mean_rad: float, amplitude_rad: float, frequency_hz: float) -> dict:
    """The scene with its shank turned by a sine; it starts at rest at the rear end of its swing."""
    document = locked_shank(resolved, mean_rad - amplitude_rad)
    rate = 2.0 * math.pi * frequency_hz * amplitude_rad
    document["mechanism"]["joints"][LOCK]["speed"] = {
        "kind": "sine", "amplitude": rate, "frequency_hz": frequency_hz,
    }  # fmt: skip
    document["name"] = f"{resolved.scene.name}_swung"
    return document


def damper_of_spring(scene: Scene, angle_rad: float) -> float:
    """C_spring [N m s/rad] of the shank's own spring about the hinge, at an angle from the reference pose."""
    found = shank_spring(scene)
    assert found is not None
    turned = found._replace(lug=found.lug * cmath.rect(1.0, angle_rad))
    return float(found.spring.damping_newton_s_per_m) * turned.arm_m**2


def as_text(seed: int, amplitude_rad: float, frequency_hz: float, swing: Swing) -> str:
    """A row of the table."""
    cells = [
        f"{seed} | {amplitude_rad:g} | {frequency_hz:g} | {swing.periods:.0f}",
        f"{swing.power_watt:+.1f} +- {swing.power_half_width_watt:.1f}",
        f"{swing.damper_newton_m_s_per_rad:+.0f} +- {swing.damper_half_width_newton_m_s_per_rad:.0f}",
        f"{swing.draft_newton:.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> int:
    """Runs what is not there yet, prints the table and writes forced_swing.csv."""
    parser = argparse.ArgumentParser(prog="python -m reproduction.yuan_yu_2020.forced_swing")
    parser.add_argument("scene", nargs="?", type=Path, default=SCENES / "field_swing.yaml")
    parser.add_argument("--out", type=Path, default=Path("runs/forced_swing"))
    parser.add_argument("--frequencies-hz", nargs="+", type=float, default=[1.5, 3.0, 4.5, 7.0])
    parser.add_argument("--amplitudes-rad", nargs="+", type=float, default=[0.02, 0.05])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()
    asked = load_scene(args.scene, args.overrides)
    if shank_spring(asked.scene) is None:
        parser.error(
            f"{args.scene}: report.shank, report.spring and report.tip_m must name a shank on a spring"
        )
    key = seed_key(asked)

    def free(seed: int) -> tuple[ResolvedScene, Summary]:
        overrides = [*args.overrides, f"{key}={seed}"]
        return load_scene(args.scene, overrides), kept_run(args.scene, args.out / "runs", overrides)

    def forced(case: tuple[int, float, float]) -> Swing:
        seed, amplitude, frequency = case
        resolved, summary = of_seed[seed]
        document = swung_shank(resolved, mean_angle_rad(summary, resolved), amplitude, frequency)
        name = f"swung_{seed}_{amplitude:g}_{frequency:g}.yaml"
        run = kept_run(write_scene(document, args.out / "scenes" / name), args.out / "runs")
        return swing_of(Path(run["folder"]), frequency, resolved.scene)

    cases = list(itertools.product(args.seeds, args.amplitudes_rad, args.frequencies_hz))
    with ThreadPoolExecutor(args.workers) as pool:
        of_seed = dict(zip(args.seeds, pool.map(free, args.seeds), strict=True))
        resolved, summary = of_seed[args.seeds[0]]
        own = damper_of_spring(resolved.scene, mean_angle_rad(summary, resolved))
        _, angle, rate, moment, _ = read_swing(Path(summary["folder"]), resolved.scene)
        print(
            f"free: the angle goes over {np.ptp(angle):.3f} rad, the soil's power on its swing is "
            f"{float(((moment - moment.mean()) * rate).mean()):.1f} W\nthe shank's own spring damps with "
            f"{own:.0f} N m s/rad about the hinge and takes {own * float((rate**2).mean()):.1f} W\n"
        )
        print(
            "| seed | amplitude rad | Hz | periods | power W | damper N m s/rad | draft N |\n"
            + "|---" * 7
            + "|"
        )
        with (args.out / "forced_swing.csv").open("w", newline="", encoding="utf-8") as file:
            table: csv.DictWriter[str] | None = None
            for case, swing in zip(cases, pool.map(forced, cases), strict=True):
                row = dict(zip(("seed", "amplitude_rad", "frequency_hz"), case, strict=True)) | asdict(swing)
                if table is None:
                    table = csv.DictWriter(file, list(row))
                    table.writeheader()
                table.writerow(row)
                file.flush()
                print(as_text(*case, swing), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
