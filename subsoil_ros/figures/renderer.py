"""Pictures and films of soil and machine, off screen (through pyvista, without a display); VTK files."""

import json
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
import pyvista
from numpy.typing import NDArray

from ..errors import InputError
from ..limits.soil_at_work import speed_and_depth
from ..loading.loader import ResolvedScene
from ..recording.soil_clouds import soil_span_m
from ..scene.tool_mesh import load_tool_mesh
from .draft_strip import DraftStrip
from .machine_shapes import COLOURS, Segments, Shapes, Surface
from .snapshots import Frame, Snapshots
from .soil_cut import SPEED_SCALE_M_PER_S

DISPLACEMENT_SCALE_DIAMETERS = 5.0
"""Upper end of the colours of displacement: that of soil which a tool has carried along."""

HEIGHT_SCALE_M = 0.1
"""End of the colours of height where no tool is in the soil at its start."""

_HEADROOM_M = 0.45  # height shown above the bed, with shank and wheels
_TUBE_M = 0.012  # radius of the lines of the machine, for appearance only
_FAR_M = 20.0  # distance of a camera without perspective from its focal point
_MARGIN = 1.06
_RADIUS = "radius_m"
_UNKNOWN = "#bbbbbb"  # colour of particles whose value is not known
_SMALLEST_FONT = 6  # points, still readable


@dataclass(frozen=True)
class Style:
    """Colours, limits and size of pictures."""

    colour: str  # "speed" [m/s], "displacement" [m], "height" [m] or "broken", part of the bonds
    limits: tuple[float, float]  # of the colours
    size: tuple[int, int]  # of the picture, pixels


def default_limits(resolved: ResolvedScene, colour: str) -> tuple[float, float]:
    """Colour limits: speed up to that of the tools [m/s]; displacement up to some diameters, height from the
    depth of the tools below z = 0 to as much above [m]; part of the bonds from 0 to 1."""
    soil = resolved.scene.particle_soil
    if colour == "broken":
        return 0.0, 1.0
    if colour in ("speed", "height") or soil is None:
        found = [
            speed_and_depth(resolved.scene, name, load_tool_mesh(resolved.directory, resolved.scene, name))
            for name, tool in resolved.scene.tools.items()
            if tool.is_tillage
        ]
        speed, depth = np.max([(0.0, 0.0), *found], axis=0).tolist()
        if colour == "height":
            return -(depth or HEIGHT_SCALE_M), depth or HEIGHT_SCALE_M
        return 0.0, speed or SPEED_SCALE_M_PER_S[1]
    return 0.0, DISPLACEMENT_SCALE_DIAMETERS * 2.0 * soil.particles.mean_volume_radius_m


