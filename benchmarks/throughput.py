"""Throughput of the engines on their own, without ROS and without recording: one line of JSON for each."""

import json
import os
import time
from pathlib import Path

from subsoil_ros.coupling.engines import build_mechanism, build_paths, build_soil
from subsoil_ros.scene.loader import load_scene

SCENES = Path(__file__).parents[1] / "config" / "scenes"
WARM_UP_TICKS = 50  # the kernels are compiled in the first
TICKS = 1000


def soil_throughput(scene: str, threads: int) -> dict[str, float]:
    """Particle steps per second of wall time, the tool moving as the scene says."""
    resolved = load_scene(SCENES / scene)
    paths = build_paths(resolved)
    soil = build_soil(resolved, threads)
    soil.start(paths.initial_motions())
    for tick in range(WARM_UP_TICKS):
        soil.advance(tick, paths.advance(tick, ()))
    start = time.perf_counter()
    for tick in range(WARM_UP_TICKS, WARM_UP_TICKS + TICKS):
        soil.advance(tick, paths.advance(tick, ()))
    seconds = time.perf_counter() - start
    end_tick = WARM_UP_TICKS + TICKS - 1
    particles = soil.state("bench", end_tick, end_tick * resolved.timing.interval_ns).particle_count
    steps = TICKS * resolved.timing.soil_steps
    return {"particles": particles, "threads": threads, "particle_steps_per_s": particles * steps / seconds}


def mechanism_throughput(scene: str) -> dict[str, float]:
    """Ticks and integration steps per second of wall time, no wrench applied."""
    resolved = load_scene(SCENES / scene)
    mechanism = build_mechanism(resolved)
    mechanism.initial_motions()
    for tick in range(WARM_UP_TICKS):
        mechanism.advance(tick, ())
    start = time.perf_counter()
    for tick in range(WARM_UP_TICKS, WARM_UP_TICKS + TICKS):
        mechanism.advance(tick, ())
    seconds = time.perf_counter() - start
    return {
        "ticks_per_s": TICKS / seconds,
        "steps_per_s": TICKS * resolved.timing.mechanism_steps / seconds,
    }


def main() -> None:
    """Prints the throughput of each engine."""
    for threads in sorted({1, len(os.sched_getaffinity(0))}):
        print(json.dumps({"engine": "soil", **soil_throughput("tine.yaml", threads)}), flush=True)
    print(json.dumps({"engine": "mechanism", **mechanism_throughput("mechanism_only.yaml")}), flush=True)


if __name__ == "__main__":
    main()
