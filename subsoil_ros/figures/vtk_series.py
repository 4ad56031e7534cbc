"""The moments of a run as VTK files for ParaView: NAME_0000.vtp etc.; NAME.vtp.series has their times."""

import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyvista

from ..loading.loader import ResolvedScene
from .machine_shapes import Shapes
from .snapshots import Frame, Snapshots


def write_vtk_series(
    resolved: ResolvedScene, frames: Snapshots, folder: Path, done: Callable[[], None]
) -> list[Path]:
    """Write soil, tools and machine into a new `folder`, which appears once it is complete.

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
                mesh.save(part / _file_name(name, index))
                times[name].append(frame.time_s)
            done()
        for name, moments in times.items():
            files = [{"name": _file_name(name, k), "time": time_s} for k, time_s in enumerate(moments)]
            text = json.dumps({"file-series-version": "1.0", "files": files}, indent=1)
            (part / f"{name}.vtp.series").write_text(text + "\n", encoding="utf-8")
        part.chmod(0o755)
        part.rename(folder)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    return [folder / f"{name}.vtp.series" for name in times]


def _file_name(name: str, index: int) -> str:
    return f"{name}_{index:04d}.vtp"


def _meshes(resolved: ResolvedScene, shapes: Shapes, frame: Frame) -> dict[str, pyvista.PolyData]:
    found: dict[str, pyvista.PolyData] = {}
    soil = resolved.scene.particle_soil
    if soil is not None and len(frame.positions_m):
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
