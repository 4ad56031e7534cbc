"""A node as an operating-system process: its thread, signals, supervision, exit status."""

import gc
import json
import os
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, NoReturn, Protocol

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ...coupling.exit_status import SIGNAL_STATUS, ExitStatus, caught_signals, interrupted
from ...coupling.protocol import COUPLER, RECORDER, external_nodes
from ...coupling.run_settings import RunSettings
from ...coupling.time_limits import CLOSE_S, KEEP_S, LAST_WORD_S, LATE_S, RETURN_S, STARTUP_GRACE_S
from ...errors import InputError, RunError, SubsoilError
from ...messages import NodeState
from ...ticks import INITIAL_TICK
from ..transport.environment import check_environment
from ..transport.private_rclpy import BAD_ARGUMENTS, Logger
from ..transport.shared_memory import avoid_full_memory
from .heartbeat import Heartbeat
from .parameters import ParameterKey, help_text, read_settings

OWN_TIME = [Parameter("use_sim_time", value=False)]
"""The nodes of a run ignore use_sim_time: the coupler publishes /clock, and none of them reads it."""


def say(text: str) -> None:
    """Write a line to standard error; ignore errors of a full disk or a closed pipe."""
    with suppress(OSError):
        os.write(sys.stderr.fileno(), (text + "\n").encode())  # past the buffer, which would fail at the exit


def say_trace(error: BaseException) -> None:
    """Write the traceback of an error to standard error, unless the error is one of this package."""
    if not isinstance(error, SubsoilError):
        say("".join(traceback.format_exception(error)).rstrip())


def log_end(logger: Logger, status: ExitStatus) -> None:
    """Log why a run ended; nothing if all went well."""
    if status.code > SIGNAL_STATUS:
        logger.warning(status.reason)
    elif status.code:
        logger.error(status.reason)


def one_line(error: BaseException) -> str:
    """An error as a message of one line; unexpected kinds with their name."""
    text = " ".join(str(error).split())
    return text if isinstance(error, SubsoilError) and text else f"{type(error).__name__}: {text}"


class Served(Protocol):
    """A node of a run, as its process sees it."""

    status: ExitStatus

    def spin(self) -> None:
        """Serve the node until it ends."""
        ...

    def serve_ended(self, over: Callable[[], bool]) -> None:
        """Answer requests that come after the end of the run, until `over`."""
        ...

    def destroy_node(self) -> None:
        """Destroy the node and its endpoints."""
        ...


class Service(threading.Thread):
    """Builds the node and spins it, both in this thread: engines may keep settings by thread.

    When the run has ended, the node answers requests until `close`: late callers would wait for ever.
    """

    def __init__(self, name: str, build: Callable[[], Served], heartbeat: Heartbeat) -> None:
        super().__init__(name=name, daemon=True)
        self.status = ExitStatus()
        self.ended = threading.Event()
        """Set with `status`."""
        self._build = build
        self._heartbeat = heartbeat
        self._closing = threading.Event()

    def run(self) -> None:
        """Build and spin the node; at the end `status` is set."""
        try:
            node = self._build()
        except Exception as error:  # published, like any fault of a node
            self._end(error)
            return
        gc.collect()
        gc.freeze()  # the objects of the node stay; garbage collections skip them
        try:
            node.spin()
        except BaseException as error:  # nothing above hears of the end of a thread
            self._end(error)
            return
        self.status = node.status
        self.ended.set()
        node.serve_ended(self._closing.is_set)
        node.destroy_node()

    def _end(self, error: BaseException) -> None:
        say_trace(error)
        self.status = ExitStatus(getattr(error, "exit_status", RunError.exit_status), one_line(error))
        log_end(self._heartbeat.node.get_logger(), self.status)
        self._heartbeat.say(NodeState.FAULT, self.status.reason, exit_status=self.status.code)
        self._heartbeat.flush(LAST_WORD_S)
        self.ended.set()

    def close(self) -> None:
        """Wait until the node is destroyed."""
        self._closing.set()
        self.join()


def watched_by(name: str, run: RunSettings) -> tuple[str, ...]:
    """Names of the nodes whose silence ends a node."""
    return run.participants if name == COUPLER else (COUPLER,)


def report_to_supervisor(**event: Any) -> None:
    """Writes an event to standard output, one JSON object per line."""
    with suppress(BrokenPipeError):  # the supervisor is gone, and standard input is closed too
        os.write(sys.stdout.fileno(), (json.dumps(event) + "\n").encode())


