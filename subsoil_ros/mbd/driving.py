"""Speeds of drivers: without jumps; between two commands of a controller they change linearly."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import PhysicsError, ProtocolError, SceneError
from ..messages import DriverCommand
from ..scene.controller import Controller
from ..scene.mechanism import Driver, Mechanism
from ..scene.scene import Scene
from ..scene.time_laws import ConstantLaw, HalfSineLaw, Law, PolynomialLaw, RampLaw, SineLaw, SumLaw, TableLaw
from .function_tables import FunctionTable

ROUND_OFF = 1e-9
"""Part by which a command may exceed the largest acceleration, because speeds are rounded."""


@dataclass(frozen=True)
class Ramp:
    """Motion of a commanded driver since its last command. For an angle the units are rad, rad/s, rad/s2."""

    start_s: float
    speed: float  # at start_s [m/s]
    acceleration: float  # since then [m/s2]
    end_speed: float  # commanded, reached at the end of the control interval [m/s]
    distance: float  # at start_s, since time 0 [m]

    def distance_at(self, time_s: float) -> float:
        """Distance since time 0 [m]."""
        span = time_s - self.start_s
        return self.distance + span * (self.speed + 0.5 * span * self.acceleration)


def first_ramp(scene: Scene) -> Ramp:
    """The motion of the driver that the scene's controller commands, before its first command."""
    assert scene.mechanism is not None
    assert scene.controller is not None
    driver = scene.mechanism.joints[scene.controller.driver]
    assert isinstance(driver, Driver)
    assert isinstance(driver.speed, ConstantLaw)
    speed = float(driver.speed.value)
    return Ramp(0.0, speed, 0.0, speed, 0.0)


def next_ramp(
    ramp: Ramp, command: DriverCommand, controller: Controller, start_s: float, interval_s: float
) -> Ramp:
    """Return the motion that follows from a command, from start_s [s] on.

    interval_s: time between two commands of the controller.

    Raises:
        ProtocolError: the command is for another driver.
        PhysicsError: a speed that is no number, or out of the controller's limits, or a jump.
    """
    where = f"tick {command.tick}: driver_command"
    if command.driver != controller.driver:
        raise ProtocolError(
            f"{where}: is for driver '{command.driver}'; commanded is '{controller.driver}' "
            "(controller.driver)"
        )
    speed, before = command.speed, ramp.end_speed
    if not math.isfinite(speed):
        raise PhysicsError(f"{where}: speed {speed} of driver '{command.driver}' is not finite")
    lowest, highest = controller.lowest_speed, controller.highest_speed
    if not lowest <= speed <= highest:
        raise PhysicsError(
            f"{where}: speed {speed:g} of driver '{command.driver}' is outside of the controller's limits, "
            f"{lowest:g} to {highest:g}"
        )
    acceleration = (speed - before) / interval_s
    largest = controller.max_acceleration
    if abs(acceleration) > largest * (1.0 + ROUND_OFF):
        raise PhysicsError(
            f"{where}: speed {speed:g} of driver '{command.driver}' is a jump: from {before:g} within "
            f"{interval_s:g} s it is an acceleration of {abs(acceleration):.3g}, allowed is "
            f"controller.max_acceleration {largest:g}"
        )
    return Ramp(start_s, before, acceleration, speed, ramp.distance_at(start_s))


def refuse_jumps(mechanism: Mechanism, step_s: float) -> None:
    """Raise SceneError if a driver's speed changes within less than a step: no step has its acceleration."""
    for name, joint in mechanism.joints.items():
        if not isinstance(joint, Driver):
            continue
        for span_s, change in _changes(joint.speed):
            if span_s < step_s and change != 0.0:
                raise SceneError(
                    f"mechanism.joints.{name}.speed: changes by {change:.3g} within {span_s:.3g} s, less "
                    f"than a step of {step_s:.3g} s: a jump, which needs an infinite force; give it a step "
                    "or more, or raise coupling.mechanism_steps"
                )


def _changes(function: Law) -> Iterator[tuple[float, float]]:
    """Times [s] in which a function changes, and by how much."""
    if isinstance(function, SumLaw):
        for term in function.terms:
            yield from _changes(term)
    elif isinstance(function, RampLaw):
        yield function.end_s - function.start_s, function.end_value - function.start_value
    elif isinstance(function, TableLaw):
        yield from zip(np.diff(function.times_s).tolist(), np.diff(function.values).tolist(), strict=True)
    elif isinstance(function, HalfSineLaw):
        yield 0.5 * function.duration_s, function.peak
    elif isinstance(function, SineLaw):
        yield 0.25 / function.frequency_hz, function.amplitude
    elif isinstance(function, PolynomialLaw) and function.end_s is not None:
        span_s = function.end_s - function.start_s
        end = float(np.polynomial.polynomial.polyval(span_s, function.coefficients))
        yield span_s, end - function.coefficients[0]


def write_ramp(functions: FunctionTable, function: int, ramp: Ramp) -> None:
    """Write a ramp over a driver's time function, whose one segment is the constant speed of the scene."""
    segment = functions.segments[functions.first[functions.chains[function]]]
    segment["reference"] = ramp.start_s
    segment["degree"] = 1
    segment["coefficients"][:2] = ramp.speed, ramp.acceleration
    segment["integral"] = ramp.distance
