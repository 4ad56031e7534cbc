"""Loads over the metrics window: what carries the machine, power, specific draft and energy.

All follow from the columns of the series. Power is what each tool delivers to the soil, -(F v + M w), and
what the driver of the draft delivers; without a mechanism, the drafts of all tools at their own speeds. The
machine is carried, row by row, upward positive, by every vertical force from outside:

    weight = soil on shares + wheels + hitch + tethers + loads + inertia + rest

hitch: joints and drivers between a body and the ground; tethers: springs there; loads: prescribed forces;
inertia: minus the sum of mass times acceleration. The machine of a row moves under the soil's wrenches
of the tick before, so rest is the change of the soil's force over one tick; without soil it is round-off.
"""

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
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
from ..scene.scene import Scene
from ..scene.tool_faces import cutting_faces
from ..scene.tool_mesh import load_tool_mesh
from ..yaml_document import Document
from . import columns
from .columns import DRAFT, TIME, Body, PlanarTool, SpatialTool, Wrench, force_element
from .metrics_window import Window, tip_path_m
from .series import Series

Values = NDArray[np.float64]

ONE_WAY = 0.01
"""Difference of the travels of two tools, relative to the longer one, up to which a metre is the same for
both: a machine that turns a little has one travel, and its mean draft is rarely known to 1 %."""


def loads_of(series: Series, resolved: ResolvedScene, window: Window) -> Document:
    """Loads over the metrics window, as in summary.json, units in the names; those the scene has."""
    scene, rows = resolved.scene, window.rows
    groups = {"vertical": vertical_parts(series, resolved), "power": _power(series, scene)}
    metrics: Document = {
        group: {name: _statistics(values[rows]) for name, values in found.items()}
        for group, found in groups.items()
    }
    if scene.mechanism is not None:
        weight = scene.gravity_m_per_s2 * sum(body.mass_kg for body in scene.mechanism.bodies.values())
        carried = sum(found["mean"] for found in metrics["vertical"].values())
        metrics["vertical"] |= {"weight_newton": weight, "rest_newton": weight - carried}
    path = tip_path_m(series, scene)
    if path is not None and scene.soil is not None:
        metrics["tip_depth_m"] = _statistics(-path[1][rows])
    metrics["specific"] = _specific(series, resolved, window)
    return metrics


def _statistics(values: Values) -> dict[str, float]:
    return {"mean": float(values.mean()), "min": float(values.min()), "max": float(values.max())}


def draft_work(series: Series, scene: Scene, rows: NDArray[np.bool_]) -> tuple[float, float] | None:
    """Work of the draft [J] and travel of its point [m] over consecutive rows (n,); None without a draft, or
    with tools of different travels."""
    pulls = _pulls(series, scene)
    if not pulls or rows.sum() < 2:
        return None
    step = np.diff(series[TIME][rows])
    power = np.sum([draft * speed for draft, speed in pulls], axis=0)[rows]
    ways = [float(step @ (speed[rows][1:] + speed[rows][:-1])) / 2.0 for _, speed in pulls]
    if max(ways) - min(ways) > ONE_WAY * max(map(abs, ways)):
        return None
    return float(step @ (power[1:] + power[:-1])) / 2.0, ways[0]


def share_width_m(resolved: ResolvedScene) -> float | None:
    """Width across travel [m] of the shares of all tillage tools together; None without soil or share."""
    widths = []
    for name, tool in resolved.scene.tools.items():
        if tool.is_tillage:
            mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
            try:
                faces = cutting_faces(mesh, f"tools.{name}")
            except SceneError:  # no facet faces forward
                return None
            widths.append(next(face.width_m for face in faces if face.is_share))
    return sum(widths) if widths else None


def _pulls(series: Series, scene: Scene) -> list[tuple[Values, Values]]:
    """Drafts and forward speeds, each (n,), of what pulls: the driver of the draft, or without a mechanism
    each tool."""
    mechanism = scene.mechanism
    if DRAFT not in series:
        return []
    if mechanism is None:
        return [
            (-series[Wrench(name).force_x_newton], series[PlanarTool(name).velocity_x_m_per_s])
            for name in scene.tools
        ]
    if mechanism.draft_driver is None:
        return []
    driver = mechanism.joints[mechanism.draft_driver]
    assert isinstance(driver, Driver)
    return [(series[DRAFT], series[Body(driver.body).velocity_x_m_per_s])]


def _power(series: Series, scene: Scene) -> dict[str, Values]:
    found: dict[str, Values] = {}
    pulls = _pulls(series, scene)
    if pulls:
        found["draft_watt"] = np.sum([draft * speed for draft, speed in pulls], axis=0)
    for name, tool in scene.tools.items():
        load = Wrench(name)
        if load.force_x_newton not in series:
            continue
        if tool.is_spatial:
            rate = SpatialTool(name)
            products = (
                (load.force_x_newton, rate.velocity_x_m_per_s),
                (load.force_y_newton, rate.velocity_y_m_per_s),
                (load.force_z_newton, rate.velocity_z_m_per_s),
                (load.torque_x_newton_m, rate.angular_velocity_x_rad_per_s),
                (load.torque_y_newton_m, rate.angular_velocity_y_rad_per_s),
                (load.torque_z_newton_m, rate.angular_velocity_z_rad_per_s),
            )
            found[f"{name}_watt"] = -np.sum([series[one] * series[other] for one, other in products], axis=0)
            continue
        motion = PlanarTool(name)
        # the planar moment is minus the torque about y, phi turns about -y
        found[f"{name}_watt"] = -(
            series[load.force_x_newton] * series[motion.velocity_x_m_per_s]
            + series[load.force_z_newton] * series[motion.velocity_z_m_per_s]
            - series[load.torque_y_newton_m] * series[motion.angular_velocity_rad_per_s]
        )
    return found


def _specific(series: Series, resolved: ResolvedScene, window: Window) -> dict[str, float]:
    found: dict[str, float] = {}
    width = share_width_m(resolved) if resolved.scene.soil is not None else None
    if width is not None and DRAFT in series:
        found["share_width_m"] = width
        mean = float(np.mean(series[DRAFT][window.rows]))
        found["draft_newton_per_m"] = mean / width
    work = draft_work(series, resolved.scene, window.rows)
    if work is not None and work[1] > 0.0:
        found["energy_joule_per_m"] = work[0] / work[1]
    return found


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
