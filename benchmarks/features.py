"""Cost of a scene, one feature after the other taken away: it must fall with each.

    python benchmarks/features.py [--rounds N] [--json FILE]

The first table is the soil alone: CPU time per particle and step of a plate dragged through beds of the same
size. Each line has what the line above has, less one feature. The second is a whole run: CPU time per tick,
direct, of the machine in a small bin, less recorder, less soil or less mechanism. All variants of a table run
by turns, so other load meets them alike; medians of the rounds.
"""

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import trimesh
import yaml

from subsoil_ros.coupling.direct import RecordSink
from subsoil_ros.coupling.engines import build_mechanism, build_paths, build_soil
from subsoil_ros.dem.bench.cases import WET_BOUNDARY, WET_PARTICLE
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.messages import SoilCloud, ToolMotion, ToolMotions, ToolWrenches
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.scene.loader import ResolvedScene, load_scene
from subsoil_ros.ticks import tick_end_ns

SCENES = Path(__file__).parents[1] / "config" / "scenes"
STEPS, TICKS = 150, 100
"""Of a round."""

Turn = Callable[[], float]
"""Does a round, gives its CPU time per unit [s]."""


def soils(folder: Path) -> list[tuple[str, dict[str, Any]]]:
    """Keys of `soil`, from all features to none."""
    trimesh.creation.box((0.02, 0.06, 0.2)).export(folder / "plate.stl")
    soft = {"law": {"kind": "wet", "particle": {"stiffness_newton_per_m": 9e3}}}
    keys: dict[str, Any] = {
        "bin": {"length_m": 0.4, "width_m": 0.24, "depth_m": 0.24, "sides": "periodic"},
        "particles": {
            "sizes": {"kind": "uniform", "smallest_radius_m": 0.0085, "largest_radius_m": 0.0115},
            "density_kg_per_m3": 1800.0,
        },
        "bed": {"kind": "dense_random"},
        "law": {"kind": "wet", "particle": WET_PARTICLE, "boundary": WET_BOUNDARY},
        "layers": [{"name": "upper", "thickness_m": 0.12, **soft}, {"name": "lower"}],
        "time_step_s": 2.5e-5,
        "monitors": {"largest_energy_defect": 0.5},
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
        return {"kind": "wet", "particle": of["particle"] | values, "boundary": of["boundary"] | values}

    less("energy book", monitors=None)
    less("sizes", particles={"radius_m": 0.01, "density_kg_per_m3": 1800.0})
    less("layers", layers=None)
    less("periodic sides", bin=keys["bin"] | {"sides": "walls"})
    less("rolling friction", law=law(rolling_friction=0.0))
    less("adhesion", law=law(adhesion_newton_per_m=0.0))
    less(
        "tangential springs",
        law=law(tangential_stiffness_newton_per_m=0.0, tangential_damping_newton_s_per_m=0.0),
    )
    return found


def soil_turn(name: str, keys: dict[str, Any], folder: Path, tool: bool = True) -> Turn:
    """Rounds of a bed with a plate dragged through it."""
    document: dict[str, Any] = {"name": "features", "duration_s": 100.0, "soil": keys}
    if tool:
        document["tools"] = {"plate": {"path": {}, "groups": {"plate": {"mesh": "plate.stl"}}}}
    path = folder / f"{abs(hash(name))}.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    resolved = load_scene(path)
    engine, step_s, done = SoilEngine(resolved), resolved.timing.soil_step_s, 0

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


class _WithoutClouds:
    """A writer's sink that leaves clouds out: they are due at other ticks than the rest."""

    def __init__(self, writer: BagWriter) -> None:
        self._writer = writer

    def write(self, record: Any) -> None:
        if not isinstance(record, SoilCloud):
            self._writer.write(record)


def run_turn(resolved: ResolvedScene, bag: Path | None) -> Turn:
    """Rounds of a direct run; the record has lockstep messages and series."""
    mechanism, soil = build_mechanism(resolved), build_soil(resolved, 1)
    mover = mechanism or build_paths(resolved)
    sink: RecordSink | None = None
    if bag is not None:
        sink = _WithoutClouds(BagWriter(bag, resolved.scene, resolved.timing))
    motions, done = mover.initial_motions(), 0
    wrenches = soil.start(motions) if soil is not None else ()
    series = resolved.scene.record.series_ticks

    def turn() -> float:
        nonlocal done, motions, wrenches
        start = time.process_time()
        for tick in range(done, done + TICKS):
            motions = mover.advance(tick, wrenches)
            if soil is not None:
                wrenches = soil.advance(tick, motions)
            if sink is None:
                continue
            end_ns = tick_end_ns(tick, resolved.timing.interval_ns)
            sink.write(ToolMotions("run", tick, end_ns, motions))
            if soil is not None:
                sink.write(ToolWrenches("run", tick, end_ns, wrenches))
            if (tick + 1) % series == 0:
                for engine in (mechanism, soil):
                    if engine is not None:
                        sink.write(engine.state("run", tick, end_ns))
        done += TICKS
        return (time.process_time() - start) / TICKS

    turn()
    return turn


def runs(folder: Path) -> dict[str, Turn]:
    """Whole runs of the machine in a small bin, and of its parts."""
    small = ["soil.bin.length_m=0.5", "soil.bin.width_m=0.2", "mechanism.initial.translate_x_m=0.05"]
    coarse = ["record.series_ticks=20", "duration_s=1000"]
    whole = load_scene(SCENES / "subsoiler_1s300_quick.yaml", [*small, *coarse])
    interval = f"coupling.interval_ns={whole.timing.interval_ns}"
    machine = load_scene(SCENES / "mechanism_only.yaml", [interval, *coarse])
    tine = load_scene(
        SCENES / "tine.yaml",
        ["soil.bin={length_m: 0.5, width_m: 0.2, depth_m: 0.4}", "tools.tine.path.start_x_m=-0.05", *coarse],
    )
    return {
        "machine, soil, recorder": run_turn(whole, folder / "whole"),
        "less recorder": run_turn(whole, None),
        "less mechanism": run_turn(tine, None),
        "less soil": run_turn(machine, None),
    }


def by_turns(turns: dict[str, Turn], rounds: int) -> dict[str, float]:
    """Median of every variant [s]."""
    found: dict[str, list[float]] = {name: [] for name in turns}
    for _ in range(rounds):
        for name, turn in turns.items():
            found[name].append(turn())
    return {name: statistics.median(values) for name, values in found.items()}


def main() -> None:
    """Measures both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        variants = soils(folder)
        turns = {variant: soil_turn(variant, keys, folder) for variant, keys in variants}
        turns["less tool"] = soil_turn("less tool", variants[-1][1], folder, tool=False)
        soil = {name: 1e9 * value for name, value in by_turns(turns, args.rounds).items()}
        whole = {name: 1e6 * value for name, value in by_turns(runs(folder), args.rounds).items()}
    print("| soil | ns per particle and step |\n|---|---|")
    for name, value in soil.items():
        print(f"| {name} | {value:.1f} |")
    print("\n| run | us per tick |\n|---|---|")
    for name, value in whole.items():
        print(f"| {name} | {value:.1f} |")
    if args.json is not None:
        args.json.write_text(
            json.dumps({"soil_ns": soil, "run_us": whole}, indent=1) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
