"""Cost of a scene as its features are removed one after the other: it must fall with each.

    python -m benchmarks.features [--rounds N] [--json FILE]

The first table is the soil alone: CPU time per particle and step of a plate dragged through beds of the same
size. Each line has the features of the line above, less one. The second is a whole run: CPU time per tick,
direct, of the machine in a small bin with a controller, a bag and clouds, less one after the other, and then
less the soil or less the mechanism (the same tool on a path). All variants of a table run by turns, so other
load affects them alike; medians of the rounds, changes being those of the same round. Prints the features
whose fall the rounds do not resolve; ends with status 1 if a cost rises in every round.
"""

import argparse
import json
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import trimesh
import yaml

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.observer import RunWatch
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.dem.build import build_engine
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import ToolMotion
from validation.laboratory import WET_BOUNDARY, WET_PARTICLE

SCENES = Path(__file__).parents[1] / "config" / "scenes"
STEPS, TICKS, WARM_UP_TICKS = 150, 500, 20
"""Of a round."""

SOIL_UNIT, RUN_UNIT = "ns per particle and step", "us per tick"

Turn = Callable[[], float]
"""Does a round, gives its CPU time per unit [s]."""

Rows = list[dict[str, Any]]


def soils(folder: Path) -> list[tuple[str, dict[str, Any]]]:
    """Keys of `soil`, from all features to none."""
    trimesh.creation.box((0.02, 0.06, 0.2)).export(folder / "plate.stl")
    soft = {"law": {"kind": "cohesive_linear", "particle": {"stiffness_newton_per_m": 9e3}}}
    keys: dict[str, Any] = {
        "bin": {"length_m": 0.4, "width_m": 0.24, "depth_m": 0.24, "sides": "periodic"},
        "particles": {
            "sizes": {"kind": "uniform", "min_radius_m": 0.0085, "max_radius_m": 0.0115},
            "density_kg_per_m3": 1800.0,
        },
        "bed": {"kind": "dense_random"},
        "law": {"kind": "cohesive_linear", "particle": WET_PARTICLE, "boundary": WET_BOUNDARY},
        "layers": [{"name": "upper", "thickness_m": 0.12, **soft}, {"name": "lower"}],
        "time_step_s": 2.5e-5,
        "monitors": {"max_energy_defect": 0.5},
    }
    found = [("all: energy book, sizes, layers, periodic, rolling, adhesion, tangential", dict(keys))]

    def less(name: str, **changes: Any) -> None:
        for key, value in changes.items():
            if value is None:
                keys.pop(key, None)
            else:
                keys[key] = value
        found.append((f"less {name}", dict(keys)))

    def law(**values: float) -> dict[str, Any]:
        of = keys["law"]
        return {
            "kind": "cohesive_linear",
            "particle": of["particle"] | values,
            "boundary": of["boundary"] | values,
        }

    less("energy book", monitors=None)
    less("sizes", particles={"radius_m": 0.01, "density_kg_per_m3": 1800.0})
    less("layers", layers=None)
    less("periodic sides", bin=keys["bin"] | {"sides": "walls"})
    less("rolling friction", law=law(rolling_friction=0.0))
    less("adhesion", law=law(cohesive_stiffness_newton_per_m=0.0))
    less(
        "tangential springs",
        law=law(tangential_stiffness_newton_per_m=0.0, tangential_damping_newton_s_per_m=0.0),
    )
    return found


def soil_variants(folder: Path) -> list[tuple[str, str, Turn]]:
    """(name, name of the line above, a round) of every bed."""
    variants = soils(folder)
    names = ["", *(name for name, _ in variants)]
    found = [
        (name, above, soil_turn(name, keys, folder))
        for (name, keys), above in zip(variants, names, strict=False)
    ]
    found.append(("less tool", names[-1], soil_turn("less tool", variants[-1][1], folder, tool=False)))
    return found


def soil_turn(name: str, keys: dict[str, Any], folder: Path, tool: bool = True) -> Turn:
    """Rounds of a bed with a plate dragged through it."""
    document: dict[str, Any] = {"name": "features", "duration_s": 100.0, "soil": keys}
    if tool:
        document["tools"] = {"plate": {"path": {}, "groups": {"plate": {"mesh": "plate.stl"}}}}
    path = folder / f"{abs(hash(name))}.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    resolved = load_scene(path)
    engine, step_s, done = build_engine(resolved), resolved.timing.soil_step_s, 0

    def motions() -> tuple[ToolMotion, ...]:
        return (
            (ToolMotion("plate", 0.08 + 0.5 * step_s * done, 0.0, -0.04, 0.0, 0.5, 0.0, 0.0),) if tool else ()
        )

    engine.start(motions())

    def turn() -> float:
        nonlocal done
        start = time.process_time()
        for _ in range(STEPS):
            done += 1
            engine.advance(done - 1, motions())
        return (time.process_time() - start) / STEPS / engine.particle_count

    turn()  # compiles
    return turn


