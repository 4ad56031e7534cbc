"""The part of a run that metrics are taken over: the tip well inside the bin, the wheels clear of its end."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..scene.scene import Scene
from .columns import TIME, Body, PlanarTool, SpatialTool
from .series import Series

WHEEL_CLEARANCE_M = 0.25
"""Distance of the centres of wheels from the end of the bin: room for a wheel and the soil it pushes."""


@dataclass(frozen=True)
class Window:
    """Rows of a series that count, and why."""

    rows: NDArray[np.bool_]  # (n,)
    rule: str  # in words, for the summary
    whole_run: bool  # the rule left no row, so all of them count


def metrics_window(series: Series, scene: Scene) -> Window:
    """The window of a run; the whole run, with `whole_run` set, where the rule leaves no row."""
    report = scene.report
    rules = []
    begun = series[TIME] > 0.0  # the state before the first tick is no part of it
    rows = begun.copy()
    if report.settle_s > 0.0:
        rows &= series[TIME] > report.settle_s
        rules.append(f"after {report.settle_s:g} s")
    tip = tip_x_m(series, scene)
    if scene.soil is not None and tip is not None:
        inside, length = report.window_inside_m, scene.soil.bin.length_m
        rows &= (tip >= inside) & (tip <= length - inside)
        rules.append(f"tip {inside:g} m or more inside both ends of the bin")
    if scene.soil is not None:
        wheels = [name for name, tool in scene.tools.items() if not tool.is_tillage]
        for name in wheels:
            rows &= series[PlanarTool(name).x_m] <= scene.soil.bin.length_m - WHEEL_CLEARANCE_M
        if wheels:
            rules.append(f"wheels {WHEEL_CLEARANCE_M:g} m or more before its end")
    rule = ", ".join(rules) or "the whole run"
    if rows.any():
        return Window(rows, rule, False)
    return Window(begun if begun.any() else ~begun, rule, True)


def tip_x_m(series: Series, scene: Scene) -> NDArray[np.float64] | None:
    """Forward position of the share tip (n,) [m]; None without a tip, or a body or tool that carries it."""
    path = tip_path_m(series, scene)
    return None if path is None else path[0]


def tip_path_m(series: Series, scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """x and z of the share tip, each (n,) [m]; None as tip_x_m."""
    if scene.report.tip_m is None:
        return None
    tip_x, tip_z = scene.report.tip_m
    tool = next((name for name, item in scene.tools.items() if item.is_tillage), None)
    body = scene.report.shank or (scene.tools[tool].body if tool is not None else None)
    if body is not None and scene.mechanism is not None:
        reference = scene.mechanism.bodies[body]
        at: Body | PlanarTool | SpatialTool = Body(body)
        angle = reference.angle_rad
        arm_x, arm_z = tip_x - reference.position_m[0], tip_z - reference.position_m[1]
    elif tool is not None:
        at = SpatialTool(tool) if scene.tools[tool].is_spatial else PlanarTool(tool)
        angle, arm_x, arm_z = 0.0, tip_x, tip_z
    else:
        return None
    if isinstance(at, SpatialTool):
        from scipy.spatial.transform import Rotation  # slow to import, and rarely used

        parts = (at.quaternion_x, at.quaternion_y, at.quaternion_z, at.quaternion_w)
        arm = Rotation.from_quat(np.stack([series[part] for part in parts], axis=1)).apply(
            (arm_x, 0.0, arm_z)
        )
        return series[at.x_m] + arm[:, 0], series[at.z_m] + arm[:, 2]
    turn = series[at.angle_rad] - angle
    cosine, sine = np.cos(turn), np.sin(turn)
    return (
        series[at.x_m] + cosine * arm_x - sine * arm_z,
        series[at.z_m] + sine * arm_x + cosine * arm_z,
    )


def window_span_s(series: Series, window: Window) -> tuple[float, float]:
    """First and last time of a window's rows [s]."""
    times = series[TIME][window.rows]
    return float(times[0]), float(times[-1])
