"""A made-up run that grows in step with the clock: python -m tests.system.growing_run FOLDER PARTICLES HZ"""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from subsoil_ros import messages
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.recording.bag_writer import open_bag
from subsoil_ros.workbench.project import Project
from subsoil_ros.yaml_document import dump_yaml

ENDLESS_S = 1e6


def write(folder: Path, particles: int, hz: float, lasts_s: float = ENDLESS_S) -> None:
    """Write a noisy draft every 10 ms, and clouds in which a wave goes to and fro; then close the bag."""
    resolved = load_scene("field_tine", ["duration_s=100", "stop_when=null"])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.yaml").write_text(dump_yaml(resolved.document), encoding="utf-8")
    step_ns, series = resolved.timing.communication_step_ns, resolved.scene.record.series_ticks
    rng = np.random.default_rng(1)
    places = rng.uniform((-1.0, -0.3, -0.3), (1.0, 0.3, 0.0), (particles, 3))
    bag, begun_s, cloud_ticks = (
        open_bag(folder / "bag", resolved),
        time.monotonic(),
        round(1e9 / hz / step_ns),
    )
    for tick in range(series - 1, round(lasts_s * 1e9 / step_ns), series):
        head, time_s = ("run", tick, (tick + 1) * step_ns), (tick + 1) * step_ns * 1e-9
        motion = messages.ToolMotion("tine", 0.5 * time_s, 0.0, 0.1, 0.0, 0.5, 0.0, 0.0)
        wrench = messages.ToolWrench("tine", rng.normal(-900.0, 90.0), *[0.0] * 6, 9)
        bag.write(messages.ToolMotions(*head, (motion,)))
        bag.write(messages.ToolWrenches(*head, (wrench,)))
        bag.write(messages.SoilState(*head, particles))
        bag.write(messages.CouplingReport(*head, *[0.0] * 6))
        if (tick + 1) % cloud_ticks == 0:
            speeds = np.exp(-9.0 * np.abs(places[:, 0] - 0.5 * np.sin(time_s)))
            moved = places + np.outer(speeds, (0.0, 0.0, 0.05)) + np.array((0.5 * time_s, 0.0, 0.0))
            cloud = np.round(moved * 1024.0) / 1024.0  # packs well
            bag.write(messages.SoilCloud(*head[1:], cloud.astype("f4"), speeds.astype("f4")))
            bag.sync()
            time.sleep(max(0.0, begun_s + time_s - time.monotonic()))
    bag.close()


def begin(project: Project, name: str, particles: int, hz: float) -> subprocess.Popen[bytes]:
    """The process of such a run, which the workbench takes for one of its own."""
    words = ["-m", "tests.system.growing_run", str(project.runs / name), str(particles), str(hz)]
    process = subprocess.Popen([sys.executable, *words])
    project.runs.mkdir(exist_ok=True)
    job = {"asked_ns": 0, "scene": "", "words": words, "pid": process.pid}
    (project.runs / f"{name}.job").write_text(json.dumps(job))
    return process


if __name__ == "__main__":
    write(Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
