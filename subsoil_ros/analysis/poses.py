"""Tools as they stand in the world."""

import numpy as np
from numpy.typing import NDArray

from ..loading.loader import ResolvedScene
from ..messages import SpatialMotion, ToolMotion
from ..rotations import placed_m
from ..scene.tool_mesh import ToolMesh


def reference_angle(resolved: ResolvedScene, tool: str) -> float:
    """Angle of a tool's body in the reference pose [rad]; 0 along a path."""
    body, mechanism = resolved.scene.tools[tool].body, resolved.scene.mechanism
    return mechanism.bodies[body].angle_rad if body is not None and mechanism is not None else 0.0


def posed_vertices_m(mesh: ToolMesh, motion: ToolMotion, reference_angle_rad: float) -> NDArray[np.float64]:
    """Vertices (n, 3) of a tool in world axes at a motion's pose."""
    if isinstance(motion, SpatialMotion):
        return placed_m(mesh.about_body().vertices_m, motion.position_m, motion.quaternion)
    turn = motion.angle_rad - reference_angle_rad
    cosine, sine = np.cos(turn), np.sin(turn)
    x, y, z = mesh.vertices_m.T
    return np.column_stack([motion.x_m + cosine * x - sine * z, y, motion.z_m + sine * x + cosine * z])
