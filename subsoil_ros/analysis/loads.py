"""Loads over the metrics window: what carries the machine (carried.py), power, specific draft and energy.

All values follow from the columns of the series. Power is what each tool delivers to the soil, -(F v + M w),
and what the driver of the draft delivers.
"""

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..loading.loader import ResolvedScene
from ..scene.mechanism import Driver
from ..scene.scene import Scene
from ..scene.tool_faces import cutting_faces
from ..scene.tool_mesh import load_tool_mesh
from ..yaml_document import Document
from .carried import vertical_parts
from .columns import DRAFT, TIME, Body, PlanarTool, SpatialTool, Wrench
from .metrics_window import Window, tip_path_m
from .series import Series

Values = NDArray[np.float64]


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
    """Work of the draft [J] and travel of its point [m] over consecutive rows (n,); None without a draft."""
    speed = _driven_speed(series, scene)
    if speed is None or rows.sum() < 2:
        return None
    times, draft = series[TIME][rows], series[DRAFT][rows]
    power = draft * speed[rows]
    step = np.diff(times)
    work = float(step @ (power[1:] + power[:-1])) / 2.0
    way = float(step @ (speed[rows][1:] + speed[rows][:-1])) / 2.0
    return work, way


def share_width_m(resolved: ResolvedScene) -> float | None:
    """Width across travel [m] of the share of the first tillage tool; None without soil or share."""
    for name, tool in resolved.scene.tools.items():
        if tool.is_tillage:
            mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
            try:
                return next(face.width_m for face in cutting_faces(mesh, f"tools.{name}") if face.is_share)
            except SceneError:  # no facet faces forward
                return None
    return None


def _driven_speed(series: Series, scene: Scene) -> Values | None:
    """Forward speed (n,) of what the draft pulls."""
    mechanism = scene.mechanism
    if DRAFT not in series:
        return None
    if mechanism is None:
        name, tool = next(iter(scene.tools.items()))
        speed = (SpatialTool(name) if tool.is_spatial else PlanarTool(name)).velocity_x_m_per_s
    elif mechanism.draft_driver is not None:
        driver = mechanism.joints[mechanism.draft_driver]
        assert isinstance(driver, Driver)
        speed = Body(driver.body).velocity_x_m_per_s
    else:
        return None
    return np.asarray(series[speed], np.float64)


def _power(series: Series, scene: Scene) -> dict[str, Values]:
    found: dict[str, Values] = {}
    speed = _driven_speed(series, scene)
    if speed is not None:
        found["draft_watt"] = series[DRAFT] * speed
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
