"""Runs as a user starts them, and what is left of them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from mcap.reader import make_reader

SCENE = Path(__file__).parents[2] / "config/scenes/subsoiler_1s300_quick.yaml"
SMALL = {
    "soil.bin.length_m": 0.4,
    "soil.bin.width_m": 0.15,
    "soil.bin.depth_m": 0.25,
    "mechanism.initial.translate_x_m": 0.05,  # the share stands in the soil
    "coupling.force": "predicted",
    "record.series_ticks": 5,
    "record.cloud_hz": 200,
}
LIMIT_S = 300.0
"""No test waits longer; kernels may have to be compiled."""


def run_arguments(out: Path, mode: str, duration_s: float, *more: str, scene: Path = SCENE) -> list[str]:
    """Arguments of `subsoil` for a short run of the machine in a small bin, or of another scene as it is."""
    values = {**(SMALL if scene == SCENE else {}), "duration_s": duration_s}
    changes = [item for key, value in values.items() for item in ("--set", f"{key}={value}")]
    return ["run", str(scene), "--out", str(out), "--mode", mode, *changes, *more]


def _wait_until(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline, f"waited {LIMIT_S:g} s for {what}"
        time.sleep(0.02)


class Run:
    """A `subsoil run` as a process."""

    def __init__(self, out: Path, mode: str, duration_s: float, *more: str, scene: Path = SCENE) -> None:
        self.out = out
        arguments = run_arguments(out, mode, duration_s, *more, scene=scene)
        command = [sys.executable, "-m", "subsoil_ros.cli.main", *arguments]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )

    def wait_until_recording(self) -> None:
        """Until some chunks of the bag are on the disk."""

        def is_recording() -> bool:
            assert self.process.poll() is None, self.process.communicate()
            return sum(path.stat().st_size for path in self.out.glob("bag/*.mcap")) > 90_000

        _wait_until(is_recording, f"{self.out}/bag")

    def node_pids(self) -> dict[str, int]:
        """Process ids of the nodes that run, by name; none once the run has ended."""
        pids: dict[str, int] = {}
        if not is_alive(self.process.pid):
            return pids
        for child in psutil.Process(self.process.pid).children():
            if not is_alive(child.pid):
                continue
            words = child.cmdline()  # none where it just ends
            if module := next((word for word in words if word.startswith("subsoil_ros.ros.nodes.")), ""):
                pids[module.rpartition(".")[2].removesuffix("_node")] = child.pid
        return pids

    def finish(self) -> tuple[int, str, str]:
        """Exit status, standard output and error."""
        out, err = self.process.communicate(timeout=LIMIT_S)
        return self.process.returncode, out, err

    def end(self, pids: dict[str, int]) -> None:
        """Leaves nothing behind, whatever the test found."""
        for pid in (self.process.pid, *pids.values()):
            if is_alive(pid):
                os.kill(pid, signal.SIGKILL)
        self.process.communicate()


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits to be reaped does not."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def wait_until_gone(pids: dict[str, int]) -> None:
    """Until none of the processes runs."""
    _wait_until(lambda: not any(is_alive(pid) for pid in pids.values()), f"the end of {pids}")


def messages(bag: Path) -> list[tuple[str, int, bytes]]:
    """Topic, time and bytes of every message, in the order of the file, read by mcap's own reader."""
    (path,) = bag.glob("*.mcap")
    with path.open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]


def lockstep_ticks(bag: Path, communication_step_ns: int) -> dict[str, list[int]]:
    """Ticks from 0 on of the lockstep messages in a bag, by topic, in recorded order."""
    ticks: dict[str, list[int]] = {"grant": [], "tool_motions": [], "tool_wrenches": []}
    for topic, time_ns, _ in messages(bag):
        name = topic.rpartition("/")[2]
        if name in ticks and time_ns > 0:
            ticks[name].append(time_ns // communication_step_ns - 1)
    return ticks


@pytest.fixture
def start_run(tmp_path: Path) -> Iterator[Callable[..., tuple[Run, dict[str, int]]]]:
    """Starts a run that records, gives it and its nodes; ends whatever is left."""
    started: list[tuple[Run, dict[str, int]]] = []

    def start(mode: str = "nodes", duration_s: float = 60.0) -> tuple[Run, dict[str, int]]:
        run = Run(tmp_path / "out", mode, duration_s)
        started.append((run, {}))
        run.wait_until_recording()
        pids = run.node_pids()
        started[-1][1].update(pids)
        return run, pids

    yield start
    for run, pids in started:
        run.end(pids)
