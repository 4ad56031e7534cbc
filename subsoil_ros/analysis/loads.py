"""Loads over the metrics window: what carries the machine (carried.py), power, specific draft and energy.

All values follow from the columns of the series. Power is what each tool delivers to the soil, -(F v + M w),
and what the driver of the draft delivers.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..loading.loader import ResolvedScene
from ..scene.mechanism import Driver
from ..scene.meshes import load_tool_mesh
from ..scene.model import Scene
from ..scene.tool_faces import cutting_faces
from .carried import vertical_parts
from .series import Series
from .window import Window, tip_path_m

Values = NDArray[np.float64]


def loads_of(series: Series, resolved: ResolvedScene, window: Window) -> dict[str, Any]:
    """Loads over the metrics window, as in summary.json, units in the names; those the scene has."""
    scene, rows = resolved.scene, window.rows
    groups = {"vertical": vertical_parts(series, resolved), "power": _power(series, scene)}
    metrics: dict[str, Any] = {
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
    times, draft = series["time_s"][rows], series["draft_newton"][rows]
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
    if "draft_newton" not in series:
        return None
    if mechanism is None:
        name = f"tool.{next(iter(scene.tools))}"
    elif mechanism.draft_driver is not None:
        driver = mechanism.joints[mechanism.draft_driver]
        assert isinstance(driver, Driver)
        name = f"body.{driver.body}"
    else:
        return None
    return np.asarray(series[f"{name}.velocity_x_m_per_s"], np.float64)


_POWER = tuple(
    (f"{load}_{axis}_{unit}", f"{rate}_{axis}_{per_s}")
    for load, unit, rate, per_s in (
        ("force", "newton", "velocity", "m_per_s"),
        ("torque", "newton_m", "angular_velocity", "rad_per_s"),
    )
    for axis in "xyz"
)
"""Loads and rates whose products are the power of a tool in space."""


def _power(series: Series, scene: Scene) -> dict[str, Values]:
    found: dict[str, Values] = {}
    speed = _driven_speed(series, scene)
    if speed is not None:
        found["draft_watt"] = series["draft_newton"] * speed
    for name in scene.tools:
        tool = f"tool.{name}"
        if f"{tool}.force_x_newton" not in series:
            continue
        if scene.tools[name].is_spatial:
            products = [series[f"{tool}.{load}"] * series[f"{tool}.{rate}"] for load, rate in _POWER]
            found[f"{name}_watt"] = -np.sum(products, axis=0)
            continue
        # the planar moment is minus the torque about y, phi turns about -y
        found[f"{name}_watt"] = -(
            series[f"{tool}.force_x_newton"] * series[f"{tool}.velocity_x_m_per_s"]
            + series[f"{tool}.force_z_newton"] * series[f"{tool}.velocity_z_m_per_s"]
            - series[f"{tool}.torque_y_newton_m"] * series[f"{tool}.angular_velocity_rad_per_s"]
        )
    return found


def _specific(series: Series, resolved: ResolvedScene, window: Window) -> dict[str, float]:
    found: dict[str, float] = {}
    width = share_width_m(resolved) if resolved.scene.soil is not None else None
    if width is not None and "draft_newton" in series:
        found["share_width_m"] = width
        mean = float(np.mean(series["draft_newton"][window.rows]))
        found["draft_newton_per_m"] = mean / width
    work = draft_work(series, resolved.scene, window.rows)
    if work is not None and work[1] > 0.0:
        found["energy_joule_per_m"] = work[0] / work[1]
    return found
