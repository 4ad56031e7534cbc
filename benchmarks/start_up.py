"""Time from the start of the process to the end of the first soil step, direct mode, kernels compiled before.

    python benchmarks/start_up.py [SCENE]

Runs it five times in fresh processes and prints one JSON object: medians of CPU and wall time [s], by stage.
"""

import argparse
import json
import statistics
import subprocess
import sys
import time
from pathlib import Path

SCENE = Path(__file__).parents[1] / "config/scenes/subsoiler_1s300_quick.yaml"
REPEATS = 5


def first_step(scene: str, started: float) -> None:
    """What `subsoil run --mode direct` does until the first step is done; prints (stage, CPU s, wall s)."""
    stages = []

    def lap(stage: str) -> None:
        stages.append((stage, time.process_time(), time.monotonic() - started))

    from subsoil_ros.coupling.engines import build_motion_source, build_soil
    from subsoil_ros.loading.loader import load_scene

    lap("imports")
    resolved = load_scene(scene)
    lap("scene")
    motion_source = build_motion_source(resolved)
    lap("mechanism")
    soil = build_soil(resolved, 1)
    if soil is None:
        raise SystemExit(f"{scene}: has no soil, so it has no first soil step")
    wrenches = soil.start(motion_source.initial_motions())
    lap("bed")
    soil.advance(0, motion_source.advance(0, wrenches))
    lap("first step")
    print(json.dumps(stages))


def main() -> None:
    """Prints the medians; the first process, which may have to compile, does not count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("scene", nargs="?", default=str(SCENE))
    scene = parser.parse_args().scene
    runs = []
    for _ in range(REPEATS + 1):
        command = [sys.executable, __file__, "--child", scene, repr(time.monotonic())]
        runs.append(json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
    result = {}
    for k, (stage, _, _) in enumerate(runs[0]):
        cpu, wall = (statistics.median(run[k][column] for run in runs[1:]) for column in (1, 2))
        result[stage] = {"cpu_s": cpu, "wall_s": wall}
    print(json.dumps(result))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        first_step(sys.argv[2], float(sys.argv[3]))
    else:
        main()