def run_process(
    name: str, build: Callable[..., Served], parameters: Mapping[str, ParameterKey] | None = None
) -> int:
    """Run one node until the run ends. Returns the exit status.

    Args:
        build: builds the node from its RunSettings and Heartbeat.
        parameters: of this node, beside those of every node; `build` reads them on `heartbeat.node`.
    """
    if name in (COUPLER, RECORDER) and hasattr(os, "SCHED_BATCH"):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))  # waking nodes interrupt no engine
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        words = remove_ros_args(sys.argv)[1:]
        if {"-h", "--help"} & set(words):
            print(help_text(name, parameters))
            return 0
        if words:
            advice = "give --ros-args -p NAME:=VALUE; --help lists the names"
            say(f"{name}: argument '{words[0]}': not known; {advice}")
            return InputError.exit_status
        try:
            check_environment()
        except InputError as error:
            say(f"{name}: {error}")
            return error.exit_status
        try:
            notice = avoid_full_memory()
        except InputError as error:
            notice = str(error)
        if notice:
            say(f"{name}: {notice}")
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
        node = Node(f"{name}_process", parameter_overrides=OWN_TIME)
    except RuntimeError as error:  # of rcl, as when security is set and not available
        say(f"{name}: no ROS node can be made: {' '.join(str(error).split())}")
        bad_input = isinstance(error, BAD_ARGUMENTS)
        return InputError.exit_status if bad_input else RunError.exit_status
    try:
        run = read_settings(node, name, parameters)
    except InputError as error:
        node.get_logger().error(one_line(error))
        return error.exit_status
    heartbeat = Heartbeat(node, name, run, watched_by(name, run))
    with (
        caught_signals(lambda number: heartbeat.request_stop(interrupted(number))),
        _announced_kernels(name, node.get_logger().info) as compiled,
    ):
        exit_status = _serve(name, partial(build, run, heartbeat), heartbeat, compiled)
    _leave(exit_status)


def _serve(
    name: str,
    build: Callable[[], Served],
    heartbeat: Heartbeat,
    compiled: Callable[[], None],
) -> int:
    supervised = heartbeat.run.supervised
    if supervised:
        threading.Thread(target=_obey, args=(heartbeat,), daemon=True).start()
    heartbeat.start()
    service = Service(name, build, heartbeat)
    service.start()
    _wait(service, heartbeat, compiled)
    status = service.status
    if supervised and name == COUPLER:
        report_to_supervisor(exit_status=status.code, reason=status.reason)
    if name == COUPLER and status.code:  # a node that starts later would wait for this one
        if not supervised:
            heartbeat.outlast(LATE_S)
        elif heartbeat.tick == INITIAL_TICK:  # the supervisor stops the nodes that it started, no others
            heartbeat.outlast(STARTUP_GRACE_S - CLOSE_S, external_nodes(heartbeat.run.resolved.scene))
    leave_in_time(name, status.code, CLOSE_S)
    service.close()
    heartbeat.close()
    rclpy.shutdown()
    return status.code


def leave_in_time(name: str, exit_status: int, limit_s: float) -> None:
    """End this process with `exit_status` after `limit_s`, if it has not ended by then.

    For a node whose work is done: its messages have arrived and its files are closed. A node has been
    observed that had not closed its DDS endpoints ten seconds after the end of a complete run.
    """

    def leave() -> None:
        say(f"{name}: DDS did not close within {limit_s:g} s; the node has done its work, and ends")
        _leave(exit_status)

    timer = threading.Timer(limit_s, leave)
    timer.daemon = True
    timer.start()


def _leave(exit_status: int) -> NoReturn:
    """End the process now: libraries that have threads of their own may hang while they are unloaded."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(exit_status)


def _obey(heartbeat: Heartbeat) -> None:
    """Read stop requests from standard input; its end means that the supervisor has ended."""
    for line in sys.stdin:
        event = json.loads(line)
        heartbeat.request_stop(ExitStatus(event["exit_status"], event["stop"]))
    heartbeat.request_stop(ExitStatus(RunError.exit_status, "the supervisor is gone"))


@contextmanager
def _announced_kernels(name: str, say: Callable[[str], None]) -> Iterator[Callable[[], None]]:
    """Announce kernels that a node compiles; yields what to call once it has compiled them.

    Coupler and recorder have none, and start sooner without numba.
    """
    if name in (COUPLER, RECORDER):
        yield lambda: None
        return
    from ...kernel_cache import CompilationListener

    with CompilationListener(say) as kernels:
        yield kernels.done


def _wait(service: Service, heartbeat: Heartbeat, compiled: Callable[[], None]) -> None:
    """Wait for the end of the run; end the process if the engine of a stopped service does not return.

    compiled: called once the node has started.
    """
    while not service.ended.wait(0.2) and heartbeat.stop is None and not heartbeat.lost:
        if heartbeat.state is not NodeState.STARTING:
            compiled()
    interrupted_run = heartbeat.stop is not None and heartbeat.stop.code > SIGNAL_STATUS
    if not service.ended.wait(RETURN_S + LAST_WORD_S + (KEEP_S if interrupted_run else 0.0)):
        status = heartbeat.stop or ExitStatus(RunError.exit_status, heartbeat.lost)
        log_end(heartbeat.node.get_logger(), status)
        os._exit(status.code)  # nothing here needs closing
