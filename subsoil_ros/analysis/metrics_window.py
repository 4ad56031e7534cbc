"""The part of a run that metrics are taken over: tips well inside the bin, the wheels clear of its end."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..loading.loader import ResolvedScene
from ..scene.scene import Scene
from ..scene.tool_mesh import load_tool_mesh, reference_angle
from ..scene.tool_shape import lowest_tip_m
from .columns import TIME, Body, PlanarTool, SpatialTool
from .series import Series

Path = tuple[NDArray[np.float64], NDArray[np.float64]]
"""x and z of a point of a tool, each (n,) [m]."""

WHEEL_CLEARANCE_M = 0.25
"""Distance of the centres of wheels from the end of the bin: room for a wheel and the soil it pushes."""


@dataclass(frozen=True)
class Window:
    """Rows of a series that count, and why."""

    rows: NDArray[np.bool_]  # (n,)
    rule: str  # in words, for the summary
    whole_run: bool  # the rule left no row, so all of them count


def metrics_window(series: Series, resolved: ResolvedScene) -> Window:
    """The window of a run; the whole run, with `whole_run` set, where the rule leaves no row."""
    scene = resolved.scene
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
        tips = [tip, *(x for x, _ in tip_paths_m(series, resolved).values())]
        rows &= (np.min(tips, axis=0) >= inside) & (np.max(tips, axis=0) <= length - inside)
        who = "tip" if sum(tool.is_tillage for tool in scene.tools.values()) < 2 else "tips of all tools"
        rules.append(f"{who} {inside:g} m or more inside both ends of the bin")
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


def tip_path_m(series: Series, scene: Scene) -> Path | None:
    """Path of the share tip that report.tip_m names; None as tip_x_m."""
    if scene.report.tip_m is None:
        return None
    tip_x, tip_z = scene.report.tip_m
    tool = named_tool(scene)
    body = scene.report.shank if tool is None else scene.tools[tool].body
    if body is not None and scene.mechanism is not None:
        reference = scene.mechanism.bodies[body]
        arm_m = tip_x - reference.position_m[0], tip_z - reference.position_m[1]
        return _carried(series, Body(body), reference.angle_rad, arm_m)
    if tool is None:
        return None
    at = SpatialTool(tool) if scene.tools[tool].is_spatial else PlanarTool(tool)
    return _carried(series, at, 0.0, (tip_x, tip_z))


def named_tool(scene: Scene) -> str | None:
    """The tillage tool whose tip report.tip_m is: that on report.shank, or the first; None without any."""
    tillage = [name for name, tool in scene.tools.items() if tool.is_tillage]
    on_shank = [name for name in tillage if scene.tools[name].body == scene.report.shank is not None]
    return next(iter([*on_shank, *tillage]), None)


def mesh_tip_m(resolved: ResolvedScene, tool: str) -> tuple[float, float]:
    """Foremost place of the lowest edge of a tool's mesh, x and z from the origin of its motion [m]."""
    return lowest_tip_m(load_tool_mesh(resolved.directory, resolved.scene, tool).vertices_m)


def tip_paths_m(series: Series, resolved: ResolvedScene) -> dict[str, Path]:
    """Paths of the tips of all tillage tools: that of report.tip_m, and those of the other tools' meshes."""
    scene, found = resolved.scene, dict[str, Path]()
    named, path = named_tool(scene), tip_path_m(series, scene)
    for name, tool in scene.tools.items():
        if name == named and path is not None:
            found[name] = path
        elif tool.is_tillage:
            at = SpatialTool(name) if tool.is_spatial else PlanarTool(name)
            found[name] = _carried(series, at, reference_angle(scene, name), mesh_tip_m(resolved, name))
    return found


def _carried(
    series: Series, at: Body | PlanarTool | SpatialTool, angle_rad: float, arm_m: tuple[float, float]
) -> Path:
    """Path of a point of a body or tool; arm_m: x and z from its origin where it stands at angle_rad."""
    arm_x, arm_z = arm_m
    if isinstance(at, SpatialTool):
        from scipy.spatial.transform import Rotation  # slow to import, and rarely used

        parts = (at.quaternion_x, at.quaternion_y, at.quaternion_z, at.quaternion_w)
        arm = Rotation.from_quat(np.stack([series[part] for part in parts], axis=1)).apply(
            (arm_x, 0.0, arm_z)
        )
        return series[at.x_m] + arm[:, 0], series[at.z_m] + arm[:, 2]
    turn = series[at.angle_rad] - angle_rad
    cosine, sine = np.cos(turn), np.sin(turn)
    return (
        series[at.x_m] + cosine * arm_x - sine * arm_z,
        series[at.z_m] + sine * arm_x + cosine * arm_z,
    )


def window_span_s(series: Series, window: Window) -> tuple[float, float]:
    """First and last time of a window's rows [s]."""
    times = series[TIME][window.rows]
    return float(times[0]), float(times[-1])
