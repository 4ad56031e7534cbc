"""Pause, resume and step as services of the coupler: ~/pause, ~/resume (std_srvs/Trigger), ~/step.

These are the short forms; simulation_services.py has the operations of simulation_interfaces.
"""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.service import Service
from std_srvs.srv import Trigger
from subsoil_msgs.srv import Step

from .run_control import Answer, Result, RunControl


class PauseServices:
    """Pause services of a coupler.

    message_loop.serve calls their callbacks with the request and the header for the response.

    Args:
        guarded: wraps a callback so that its errors become the node's fault.
    """

    def __init__(
        self, node: Node, control: RunControl, guarded: Callable[[Callable[..., None]], Callable[..., None]]
    ) -> None:
        self._control = control
        self._pause = node.create_service(Trigger, "~/pause", guarded(self._on_pause))
        self._resume = node.create_service(Trigger, "~/resume", guarded(self._on_resume))
        self._step = node.create_service(Step, "~/step", guarded(self._on_step))

    def _on_pause(self, request: Any, header: Any) -> None:
        self._control.pause(self._answer(self._pause, header))

    def _on_resume(self, request: Any, header: Any) -> None:
        self._control.resume(self._answer(self._resume, header))

    def _on_step(self, request: Any, header: Any) -> None:
        self._control.step(request.steps, self._answer(self._step, header))

    def _answer(self, service: Service, header: Any) -> Answer:
        def answer(result: Result, reason: str) -> None:
            done = self._control.done_tick
            resumed = service is self._resume
            well = "the run goes on" if resumed else f"the run stands at the end of tick {done}"
            response = service.srv_type.Response(  # type: ignore[attr-defined]
                success=result in (Result.OK, Result.ALREADY_IN_TARGET_STATE), message=reason or well
            )
            if service is self._step:
                response.tick = done
            service.send_response(response, header)

        return answer
