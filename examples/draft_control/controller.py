"""Draft control of a hitch: a node of one's own in the lockstep of a run.

    python controller.py --ros-args -p scene:=RUN/scene.yaml -p run_id:=NAME

`subsoil run` of a scene with `controller.law: {kind: external}` prints the run's name and domain and waits.
Every control tick the run hands over the machine's state and waits for the answer, a speed of the hitch, so
results do not depend on how fast this program is. With real_time:=true it holds the run to the wall clock.
"""

import time
from dataclasses import dataclass

from rclpy.context import Context

from subsoil_ros.coupling.protocol import CONTROLLER
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.messages import DriverCommand, MechanismState
from subsoil_ros.ros.nodes.controller_node import ControllerNode
from subsoil_ros.ros.process.heartbeat import Heartbeat
from subsoil_ros.ros.process.node_process import run_process
from subsoil_ros.ros.process.parameters import ParameterKey
from subsoil_ros.scene.controller import Controller as ControllerKeys

RANGE = (0.0, 1e5)  # of each of the three parameters
ALLOWED = "a number from 0 to 100000, with a decimal point"
TARGETS = {
    "target_newton": ParameterKey(1300.0, "draft to hold", ALLOWED, RANGE),
    "later_target_newton": ParameterKey(1700.0, "draft to hold from step_at_s on", ALLOWED, RANGE),
    "step_at_s": ParameterKey(5.0, "simulated time of the step between the two", ALLOWED, RANGE),
}
PARAMETERS = {**TARGETS, "real_time": ParameterKey(False, "hold the run to the wall clock", "true or false")}

GAIN_M_PER_NEWTON_S = 4e-4
"""Speed of the hitch for each newton of draft too much. Draft grows with depth by about S = 5000 N/m in this
soil (config/soils/paper_grid.yaml). With the filter T the loop is T s^2 + s + GAIN S = 0: two real roots, the
slower one -2.8 /s, -3.2 /s with the sampling: the draft follows its target in 0.3 s, without overshoot."""

FILTER_S = 0.1
"""Time constant of the mean that is controlled: longer than a failure of the soil (18 mm at 0.5 m/s: 36 ms),
shorter than the loop's."""

ENGAGED_NEWTON = 300.0
"""Below it the share is not in the soil yet: the hitch holds still."""


@dataclass(frozen=True)
class Targets:
    """The draft that is asked for."""

    target_newton: float
    later_target_newton: float
    step_at_s: float

    def at(self, time_s: float) -> float:
        """The target at a simulated time [N]."""
        return self.target_newton if time_s < self.step_at_s else self.later_target_newton


class DraftControl:
    """Lifts while the draft is above its target, lowers while it is below. Speeds are upward [m/s]."""

    def __init__(self, keys: ControllerKeys, targets: Targets, interval_s: float) -> None:
        self._keys, self._targets, self._interval_s = keys, targets, interval_s
        self._draft = 0.0  # filtered [N]
        self._speed = 0.0

    def command(self, tick: int, state: MechanismState) -> DriverCommand:
        """The speed of the hitch by the end of the next control interval."""
        self._draft += (state.draft_newton - self._draft) * self._interval_s / (FILTER_S + self._interval_s)
        requested = 0.0
        if self._draft > ENGAGED_NEWTON:
            requested = GAIN_M_PER_NEWTON_S * (self._draft - self._targets.at(state.end_time_ns * 1e-9))
        change = self._keys.max_acceleration * self._interval_s
        reachable = min(max(requested, self._speed - change), self._speed + change)
        self._speed = min(max(reachable, self._keys.lowest_speed), self._keys.highest_speed)
        return DriverCommand(state.run_id, tick, self._keys.driver, self._speed)


class RealTime:
    """A controller that lets no simulated time pass before its wall time; knows how late the run came."""

    def __init__(self, controller: DraftControl) -> None:
        self._controller = controller
        self._start: float | None = None
        self.worst_s = 0.0

    def command(self, tick: int, state: MechanismState) -> DriverCommand:
        """The controller's, when it is due."""
        time_s = state.end_time_ns * 1e-9
        if self._start is None:
            self._start = time.monotonic() - time_s
        early_s = self._start + time_s - time.monotonic()
        if early_s > 0.0:
            time.sleep(early_s)
        self.worst_s = max(self.worst_s, -early_s)
        return self._controller.command(tick, state)


class DraftControlNode(ControllerNode):
    """Says at the end how well the run kept up with the clock."""

    def __init__(
        self, real_time: RealTime | None, controller: DraftControl, run: RunSettings, heartbeat: Heartbeat,
        context: Context | None = None,
    ) -> None:  # fmt: skip
        super().__init__(real_time or controller, run, heartbeat, context)
        self._real_time = real_time

    def spin(self) -> None:
        """Serves until the run ends."""
        super().spin()
        if self._real_time is not None:
            print(f"real time: the run was at most {1e3 * self._real_time.worst_s:.1f} ms late", flush=True)


def build(run: RunSettings, heartbeat: Heartbeat, context: Context | None = None) -> DraftControlNode:
    """The node, its targets from its parameters."""
    keys = run.resolved.scene.controller
    assert keys is not None  # subsoil_ros names the scene's mistake before
    values = {name: heartbeat.node.get_parameter(name).value for name in TARGETS}
    paced = heartbeat.node.get_parameter("real_time").value
    interval_s = keys.interval_ticks * run.resolved.timing.communication_step_s
    control = DraftControl(keys, Targets(**values), interval_s)
    return DraftControlNode(RealTime(control) if paced else None, control, run, heartbeat, context)


if __name__ == "__main__":
    raise SystemExit(run_process(CONTROLLER, build, PARAMETERS))
