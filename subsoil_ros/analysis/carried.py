"""What carries the machine: every vertical force on it from outside, row by row, upward positive.

    weight = soil on shares + wheels + hitch + tethers + loads + inertia + rest

hitch: joints and drivers between a body and the ground; tethers: springs there; loads: prescribed forces;
inertia: minus the sum of mass times acceleration. The machine of a row moves under the soil's wrenches
of the tick before, so rest is the change of the soil's force over one tick; without soil it is round-off.
"""

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from ..loading.loader import ResolvedScene
from ..scene.mechanism import (
    GROUND,
    CoordinateSpring,
    Driver,
    Force,
    Joint,
    Mechanism,
    PointLoad,
    SpringDamper,
    WheelContact,
)
from . import columns
from .columns import TIME, Body, Wrench, force_element
from .series import Series

Values = NDArray[np.float64]


def vertical_parts(series: Series, resolved: ResolvedScene) -> dict[str, Values]:
    """Return the parts by name, each (n,) [N]; empty without a mechanism: paths then hold the tools."""
    scene, mechanism = resolved.scene, resolved.scene.mechanism
    if mechanism is None:
        return {}
    parts: dict[str, list[Values]] = defaultdict(list)
    for name, tool in scene.tools.items():
        column = Wrench(name).force_z_newton
        if column in series:
            parts["share" if tool.is_tillage else "wheels"].append(series[column])
    for name, joint in mechanism.joints.items():
        parts["hitch"] += _of_joint(series, mechanism, name, joint)
    half_step_s = 0.5 * resolved.timing.communication_step_s / resolved.timing.mechanism_steps
    for name, force in mechanism.forces.items():
        found = _of_force(series, mechanism, name, force, half_step_s)
        if found is not None:
            parts[found[0]].append(found[1])
    inertia = [
        -body.mass_kg * series[Body(name).acceleration_z_m_per_s2] for name, body in mechanism.bodies.items()
    ]
    return {f"{part}_newton": np.sum(found, axis=0) for part, found in parts.items() if found} | {
        "inertia_newton": np.sum(inertia, axis=0)
    }


def _of_joint(series: Series, mechanism: Mechanism, name: str, joint: Joint) -> list[Values]:
    """Reaction of the ground through a joint or a driver, with friction and stops along its axis."""
    reaction = series[columns.Joint(name).force_z_newton]
    if isinstance(joint, Driver):
        return [reaction] if joint.relative_to in (None, GROUND) else []
    if GROUND not in (joint.body_a, joint.body_b):
        return []
    sign = -1.0 if joint.body_b == GROUND else 1.0  # what is reported acts on body_b
    found = [sign * reaction]
    axis = getattr(joint, "axis", None)
    for part in ("friction", "stops"):
        column = force_element(mechanism, f"{name}.{part}").load
        if axis is not None and column in series:
            _, upward = _turned(series, mechanism, joint.body_a, axis)
            found.append(sign * series[column] * upward / float(np.hypot(*axis)))
    return found


def _of_force(
    series: Series, mechanism: Mechanism, name: str, force: Force, half_step_s: float
) -> tuple[str, Values] | None:
    """The part that a force element belongs to, and its force; None for internal or non-vertical forces."""
    load = force_element(mechanism, name).load
    if isinstance(force, WheelContact):
        return "wheels", series[load]
    if isinstance(force, PointLoad):
        if force.force_z_newton is None:
            return None
        from ..mbd.function_tables import function_value, tabulate  # imports numba

        functions, _ = tabulate([force.force_z_newton])
        # at a jump of a load the value before it, which is the one in the state at the end of a step
        times = [
            (float(time), time + (half_step_s if time == 0.0 else -half_step_s)) for time in series[TIME]
        ]
        return "loads", np.array([function_value(functions, 0, *time) for time in times])
    if isinstance(force, CoordinateSpring):
        upright = force.coordinate == "z"
        return ("tethers", series[load]) if upright else None
    if isinstance(force, SpringDamper) and GROUND in (force.body_a, force.body_b):
        x_a, z_a = _point(series, mechanism, force.body_a, force.point_a_m)
        x_b, z_b = _point(series, mechanism, force.body_b, force.point_b_m)
        length = np.maximum(np.hypot(x_b - x_a, z_b - z_a), np.finfo(float).tiny)
        sign = -1.0 if force.body_b == GROUND else 1.0  # compression pushes body_b from a to b
        return "tethers", sign * series[load] * (z_b - z_a) / length
    return None


def _point(
    series: Series, mechanism: Mechanism, body: str, point_m: tuple[float, float]
) -> tuple[Values, Values]:
    """x and z (n,) [m] of a point given in the reference pose."""
    if body == GROUND:
        level = np.ones(len(series))
        return (point_m[0] + mechanism.initial.translate_x_m) * level, point_m[1] * level
    centre_x, centre_z = mechanism.bodies[body].position_m
    arm_x, arm_z = _turned(series, mechanism, body, (point_m[0] - centre_x, point_m[1] - centre_z))
    return series[Body(body).x_m] + arm_x, series[Body(body).z_m] + arm_z


def _turned(
    series: Series, mechanism: Mechanism, body: str, vector: tuple[float, float]
) -> tuple[Values, Values]:
    """x and z (n,) of a vector given in the reference pose and fixed in a body."""
    turn = np.zeros(len(series))
    if body != GROUND:
        turn = series[Body(body).angle_rad] - mechanism.bodies[body].angle_rad
    cosine, sine = np.cos(turn), np.sin(turn)
    return cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]
