"""Wall time of a direct run without recording, and its parts: contact, search, tool, integration.

    python benchmarks/scene_phases.py SCENE [--threads N] [--set key=value ...]

Prints one JSON object. The parts are of the wall time after the start; `mechanism` is that of the machine,
`other` that between the kernels.
"""

import argparse
import json
import time

from subsoil_ros.api.beds import prepare_bed_first
from subsoil_ros.cli._shared.bed_preparation import bed_progress
from subsoil_ros.cli._shared.preparation import KernelAnnouncer
from subsoil_ros.coupling.engines import build_motion_source, build_soil
from subsoil_ros.dem.bench.phases import clocked
from subsoil_ros.loading.loader import load_scene


def main() -> None:
    """Runs the scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()
    resolved = load_scene(args.scene, args.overrides)
    prepare_bed_first(resolved, args.threads, bed_progress)
    motion_source = build_motion_source(resolved)
    soil = build_soil(resolved, args.threads)
    if soil is None:
        raise SystemExit(f"{args.scene}: has no soil, so there is nothing to profile")
    with KernelAnnouncer(), clocked(time.perf_counter) as spent:
        wrenches = soil.start(motion_source.initial_motions())
        spent.update(dict.fromkeys(spent, 0.0))
        mechanism_s = 0.0
        start, cpu = time.perf_counter(), time.process_time()
        for tick in range(resolved.timing.tick_count):
            before = time.perf_counter()
            motions = motion_source.advance(tick, wrenches)
            mechanism_s += time.perf_counter() - before
            wrenches = soil.advance(tick, motions)
        wall_s, cpu_s = time.perf_counter() - start, time.process_time() - cpu
    end = resolved.timing.tick_count - 1
    state = soil.state("", end, (end + 1) * resolved.timing.communication_step_ns)
    steps = resolved.timing.tick_count * resolved.timing.soil_steps
    parts = {phase: seconds / wall_s for phase, seconds in spent.items()}
    parts["mechanism"] = mechanism_s / wall_s
    result = {
        "scene": resolved.scene.name,
        "particle_count": state.particle_count,
        "steps": steps,
        "threads": args.threads,
        "rebuild_count": state.rebuild_count,
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "particle_steps_per_wall_s": state.particle_count * steps / wall_s,
        "parts": {**parts, "other": 1.0 - sum(parts.values())},
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
