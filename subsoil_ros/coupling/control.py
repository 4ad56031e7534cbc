"""Controllers: they compute the speed of a driver from the state of the machine."""

from typing import Protocol

from ..loading.loader import ResolvedScene
from ..mbd.driving import Ramp, first_ramp
from ..messages import DriverCommand, MechanismState
from ..recording.checkpoint import Checkpoint
from ..scene.controller import Controller as ControllerKeys
from ..scene.controller import DraftLimit, External
from .protocol import MECHANISM


class Controller(Protocol):
    """Computes a speed from a state. Its results may depend only on the states that it has received."""

    def command(self, tick: int, state: MechanismState) -> DriverCommand:
        """The command of `tick`; the state is that at the end of the tick before."""
        ...


class SpeedController:
    """A law of the scene, within the controller's limits of speed and acceleration."""

    def __init__(self, keys: ControllerKeys, speed: float, interval_s: float) -> None:
        """speed: that of the driver at the start [m/s, rad/s]; interval_s: time between commands."""
        self._keys = keys
        self._speed = speed
        self._interval_s = interval_s

    def command(self, tick: int, state: MechanismState) -> DriverCommand:
        """The speed that the law gives, as far as it can be reached by the end of the interval."""
        keys = self._keys
        change = keys.max_acceleration * self._interval_s
        requested = min(max(self._requested_speed(state), self._speed - change), self._speed + change)
        self._speed = min(max(requested, keys.lowest_speed), keys.highest_speed)
        return DriverCommand(state.run_id, tick, keys.driver, self._speed)

    def _requested_speed(self, state: MechanismState) -> float:
        law = self._keys.law
        assert isinstance(law, DraftLimit)
        acceleration = law.gain_per_kg * (law.draft_limit_newton - state.draft_newton)
        return self._speed + acceleration * self._interval_s


def build_controller(resolved: ResolvedScene, resumed: Checkpoint | None = None) -> Controller | None:
    """The scene's controller; None if it names none, or an external one.

    resumed: checkpoint to continue from; the last commanded speed is in the mechanism's part.
    """
    scene = resolved.scene
    if scene.controller is None or scene.mechanism is None or isinstance(scene.controller.law, External):
        return None
    ramp = first_ramp(scene)
    if resumed is not None:
        ramp = Ramp(*resumed.read_part(MECHANISM)["ramp"].tolist())
    interval_s = scene.controller.interval_ticks * resolved.timing.communication_step_s
    return SpeedController(scene.controller, ramp.end_speed, interval_s)
