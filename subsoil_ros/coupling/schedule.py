"""Which ticks record what: the one answer for the direct run, the nodes and the recorder."""

from dataclasses import dataclass

from ..scene.limits import Timing
from ..scene.model import Scene
from ..ticks import every_ticks


@dataclass(frozen=True)
class Schedule:
    """Series and clouds of a run, by tick."""

    tick_count: int
    series_ticks: int
    cloud_ticks: int  # 0: no clouds

    @property
    def last_tick(self) -> int:
        """The tick the run ends with."""
        return self.tick_count - 1

    def series_due(self, tick: int) -> bool:
        """Whether states, reports, poses and wrenches of `tick` are recorded."""
        return (tick + 1) % self.series_ticks == 0 or tick == self.last_tick

    def cloud_due(self, tick: int) -> bool:
        """Whether the soil's cloud at the end of `tick` is recorded."""
        if self.cloud_ticks == 0:
            return False
        return (tick + 1) % self.cloud_ticks == 0 or tick == self.last_tick


def schedule_of(scene: Scene, timing: Timing) -> Schedule:
    """The schedule a scene asks for; clouds at the multiple of the tick nearest to 1 / cloud_hz."""
    cloud_ticks = every_ticks(scene.record.cloud_hz, timing.interval_ns) if scene.soil is not None else 0
    return Schedule(timing.tick_count, scene.record.series_ticks, cloud_ticks)
