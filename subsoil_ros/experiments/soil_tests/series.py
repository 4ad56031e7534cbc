"""One run of a box with soil in it, and its rows."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...api.simulate import simulate
from ...dem.engine import build_engine
from ...limits.stable_steps import Timing
from ...loading.loader import ResolvedScene
from ...messages import MechanismState, SoilState, ToolMotions, ToolWrenches
from ...ticks import INITIAL_TICK
from .specimen import Specimen

RunProgress = Callable[[str, Timing], AbstractContextManager[Callable[[int], None]]]
"""Shows a run, given its name and timing; yields a callback that takes every tick."""


@dataclass
class Series:
    """Sink of the records of a run; one row per series tick."""

    times_s: list[float] = field(default_factory=list)
    rows: list[dict[str, float]] = field(default_factory=list)
    _last: dict[type, Any] = field(default_factory=dict)

    def write(self, record: Any) -> None:
        """Add one record."""
        self._last[type(record)] = record
        if not isinstance(record, SoilState) or record.tick == INITIAL_TICK:
            return  # a SoilState is the last record of a tick that is used here
        motions = {motion.tool: motion for motion in self._last[ToolMotions].tools}
        wrenches = {wrench.tool: wrench for wrench in self._last[ToolWrenches].tools}
        machine: MechanismState = self._last[MechanismState]
        self.times_s.append(record.end_time_ns * 1e-9)
        self.rows.append(
            {
                "x": motions["upper"].x_m,
                "z": motions["upper"].z_m,
                "upper_x": wrenches["upper"].force_x_newton,
                "upper_z": wrenches["upper"].force_z_newton,
                "lower_x": wrenches["lower"].force_x_newton,
                "lower_z": wrenches["lower"].force_z_newton,
                "drive": machine.draft_newton,
            }
        )

    def column(self, name: str) -> NDArray[np.float64]:
        """(n,) one column, SI."""
        return np.array([row[name] for row in self.rows])


def run_box(
    resolved: ResolvedScene,
    specimen: Specimen,
    threads: int,
    watched: AbstractContextManager[Callable[[int], None]],
) -> tuple[Series, NDArray[np.float64]]:
    """Run a test; return its series and the final positions (n, 3) [m] of its particles."""
    soil = build_engine(resolved, threads)
    series = Series()
    with watched as on_tick:
        simulate(resolved, soil=soil, sink=series, on_tick=on_tick)
    ends_m = soil.positions_m()
    assert len(ends_m) == len(specimen.bed.positions_m), "the box stands off every particle"
    return series, ends_m
