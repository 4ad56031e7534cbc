"""Tools on prescribed paths: closed-form integrals of the time functions of their speeds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ProtocolError
from ..messages import ToolMotion, ToolWrench
from ..scene.model import Scene
from ..scene.time_functions import Law
from ..ticks import INITIAL_TICK, tick_end_s
from .time_functions import NO_FUNCTION, function_integral, function_value, tabulate

if TYPE_CHECKING:
    from ..limits.stable_steps import Timing


class PathEngine:
    """Moves tools without a mechanism; nothing pushes them back."""

    def __init__(self, scene: Scene, timing: "Timing") -> None:
        self._interval_ns = timing.communication_step_ns
        self._tick = INITIAL_TICK
        self._paths = [
            (name, tool.lateral_m, tool.path) for name, tool in scene.tools.items() if tool.path is not None
        ]
        functions: list[Law] = []
        self._indices: list[list[int]] = []  # of the functions of every tool: x, z, angle
        for _, _, path in self._paths:
            triple = []
            for function in (path.speed_x_m_per_s, path.speed_z_m_per_s, path.angular_speed_rad_per_s):
                triple.append(NO_FUNCTION if function is None else len(functions))
                if function is not None:
                    functions.append(function)
            self._indices.append(triple)
        self._functions, _ = tabulate(functions)

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """Poses and twists before the first tick, in scene order."""
        return self._motions(tick_end_s(self._tick, self._interval_ns))

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...] = ()) -> tuple[ToolMotion, ...]:
        """Poses and twists at the end of `tick`; the wrenches change nothing.

        Raises:
            ProtocolError: not the next tick.
        """
        if tick != self._tick + 1:
            raise ProtocolError(f"path: asked to advance tick {tick}, but the next one is {self._tick + 1}")
        self._tick = tick
        return self._motions(tick_end_s(tick, self._interval_ns))

    def state_arrays(self) -> dict[str, np.ndarray]:
        """The tick: the paths are functions of time."""
        return {"tick": np.array(self._tick)}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Goes on from such a state."""
        self._tick = int(arrays["tick"])

    def _motions(self, time: float) -> tuple[ToolMotion, ...]:
        motions = []
        for (name, lateral_m, path), indices in zip(self._paths, self._indices, strict=True):
            distance = [function_integral(self._functions, function, time, time) for function in indices]
            speed = [function_value(self._functions, function, time, time) for function in indices]
            motions.append(
                ToolMotion(
                    tool=name,
                    x_m=path.start_x_m + distance[0],
                    y_m=lateral_m,
                    z_m=path.start_z_m + distance[1],
                    angle_rad=path.start_angle_rad + distance[2],
                    velocity_x_m_per_s=speed[0],
                    velocity_z_m_per_s=speed[1],
                    angular_velocity_rad_per_s=speed[2],
                )
            )
        return tuple(motions)
