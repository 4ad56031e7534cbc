"""Tools on prescribed paths: closed-form integrals of the time functions of their speeds, or given poses."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..errors import PhysicsError, ProtocolError
from ..messages import SpatialMotion, ToolMotion, ToolWrench
from ..rotations import Vector, product, quaternion_of
from ..scene.scene import Scene
from ..scene.time_laws import Law
from ..scene.tools import Path, Poses
from ..ticks import INITIAL_TICK, tick_end_s
from .function_tables import NO_FUNCTION, function_integral, function_value, tabulate

if TYPE_CHECKING:
    from ..limits.stable_steps import Timing


class Speeds:
    """Time functions of speeds, with their integrals; None stands for zero."""

    def __init__(self, *laws: Law | None) -> None:
        given = [law for law in laws if law is not None]
        self._functions, _ = tabulate(given)
        places = iter(range(len(given)))
        self._indices = [NO_FUNCTION if law is None else next(places) for law in laws]

    def at(self, time: float) -> tuple[list[float], list[float]]:
        """Distances covered since time 0, and speeds, at `time` [s]."""
        way = [function_integral(self._functions, function, time, time) for function in self._indices]
        return way, [function_value(self._functions, function, time, time) for function in self._indices]


class TurnedPath:
    """The path of one tool along time functions in x, y and z, turned about one axis."""

    def __init__(self, name: str, lateral_m: float, path: Path) -> None:
        turn, self.name = path.turn, name
        self._start_m = (path.start_x_m, lateral_m, path.start_z_m)
        self._start_quaternion = path.start_quaternion
        self.axis: Vector = turn.unit_axis if turn is not None else (0.0, -1.0, 0.0)  # in the world
        law = turn.speed_rad_per_s if turn is not None else path.angular_speed_rad_per_s
        self._speeds = Speeds(path.speed_x_m_per_s, path.speed_y_m_per_s, path.speed_z_m_per_s, law)

    def motion(self, time: float) -> SpatialMotion:
        """Pose and twist at `time` [s]."""
        way, speed = self._speeds.at(time)
        angle, rate = self._turned(way[3], speed[3])
        x, y, z = self.axis
        return SpatialMotion.of(
            self.name,
            (self._start_m[0] + way[0], self._start_m[1] + way[1], self._start_m[2] + way[2]),
            product(quaternion_of((angle * x, angle * y, angle * z)), self._start_quaternion),
            (speed[0], speed[1], speed[2]),
            (rate * x, rate * y, rate * z),
        )

    def _turned(self, angle: float, rate: float) -> tuple[float, float]:
        """Angle [rad] and speed [rad/s] about the axis; given are those of the time function."""
        return angle, rate


class FreePath(TurnedPath):
    """Path of a tool that rolls freely about the axis: I d2(angle)/dt2 = torque about the axis."""

    def __init__(self, name: str, lateral_m: float, path: Path) -> None:
        super().__init__(name, lateral_m, path)
        assert path.turn is not None
        assert path.turn.free is not None
        self._inertia = path.turn.free.inertia_kg_m2
        self.turned = np.array((0.0, path.turn.free.start_speed_rad_per_s))  # angle [rad], speed [rad/s]

    def turn(self, where: str, wrench: ToolWrench, interval_s: float) -> None:
        """Advance by an interval [s] under the torque of `wrench`, held through it: exact.

        Raises:
            PhysicsError: the torque is not finite.
        """
        torque = (wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m)
        acceleration = sum(a * b for a, b in zip(self.axis, torque, strict=True)) / self._inertia
        if not math.isfinite(acceleration):
            raise PhysicsError(f"{where}: the torque on tool '{self.name}' is not finite: {torque} N m")
        self.turned[0] += interval_s * (self.turned[1] + 0.5 * acceleration * interval_s)
        self.turned[1] += acceleration * interval_s

    def _turned(self, angle: float, rate: float) -> tuple[float, float]:
        return float(self.turned[0]), float(self.turned[1])


class PosedPath:
    """The path of one tool through given poses: cubic splines of position and of rotation."""

    def __init__(self, name: str, poses: Poses) -> None:
        from scipy.interpolate import CubicSpline  # slow to import, and rarely used
        from scipy.spatial.transform import Rotation, RotationSpline

        self.name = name
        self._position = CubicSpline(poses.times_s, poses.positions_m)
        self._rotation = RotationSpline(poses.times_s, Rotation.from_rotvec(poses.rotations_rad))

    def motion(self, time: float) -> SpatialMotion:
        """Pose and twist at `time` [s]."""
        rotation = self._rotation(time)
        return SpatialMotion.of(
            self.name,
            tuple(self._position(time).tolist()),
            tuple(rotation.as_quat().tolist()),
            tuple(self._position(time, 1).tolist()),
            tuple(rotation.apply(self._rotation(time, 1)).tolist()),  # rates are given in the tool's axes
        )


class PathEngine:
    """Moves tools along given paths. Forces do not change a path; they only turn tools that roll freely."""

    keeps_state = True

    def __init__(self, scene: Scene, timing: "Timing") -> None:
        self._interval_ns = timing.communication_step_ns
        self._tick = INITIAL_TICK
        self._paths = [
            tool_path(name, tool.lateral_m, tool.path)
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


def tool_path(name: str, lateral_m: float, path: Path) -> PlanarPath | TurnedPath | PosedPath:
    if path.poses is not None:
        return PosedPath(name, path.poses)
    if path.turn is not None and path.turn.free is not None:
        return FreePath(name, lateral_m, path)
    return TurnedPath(name, lateral_m, path) if path.is_spatial else PlanarPath(name, lateral_m, path)
