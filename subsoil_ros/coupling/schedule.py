"""Which ticks record what: the one answer for the direct run, the nodes and the recorder."""

from dataclasses import dataclass

from ..limits.stable_steps import Timing
from ..scene.model import Scene
from ..ticks import NANOSECONDS_PER_SECOND, every_ticks, is_control_tick


@dataclass(frozen=True)
class Schedule:
    """Series and clouds of a run, by tick."""

    tick_count: int
    series_ticks: int
    cloud_ticks: int  # 0: no clouds
    checkpoint_ticks: int = 0  # 0: no checkpoints
    control_ticks: int = 0  # 0: no controller

    @property
    def last_tick(self) -> int:
        """The tick the run ends with."""
        return self.tick_count - 1

    def series_due(self, tick: int) -> bool:
        """Whether states, reports, poses and wrenches of `tick` are recorded."""
        return (tick + 1) % self.series_ticks == 0 or tick == self.last_tick

    def control_due(self, tick: int) -> bool:
        """Whether a controller commands `tick`."""
        return is_control_tick(tick, self.control_ticks)

    def cloud_due(self, tick: int) -> bool:
        """Whether the soil's cloud at the end of `tick` is recorded."""
        if self.cloud_ticks == 0:
            return False
        return (tick + 1) % self.cloud_ticks == 0 or tick == self.last_tick

    def checkpoint_due(self, tick: int) -> bool:
        """Whether the state at the end of `tick` is kept; never that at the end of the run."""
        if self.checkpoint_ticks == 0 or tick == self.last_tick:
            return False
        return (tick + 1) % self.checkpoint_ticks == 0


def schedule_of(scene: Scene, timing: Timing) -> Schedule:
    """The schedule a scene asks for; clouds and checkpoints at the nearest multiple of the tick."""
    cloud_ticks = 0
    if scene.particle_soil is not None:
        cloud_ticks = every_ticks(scene.record.cloud_hz, timing.communication_step_ns)
    checkpoint_ticks = 0
    if scene.record.checkpoint_s > 0.0:
        ticks = round(scene.record.checkpoint_s * NANOSECONDS_PER_SECOND / timing.communication_step_ns)
        checkpoint_ticks = max(1, ticks)
    control_ticks = scene.controller.interval_ticks if scene.controller is not None else 0
    return Schedule(
        timing.tick_count, scene.record.series_ticks, cloud_ticks, checkpoint_ticks, control_ticks
    )
