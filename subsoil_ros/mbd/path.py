"""Tools on prescribed paths: closed-form integrals of the time functions of their speeds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ProtocolError
from ..messages import ToolMotion, ToolWrench
from ..scene.model import Scene
from ..scene.tools import Path
from ..ticks import INITIAL_TICK, tick_end_s
from .spatial_path import FreePath, PosedPath, Speeds, TurnedPath

if TYPE_CHECKING:
    from ..limits.stable_steps import Timing


class PathEngine:
    """Moves tools along given paths. Forces do not change a path; they only turn tools that roll freely."""

    keeps_state = True

    def __init__(self, scene: Scene, timing: "Timing") -> None:
        self._interval_ns = timing.communication_step_ns
        self._tick = INITIAL_TICK
        self._paths = [
            path_of(name, tool.lateral_m, tool.path)
            for name, tool in scene.tools.items()
            if tool.path is not None
        ]

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """Poses and twists before the first tick, in scene order."""
        return self._motions()

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...] = ()) -> tuple[ToolMotion, ...]:
        """Poses and twists at the end of `tick`; the wrenches, held through it, turn tools that roll freely.

        Raises:
            ProtocolError: not the next tick.
            PhysicsError: the torque on a tool that rolls freely is not finite.
        """
        if tick != self._tick + 1:
            raise ProtocolError(f"path: asked to advance tick {tick}, but the next one is {self._tick + 1}")
        for path, wrench in zip(self._paths, wrenches, strict=False):
            if isinstance(path, FreePath):
                path.turn(f"tick {tick}", wrench, 1e-9 * self._interval_ns)
        self._tick = tick
        return self._motions()

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Return the tick, as paths are functions of time, and angle and speed of tools that roll freely."""
        free = {f"turned.{path.name}": path.turned for path in self._paths if isinstance(path, FreePath)}
        return {"tick": np.array(self._tick), **free}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Restore a state that `state_arrays` returned."""
        self._tick = int(arrays["tick"])
        for path in self._paths:
            if isinstance(path, FreePath):
                path.turned[:] = arrays[f"turned.{path.name}"]

    def _motions(self) -> tuple[ToolMotion, ...]:
        time = tick_end_s(self._tick, self._interval_ns)
        return tuple(path.motion(time) for path in self._paths)


class PlanarPath:
    """The path of one tool in the plane of travel."""

    def __init__(self, name: str, lateral_m: float, path: Path) -> None:
        self.name, self._lateral_m, self._path = name, lateral_m, path
        self._speeds = Speeds(path.speed_x_m_per_s, path.speed_z_m_per_s, path.angular_speed_rad_per_s)

    def motion(self, time: float) -> ToolMotion:
        """Pose and twist at `time` [s]."""
        way, speed = self._speeds.at(time)
        return ToolMotion(
            self.name,
            self._path.start_x_m + way[0],
            self._lateral_m,
            self._path.start_z_m + way[1],
            self._path.start_angle_rad + way[2],
            *speed,
        )


def path_of(name: str, lateral_m: float, path: Path) -> PlanarPath | TurnedPath | PosedPath:
    if path.poses is not None:
        return PosedPath(name, path.poses)
    if path.turn is not None and path.turn.free is not None:
        return FreePath(name, lateral_m, path)
    return TurnedPath(name, lateral_m, path) if path.is_spatial else PlanarPath(name, lateral_m, path)
