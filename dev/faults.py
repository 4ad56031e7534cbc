"""Many runs, each with one fault at a random moment: python -m dev.faults [--runs N] [--seed S]

A small scene as separate nodes under `subsoil run`. Every run must end by itself, with the right exit status
and one message that names the cause, leave no process behind and a bag that can be read with every tick
once, if need be after recovery. Prints a line per run, then a table by kind, as Markdown.
"""

import argparse
import fcntl
import json
import os
import pty
import random
import re
import resource
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
from mcap.reader import make_reader

from subsoil_ros.loading.loader import load_scene
from subsoil_ros.recording.recovery import recover

SCENE = Path(__file__).parents[1] / "config/scenes/subsoiler_1s300_quick.yaml"
CHANGES = {
    "duration_s": 600.0,
    "soil.bin.length_m": 0.4,
    "soil.bin.width_m": 0.15,
    "soil.bin.depth_m": 0.25,
    "mechanism.initial.translate_x_m": 0.05,
    "record.series_ticks": 5,
    "record.cloud_hz": 200,
}
NODES = ("mechanism", "soil", "recorder", "coupler")
START_LIMIT_S, END_LIMIT_S = 240.0, 90.0
LATEST_S = 3.0
"""Faults come up to so long after the first chunk of the bag."""


@dataclass(frozen=True)
class Kind:
    """A kind of fault."""

    name: str
    inject: Callable[["Run"], None]
    exit_status: int
    words: str  # a pattern in the last line of standard error
    set_up: str = ""  # terminal, disk


@dataclass(frozen=True)
class Outcome:
    """What became of a run."""

    kind: str
    end_s: float  # from the fault to the end of the last process
    silence_s: float  # of that, waited before a silent participant was taken for lost
    faults: tuple[str, ...]  # what was not as it should be


def take_terminal() -> None:
    """In the child: standard input is its terminal, whose hanging up is not ignored, as under nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


class Run:
    """One `subsoil run` and what it consists of."""

    def __init__(self, folder: Path, set_up: str) -> None:
        self.out = folder / "out"
        self._others: list[subprocess.Popen[bytes]] = []
        self._master = -1
        changes = [item for key, value in CHANGES.items() for item in ("--set", f"{key}={value}")]
        command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", str(SCENE), "--out", str(self.out)]
        self._words = folder.parent / "stderr"
        if set_up == "terminal":
            self._master, slave = pty.openpty()
            threading.Thread(target=self._drain, daemon=True).start()
            self.process = subprocess.Popen(
                [*command, *changes], stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
                preexec_fn=take_terminal,
            )  # fmt: skip
            os.close(slave)
        else:
            with self._words.open("wb") as stream:
                self.process = subprocess.Popen(
                    [*command, *changes], stdout=subprocess.DEVNULL, stderr=stream, start_new_session=True
                )
        self.pids: dict[str, int] = {}

    def _drain(self) -> None:
        with suppress(OSError):
            while os.read(self._master, 65536):
                pass

    def close_terminal(self) -> None:
        """The user closes the window."""
        os.close(self._master)

    def wait_until_recording(self) -> None:
        """Until the first chunks of the bag are on the disk."""
        deadline = time.monotonic() + START_LIMIT_S
        while self.bag_bytes() < 60_000:
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"the run did not start: {self.last_words()}")
            time.sleep(0.05)
        self.pids = _children(self.process.pid)

    def bag_bytes(self) -> int:
        """Size of the bag."""
        return sum(path.stat().st_size for path in self.out.glob("bag/*.mcap"))

    def start_other(self, *arguments: str) -> None:
        """A foreign node in the same domain."""
        environment = psutil.Process(self.pids["coupler"]).environ()
        devnull = subprocess.DEVNULL
        self._others.append(
            subprocess.Popen([sys.executable, *arguments], env=environment, stdout=devnull, stderr=devnull)
        )

    def run_id(self) -> str:
        """As the nodes were told."""
        words = " ".join(psutil.Process(self.pids["coupler"]).cmdline())
        return re.search(r'run_id:="?(\w+)', words).group(1)  # type: ignore[union-attr]

    def wait(self) -> bool:
        """Until all processes of the run are gone; False if that takes too long."""
        deadline = time.monotonic() + END_LIMIT_S
        while self.left() or self.process.poll() is None:
            if time.monotonic() > deadline:
                return False
            time.sleep(0.02)
        return True

    def left(self) -> list[str]:
        """Nodes that still run."""
        return [name for name, pid in self.pids.items() if _runs(pid)]

    def last_words(self) -> str:
        """The last line that the user saw, or the summary's if there was no terminal to see it."""
        if self._words.exists():
            lines = self._words.read_text(errors="replace").strip().splitlines()
            return lines[-1] if lines else ""
        with suppress(OSError):
            return str(json.loads((self.out / "summary.json").read_text())["run"]["failure"])
        return ""

    def end(self) -> None:
        """Leaves nothing behind, whatever was found; a foreign publisher must end by itself if it can."""
        for other in self._others:
            with suppress(subprocess.TimeoutExpired):
                other.wait(0.0 if _is_stopped(other.pid) else 10.0)
            other.kill()
            other.wait()
        for pid in (self.process.pid, *self.pids.values()):
            if _runs(pid):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()


