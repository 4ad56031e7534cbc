"""Mechanism and soil that compute nothing: what is left of a run is the cost of its exchanges."""

import sys
import time
from array import array
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np
from rclpy.context import Context

from ...coupling.protocol import MECHANISM, SOIL
from ...loading.loader import ResolvedScene
from ...messages import (
    BodyState,
    DriverCommand,
    FacetGroupForce,
    MechanismState,
    SoilCloud,
    SoilState,
    ToolMotion,
    ToolWrench,
)
from ...ticks import INITIAL_TICK
from ..process.heartbeat import Heartbeat, NodeRun
from ..process.node_process import run_process
from ..process.parameters import NodeSettings
from .mechanism_node import MechanismNode
from .soil_node import SoilNode

STAMPS_FILE = "stamps_ns.bin"
"""Beside the scene: when each tick began, int64 in the machine's order, monotonic."""

_STEP_M = 1e-5


class _Stateless:
    """Nothing to keep in a checkpoint."""

    def state_arrays(self) -> dict[str, np.ndarray]:
        """None."""
        return {}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Nothing to do."""


class IdleMechanism(_Stateless):
    """Moves every tool forward at constant speed, and notes when it was asked to."""

    def __init__(self, resolved: ResolvedScene, stamps: Path) -> None:
        scene = resolved.scene
        self._last_tick = resolved.timing.tick_count - 1
        self._tools = tuple(scene.tools)
        self._bodies = tuple(scene.mechanism.bodies) if scene.mechanism is not None else ()
        self._stamps_file = stamps
        self._stamps_ns = array("q")

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """At the origin."""
        return self._motions(0.0)

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """One step further; after the last one the times are written."""
        self._stamps_ns.append(time.monotonic_ns())
        if tick == self._last_tick:
            self._stamps_file.write_bytes(self._stamps_ns.tobytes())
        return self._motions((tick + 1) * _STEP_M)

    def initial_state(self, run_id: str, wrenches: tuple[ToolWrench, ...]) -> MechanismState:
        """All zero."""
        return self.state(run_id, INITIAL_TICK, 0)

    def state(self, run_id: str, tick: int, end_time_ns: int) -> MechanismState:
        """All zero."""
        bodies = tuple(BodyState(name, *[0.0] * 9) for name in self._bodies)
        zeros = [0.0] * sum(item.type is float for item in fields(MechanismState))
        return MechanismState(run_id, tick, end_time_ns, *zeros, part_count=0, bodies=bodies)  # type: ignore[arg-type, misc]

    def command(self, command: DriverCommand) -> None:
        """Not heard."""

    def _motions(self, x_m: float) -> tuple[ToolMotion, ...]:
        return tuple(ToolMotion(name, x_m, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0) for name in self._tools)


class IdleSoil(_Stateless):
    """Answers with no force, on two facet groups of every tool."""

    _GROUPS = (FacetGroupForce("share", 0.0, 0.0, 0.0), FacetGroupForce("blade", 0.0, 0.0, 0.0))

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """No force."""
        return self._wrenches(motions)

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """No force."""
        return self._wrenches(motions)

    def ends_with(self, tick: int) -> None:
        """Nothing depends on it."""

    def state(self, run_id: str, tick: int, end_time_ns: int) -> SoilState:
        """All zero."""
        return SoilState(run_id, tick, end_time_ns, 0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """Nothing to see."""
        return SoilCloud(tick, end_time_ns, [], [])

    def _wrenches(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        zero = 0.0
        return tuple(
            ToolWrench(motion.tool, zero, zero, zero, zero, zero, zero, zero, 0, self._GROUPS)
            for motion in motions
        )


def _mechanism(
    settings: NodeSettings, run: NodeRun, heartbeat: Heartbeat, context: Context | None = None
) -> MechanismNode:
    engine = IdleMechanism(run.resolved, Path(settings.scene).parent / STAMPS_FILE)
    return MechanismNode(engine, run, heartbeat, context)


def _soil(
    settings: NodeSettings, run: NodeRun, heartbeat: Heartbeat, context: Context | None = None
) -> SoilNode:
    return SoilNode(IdleSoil(), None, run, heartbeat, context)


def main() -> int:
    """Runs the node named by the first argument, with an idle engine, as a process."""
    name = sys.argv.pop(1)
    return run_process(name, {MECHANISM: _mechanism, SOIL: _soil}[name])


if __name__ == "__main__":
    raise SystemExit(main())
