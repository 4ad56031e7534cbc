"""How much of a run on a wedge model lay outside the range in which the model was fitted."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..loading.loader import ResolvedScene
from ..loading.soil_file import RANGE_UNITS, soil_of
from ..scene.tool_faces import cutting_faces
from ..scene.tool_mesh import load_tool_mesh, reference_angle
from ..yaml_document import Document
from .columns import PlanarTool
from .metrics_window import Window
from .series import Series

TOLD_PART = 0.01
"""Part of the window from which on it is told: a share that is thrown once says little of the means."""


def extrapolated(series: Series, resolved: ResolvedScene, window: Window) -> Document:
    """What planar tillage tools in soil do outside the fitted range in more than TOLD_PART of the window.

    By tool and quantity, with the fields of summary.Extrapolated. Speeds below the range are left out: the
    tip of a share that swings stands still for moments.
    """
    wedge = resolved.scene.wedge_soil
    fitted = None if wedge is None else soil_of(wedge).fitted_range
    if fitted is None:
        return {}
    found: Document = {}
    for name, tool in resolved.scene.tools.items():
        if not tool.is_tillage or tool.is_spatial or PlanarTool(name).angle_rad not in series:
            continue
        for key, values in _quantities(name, series, resolved, window):
            low, high = getattr(fitted, key)
            outside = (values > high) | ((values < low) & (key != "speed_m_per_s"))
            if outside.mean() > TOLD_PART:
                found.setdefault(name, {})[key] = {
                    "least": float(values.min()),
                    "largest": float(values.max()),
                    "fitted_from": low,
                    "fitted_to": high,
                    "part": float(outside.mean()),
                }
    return found


def _quantities(
    name: str, series: Series, resolved: ResolvedScene, window: Window
) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Depth, speed and rake of a tool's share in the rows of the window in which it is in the soil."""
    scene, at = resolved.scene, PlanarTool(name)
    share = cutting_faces(load_tool_mesh(resolved.directory, scene, name), f"tools.{name}")[0]
    turn = series[at.angle_rad][window.rows] - reference_angle(scene, name)
    ahead, up = share.tip_m
    below = np.sin(turn) * ahead + np.cos(turn) * up
    depth = -(series[at.z_m][window.rows] + below)
    speed = (
        series[at.velocity_x_m_per_s][window.rows]
        - series[at.angular_velocity_rad_per_s][window.rows] * below
    )
    inside = depth > 0.0
    if inside.any():
        yield "depth_m", depth[inside]
        yield "speed_m_per_s", speed[inside]
        yield "rake_rad", share.rake_rad - turn[inside]


def words(tool: str, key: str, item: Document) -> str:
    """One line on a quantity that left the fitted range."""
    unit, factor = RANGE_UNITS[key]
    least, largest, low, high = (
        f"{factor * item[end]:.3g}" for end in ("least", "largest", "fitted_from", "fitted_to")
    )
    return (
        f"{tool}: {key.partition('_')[0]} {least} to {largest} {unit}, in {100.0 * item['part']:.0f} % of "
        f"the window outside {low} to {high} {unit}, where the soil file was fitted: forces are extrapolated"
    )