def runs(folder: Path) -> list[tuple[str, str, Turn]]:
    """Whole runs of the machine in a small bin, and of its parts: (name, name of what has more, a round)."""
    changes = [
        "soil.bin.length_m=0.5",
        "soil.bin.width_m=0.2",
        "mechanism.initial.translate_x_m=0.05",
        "record.cloud_hz=200.0",
    ]
    found: list[tuple[str, str, Turn]] = []

    def add(name: str, above: str, further: Sequence[str]) -> None:
        resolved = load_scene(SCENES / "subsoiler_1s300_draft_limit.yaml", [*changes, *further])
        timing = replace(resolved.timing, tick_count=TICKS)
        found.append((name, above, run_turn(replace(resolved, timing=timing), folder / str(len(found)))))

    def less(name: str, further: Sequence[str]) -> None:
        add(name, found[-1][0] if found else "", further)
        changes.extend(further)

    less("machine, soil, bag, clouds, controller", [])
    communication_step_ns = load_scene(
        SCENES / "subsoiler_1s300_draft_limit.yaml", changes
    ).timing.communication_step_ns
    changes.append(f"coupling.communication_step_ns={communication_step_ns}")
    less("less controller", ["controller=null"])
    less("less clouds", ["record.cloud_hz=0.0"])
    less("less bag", ["record.bag=false"])
    bare = found[-1][0]
    machine = ["soil=null", "tools=null"]
    for name, further in (
        ("less soil", []),
        (
            "less soil and ground of the wheels",
            [f"mechanism.forces.ground_{s}=null" for s in ("left", "right")],
        ),
        ("less soil, ground and spring", ["mechanism.forces.H9_spring=null", "report.spring=null"]),
    ):
        machine += further
        add(name, found[-1][0], machine)
    add(
        "less mechanism",
        bare,
        [
            "mechanism=null",
            "report={shank: null, spring: null}",
            "tools.shank.body=null",
            "tools.shank.path={start_x_m: 0.05, speed_x_m_per_s: {kind: constant, value: 0.5}}",
        ],
    )
    return found


def run_turn(resolved: ResolvedScene, folder: Path) -> Turn:
    """Rounds of a direct run with all that its scene names; ticks that load kernels do not count."""

    def turn() -> float:
        started = 0.0

        def on_tick(tick: int) -> None:
            nonlocal started
            if tick == WARM_UP_TICKS - 1:
                started = time.process_time()

        bag = folder if resolved.scene.record.bag else None
        try:
            simulate(RunSettings(resolved, bag=bag), observer=RunWatch(on_tick))
            return (time.process_time() - started) / (resolved.timing.tick_count - WARM_UP_TICKS)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    turn()
    return turn


def by_turns(variants: Sequence[tuple[str, str, Turn]], rounds: int, unit: str, scale: float) -> Rows:
    """Median of every variant, and of what it costs less than the one above in the same round."""
    found: dict[str, list[float]] = {name: [] for name, _, _ in variants}
    for _ in range(rounds):
        for name, _, turn in variants:
            found[name].append(scale * turn())
    rows: Rows = []
    for name, above, _ in variants:
        row: dict[str, Any] = {"variant": name, unit: statistics.median(found[name])}
        if above:
            falls = [before - here for before, here in zip(found[above], found[name], strict=True)]
            row |= {"falls by": statistics.median(falls), "from": min(falls), "to": max(falls)}
        rows.append(row)
    return rows


def print_table(rows: Rows, unit: str) -> None:
    """Markdown."""
    print(f"\n| | {unit} | falls by (least to largest of the rounds) |\n|---|---|---|")
    for row in rows:
        fall = f"{row['falls by']:.1f} ({row['from']:.1f} to {row['to']:.1f})" if "falls by" in row else ""
        print(f"| {row['variant']} | {row[unit]:.1f} | {fall} |")


def main() -> int:
    """Measures both tables; 1 if a cost did not fall."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tables = {
            SOIL_UNIT: by_turns(soil_variants(folder), args.rounds, SOIL_UNIT, 1e9),
            RUN_UNIT: by_turns(runs(folder), args.rounds, RUN_UNIT, 1e6),
        }
    for unit, rows in tables.items():
        print_table(rows, unit)
    if args.json is not None:
        args.json.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")
    risen = [row["variant"] for rows in tables.values() for row in rows if row.get("to", 1.0) <= 0.0]
    for row in (row for rows in tables.values() for row in rows if row.get("from", 1.0) <= 0.0):
        if row["variant"] not in risen:
            print(f"no fall that these rounds resolve: {row['variant']}", file=sys.stderr)
    for variant in risen:
        print(f"rises in every round: {variant}", file=sys.stderr)
    return 1 if risen else 0


if __name__ == "__main__":
    sys.exit(main())
