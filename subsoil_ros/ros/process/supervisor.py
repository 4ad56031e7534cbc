"""Supervisor of a run: starts one process per node, watches them, and ends all of them."""

import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from ...coupling.exit_status import SIGNAL_STATUS, ExitStatus, interrupted
from ...coupling.observer import RunObserver
from ...coupling.protocol import COUPLER, RECORDER
from ...coupling.time_limits import CUT_PATIENCE_S, END_S, FAILED_END_S, KEEP_S, STARTUP_GRACE_S, VERDICT_S
from ...errors import RunError
from ..transport.shared_memory import sweep_shared_memory
from .mpi import under_mpi
from .node_plan import Parameters, ros_arguments

_POLL_S = 0.05

_LOGGED_ERROR = re.compile(r"\[(ERROR|FATAL)\] \[[\d.]+\] \[[^]]*\]: (?P<words>.*)")
"""An error as rclpy logs it."""


@dataclass(frozen=True)
class NodeProcess:
    """A node's process and its log."""

    name: str
    popen: subprocess.Popen[str]
    log: Path

    @property
    def exit_status(self) -> int | None:
        """None while it runs; negative: ended by that signal."""
        return self.popen.poll()

    @property
    def stands_still(self) -> bool:
        """Whether it was stopped (SIGSTOP) and cannot end by itself."""
        try:
            return psutil.Process(self.popen.pid).status() == psutil.STATUS_STOPPED
        except psutil.NoSuchProcess:
            return False

    @property
    def lost_rank(self) -> bool:
        """Whether mpiexec ended it because one of its ranks was killed or failed."""
        text = self.log.read_text(encoding="utf-8", errors="replace")
        return "BAD TERMINATION" in text and not any(map(_LOGGED_ERROR.fullmatch, text.splitlines()))

    def send_stop(self, status: ExitStatus) -> None:
        """Send a stop request to the node."""
        self._send(json.dumps({"stop": status.reason, "exit_status": status.code}) + "\n")

    def _send(self, line: str) -> None:
        if self.popen.stdin is not None:
            with suppress(BrokenPipeError):  # it has ended
                os.write(self.popen.stdin.fileno(), line.encode())  # past the buffer, so that none is left

    def last_words(self) -> str:
        """The last error in its log, or else its last line."""
        lines = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        errors = [found for line in lines if (found := _LOGGED_ERROR.fullmatch(line))]
        if errors:
            return f"{self.name}: {errors[-1]['words']}"
        if self.lost_rank:
            return f"{self.name}: a rank of MPI ended before the run did; its log is {self.log}"
        return lines[-1] if lines else "it left no message"


def node_program(name: str) -> tuple[str, ...]:
    """The Python program of a node."""
    return ("-m", f"subsoil_ros.ros.nodes.{name}_node")


def start_node(
    name: str, program: Sequence[str], log: Path, parameters: Parameters, domain: int, namespace: str = ""
) -> NodeProcess:
    """Starts a node in a session of its own, so that a Ctrl-C of the terminal reaches only this process."""
    command = [sys.executable, *program, *ros_arguments(parameters, namespace)]
    ranks = int(parameters.get("ranks", 1))
    if ranks > 1:
        command = under_mpi(command, ranks)
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ, "ROS_DOMAIN_ID": str(domain)}
    with log.open("w", encoding="utf-8") as stream:
        popen = subprocess.Popen(
            command,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE if name == COUPLER else stream,
            stderr=stream,
            text=True,
            start_new_session=True,
        )
    return NodeProcess(name, popen, log)


