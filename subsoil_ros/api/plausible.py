"""Whether a scene can be meant: sizes, places, angles and densities that come from another unit or frame."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..limits.soil_at_work import speed_and_depth
from ..loading.loader import ResolvedScene
from ..rotations import placed_m
from ..scene.cad_mesh import LARGEST_M, SMALLEST_M
from ..scene.soil import Soil
from ..scene.tool_mesh import ToolMesh, load_tool_mesh
from ..scene.tools import Tool
from ..yaml_document import leaves

SMALLEST_DENSITY_KG_PER_M3 = 500.0
"""Below it there is no soil and no tool; g/cm3 are below it."""

MOMENTS = 101
"""Times at which a tool on a path is looked at, over the run."""

_ABOVE, _BEFORE = "stays above the soil", "does not reach the soil"


def implausible(resolved: ResolvedScene) -> tuple[str, ...]:
    """Warnings of what can hardly be meant.

    Raises:
        SceneError: no tool touches soil in the whole run, nor could in a longer one.
    """
    found = [*_values(resolved)]
    places: dict[str, str] = {}
    for name, tool in resolved.scene.tools.items():
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
        found += [*_size(name, mesh, resolved), *_buried(name, tool, mesh, resolved)]
        place = _place(resolved, name, tool, mesh)
        if place:
            places[name] = place
    if places and len(places) == len(resolved.scene.tools):
        lost = {name: place for name, place in places.items() if place not in (_ABOVE, _BEFORE)}
        if len(lost) == len(places):
            raise SceneError(
                "; ".join(f"tools.{name}: {place}" for name, place in lost.items())
                + ": no tool touches soil; move it, or make soil.bin as large as is meant"
            )
    found += [f"tools.{name}: {place}, so no force acts on it in this run" for name, place in places.items()]
    return tuple(found)


def _values(resolved: ResolvedScene) -> Iterator[str]:
    for path, value in leaves(resolved.scene.model_dump(mode="json", exclude_none=True)):
        if not isinstance(value, float | int) or isinstance(value, bool):
            continue
        keys = [key for key in path.split(".") if not key.isdecimal()]
        if keys[-1].endswith("_rad") and abs(value) > 2.0 * math.pi:
            yield f"{path}: {value:g} rad is more than a whole turn; is it in degrees?"
        elif keys[-1] == "density_kg_per_m3" and 0.0 < value < SMALLEST_DENSITY_KG_PER_M3:
            yield f"{path}: {value:g} kg/m3 is less than any soil has; is it in g/cm3?"


def _size(name: str, mesh: ToolMesh, resolved: ResolvedScene) -> Iterator[str]:
    for index, group in enumerate(mesh.groups):
        corners = mesh.vertices_m[mesh.facets[mesh.facet_group == index]]
        size = float(np.ptp(corners, axis=(0, 1)).max())
        if not SMALLEST_M <= size <= LARGEST_M:
            where = f"tools.{name}.groups.{group}"
            yield f"{where}: is {size:.3g} m large; is 'scale' that of the file's unit?"
    soil, width = resolved.scene.soil, float(np.ptp(mesh.vertices_m[:, 1]))
    if soil is not None and width > soil.bin.width_m:
        yield f"tools.{name}: is {width:.3g} m wide, soil.bin {soil.bin.width_m:g} m; is 'scale' right?"


def _buried(name: str, tool: Tool, mesh: ToolMesh, resolved: ResolvedScene) -> Iterator[str]:
    """A tool without a shank up to the surface: one whose file has another axis upwards looks like it."""
    if not tool.is_tillage or tool.is_spatial:
        return
    height, (_, depth) = float(np.ptp(mesh.vertices_m[:, 2])), speed_and_depth(resolved.scene, name, mesh)
    if 0.0 < height < depth:
        yield (
            f"tools.{name}: is {height:.3g} m high and {depth:.3g} m deep, so it is wholly below the "
            "surface; if its file has y upwards, give 'up: y'"
        )


def _place(resolved: ResolvedScene, name: str, tool: Tool, mesh: ToolMesh) -> str:
    """Where a tool is that touches no soil in the whole run, in words; empty if it touches some, or may."""
    soil = resolved.scene.soil
    if soil is None:
        return ""
    top = 0.0
    if isinstance(soil, Soil) and soil.surface is not None:
        top = max(soil.surface.z_m)
    low, high = _boxes(resolved, name, tool, mesh)
    half = 0.5 * soil.bin.width_m
    beside = (low[:, 1] > half) | (high[:, 1] < -half)
    if beside.all() and not tool.is_spatial:
        return (
            f"is beside the soil, from y = {low[0, 1]:.3g} to {high[0, 1]:.3g} m of -{half:g} to {half:g} m"
        )
    if tool.path is None or tool.path.external:
        return ""
    under, past = high[:, 2] < -soil.bin.depth_m, low[:, 0] > soil.bin.length_m
    above, before = low[:, 2] > top, high[:, 0] < 0.0
    if not (beside | under | past | above | before).all():
        return ""
    if under.all():
        return f"is under the floor, z = {-soil.bin.depth_m:g} m"
    if past.all():
        return f"is past the end of the soil, x = {soil.bin.length_m:g} m"
    return _ABOVE if above.all() else _BEFORE


def _boxes(
    resolved: ResolvedScene, name: str, tool: Tool, mesh: ToolMesh
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper corners (t, 3) [m] of a box about the tool: over the run, or where it starts."""
    about = mesh.about_body() if tool.is_spatial else mesh
    ends = np.stack((about.vertices_m.min(axis=0), about.vertices_m.max(axis=0)))
    corners = np.array([ends[[i, j, k], [0, 1, 2]] for i, j, k in itertools.product((0, 1), repeat=3)])
    if tool.path is None:  # in the frame of its body
        assert tool.body is not None
        assert resolved.scene.mechanism is not None
        x, z = resolved.scene.mechanism.bodies[tool.body].position_m
        places = [corners + np.array((x, 0.0, z))]
    elif tool.path.external:
        start = tool.path.start_m(tool.lateral_m if tool.is_spatial else 0.0)
        places = [placed_m(corners, start, tool.path.start_quaternion)]
    else:
        from ..mbd.tool_paths import tool_path  # only for a tool that has a path

        path = tool_path(name, tool.lateral_m, tool.path)
        motions = [path.motion(time) for time in np.linspace(0.0, resolved.scene.duration_s, MOMENTS)]
        places = [
            placed_m(corners, at.position_m if tool.is_spatial else (at.x_m, 0.0, at.z_m), at.quaternion)
            for at in motions
        ]
    return np.array([place.min(axis=0) for place in places]), np.array(
        [place.max(axis=0) for place in places]
    )