def _state(pid: int) -> str:
    try:
        return psutil.Process(pid).status()
    except psutil.NoSuchProcess:
        return psutil.STATUS_DEAD


def _runs(pid: int) -> bool:
    return _state(pid) not in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)


def _is_stopped(pid: int) -> bool:
    return _state(pid) == psutil.STATUS_STOPPED


def _children(parent: int) -> dict[str, int]:
    pids = {}
    for child in psutil.Process(parent).children():
        module = next(word for word in child.cmdline() if word.startswith("subsoil_ros.ros.nodes."))
        pids[module.rpartition(".")[2].removesuffix("_node")] = child.pid
    return pids


def _send(name: str, number: signal.Signals) -> Callable[[Run], None]:
    return lambda run: os.kill(run.pids[name], number)


def _second_soil(run: Run) -> None:
    scene = run.out / "scene.yaml"
    run.start_other(
        "-m", "subsoil_ros.ros.nodes.soil_node", "--ros-args", "-p", f"scene:={scene}",
        "-p", f"run_id:='{run.run_id()}'",
    )  # fmt: skip


def _foreign(kind: str) -> Callable[[Run], None]:
    return lambda run: run.start_other("-m", "dev.intruder", kind, run.run_id())


def _slow_listener(run: Run) -> None:
    """No fault: the run goes on, until it is asked to end."""
    run.start_other("-m", "dev.intruder", "slow")
    time.sleep(4.0)
    before = run.bag_bytes()
    time.sleep(4.0)
    if run.bag_bytes() <= before:
        raise RuntimeError("a listener that stands still held the run up")
    run.process.send_signal(signal.SIGTERM)


def _fill_disk(run: Run) -> None:
    """Leaves the recorder some more chunks."""
    disk = os.statvfs(run.out)
    room = disk.f_bavail * disk.f_frsize
    with (run.out / "filler").open("wb") as stream:
        stream.write(b"\0" * max(0, room - random.randrange(150_000)))


def kinds() -> list[Kind]:
    """All kinds of fault that can be made here; a full disk needs root for a small file system."""
    foreign = "tool_wrenches|two nodes|publishes on it|finite|residual"
    found = [
        *(Kind(f"kill {name}", _send(name, signal.SIGKILL), 3, f"{name} node .*SIGKILL") for name in NODES),
        *(
            Kind(f"stop {name}", _send(name, signal.SIGSTOP), 3, f"{name} (has not been heard|.*killed)")
            for name in NODES
        ),
        Kind("second soil", _second_soil, 3, "two nodes 'soil'|node '/soil.* publishes on it"),
        *(
            Kind(f"foreign {what}", _foreign(f"foreign_{what}"), 3, foreign)
            for what in ("run", "tick", "nan", "tools")
        ),
        Kind("slow listener", _slow_listener, 143, "ended by SIGTERM"),
        Kind("supervisor killed", lambda run: run.process.kill(), -9, ""),
        Kind("terminal closed", lambda run: run.close_terminal(), 3, "terminal was closed", "terminal"),
    ]  # fmt: skip
    if os.geteuid() == 0:
        found.append(Kind("disk full", _fill_disk, 3, "No space left", "disk"))
    return found