class Renderer:
    """Draws the moments of one run."""

    def __init__(self, resolved: ResolvedScene, style: Style) -> None:
        """Load the meshes; no window is opened."""
        self._resolved, self._style = resolved, style
        self._shapes = Shapes(resolved)

    def draw(self, frame: Frame, view: str) -> NDArray[np.uint8]:
        """The picture of a moment, (height, width, 3)."""
        plotter = pyvista.Plotter(off_screen=True, window_size=list(self._style.size))
        try:
            self._fill(plotter, frame, view)
            return np.asarray(plotter.screenshot(None, return_img=True))[:, :, :3]
        finally:
            plotter.close()

    def _fill(self, plotter: pyvista.Plotter, frame: Frame, view: str) -> None:
        plotter.set_background("white")
        surfaces = self._shapes.surfaces(frame)
        keep, hidden = self._cut(frame, surfaces, view)
        if keep.any():
            self._add_particles(plotter, frame, keep)
        for surface in surfaces:
            behind = hidden(surface)
            mesh = pyvista.PolyData.from_regular_faces(surface.vertices_m, surface.facets)
            plotter.add_mesh(mesh, color=COLOURS["tool"], opacity=0.25 if behind else 1.0, specular=0.3)
        _add_lines(plotter, self._shapes.skeleton(frame), "body", _TUBE_M)
        _add_lines(plotter, self._shapes.wheels(frame), "body", 0.5 * _TUBE_M)
        _add_lines(plotter, self._shapes.springs(frame), "spring", 1.5 * _TUBE_M)
        plotter.add_text(
            f"{self._resolved.scene.name}   t = {frame.time_s:.3f} s", position="upper_left",
            font_size=self._font_size(10), color="black",
        )  # fmt: skip
        self._aim(plotter, view, self._bounds(frame))

    def _add_particles(self, plotter: pyvista.Plotter, frame: Frame, keep: NDArray[np.bool_]) -> None:
        title, values = {
            "speed": ("speed\n[m/s]", frame.speeds_m_per_s),
            "displacement": ("displacement\n[m]", frame.displacements_m),
            "height": ("height\n[m]", frame.positions_m[:, 2] + frame.radii_m),
            "broken": ("broken\nbonds", frame.broken_parts),
        }[self._style.colour]
        bar = {
            "title": f"{title}\n", "color": "black", "n_labels": 5, "fmt": "%.3g", "vertical": True,
            "position_x": 0.9, "position_y": 0.25, "height": 0.5, "width": 0.05,
            "title_font_size": self._font_size(16), "label_font_size": self._font_size(14),
        }  # fmt: skip
        known = keep & ~np.isnan(values)
        for part, look in (
            (
                known,
                {"scalars": title, "cmap": "viridis", "clim": self._style.limits, "scalar_bar_args": bar},
            ),
            (keep & ~known, {"color": _UNKNOWN}),
        ):
            if not part.any():
                continue
            cloud = pyvista.PolyData(frame.positions_m[part])
            cloud.point_data[title], cloud.point_data[_RADIUS] = values[part], frame.radii_m[part]
            actor = plotter.add_mesh(
                cloud, style="points_gaussian", render_points_as_spheres=True, emissive=False, **look
            )
            actor.mapper.scale_factor = 1.0
            actor.mapper.SetScaleArray(_RADIUS)

    def _font_size(self, points: int) -> int:
        """Font size of a text that has `points` in a picture of 1280 x 720."""
        width, height = self._style.size
        return max(_SMALLEST_FONT, round(points * min(width / 1280.0, height / 720.0)))

    def _cut(
        self, frame: Frame, surfaces: Sequence[Surface], view: str
    ) -> tuple[NDArray[np.bool_], Callable[[Surface], bool]]:
        """Particles that are shown (n,), and tools that lie entirely in the part that is cut away."""
        x, y = frame.positions_m[:, 0], frame.positions_m[:, 1]
        if view in ("longitudinal", "corner"):
            return y >= 0.0, lambda surface: bool((surface.vertices_m[:, 1] < 0.0).all())
        if view == "cross":
            plane = self._cross_x_m(frame, surfaces)
            return x <= plane, lambda surface: bool((surface.vertices_m[:, 0] > plane).all())
        return np.ones(len(x), dtype=bool), lambda surface: False

    def _cross_x_m(self, frame: Frame, surfaces: Sequence[Surface]) -> float:
        """Forward place of the lowest point of the tools that cut; mid-bin while that is outside."""
        x0, x1, *_ = self._bounds(frame)
        tools = self._resolved.scene.tools
        shares = [surface.vertices_m for surface in surfaces if tools[surface.tool].is_tillage]
        if shares:
            vertices = np.concatenate(shares)
            tip = float(vertices[np.argmin(vertices[:, 2]), 0])
            if x0 < tip < x1:
                return tip
        return 0.5 * (x0 + x1)

    def _bounds(self, frame: Frame) -> tuple[float, float, float, float, float, float]:
        """Bounds of the view, x, y, z from and to: those of the soil, or without soil of the machine."""
        scene = self._resolved.scene
        if scene.soil is not None:
            size = scene.soil.bin
            soil = scene.particle_soil
            low, high = (0.0, size.length_m) if soil is None else soil_span_m(frame.positions_m, soil)
            return low, high, -0.5 * size.width_m, 0.5 * size.width_m, -size.depth_m, 0.0
        assert scene.mechanism is not None
        places = np.array([body.position_m for body in scene.mechanism.bodies.values()])
        (low_x, low_z), (high_x, high_z) = places.min(axis=0) - 0.5, places.max(axis=0) + 0.5
        return low_x, high_x, -0.5, 0.5, min(low_z, 0.0), high_z

    def _aim(self, plotter: pyvista.Plotter, view: str, bounds: tuple[float, ...]) -> None:
        x0, x1, y0, y1, z0, z1 = bounds
        top = z1 + (_HEADROOM_M if self._resolved.scene.soil is not None else 0.0)
        middle = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + top)])
        towards, up, wide, high = {
            "longitudinal": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), x1 - x0, top - z0),
            "cross": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), y1 - y0, top - z0),
            "above": ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), x1 - x0, y1 - y0),
            "corner": ((-0.5, 1.0, -0.5), (0.0, 0.0, 1.0), 0.0, 0.0),
        }[view]
        direction = np.array(towards) / np.linalg.norm(towards)
        camera = plotter.camera
        camera.focal_point, camera.up = middle, up
        aspect = self._style.size[0] / self._style.size[1]
        if view == "corner":
            reach = float(np.linalg.norm([x1 - x0, y1 - y0, top - z0]))
            camera.parallel_projection = False
            camera.position = middle - direction * 1.9 * reach * max(1.0, 1.4 / aspect)
        else:
            camera.parallel_projection = True
            camera.position = middle - direction * _FAR_M
            # a fifth of the width is left to the bar of colours
            camera.parallel_scale = 0.5 * _MARGIN * max(high, 1.2 * wide / aspect)
        plotter.renderer.ResetCameraClippingRange()


def _add_lines(plotter: pyvista.Plotter, ends_m: Segments, kind: str, radius_m: float) -> None:
    if len(ends_m):
        tubes = pyvista.line_segments_from_points(ends_m).tube(radius=radius_m)
        plotter.add_mesh(tubes, color=COLOURS[kind])


