"""What is checked of a soil before and after each soil step."""

import math
from collections.abc import Sequence

from ..errors import PhysicsError, SceneError
from ..messages import ToolMotion
from .model import SoilModel
from .monitors import Observable
from .state import SoilState
from .tools.surface import ToolSurface, refuse_leap


class StepChecks:
    """The checks of one state, which `soil` shows.

    ends_m: ends of a field, where walls stand.
    """

    def __init__(
        self, model: SoilModel, state: SoilState, soil: Observable, last_tick: int, ends_m: tuple[float, ...]
    ) -> None:
        self._model, self._state, self._soil, self._ends_m = model, state, soil, ends_m
        self.last_tick = last_tick  # at whose end the monitors look in any case

    def where(self, tick: int, step: int) -> str:
        """Tick and step of an error, for its message."""
        steps = self._model.soil_steps
        return f"tick {tick}" if steps == 1 else f"tick {tick}, soil step {step} of {steps}"

    def begin(self, tick: int, step: int, motions: tuple[ToolMotion, ...]) -> None:
        """Refuse motions of a step, see `refuse`; clear the loads before one that counts alone."""
        if step == self._model.soil_steps:
            self.keep_last_step_only()
        self.refuse(tick, step, motions)

    def refuse(self, tick: int, step: int, motions: tuple[ToolMotion, ...]) -> None:
        """Refuse tools that leap or leave the soil by its sides.

        Raises:
            PhysicsError: a surface moves by more than a radius, or a tool in space is at periodic sides.
        """
        model, state = self._model, self._state
        for tool, motion in zip(state.tools, motions, strict=True):
            allowed_m = model.smallest_m - tool.mesh.setback_m
            if tool.speed_m_per_s(motion) * model.step_s > allowed_m:
                refuse_leap(self.where(tick, step), tool, motion, model.step_s, allowed_m)
            if tool.spatial and model.soil.bin.sides != "walls":
                try:
                    tool.refuse_at_sides(motion, state.domain.bed, model.soil)
                except SceneError as error:
                    raise PhysicsError(f"{self.where(tick, step)}: {error}") from error

    def first_refused(self, tick: int, done: int, way: Sequence[tuple[ToolMotion, ...]]) -> int:
        """The first soil step, from 0, whose motions are refused; refuses those of step `done`."""
        self.refuse(tick, done + 1, way[done])
        for s in range(done + 1, len(way)):
            try:
                self.refuse(tick, s + 1, way[s])
            except PhysicsError:
                return s
        return len(way)

    def keep_last_step_only(self) -> None:
        """`tick_end`: the exchanged force is that of the last step; work is still summed over all."""
        if self._model.last_step_only:
            for tool in self._state.tools:
                work = tool.load.work_joule
                tool.begin_tick()
                tool.load.work_joule = work

    def end(self, tick: int, step: int) -> None:
        """Run the checks of a step that is done, and the monitors when they are due.

        Raises:
            PhysicsError: a tool overlaps a particle too far, or a monitor's bound is passed.
        """
        model, monitor = self._model, self._state.monitor
        for tool in self._state.tools:
            # the default is where contacts end behind a face, which is nearer by the setback
            back_m = 0.0 if model.soil.max_tool_overlap_m else tool.mesh.setback_m
            allowed_m = model.largest_tool_overlap_m - back_m
            if math.isinf(tool.max_overlap_m):
                raise PhysicsError(
                    f"{self.where(tick, step)}: the centre of a particle is pressed through a face of tool "
                    f"{tool.name}, where its contact ends; {self._remedy_of_overlap(tool)}"
                )
            if tool.max_overlap_m > allowed_m:
                less = " less tools.*.setback_m" if back_m else ""
                raise PhysicsError(
                    f"{self.where(tick, step)}: tool {tool.name} overlaps a particle by "
                    f"{tool.max_overlap_m:.3g} m, allowed is soil.max_tool_overlap_m{less} "
                    f"{allowed_m:.3g} m; {self._remedy_of_overlap(tool)}"
                )
        last = step == model.soil_steps and tick == self.last_tick
        if monitor is not None and monitor.due(last=last):
            monitor.check(self.where(tick, step), tick, self._soil)

    def _remedy_of_overlap(self, tool: ToolSurface) -> str:
        """What to do about the overlap of this tool; at an end of a field soil is caught at the wall."""
        low, high = tool.span_m(self._model.soil.bin.depth_m)
        for end in self._ends_m:
            if low - 2.0 * self._model.radius_m < end < high + 2.0 * self._model.radius_m:
                return (
                    f"it presses soil against the wall at the end of the field, x = {end:.4g} m: make "
                    "soil.bin.length_m larger, or let the run end before"
                )
        return "raise soil.tool_stiffness_factor, or make the tool slower or thicker"
