"""Mass, centre of mass and inertia of a tool, computed from its meshes and a density."""

from dataclasses import dataclass

import numpy as np
import trimesh

from .meshes import ToolMesh


@dataclass(frozen=True)
class ToolMass:
    """Mass of the solid inside the meshes, in the frame of the tool's body; overlaps count twice."""

    mass_kg: float
    centre_m: tuple[float, float, float]  # from the body's typed centre of mass
    inertia_kg_m2: float  # about the y axis through the computed centre


def tool_mass(mesh: ToolMesh, density_kg_per_m3: float) -> ToolMass:
    """Integrals over the closed meshes of a tool (divergence theorem, by trimesh)."""
    mass, moment, about_origin = 0.0, np.zeros(3), 0.0
    for group in range(len(mesh.groups)):
        part = trimesh.Trimesh(mesh.vertices_m, mesh.facets[mesh.facet_group == group], process=False)
        found = trimesh.triangles.mass_properties(part.triangles, density=density_kg_per_m3)
        centre = np.asarray(found["center_mass"])
        mass += float(found["mass"])
        moment += found["mass"] * centre
        about_origin += float(found["inertia"][1, 1] + found["mass"] * (centre[0] ** 2 + centre[2] ** 2))
    x, y, z = (moment / mass).tolist()
    return ToolMass(mass, (x, y, z), about_origin - mass * (x**2 + z**2))