@contextmanager
def _place(set_up: str) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="subsoil_faults_") as name:
        folder = Path(name) / "place"
        folder.mkdir()
        if set_up != "disk":
            yield folder
            return
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "none", str(folder)], check=True)
        try:
            yield folder
        finally:
            subprocess.run(["umount", "-l", str(folder)], check=True)


def one_run(kind: Kind, delay_s: float) -> Outcome:
    """Starts a run, makes the fault, looks at what is left."""
    with _place(kind.set_up) as folder:
        run = Run(folder, kind.set_up)
        faults = []
        try:
            run.wait_until_recording()
            time.sleep(delay_s)
            begin = time.monotonic()
            kind.inject(run)
            if kind.name == "slow listener":
                begin = time.monotonic()
            if not run.wait():
                faults.append("did not end")
            end_s = time.monotonic() - begin
            if run.left():
                faults.append(f"left running: {', '.join(run.left())}")
            words = run.last_words()
            if run.process.poll() != kind.exit_status:
                faults.append(f"exit status {run.process.poll()}")
            if kind.words and not re.search(kind.words, words):
                faults.append(f"said: {words}")
            faults += _bag_faults(run.out, Path(folder.parent) / "copy")
        finally:
            run.end()
    silence = re.search(r"heard of for ([0-9.]+) s", words)
    return Outcome(kind.name, end_s, float(silence.group(1)) if silence else 0.0, tuple(faults))


def _bag_faults(out: Path, copy: Path) -> list[str]:
    """What is wrong with the bag, mended elsewhere where it has no end."""
    shutil.copytree(out / "bag", copy)
    try:
        recover(copy)
        (path,) = copy.glob("*.mcap")
        communication_step_ns = load_scene(out / "scene.yaml").timing.communication_step_ns
        ticks: dict[str, list[int]] = {"grant": [], "tool_motions": [], "tool_wrenches": []}
        with path.open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
                name = channel.topic.rpartition("/")[2]
                if name in ticks and message.log_time > 0:  # at 0 stands the state before tick 0
                    ticks[name].append(message.log_time // communication_step_ns - 1)
    except Exception as error:  # whatever it is, it goes into the table
        return [f"bag: {type(error).__name__}: {error}"]
    lengths = [len(numbers) for numbers in ticks.values()]
    whole = all(numbers == list(range(len(numbers))) for numbers in ticks.values())
    if not whole or min(lengths) == 0 or max(lengths) - min(lengths) > 1:
        return [f"bag: ticks are not one after another: {lengths}"]
    return []


def main() -> int:
    """Runs them all. Returns 1 if one was not as it should be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="kinds whose name has this in it")
    args = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    rng = random.Random(args.seed)
    wanted = [kind for kind in kinds() if args.only in kind.name]
    outcomes: list[Outcome] = []
    for number in range(args.runs):
        kind = wanted[number % len(wanted)]
        try:
            outcome = one_run(kind, rng.uniform(0.0, LATEST_S))
        except RuntimeError as error:
            outcome = Outcome(kind.name, 0.0, 0.0, (str(error),))
        outcomes.append(outcome)
        print(
            f"{number + 1:4d} {kind.name:18s} {outcome.end_s:6.2f} s {outcome.faults or 'as it should'}",
            flush=True,
        )
    print(
        "\n| fault | runs | as it should | from detection to the end, median [s] | longest [s] |"
        "\n|---|---|---|---|---|"
    )
    for kind in wanted:
        mine = [outcome for outcome in outcomes if outcome.kind == kind.name]
        if mine:
            after = [outcome.end_s - outcome.silence_s for outcome in mine]
            good = sum(not outcome.faults for outcome in mine)
            print(
                f"| {kind.name} | {len(mine)} | {good} | {statistics.median(after):.1f} | {max(after):.1f} |"
            )
    return int(any(outcome.faults for outcome in outcomes))


if __name__ == "__main__":
    raise SystemExit(main())
