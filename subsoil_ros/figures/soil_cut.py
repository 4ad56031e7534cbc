"""A cut through the soil along the mid-plane of the bin at three times (paper, figure 7)."""

from pathlib import Path

import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ..loading.loader import ResolvedScene
from ..messages import SoilCloud, ToolMotion, ToolMotions
from ..recording.joined import open_record
from ..recording.soil_clouds import soil_span_m
from ..scene.soil import Soil
from ..scene.tool_mesh import ToolMesh, load_tool_mesh, posed_vertices_m, reference_angle
from .plotting import new_figure, save_figure

PANELS = 3
SPEED_SCALE_M_PER_S = (0.0, 0.2)  # the paper's
_HEADROOM_M = 0.15  # height shown above the bed, for appearance only
_WIDTH_INCH, _HEIGHT_INCH = 7.6, 2.7  # of a panel, at most
_BIN = "#806040"
_HALO = [withStroke(linewidth=3.0, foreground="white")]  # lines stay visible on dark particles
_TOOL_EDGE, _TOOL_FILL = "#202020", "#d9d9d9"


def draw_soil_cut(bag: Path, resolved: ResolvedScene, path: Path, span_s: tuple[float, float]) -> Path | None:
    """Draw the cut at the clouds nearest to start, middle and end of `span_s` [s]; None without clouds."""
    soil = resolved.scene.particle_soil
    if soil is None:
        return None
    reader = open_record(bag)
    chosen = nearest_times_ns(reader.cloud_times_ns(), span_s)
    if not chosen:
        return None
    communication_step_ns = resolved.timing.communication_step_ns
    motions = {
        record.end_time_ns: record
        for record in reader.records(ToolMotions, at=lambda time_ns: time_ns in chosen)
    }
    clouds = list(reader.clouds(communication_step_ns, at=lambda time_ns: time_ns in chosen))
    _draw(resolved, soil, clouds, motions, path)
    return path


def nearest_times_ns(times_ns: list[int], span_s: tuple[float, float]) -> list[int]:
    """The times nearest to start, middle and end of a span, ascending.

    If these are fewer than three, three times spread over all; each once.
    """
    if not times_ns:
        return []
    moments_ns = np.linspace(*span_s, PANELS) * 1e9
    nearest = {min(times_ns, key=lambda time_ns: abs(time_ns - moment_ns)) for moment_ns in moments_ns}
    if len(nearest) < PANELS:
        nearest = {times_ns[i] for i in np.linspace(0, len(times_ns) - 1, PANELS).round().astype(int)}
    return sorted(nearest)


