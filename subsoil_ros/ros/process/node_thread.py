"""One thread that builds a node and serves it."""

import gc
import threading
from collections.abc import Callable

from ...coupling.exit_status import ExitStatus
from ...errors import RunError
from ...messages import NodeState
from ..nodes.lockstep_node import LAST_WORD_S, LockstepNode, log_end, one_line, say_trace
from .heartbeat import Heartbeat


class Service(threading.Thread):
    """Builds the node and spins it, both in this thread: engines may keep settings by thread.

    When the run has ended, the node answers requests until `close`: late callers would wait for ever.
    """

    def __init__(self, name: str, build: Callable[[], LockstepNode], heartbeat: Heartbeat) -> None:
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
            say_trace(error)
            self.status = ExitStatus(getattr(error, "exit_status", RunError.exit_status), one_line(error))
            log_end(self._heartbeat.node.get_logger(), self.status)
            self._heartbeat.say(NodeState.FAULT, self.status.reason, exit_status=self.status.code)
            self._heartbeat.flush(LAST_WORD_S)
            self.ended.set()
            return
        gc.collect()
        gc.freeze()  # the objects of the node stay; garbage collections skip them
        node.spin()
        self.status = node.status
        self.ended.set()
        node.serve_ended(self._closing.is_set)
        node.destroy_node()

    def close(self) -> None:
        """Wait until the node is destroyed."""
        self._closing.set()
        self.join()