def save_pictures(
    frames: Snapshots, renderer: Renderer, times_ns: Sequence[int], views: Sequence[str], folder: Path,
    done: Callable[[], None],
) -> list[Path]:  # fmt: skip
    """Write VIEW_TIME.png of every moment and view; return their paths. `done` is called after each."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for frame in frames.read(times_ns):
        for view in views:
            path = folder / f"{view}_{frame.time_s:.3f}s.png"
            imageio.imwrite(path, renderer.draw(frame, view))
            paths.append(path)
            done()
    return paths


def save_film(
    frames: Snapshots,
    renderer: Renderer,
    times_ns: Sequence[int],
    view: str,
    path: Path,
    rate_hz: float | None,
    done: Callable[[], None],
    strip: DraftStrip | None = None,
) -> float:
    """Write the moments at `times_ns` as MP4 (H.264) or GIF, by the ending of `path`; return pictures per
    second.

    rate_hz: None: as many as moments per simulated second, so that the film runs in real time. strip: drawn
    under each picture.

    Raises:
        InputError: the ending of the path is not .mp4 or .gif.
    """
    rate = rate_hz or _natural_rate_hz(times_ns)
    part = path.with_name(f".{path.name}.part{path.suffix}")
    with _film_writer(part, rate) as append:
        for frame in frames.read(times_ns):
            picture = renderer.draw(frame, view)
            append(picture if strip is None else np.concatenate([picture, strip.draw(frame.time_s)]))
            done()
    part.replace(path)
    return rate


def _natural_rate_hz(times_ns: Sequence[int]) -> float:
    if len(times_ns) < 2:
        return 1.0
    return float(np.clip(1e9 / np.median(np.diff(times_ns)), 1.0, 60.0))


@contextmanager
def _film_writer(path: Path, rate_hz: float) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
    """Context of a writer of pictures; an unfinished file is removed on an error."""
    if path.suffix == ".mp4":
        options: dict[str, Any] = {
            "format": "FFMPEG",
            "fps": rate_hz,
            "codec": "libx264",
            "macro_block_size": 2,
        }
    elif path.suffix == ".gif":
        options = {"format": "GIF", "duration": 1e3 / rate_hz, "loop": 0}
    else:
        raise InputError(f"--film: given '{path.suffix}', allowed are .mp4 and .gif")
    try:
        writer: Any  # untyped: its kind depends on the format
        with imageio.get_writer(path, mode="I", **options) as writer:
            yield writer.append_data
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def write_vtk_series(
    resolved: ResolvedScene, frames: Snapshots, folder: Path, done: Callable[[], None]
) -> list[Path]:
    """Write the moments for ParaView into a new `folder`, which appears once it is complete.

    NAME_0000.vtp etc. are the moments of a part; NAME.vtp.series has their times.

    soil: points with speed_m_per_s, displacement_m, broken_part and radius_m; tools: their surfaces, with the
    index of the tool in the scene; machine: lines to joints and springs. Returns the .vtp.series files.

    Raises:
        OSError: the folder cannot be written.
    """
    shapes = Shapes(resolved)
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
    times: dict[str, list[float]] = {}
    try:
        for frame in frames.read(frames.times_ns):
            for name, mesh in _meshes(resolved, shapes, frame).items():
                index = len(times.setdefault(name, []))
                mesh.save(part / f"{name}_{index:04d}.vtp")
                times[name].append(frame.time_s)
            done()
        for name, moments in times.items():
            files = [{"name": f"{name}_{k:04d}.vtp", "time": time_s} for k, time_s in enumerate(moments)]
            text = json.dumps({"file-series-version": "1.0", "files": files}, indent=1)
            (part / f"{name}.vtp.series").write_text(text + "\n", encoding="utf-8")
        part.chmod(0o755)
        part.rename(folder)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    return [folder / f"{name}.vtp.series" for name in times]


def _meshes(resolved: ResolvedScene, shapes: Shapes, frame: Frame) -> dict[str, pyvista.PolyData]:
    found: dict[str, pyvista.PolyData] = {}
    if len(frame.positions_m):
        cloud = pyvista.PolyData(frame.positions_m)
        cloud.point_data["speed_m_per_s"] = frame.speeds_m_per_s
        cloud.point_data["displacement_m"] = frame.displacements_m
        cloud.point_data["broken_part"] = frame.broken_parts
        cloud.point_data["radius_m"] = frame.radii_m
        found["soil"] = cloud
    surfaces = shapes.surfaces(frame)
    if surfaces:
        starts = np.cumsum([0, *(len(surface.vertices_m) for surface in surfaces)])[:-1]
        tools = pyvista.PolyData.from_regular_faces(
            np.concatenate([surface.vertices_m for surface in surfaces]),
            np.concatenate([s.facets + start for s, start in zip(surfaces, starts, strict=True)]),
        )
        names = list(resolved.scene.tools)
        counts = [len(surface.facets) for surface in surfaces]
        tools.cell_data["tool"] = np.repeat([names.index(surface.tool) for surface in surfaces], counts)
        found["tools"] = tools
    lines = np.concatenate([shapes.skeleton(frame), shapes.wheels(frame), shapes.springs(frame)])
    if len(lines):
        found["machine"] = pyvista.line_segments_from_points(lines)
    return found