def _draw(
    resolved: ResolvedScene,
    soil: Soil,
    clouds: list[SoilCloud],
    motions: dict[int, ToolMotions],
    path: Path,
) -> None:
    meshes = {name: load_tool_mesh(resolved.directory, resolved.scene, name) for name in resolved.scene.tools}
    radius, depth = soil.particles.mean_volume_radius_m, soil.bin.depth_m
    first = np.asarray(clouds[0].positions_m)
    spans = [soil_span_m(np.asarray(cloud.positions_m), soil) for cloud in clouds]
    if soil.window is None:  # the walls stand up to one spacing inside the nominal bin, to fit the bed
        spans = [(0.0, min(soil.bin.length_m, first[:, 0].max(initial=0.0) + radius))] * len(clouds)
    length = max(high - low for low, high in spans)
    floor = max(-depth, first[:, 2].min(initial=0.0) - radius)
    inch_per_m = min(_WIDTH_INCH / (1.1 * length), _HEIGHT_INCH / (depth + _HEADROOM_M))
    figure = new_figure(
        1.1 * length * inch_per_m + 1.6, len(clouds) * ((depth + _HEADROOM_M) * inch_per_m + 0.5) + 1.2
    )
    panels = figure.subplots(len(clouds), 1, sharex=soil.window is None, squeeze=False)[:, 0]
    drawn = set()
    for axes, cloud, (low, high) in zip(panels, clouds, spans, strict=True):
        count = len(np.asarray(cloud.positions_m))
        radii = np.full(count, radius) if cloud.radii_m is None else np.asarray(cloud.radii_m)
        spheres = _draw_particles(axes, cloud, radii)
        record = motions.get(cloud.end_time_ns)
        for motion in record.tools if record is not None else ():
            drawn.add(
                _draw_tool(axes, meshes[motion.tool], motion, reference_angle(resolved.scene, motion.tool))
            )
        rim = _HEADROOM_M / 5
        axes.plot([low, low, high, high], [rim, floor, floor, rim], color=_BIN, lw=1.5)
        axes.set_aspect("equal")
        axes.set_xlim(low - 0.05 * length, low + 1.05 * length)
        axes.set_ylim(floor - 0.01, _HEADROOM_M)
        axes.set_ylabel("height [m]")
        axes.set_title(f"t = {cloud.end_time_ns * 1e-9:.3f} s", fontsize=10, loc="left")
    panels[-1].set_xlabel("along travel [m]")
    bar = figure.colorbar(spheres, ax=list(panels), shrink=0.5, aspect=30, pad=0.01, extend="max")
    bar.set_label("particle speed [m/s]")
    mean = soil.particles.sizes is not None and any(cloud.radii_m is None for cloud in clouds)
    sizes = ", particles drawn in their mean size" if mean else ""
    figure.suptitle(
        f"Soil along the mid-plane, tool moving to the right{sizes}\n{resolved.scene.name}",
        fontsize=11,
    )
    handles = [Line2D([], [], color=_BIN, lw=1.5, label="bin" if soil.window is None else "window of soil")]
    if "cut" in drawn:
        handles.append(Line2D([], [], color=_TOOL_EDGE, lw=1.6, label="tool, cut at the mid-plane"))
    if "beside" in drawn:
        handles.append(Line2D([], [], color=_TOOL_EDGE, lw=1.0, ls="--", label="outline of a tool beside it"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    save_figure(figure, path)


def _draw_particles(axes: Axes, cloud: SoilCloud, radii_m: NDArray[np.floating]) -> EllipseCollection:
    """Circles of true size of the particles (n,) whose centres lie within their radius of y = 0."""
    positions, speeds = np.asarray(cloud.positions_m), np.asarray(cloud.speeds_m_per_s)
    aside = np.abs(positions[:, 1])
    shown = np.flatnonzero(aside < radii_m)
    shown = shown[np.argsort(-aside[shown], kind="stable")]  # nearest to the plane on top
    diameters = 2.0 * radii_m[shown]
    spheres = EllipseCollection(
        diameters,
        diameters,
        np.zeros(len(shown)),
        units="xy",
        offsets=positions[shown][:, [0, 2]],
        offset_transform=axes.transData,
        cmap="viridis",
        edgecolors="#00000040",
        linewidths=0.3,
        zorder=2,
    )
    spheres.set_array(speeds[shown])
    spheres.set_clim(*SPEED_SCALE_M_PER_S)
    axes.add_collection(spheres)
    return spheres


def _draw_tool(axes: Axes, mesh: ToolMesh, motion: ToolMotion, reference_angle_rad: float) -> str:
    """Draw the tool's cut with the mid-plane, or its outline if it lies beside; return which."""
    vertices = posed_vertices_m(mesh, motion, reference_angle_rad)
    surface = trimesh.Trimesh(vertices, mesh.facets, process=False)
    # slightly beside y = 0: facets of a symmetric mesh may lie in the plane itself
    plane_y = 1e-6 * float(np.ptp(vertices[:, 1]))
    cut = trimesh.intersections.mesh_plane(surface, (0.0, 1.0, 0.0), (0.0, plane_y, 0.0))
    if len(cut):
        triangles = list(vertices[mesh.facets][:, :, [0, 2]])
        axes.add_collection(PolyCollection(triangles, facecolors=_TOOL_FILL, edgecolors=_TOOL_FILL, zorder=1))
        axes.add_collection(
            LineCollection(cut[:, :, [0, 2]], colors=_TOOL_EDGE, linewidths=1.6, zorder=4, path_effects=_HALO)
        )
        return "cut"
    flat = vertices[:, [0, 2]]
    hull = flat[ConvexHull(flat).vertices]
    axes.add_collection(
        PolyCollection(
            [hull],
            facecolors="none",
            edgecolors=_TOOL_EDGE,
            linestyles="--",
            linewidths=1.0,
            zorder=4,
            path_effects=_HALO,
        )
    )
    return "beside"
