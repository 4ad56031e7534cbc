"""Services and the action that control a run: those of simulation_interfaces, and their short forms.

The types are of simulation_interfaces where it is installed, otherwise of subsoil_msgs, with the same names
and operations: get_simulator_features, get_simulation_state, set_simulation_state, step_simulation,
reset_simulation and the action simulate_steps, in the namespace of the run. The short forms are ~/pause,
~/resume (std_srvs/Trigger) and ~/step of the coupler.
"""

import queue
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module

from rclpy.action import ActionServer, CancelResponse
from rclpy.node import Node
from rclpy.service import Service
from std_srvs.srv import Trigger
from subsoil_msgs.srv import Step

from ..._version import __version__
from ..process.heartbeat import Heartbeat
from ..transport.private_rclpy import new_response
from ..transport.qos import RosMessage
from .run_control import RESET_ADVICE, Answer, Result, RunControl

FEATURES = (
    "SIMULATION_STATE_GETTING",
    "SIMULATION_STATE_SETTING",
    "SIMULATION_STATE_PAUSE",
    "STEP_SIMULATION_SINGLE",
    "STEP_SIMULATION_MULTIPLE",
    "STEP_SIMULATION_ACTION",
)
"""Constants of simulation_interfaces/SimulatorFeatures."""

CUSTOM_INFO = f"subsoil_ros {__version__}: soil and a tillage machine in lockstep. No reset: {RESET_ADVICE}"

Guarded = Callable[[Callable[..., None]], Callable[..., None]]


@dataclass(frozen=True)
class Dialect:
    """The package whose types are served, and how its messages are filled."""

    package: str
    standard: bool  # simulation_interfaces: a result and a state are messages of their own

    def service(self, name: str) -> RosMessage:
        """Return a service type."""
        return getattr(import_module(f"{self.package}.srv"), name)

    def action(self) -> RosMessage:
        """Return the action type SimulateSteps."""
        return import_module(f"{self.package}.action").SimulateSteps

    def wanted_state(self, request: RosMessage) -> int:
        """Return the state that a SetSimulationState requests."""
        return request.state.state if self.standard else request.state

    def fill_result(self, response: RosMessage, result: Result, reason: str) -> RosMessage:
        """Write result and reason into a response, and return it."""
        if self.standard:
            response.result.result, response.result.error_message = int(result), reason
        else:
            response.result, response.error_message = int(result), reason
        return response

    def fill_state(self, response: RosMessage, state: int, tick: int) -> None:
        """Write the state of the run into a response."""
        if self.standard:
            response.state.state = state
        else:
            response.state, response.tick = state, tick

    def fill_features(self, response: RosMessage) -> None:
        """Write the features of the simulator into a response."""
        if self.standard:
            kind = type(response.features)
            response.features.features = [getattr(kind, name) for name in FEATURES]
            response.features.custom_info = CUSTOM_INFO
        else:
            response.features, response.custom_info = list(FEATURES), CUSTOM_INFO


def dialect() -> Dialect:
    """Return simulation_interfaces if it is installed, else subsoil_msgs."""
    try:
        import_module("simulation_interfaces.srv")
    except ImportError:
        return Dialect("subsoil_msgs", standard=False)
    return Dialect("simulation_interfaces", standard=True)


class SimulationServices:
    """Services of a coupler, in its own thread (private_rclpy.serve).

    Args:
        guarded: wraps a callback so that its errors become the node's fault.
    """

    def __init__(self, node: Node, control: RunControl, guarded: Guarded) -> None:
        self._node, self._control, self._guarded = node, control, guarded
        self._dialect = dialect()
        self._serve("GetSimulatorFeatures", "get_simulator_features", self._on_features)
        self._serve("GetSimulationState", "get_simulation_state", self._on_state)
        self._serve("SetSimulationState", "set_simulation_state", self._on_set_state)
        self._serve("StepSimulation", "step_simulation", self._on_step)
        self._serve("ResetSimulation", "reset_simulation", self._on_reset)

    def _serve(
        self,
        kind: str,
        name: str,
        handle: Callable[[RosMessage, RosMessage, Callable[[RosMessage], None]], None],
    ) -> None:
        def received(request: RosMessage, header: RosMessage) -> None:
            send = partial(_send, service, header)
            handle(request, new_response(service), send)

        service: Service = self._node.create_service(
            self._dialect.service(kind), name, self._guarded(received)
        )

    def _on_features(
        self, request: RosMessage, response: RosMessage, send: Callable[[RosMessage], None]
    ) -> None:
        self._dialect.fill_features(response)
        send(response)

    def _on_state(
        self, request: RosMessage, response: RosMessage, send: Callable[[RosMessage], None]
    ) -> None:
        self._dialect.fill_state(response, int(self._control.state), self._control.done_tick)
        send(self._dialect.fill_result(response, Result.OK, ""))

    def _on_set_state(
        self, request: RosMessage, response: RosMessage, send: Callable[[RosMessage], None]
    ) -> None:
        wanted = self._dialect.wanted_state(request)
        self._control.set_state(
            wanted, lambda result, reason: send(self._dialect.fill_result(response, result, reason))
        )

    def _on_step(self, request: RosMessage, response: RosMessage, send: Callable[[RosMessage], None]) -> None:
        self._control.step(
            request.steps, lambda result, reason: send(self._dialect.fill_result(response, result, reason))
        )

    def _on_reset(
        self, request: RosMessage, response: RosMessage, send: Callable[[RosMessage], None]
    ) -> None:
        send(self._dialect.fill_result(response, Result.FEATURE_UNSUPPORTED, RESET_ADVICE))


