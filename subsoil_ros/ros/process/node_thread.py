"""One thread that builds a node and serves it."""

import gc
import threading
from collections.abc import Callable

from ...coupling.exit_status import Ending
from ...errors import RunError
from ...messages import NodeState
from ..nodes.lockstep_node import LAST_WORD_S, LockstepNode, one_line
from .heartbeat import Heartbeat


class Service(threading.Thread):
    """Builds the node and spins it. One thread for both: engines may keep settings by thread."""

    def __init__(self, name: str, build: Callable[[], LockstepNode], lifeline: Heartbeat) -> None:
        super().__init__(name=name, daemon=True)
        self.ending = Ending()
        self._build = build
        self._lifeline = lifeline

    def run(self) -> None:
        """Ends with `ending` set."""
        try:
            node = self._build()
        except Exception as error:  # said to all, as any fault of a node
            self.ending = Ending(getattr(error, "exit_status", RunError.exit_status), one_line(error))
            self._lifeline.say(NodeState.FAULT, self.ending.reason)
            self._lifeline.flush(LAST_WORD_S)
            return
        gc.collect()
        gc.freeze()  # what the node is made of stays; collections pass it by
        node.spin()
        self.ending = node.ending
        node.destroy_node()