class Supervisor:
    """Supervises the processes of one run to its end.

    Each node reads a pipe from this process: if this process is killed, the pipe closes and the nodes end.
    """

    def __init__(
        self,
        processes: list[NodeProcess],
        observer: RunObserver,
    ) -> None:
        """observer: receives ticks and checks, and is asked many times a second for a signal."""
        self._processes = processes
        self._observer = observer
        self._coupler = next(process for process in processes if process.name == COUPLER)
        self._events: queue.Queue[dict] = queue.Queue()
        self._verdict: ExitStatus | None = None
        self._failed: tuple[float, NodeProcess] | None = None
        self._progressed = False
        self._deadline = float("inf")  # then the remaining processes are killed
        self._coupler_end: float | None = None
        self._asked: set[str] = set()  # nodes asked to end after the coupler
        self._reader = threading.Thread(target=self._read_events, daemon=True)
        self._reader.start()

    def follow(self) -> ExitStatus:
        """Wait for the end of the run. On return no process is left."""
        status: ExitStatus | None = None
        requested: ExitStatus | None = None
        try:
            while any(process.exit_status is None for process in self._processes):
                self._take_events()
                if requested is None and (number := self._observer.stop_signal()):
                    requested = interrupted(number)
                    if status is None:
                        self._end_coupler(requested)
                    else:
                        self._coupler.send_stop(requested)  # wait for no late program
                if status is None:
                    status = self._cause()
                    if status is not None:
                        self._end_coupler(status)
                if status is not None:
                    self._kill_who_stands_still()
                if self._coupler.exit_status is not None:
                    self._end_others(status or requested)
                if time.monotonic() > self._deadline:
                    break
        finally:
            killed = self._kill_remaining()
        status = status or requested
        if status is None and killed:
            status = ExitStatus(
                RunError.exit_status, f"{killed} did not end within {END_S:g} s of the run and was killed"
            )
        return status or self._cause() or ExitStatus()

    def _read_events(self) -> None:
        for line in self._coupler.popen.stdout or ():
            try:
                self._events.put(json.loads(line))
            except json.JSONDecodeError:
                continue  # a line of a library on standard output

    def _take_events(self) -> None:
        """Wait _POLL_S for events of the coupler, and handle all that have come."""
        timeout_s = _POLL_S
        while True:
            try:
                event = self._events.get(timeout=timeout_s)
            except queue.Empty:
                return
            timeout_s = 0.0
            if "tick" in event:
                self._progressed = True
                self._observer.on_tick(event["tick"])
            elif "check" in event:
                self._observer.on_check(event["check"])
            else:
                self._verdict = ExitStatus(event["exit_status"], event["reason"])

    def _cause(self) -> ExitStatus | None:
        """Why the run ended, as soon as it is known; None while it goes on, or if all went well."""
        if self._coupler.exit_status is not None:
            self._reader.join()  # its last events may still come
            self._take_events()
        for process in self._processes:
            status = process.exit_status
            if status is not None and status < 0:
                return ExitStatus(
                    RunError.exit_status,
                    f"{process.name} node (process {process.popen.pid}) was ended by "
                    f"{signal.Signals(-status).name}; its log is {process.log}",
                )
            if status and self._failed is None:
                self._failed = (time.monotonic(), process)
        if self._verdict is not None and self._verdict.code:
            return self._verdict
        if self._failed is None:
            return None
        since, process = self._failed
        over = all(item.exit_status is not None for item in self._processes)
        may_tell = self._coupler.exit_status is None and not self._coupler.stands_still
        if may_tell and not over and time.monotonic() - since < VERDICT_S:
            return None
        code = RunError.exit_status if process.lost_rank else process.exit_status
        return ExitStatus(code or RunError.exit_status, process.last_words())

    def _end_coupler(self, status: ExitStatus) -> None:
        """Request the coupler to abort the run so that the bag is closed in order, unless it has already
        reported how the run ended."""
        if self._verdict is None:
            self._coupler.send_stop(status)
        grace_s = FAILED_END_S if self._progressed else STARTUP_GRACE_S
        if status.code > SIGNAL_STATUS:
            grace_s += KEEP_S
        self._deadline = min(self._deadline, time.monotonic() + grace_s)

    def _end_others(self, status: ExitStatus | None) -> None:
        """Request the others to end after the coupler; a recorder may first complete an aborted record."""
        now = time.monotonic()
        if self._coupler_end is None:
            self._coupler_end = now
            self._deadline = now + (END_S if status is None else FAILED_END_S)
        if status is None:
            return  # success: the coupler has published the end
        killed = (self._coupler.exit_status or 0) < 0
        for process in self._processes:
            patience_s = CUT_PATIENCE_S if process.name == RECORDER and not killed else 0.0
            if process.name not in self._asked and now >= self._coupler_end + patience_s:
                self._asked.add(process.name)
                process.send_stop(status)

    def _kill_who_stands_still(self) -> None:
        """Kill stopped processes, which cannot end by themselves."""
        for process in self._processes:
            if process.stands_still:
                process.popen.kill()

    def _kill_remaining(self) -> str:
        """Kill the nodes that are left; return their names."""
        stuck = [process for process in self._processes if process.exit_status is None]
        for process in stuck:
            process.popen.kill()
        for process in self._processes:
            process.popen.wait()
            for stream in (process.popen.stdin, process.popen.stdout):
                if stream is not None:
                    stream.close()
        if any((process.exit_status or 0) < 0 for process in self._processes):
            sweep_shared_memory()
        return ", ".join(process.name for process in stuck)
