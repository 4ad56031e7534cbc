"""Paths of tools in space: along time functions, turned about an axis, or through given poses."""

import math

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from ..errors import PhysicsError
from ..messages import SpatialMotion, ToolWrench
from ..rotations import Vector, product, quaternion_of
from ..scene.time_laws import Law
from ..scene.tools import Path, Poses
from .time_functions import NO_FUNCTION, function_integral, function_value, tabulate


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
