"""The tillage tools of a run, drawn from their meshes."""

from pathlib import Path

import numpy as np
import trimesh
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from ..loading.loader import ResolvedScene
from .machine_shapes import Shapes, Surface
from .plotting import new_figure, save_figure
from .snapshots import Snapshots

_TOWARDS = np.array([0.55, -0.75, 0.37])
"""Direction of the viewer: before the tool, on its right, above; travel is to the right of the picture."""

_LONGEST = 0.03
"""Longest edge of what is drawn, over the size: facets are drawn from far to near by their middles."""


def draw_tool(bag: Path, resolved: ResolvedScene, path: Path) -> Path | None:
    """Draw the tillage tools as they stand at the first recorded moment; None without one.

    Raises:
        InputError, RecordingError: as Snapshots.
    """
    snapshots = Snapshots(bag, resolved)
    frame = next(snapshots.read(snapshots.times_ns[:1]))
    tools = resolved.scene.tools
    found = [surface for surface in Shapes(resolved).surfaces(frame) if tools[surface.tool].is_tillage]
    if not found:
        return None
    towards = _TOWARDS / np.linalg.norm(_TOWARDS)
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    triangles = np.concatenate([_small_triangles(surface) for surface in found])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    facing = normals @ towards / np.linalg.norm(normals, axis=1)
    far_to_near = np.argsort(triangles.mean(axis=1) @ towards)
    shown = far_to_near[facing[far_to_near] > 0.0]
    greys = np.column_stack([0.2 + 0.65 * facing[shown]] * 3)
    places = triangles[shown] @ np.column_stack([right, np.cross(towards, right)])
    figure = new_figure(4.0, 4.0)
    axes = figure.add_subplot(aspect="equal")
    axes.add_collection(PolyCollection(list(places), facecolors=greys, edgecolors=greys, linewidths=0.3))
    axes.autoscale_view()
    axes.set_axis_off()
    return save_figure(figure, path)


def _small_triangles(surface: Surface) -> NDArray[np.float64]:
    """Corners (n, 3, 3) of the facets, divided into parts of at most _LONGEST."""
    longest_m = _LONGEST * float(np.ptp(surface.vertices_m, axis=0).max())
    corners, facets = trimesh.remesh.subdivide_to_size(surface.vertices_m, surface.facets, longest_m)
    return np.asarray(corners[facets], np.float64)
