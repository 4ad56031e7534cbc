"""Runs that end once their mean is known: the rule of `stop_when`.

The metric is averaged over bins of ticks. A check takes the interval of the bins' mean (stationarity.py) and
ends the run where half-width <= relative_interval |mean| and no drift is seen. Repeated checks make such an
interval somewhat too narrow, because the run ends at the first check that passes.
"""

import math
from dataclasses import replace

import numpy as np

from ..coupling.checkpoints import CouplingState, StopState
from ..loading.loader import ResolvedScene
from ..messages import SpatialMotion, ToolMotion, ToolWrench
from ..recording.checkpoint import Checkpoint
from ..rotations import turned
from ..scene.tool_mesh import reference_angle
from ..ticks import NANOSECONDS_PER_SECOND, tick_end_s
from ..yaml_document import Document
from .columns import draft_of
from .metrics_window import mesh_tip_m, named_tool
from .stationarity import stationarity

BIN_S = 0.01
"""Simulated time of a bin: short against a failure cycle of soil, which takes some tenths of a second, and
long enough that even the longest field has few bins."""

UNKNOWN = "too short"
"""Verdict before a check has had enough bins."""


class KnownMean:
    """The rule of a scene's `stop_when`: coupling.tick_rules.StopRule.

    Args:
        state: the rule's state in the checkpoint that the run resumes from; None: from the first tick.
    """

    def __init__(self, resolved: ResolvedScene, state: StopState | None = None) -> None:
        scene = resolved.scene
        assert scene.stop_when is not None
        assert scene.soil is not None  # the scene model refuses it
        self.state = state or StopState()
        self._scene, self._stop_when = scene, scene.stop_when
        self._communication_step_ns = resolved.timing.communication_step_ns
        self._bin_ticks = max(1, round(BIN_S * NANOSECONDS_PER_SECOND / self._communication_step_ns))
        self._tools = frozenset(
            name
            for name, tool in scene.tools.items()
            if tool.is_tillage or self._stop_when.metric == "draft_newton"
        )
        self._arms = {name: _tip_arm(resolved, name) for name, tool in scene.tools.items() if tool.is_tillage}
        named = named_tool(scene)
        assert named is not None  # as above
        self._named = named
        self._inside_m = scene.report.window_inside_m
        self._last_m = scene.soil.bin.length_m - self._inside_m

    def add(self, tick: int, motions: tuple[ToolMotion, ...], wrenches: tuple[ToolWrench, ...]) -> None:
        """Take the exchange of `tick`; it counts if all tips are inside the metrics window."""
        state = self.state
        tips_m = self._tips_m(motions)
        tip_m = tips_m[self._named]
        start_m = tip_m if state.start_m is None else state.start_m
        settled = tick_end_s(tick, self._communication_step_ns) > self._scene.report.settle_s
        started = state.started or (settled and min(tips_m.values()) >= self._inside_m)
        ended = state.ended or max(tips_m.values()) > self._last_m
        means, total, count = state.means, state.total, state.count
        if started and not ended:
            total += draft_of(wrench for wrench in wrenches if wrench.tool in self._tools)
            count += 1
            if count == self._bin_ticks:
                means, total, count = (*means, total / count), 0.0, 0
        self.state = StopState(
            means, total, count, started, ended, start_m, tip_m - start_m, stops=state.stops
        )

    def check(self) -> bool:
        """Whether the run ends with the next tick: the mean is known, or the tool has gone `at_most_m`."""
        at_most_m = self._stop_when.at_most_m
        over = at_most_m is not None and self.state.travel_m >= at_most_m
        self.state = replace(self.state, stops=over or self.result()["reached"])
        return self.state.stops

    def result(self) -> Document:
        """Mean and half-width of the bins, None where there are too few, and whether they meet the scene."""
        wanted, state = self._stop_when, self.state
        bin_s = self._bin_ticks * self._communication_step_ns * 1e-9
        times_s = np.arange(len(state.means), dtype=np.float64) * bin_s
        found = stationarity(times_s, np.array(state.means))
        mean = half_width = None
        verdict, reached = UNKNOWN, False
        if found is not None:
            mean, half_width, verdict = found.mean, found.half_width(wanted.confidence), found.verdict
            narrow = half_width <= wanted.relative_interval * abs(mean) and math.isfinite(mean)
            reached = narrow and mean != 0.0 and verdict == "no drift seen"
        return {
            **wanted.model_dump(),
            "reached": reached,
            "mean": mean,
            "half_width": half_width,
            "verdict": verdict,
            "travel_m": state.travel_m,
        }

    def _tips_m(self, motions: tuple[ToolMotion, ...]) -> dict[str, float]:
        """Forward positions of the tips of all tillage tools [m], by tool."""
        return {
            motion.tool: _tip_x_m(motion, *self._arms[motion.tool])
            for motion in motions
            if motion.tool in self._arms
        }


def _tip_x_m(motion: ToolMotion, arm_m: tuple[float, float], angle_rad: float) -> float:
    """Forward position of a tip [m]; arm_m, angle_rad: as _tip_arm gives them."""
    arm_x, arm_z = arm_m
    if isinstance(motion, SpatialMotion):
        return motion.x_m + turned(motion.quaternion, (arm_x, 0.0, arm_z))[0]
    turn = motion.angle_rad - angle_rad
    return motion.x_m + math.cos(turn) * arm_x - math.sin(turn) * arm_z


def _tip_arm(resolved: ResolvedScene, name: str) -> tuple[tuple[float, float], float]:
    """From a tool's origin to its tip (x, z) [m] in the reference pose, and the tool's angle there [rad].

    The tip is the tool's origin if the scene has no report.tip_m.
    """
    scene = resolved.scene
    if scene.report.tip_m is None:
        return (0.0, 0.0), 0.0
    if name != named_tool(scene):
        return mesh_tip_m(resolved, name), reference_angle(scene, name)
    x, z = scene.report.tip_m
    body = scene.tools[name].body
    if body is None or scene.mechanism is None:
        return (x, z), 0.0
    reference = scene.mechanism.bodies[body]
    return (x - reference.position_m[0], z - reference.position_m[1]), reference.angle_rad


def build_stop_rule(resolved: ResolvedScene, resumed: Checkpoint | None = None) -> KnownMean | None:
    """The rule of a scene, in the state of a checkpoint; None if the scene has no `stop_when`."""
    if resolved.scene.stop_when is None:
        return None
    return KnownMean(resolved, CouplingState.of(resumed).stopping if resumed is not None else None)
