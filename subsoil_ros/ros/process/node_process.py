"""A node as an operating-system process: its start, signals, supervision, exit status."""

import json
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, NoReturn

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ...coupling.exit_status import KEEP_S, SIGNAL_STATUS, ExitStatus, interrupted
from ...coupling.protocol import COUPLER, RECORDER, nodes_from_outside
from ...coupling.run_settings import RunSettings
from ...coupling.signals import caught_signals
from ...errors import InputError, RunError
from ...messages import NodeState
from ...ticks import INITIAL_TICK
from ..nodes.lockstep_node import LAST_WORD_S, OWN_TIME, LockstepNode, log_end, one_line, say
from ..transport.environment import check_environment
from ..transport.shared_memory import avoid_full_memory
from .heartbeat import LATE_S, Heartbeat
from .node_thread import Service
from .parameters import ParameterKey, help_text, read_settings
from .supervisor import STARTUP_GRACE_S

GRACE_S = 2.0
"""Time for a computing engine to return, so that the node ends in order; then the process ends itself."""

CLOSE_S = 5.0
"""Time to destroy the endpoints of a node: it takes tens of milliseconds. A supervisor waits longer."""


def watched_by(name: str, run: RunSettings) -> tuple[str, ...]:
    """Names of the nodes whose silence ends a node."""
    return run.participants if name == COUPLER else (COUPLER,)


def report_to_supervisor(**event: Any) -> None:
    """Writes an event to standard output, one JSON object per line."""
    with suppress(BrokenPipeError):  # the supervisor is gone, and standard input is closed too
        os.write(sys.stdout.fileno(), (json.dumps(event) + "\n").encode())


def run_process(
    name: str, build: Callable[..., LockstepNode], parameters: Mapping[str, ParameterKey] | None = None
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
        bad_input = isinstance(error, _rclpy.RCLInvalidROSArgsError | _rclpy.UnknownROSArgsError)
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
    build: Callable[[], LockstepNode],
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
            heartbeat.outlast(STARTUP_GRACE_S - CLOSE_S, nodes_from_outside(heartbeat.run.resolved.scene))
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
    if not service.ended.wait(GRACE_S + LAST_WORD_S + (KEEP_S if interrupted_run else 0.0)):
        status = heartbeat.stop or ExitStatus(RunError.exit_status, heartbeat.lost)
        log_end(heartbeat.node.get_logger(), status)
        os._exit(status.code)  # nothing here needs closing
