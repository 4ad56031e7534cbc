"""Mechanism and soil that compute nothing, to measure the cost of the exchanges of a run."""

import sys
import time
from array import array
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np
from rclpy.context import Context

from subsoil_ros.coupling.protocol import MECHANISM, SOIL
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.messages import (
    BodyState,
    DriverCommand,
    FacetGroupForce,
    MechanismState,
    SoilCloud,
    SoilState,
    ToolMotion,
    ToolWrench,
)
from subsoil_ros.ros.nodes.mechanism_node import MechanismNode
from subsoil_ros.ros.nodes.soil_node import SoilNode
from subsoil_ros.ros.process.heartbeat import Heartbeat
from subsoil_ros.ros.process.node_process import run_process
from subsoil_ros.ticks import INITIAL_TICK

STAMPS_FILE = "stamps_ns.bin"
"""File beside the scene: start of each tick on the monotonic clock [ns], int64 in native byte order."""

_STEP_M = 1e-5


class _Stateless:
    """An engine without state."""

    keeps_state = True

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Return no arrays."""
        return {}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Do nothing."""


class IdleMechanism(_Stateless):
    """Moves every tool forward at constant speed, and keeps the times at which ticks begin."""

    def __init__(self, resolved: ResolvedScene, stamps: Path) -> None:
        scene = resolved.scene
        self._last_tick = resolved.timing.tick_count - 1
        self._tools = tuple(scene.tools)
        self._bodies = tuple(scene.mechanism.bodies) if scene.mechanism is not None else ()
        self._stamps_file = stamps
        self._stamps_ns = array("q")

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """Motions at the origin."""
        return self._motions(0.0)

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """Motions one step further; writes the times after the last tick."""
        self._stamps_ns.append(time.monotonic_ns())
        if tick == self._last_tick:
            self._stamps_file.write_bytes(self._stamps_ns.tobytes())
        return self._motions((tick + 1) * _STEP_M)

    def initial_state(self, run_id: str, wrenches: tuple[ToolWrench, ...]) -> MechanismState:
        """A state of zeros."""
        return self.state(run_id, INITIAL_TICK, 0)

    def state(self, run_id: str, tick: int, end_time_ns: int) -> MechanismState:
        """A state of zeros."""
        bodies = tuple(BodyState(name, *[0.0] * 9) for name in self._bodies)
        zeros = [0.0] * sum(item.type is float for item in fields(MechanismState))
        return MechanismState(run_id, tick, end_time_ns, *zeros, part_count=0, bodies=bodies)  # type: ignore[arg-type, misc]

    def command(self, command: DriverCommand) -> None:
        """Ignore the command."""

    def _motions(self, x_m: float) -> tuple[ToolMotion, ...]:
        return tuple(ToolMotion(name, x_m, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0) for name in self._tools)


class IdleSoil(_Stateless):
    """Returns wrenches of zero, with two facet groups for every tool."""

    _GROUPS = (FacetGroupForce("share", 0.0, 0.0, 0.0), FacetGroupForce("blade", 0.0, 0.0, 0.0))

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of zero."""
        return self._wrenches(motions)

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of zero."""
        return self._wrenches(motions)

    def ends_with(self, tick: int) -> None:
        """Do nothing: no result depends on the last tick."""

    def state(self, run_id: str, tick: int, end_time_ns: int) -> SoilState:
        """A state of zeros."""
        return SoilState(run_id, tick, end_time_ns)

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """A cloud without particles."""
        return SoilCloud(tick, end_time_ns, [], [])

    def _wrenches(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        zero = 0.0
        return tuple(
            ToolWrench(motion.tool, zero, zero, zero, zero, zero, zero, zero, 0, self._GROUPS)
            for motion in motions
        )


def _mechanism(run: RunSettings, heartbeat: Heartbeat, context: Context | None = None) -> MechanismNode:
    engine = IdleMechanism(run.resolved, run.resolved.path.parent / STAMPS_FILE)
    return MechanismNode(engine, run, heartbeat, context)


def _soil(run: RunSettings, heartbeat: Heartbeat, context: Context | None = None) -> SoilNode:
    return SoilNode(IdleSoil(), None, run, heartbeat, context)


def main() -> int:
    """Runs the node named by the first argument, with an idle engine, as a process."""
    name = sys.argv.pop(1)
    return run_process(name, {MECHANISM: _mechanism, SOIL: _soil}[name])


if __name__ == "__main__":
    raise SystemExit(main())
