"""Schedule of the records by tick, used by the direct run, the nodes and the recorder alike."""

from dataclasses import dataclass, replace

from ..limits.stable_steps import Timing
from ..scene.model import Scene
from ..ticks import NANOSECONDS_PER_SECOND, every_ticks, is_control_tick, is_early_end

CHECK_S = 0.1
"""Simulated time between checks of `stop_when`, the nearest multiple of the series interval: short
compared with the seconds that a mean needs to settle, and long compared with the cost of a check."""


@dataclass(frozen=True)
class Schedule:
    """Series and clouds of a run, by tick."""

    tick_count: int
    series_ticks: int
    cloud_ticks: int  # 0: no clouds
    checkpoint_ticks: int = 0  # 0: no checkpoints
    control_ticks: int = 0  # 0: no controller
    check_ticks: int = (
        0  # a multiple of series_ticks: the run may end early with a series tick; 0: it may not
    )

    @property
    def last_tick(self) -> int:
        """The tick the run ends with."""
        return self.tick_count - 1

    def series_due(self, tick: int) -> bool:
        """Whether states, reports, poses and wrenches of `tick` are recorded."""
        return (tick + 1) % self.series_ticks == 0 or tick == self.last_tick

    def ends_with(self, tick: int) -> "Schedule":
        """This schedule where `tick` is the last one."""
        return replace(self, tick_count=tick + 1)

    def check_due(self, tick: int) -> bool:
        """Whether `tick` is a check tick: at its end it is decided if the next tick is the last one."""
        return tick < self.last_tick and is_early_end(tick + 1, self.check_ticks)

    def control_due(self, tick: int) -> bool:
        """Whether a controller commands `tick`."""
        return is_control_tick(tick, self.control_ticks)

    def cloud_due(self, tick: int) -> bool:
        """Whether the soil's cloud at the end of `tick` is recorded."""
        if self.cloud_ticks == 0:
            return False
        return (tick + 1) % self.cloud_ticks == 0 or tick == self.last_tick

    def checkpoint_due(self, tick: int) -> bool:
        """Whether a checkpoint is written at the end of `tick`; never at the end of the run."""
        if self.checkpoint_ticks == 0 or tick == self.last_tick:
            return False
        return (tick + 1) % self.checkpoint_ticks == 0


def schedule_of(scene: Scene, timing: Timing) -> Schedule:
    """Return the schedule of a scene; clouds and checkpoints at the nearest multiple of the tick."""
    cloud_ticks = 0
    if scene.particle_soil is not None:
        cloud_ticks = every_ticks(scene.record.cloud_hz, timing.communication_step_ns)
    checkpoint_ticks = 0
    if scene.record.checkpoint_s > 0.0:
        ticks = round(scene.record.checkpoint_s * NANOSECONDS_PER_SECOND / timing.communication_step_ns)
        checkpoint_ticks = max(1, ticks)
    control_ticks = scene.controller.interval_ticks if scene.controller is not None else 0
    series_ticks = scene.record.series_ticks
    check_ticks = 0
    if scene.stop_when is not None:
        series = round(CHECK_S * NANOSECONDS_PER_SECOND / (series_ticks * timing.communication_step_ns))
        check_ticks = max(2, series * series_ticks, series_ticks)
    return Schedule(
        timing.tick_count, series_ticks, cloud_ticks, checkpoint_ticks, control_ticks, check_ticks
    )
