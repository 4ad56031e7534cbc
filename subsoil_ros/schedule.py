"""Schedule of a run by tick: what is recorded, commanded, checked and kept, and where the run may end."""

from dataclasses import dataclass, replace

from .limits.stable_steps import Timing
from .scene.scene import Scene
from .ticks import NANOSECONDS_PER_SECOND

CHECK_S = 0.1
"""Simulated time between checks of `stop_when`, the nearest multiple of the series interval: short
compared with the seconds that a mean needs to settle, and long compared with the cost of a check."""


@dataclass(frozen=True)
class Schedule:
    """What is due at each tick of a run. Intervals are in ticks; 0: never."""

    tick_count: int
    series_ticks: int = 1
    cloud_ticks: int = 0
    checkpoint_ticks: int = 0
    control_ticks: int = 0  # a multiple of series_ticks
    check_ticks: int = 0  # a multiple of series_ticks
    first_tick: int = 0  # later in a resumed run

    @classmethod
    def of(cls, scene: Scene, timing: Timing) -> "Schedule":
        """The schedule of a scene; clouds and checkpoints at the nearest multiple of the tick."""
        record, tick_ns = scene.record, timing.communication_step_ns
        cloud_ticks = checkpoint_ticks = check_ticks = 0
        if scene.has_clouds and record.cloud_hz > 0.0:
            cloud_ticks = max(1, round(NANOSECONDS_PER_SECOND / (record.cloud_hz * tick_ns)))
        if scene.checkpoint_s > 0.0:
            checkpoint_ticks = max(1, round(scene.checkpoint_s * NANOSECONDS_PER_SECOND / tick_ns))
        if scene.stop_when is not None:
            series = round(CHECK_S * NANOSECONDS_PER_SECOND / (record.series_ticks * tick_ns))
            check_ticks = max(2, series * record.series_ticks, record.series_ticks)
        return cls(
            timing.tick_count,
            record.series_ticks,
            cloud_ticks,
            checkpoint_ticks,
            scene.controller.interval_ticks if scene.controller is not None else 0,
            check_ticks,
        )

    @property
    def last_tick(self) -> int:
        """The tick the run ends with."""
        return self.tick_count - 1

    def begins_with(self, tick: int) -> "Schedule":
        """This schedule where `tick` is the first one, of a resumed run."""
        return replace(self, first_tick=tick)

    def ends_with(self, tick: int) -> "Schedule":
        """This schedule where `tick` is the last one."""
        return replace(self, tick_count=tick + 1)

    def may_end(self, tick: int) -> bool:
        """Whether the run may end with `tick`: the last one, or the one after a check tick."""
        early = self.check_ticks > 0 and tick > 0 and (tick + 1) % self.check_ticks == 0
        return tick == self.last_tick or (early and tick < self.last_tick)

    def check_due(self, tick: int) -> bool:
        """Whether `tick` is a check tick: at its end it is decided if the next tick is the last one."""
        return (
            self.check_ticks > 0
            and tick >= 0
            and (tick + 2) % self.check_ticks == 0
            and tick < self.last_tick
        )

    def next_check(self, tick: int) -> int:
        """The first check tick from `tick` on, whether or not the run lasts that long; it has check ticks."""
        return -(-(max(tick, 0) + 2) // self.check_ticks) * self.check_ticks - 2

    def series_due(self, tick: int) -> bool:
        """Whether states, reports, poses and wrenches of `tick` are recorded; those before tick 0 are."""
        return (tick + 1) % self.series_ticks == 0 or tick == self.last_tick

    def cloud_due(self, tick: int) -> bool:
        """Whether the soil's cloud at the end of `tick` is recorded."""
        return self.cloud_ticks > 0 and ((tick + 1) % self.cloud_ticks == 0 or tick == self.last_tick)

    def control_due(self, tick: int) -> bool:
        """Whether a controller commands `tick`; never the first tick of a scene."""
        return self.control_ticks > 0 and tick > 0 and tick % self.control_ticks == 0

    def next_control(self, tick: int) -> int:
        """The first tick from `tick` on that a controller commands; 1 or later without a controller."""
        every = max(self.control_ticks, 1)
        return -(-max(tick, 1) // every) * every

    def checkpoint_due(self, tick: int) -> bool:
        """Whether a checkpoint is written at the end of `tick`; never at the end of the run."""
        every = self.checkpoint_ticks
        return every > 0 and (tick + 1) % every == 0 and tick != self.last_tick
