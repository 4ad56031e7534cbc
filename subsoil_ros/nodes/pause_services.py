"""Pause, resume and step as services of the coupler: ~/pause, ~/resume (std_srvs/Trigger), ~/step.

They are the operations that simulation_interfaces' SetSimulationState and StepSimulation need; the names of
those are left free.
"""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.service import Service
from std_srvs.srv import Trigger
from subsoil_msgs.srv import Step

from ..coupling.protocol import Coupler
from ..errors import ProtocolError


class PauseServices:
    """Serves a coupler. A pause and steps are answered when the run stands.

    Services are taken by message_loop.serve, which calls with the request and what the answer is sent to.

    Args:
        changed: called when ticks may be granted again, or when the run begins to pause.
    """

    def __init__(self, node: Node, coupler: Coupler, changed: Callable[[], None]) -> None:
        self._coupler = coupler
        self._changed = changed
        self._waiting: list[tuple[int, Service, Any]] = []  # tick to be done, whom to answer
        self._pause = node.create_service(Trigger, "~/pause", self._on_pause)
        self._resume = node.create_service(Trigger, "~/resume", self._on_resume)
        self._step = node.create_service(Step, "~/step", self._on_step)

    def note_done(self) -> None:
        """Answers whoever waited for ticks that are done now."""
        done = self._coupler.done_tick
        waiting, self._waiting = self._waiting, []
        for tick, service, header in waiting:
            if tick > done:
                self._waiting.append((tick, service, header))
            else:
                _answer(service, header, True, f"the run stands at the end of tick {done}", done)

    def refuse_waiting(self, reason: str) -> None:
        """Answers whoever waits that the run has ended."""
        for _, service, header in self._waiting:
            _answer(service, header, False, reason, self._coupler.done_tick)
        self._waiting = []

    def _on_pause(self, request: Any, header: Any) -> None:
        self._waiting.append((self._coupler.pause(), self._pause, header))
        self._changed()
        self.note_done()

    def _on_resume(self, request: Any, header: Any) -> None:
        self._coupler.resume()
        _answer(self._resume, header, True, "the run goes on", self._coupler.done_tick)
        self._changed()

    def _on_step(self, request: Any, header: Any) -> None:
        try:
            tick = self._coupler.step(request.steps)
        except ProtocolError as error:
            _answer(self._step, header, False, str(error), self._coupler.done_tick)
            return
        self._waiting.append((tick, self._step, header))
        self._changed()


def _answer(service: Service, header: Any, success: bool, message: str, tick: int) -> None:
    response = service.srv_type.Response(success=success, message=message)  # type: ignore[attr-defined]
    if service.srv_type is Step:
        response.tick = tick
    service.send_response(response, header)
