"""One thread that builds a node and serves it."""

import gc
import threading
from collections.abc import Callable

from ...coupling.exit_status import ExitStatus
from ...errors import RunError
from ...messages import NodeState
from ..nodes.lockstep_node import LAST_WORD_S, LockstepNode, one_line
from .heartbeat import Heartbeat


class Service(threading.Thread):
    """Builds the node and spins it. One thread for both: engines may keep settings by thread."""

    def __init__(self, name: str, build: Callable[[], LockstepNode], heartbeat: Heartbeat) -> None:
        super().__init__(name=name, daemon=True)
        self.status = ExitStatus()
        self._build = build
        self._heartbeat = heartbeat

    def run(self) -> None:
        """Ends with `status` set."""
        try:
            node = self._build()
        except Exception as error:  # said to all, as any fault of a node
            self.status = ExitStatus(getattr(error, "exit_status", RunError.exit_status), one_line(error))
            self._heartbeat.say(NodeState.FAULT, self.status.reason, exit_status=self.status.code)
            self._heartbeat.flush(LAST_WORD_S)
            return
        gc.collect()
        gc.freeze()  # what the node is made of stays; collections pass it by
        node.spin()
        self.status = node.status
        node.destroy_node()
