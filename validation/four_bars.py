"""The N-four-bar of the IFToMM library of benchmarks (A02): how far energy drifts over ten seconds.

    python -m validation.four_bars [--json FILE]

N windows of rods of 1 m and 1 kg, the upper left corner at 1 m/s: ten times in 10 s they lie flat, where N
freedoms are added to the one that they have. The benchmark requires 0.1 J, and 1e-3 J for high precision.
The table is Markdown; it is that of docs/decisions/0002-mechanism-integrator.md.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

from .laboratory import Document, Laboratory
from .machines import pin
from .mechanism import stored

DURATION_NS = 10_000_000_000
HIGH_PRECISION_JOULE = 1e-3

COUNTS = (1, 2, 10, 40)
STEPS_NS = (5_000_000, 1_000_000, 500_000, 250_000, 100_000)
"""From coarse to fine; 500 us is the usual one."""


def windows(count: int, **more: object) -> Document:
    """`count` windows; `more` are keys of the mechanism."""
    rod = {"mass_kg": 1.0, "inertia_kg_m2": 1.0 / 12.0}
    bodies: Document = {}
    joints: Document = {}
    for i in range(count + 1):
        bodies[f"post{i}"] = {**rod, "position_m": [float(i), 0.5]}
        joints[f"foot{i}"] = pin("ground", f"post{i}", float(i), 0.0)
    bodies["post0"]["angular_velocity_rad_per_s"] = -1.0
    for i in range(count):
        bodies[f"bar{i}"] = {**rod, "position_m": [i + 0.5, 1.0]}
        joints[f"left{i}"] = pin(f"post{i}", f"bar{i}", float(i), 1.0)
        joints[f"right{i}"] = pin(f"bar{i}", f"post{i + 1}", i + 1.0, 1.0)
    return {"bodies": bodies, "joints": joints, **more}


def energy_drift(laboratory: Laboratory, count: int, step_ns: int, **more: object) -> float:
    """Largest change of energy [J] within 10 s, looked at 500 times."""
    engine = laboratory.machine(windows(count, **more), step_ns)
    first, worst = stored(engine.state("", -1, 0)), 0.0
    ticks = DURATION_NS // step_ns
    for tick in range(ticks):
        engine.advance(tick, ())
        if (tick + 1) % (ticks // 500) == 0:
            worst = max(worst, abs(stored(engine.state("", tick, (tick + 1) * step_ns)) - first))
    return worst


def measure(laboratory: Laboratory, count: int, step_ns: int) -> dict[str, Any]:
    """One row of the table."""
    start = time.process_time()
    adams = energy_drift(laboratory, count, step_ns)
    cpu = time.process_time() - start
    return {
        "count": count, "step_ms": step_ns * 1e-6, "adams_moulton_joule": adams,
        "runge_kutta_4_joule": energy_drift(laboratory, count, step_ns, integrator="runge_kutta_4"),
        "cpu_s": cpu,
    }  # fmt: skip


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    rows = []
    print("| N | step [ms] | Adams-Moulton [J] | Runge-Kutta 4 [J] | CPU of Adams-Moulton [s] |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        laboratory = Laboratory(Path(folder))
        energy_drift(laboratory, 1, 5_000_000)  # compiles
        for count in COUNTS:
            for step_ns in STEPS_NS:
                row = measure(laboratory, count, step_ns)
                rows.append(row)
                print(
                    f"| {count} | {row['step_ms']:g} | {row['adams_moulton_joule']:.1e} "
                    f"| {row['runge_kutta_4_joule']:.1e} | {row['cpu_s']:.2f} |",
                    flush=True,
                )
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
