"""Interface of the rule that decides at check ticks whether a run ends early."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from ..messages import ToolMotion, ToolWrench


@dataclass(frozen=True, slots=True)
class StopState:
    """All that later checks depend on: the means of the bins that are full, and the bin that is not."""

    means: tuple[float, ...] = ()  # of the metric, one a bin
    total: float = 0.0  # of the metric over the ticks of the bin that is not full
    count: int = 0  # ticks in that bin
    started: bool = False  # the metrics window has begun
    ended: bool = False  # it is over
    start_m: float | None = None  # tip at the end of the first tick; None: before it
    travel_m: float = 0.0  # of the tip since then
    stops: bool = False  # a check has ended the run

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> "StopState":
        """The state in a checkpoint."""
        return cls(**{**document, "means": tuple(document["means"])})


class StopRule(Protocol):
    """Observes the exchange of every tick, and decides at check ticks whether the run ends."""

    state: StopState

    def add(self, tick: int, motions: tuple[ToolMotion, ...], wrenches: tuple[ToolWrench, ...]) -> None:
        """Add the exchange of `tick`."""
        ...

    def check(self) -> bool:
        """Decide from the ticks added whether the run ends with the next tick."""
        ...

    def result(self) -> dict[str, Any]:
        """Present result for the mean, in the form of `run.stop_when` of summary.json."""
        ...