def _send(service: Service, header: RosMessage, response: RosMessage) -> None:
    service.send_response(response, header)


class _Goal:
    """An accepted goal: its number of ticks, and the last of them, once it has begun."""

    def __init__(self, handle: RosMessage) -> None:
        self.handle = handle
        self.tick_count = 0
        self.last_tick: int | None = None  # None: it was refused
        self.finished = False


class StepsAction:
    """The action simulate_steps of a coupler.

    Goals arrive in the thread of the heartbeat. They are handled in the coupler's, ten times a second
    (`poll`) and when their ticks are done, so no thread waits.
    """

    def __init__(self, heartbeat: Heartbeat, control: RunControl) -> None:
        self._control = control
        self._dialect = dialect()
        self._kind = self._dialect.action()
        self._accepted: queue.SimpleQueue[RosMessage] = queue.SimpleQueue()
        self._goals: list[_Goal] = []
        server = ActionServer(
            heartbeat.node,
            self._kind,
            "simulate_steps",
            execute_callback=lambda handle: self._kind.Result(),  # replaced by that of the goal
            handle_accepted_callback=self._accepted.put,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )
        heartbeat.at_close(server.destroy)

    def poll(self) -> None:
        """Begin goals, publish their feedback, end those that are cancelled."""
        while not self._accepted.empty():
            self._begin(_Goal(self._accepted.get()))
        for goal in self._goals:
            if goal.handle.is_cancel_requested and not goal.finished:
                goal.finished = True
                self._control.pause(partial(self._cancelled, goal))
            elif not goal.finished:
                self._say(goal)
        self._goals = [goal for goal in self._goals if not goal.finished]

    def _begin(self, goal: _Goal) -> None:
        self._goals.append(goal)
        asked, done = goal.handle.request.steps, self._control.done_tick
        goal.last_tick = self._control.step(asked, partial(self._done, goal))
        if goal.last_tick is not None:
            goal.tick_count = min(asked, goal.last_tick - done)  # the run may end before

    def _done(self, goal: _Goal, result: Result, reason: str) -> None:
        """Finish a goal whose ticks are done, or can no longer be done."""
        if goal.finished:
            return  # cancelled
        goal.finished = True
        self._say(goal)
        self._finish(goal, result, reason, "succeed" if result is Result.OK else "abort")

    def _cancelled(self, goal: _Goal, result: Result, reason: str) -> None:
        words = reason or f"cancelled at the end of tick {self._control.done_tick}"
        self._finish(goal, result, words, "canceled")

    def _say(self, goal: _Goal) -> None:
        if goal.last_tick is None:
            return
        left = min(max(0, goal.last_tick - self._control.done_tick), goal.tick_count)
        goal.handle.publish_feedback(
            self._kind.Feedback(completed_steps=goal.tick_count - left, remaining_steps=left)
        )

    def _finish(self, goal: _Goal, result: Result, reason: str, how: str) -> None:
        def execute(handle: RosMessage) -> RosMessage:
            getattr(handle, how)()
            return self._dialect.fill_result(self._kind.Result(), result, reason)

        goal.handle.execute(execute)


class PauseServices:
    """The short forms, of a coupler; serve calls their callbacks with the request and the response's header.

    Args:
        guarded: wraps a callback so that its errors become the node's fault.
    """

    def __init__(self, node: Node, control: RunControl, guarded: Guarded) -> None:
        self._control = control
        self._pause = node.create_service(Trigger, "~/pause", guarded(self._on_pause))
        self._resume = node.create_service(Trigger, "~/resume", guarded(self._on_resume))
        self._step = node.create_service(Step, "~/step", guarded(self._on_step))

    def _on_pause(self, request: RosMessage, header: RosMessage) -> None:
        self._control.pause(self._answer(self._pause, header))

    def _on_resume(self, request: RosMessage, header: RosMessage) -> None:
        self._control.resume(self._answer(self._resume, header))

    def _on_step(self, request: RosMessage, header: RosMessage) -> None:
        self._control.step(request.steps, self._answer(self._step, header))

    def _answer(self, service: Service, header: RosMessage) -> Answer:
        def answer(result: Result, reason: str) -> None:
            done = self._control.done_tick
            resumed = service is self._resume
            well = "the run goes on" if resumed else f"the run stands at the end of tick {done}"
            response = new_response(service)
            response.success = result in (Result.OK, Result.ALREADY_IN_TARGET_STATE)
            response.message = reason or well
            if service is self._step:
                response.tick = done
            service.send_response(response, header)

        return answer
