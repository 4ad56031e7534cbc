"""The rows of `subsoil check` about tools: as a designer sees them, and their mass."""

from collections.abc import Iterable

import numpy as np

from ...limits.soil_at_work import speed_and_depth
from ...loading.loader import ResolvedScene
from ...scene.tool_mesh import ToolMesh, load_tool_mesh, tool_mass
from ...scene.tool_shape import tool_shape
from ...scene.tools import Tool


def tool_rows(resolved: ResolvedScene) -> Iterable[tuple[str, str]]:
    """Rows of every tool."""
    for name, tool in resolved.scene.tools.items():
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
        yield from _rows(resolved, name, tool, mesh)


def _rows(resolved: ResolvedScene, name: str, tool: Tool, mesh: ToolMesh) -> Iterable[tuple[str, str]]:
    carrier = f"body {tool.body}" if tool.body else "path"
    yield name, f"{', '.join(tool.groups)} ({len(mesh.facets)} facets) on {carrier}"
    size = " x ".join(f"{1e3 * edge:.0f}" for edge in np.ptp(mesh.vertices_m, axis=0))
    yield "size", f"{size} mm, along, across and upwards"
    speed, depth = speed_and_depth(resolved.scene, name, mesh)
    if depth > 0.0:
        yield "at the start", f"{1e3 * depth:.0f} mm deep{f', at up to {speed:g} m/s' if speed else ''}"
    if tool.is_tillage and not tool.is_spatial and depth > 0.0:
        shape = tool_shape(mesh.vertices_m, mesh.facets, depth)
        told = [f"{1e3 * shape.width_m:.0f} mm wide in the soil"]
        if shape.rake_deg is not None:
            told.append(f"rake {shape.rake_deg:.0f} deg at the edge (90: upright)")
        if shape.clearance_deg is not None:
            told.append(f"clearance {shape.clearance_deg:.0f} deg")
        yield "works", ", ".join(told)
        x, z = shape.tip_m
        yield "tip", f"x = {x:.4g} m, z = {z:.4g} m in the axes of the {'body' if tool.body else 'mesh'}"
    if tool.setback_m > 0.0:
        yield "set back", f"{1e3 * tool.setback_m:g} mm: particles reach so far into it before they touch it"
    if tool.density_kg_per_m3 is not None:
        found = tool_mass(mesh, tool.density_kg_per_m3)
        cx, cy, cz = found.centre_m
        yield (
            f"at {tool.density_kg_per_m3:g} kg/m3",
            f"{found.mass_kg:.4g} kg, {found.inertia_kg_m2:.4g} kg m2 about y through its centre, "
            f"({cx:.4f}, {cy:.4f}, {cz:.4f}) m from the origin of the {'body' if tool.body else 'path'}",
        )
        if tool.body and resolved.scene.mechanism:
            body = resolved.scene.mechanism.bodies[tool.body]
            yield f"body {tool.body}, typed", f"{body.mass_kg:.4g} kg, {body.inertia_kg_m2:.4g} kg m2"
