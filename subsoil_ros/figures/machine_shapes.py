"""The machine in world axes at one moment, as surfaces and lines for pictures and VTK files."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..loading.loader import ResolvedScene
from ..messages import BodyState
from ..scene.mechanism import GROUND, Driver, Mechanism, SpringDamper, WheelContact
from ..scene.tool_mesh import ToolMesh, load_tool_mesh, posed_vertices_m, reference_angle
from .snapshots import Frame

COLOURS = {"tool": "#9aa0a6", "body": "#3c4043", "spring": "#c55a11", "soil": "#806040"}

RIM_CORNERS = 48
"""Corners of the circle that is drawn for a wheel without a mesh; only its appearance depends on it."""

Segments = NDArray[np.float64]  # (2 n, 3) [m]: pairs of ends


@dataclass(frozen=True)
class Surface:
    """A tool's mesh at its pose."""

    tool: str
    vertices_m: NDArray[np.float64]  # (n, 3)
    facets: NDArray[np.int32]  # (m, 3)


class Shapes:
    """The tools and bodies of a scene, placed at the poses of a moment."""

    def __init__(self, resolved: ResolvedScene) -> None:
        """Load the meshes of all tools."""
        self._resolved, self._scene = resolved, resolved.scene
        self._meshes: dict[str, ToolMesh] = {
            name: load_tool_mesh(resolved.directory, resolved.scene, name) for name in resolved.scene.tools
        }
        self._forces = [*resolved.scene.mechanism.forces.values()] if resolved.scene.mechanism else []
        self._points = _body_points(resolved.scene.mechanism) if resolved.scene.mechanism else {}

    def surfaces(self, frame: Frame) -> list[Surface]:
        """Every tool at its pose."""
        found = []
        for motion in frame.tools:
            mesh, reference = self._meshes[motion.tool], reference_angle(self._resolved.scene, motion.tool)
            found.append(Surface(motion.tool, posed_vertices_m(mesh, motion, reference), mesh.facets))
        return found

    def skeleton(self, frame: Frame) -> Segments:
        """Lines from the centre of mass of each body to the points of its joints and forces."""
        pairs = [
            end
            for body in frame.bodies
            for point in self._points.get(body.name, ())
            for end in (self._world(body, None), self._world(body, point))
        ]
        return np.array(pairs).reshape(-1, 3)

    def springs(self, frame: Frame) -> Segments:
        """Lines along all springs between two points."""
        bodies = {body.name: body for body in frame.bodies}
        pairs = [
            end
            for force in self._forces
            if isinstance(force, SpringDamper)
            for end in self._ends(bodies, force)
        ]
        return np.array(pairs).reshape(-1, 3)

    def wheels(self, frame: Frame) -> Segments:
        """Rim and one spoke of every wheel that has no mesh."""
        bodies = {body.name: body for body in frame.bodies}
        turn = np.linspace(0.0, 2.0 * np.pi, RIM_CORNERS + 1)
        found: list[NDArray[np.float64]] = []
        for force in self._forces:
            if not isinstance(force, WheelContact) or force.body not in bodies:
                continue
            body = bodies[force.body]
            angles = turn + body.angle_rad
            y = self._lateral_m(force.body)
            x, z = body.x_m + force.radius_m * np.cos(angles), body.z_m + force.radius_m * np.sin(angles)
            rim = np.column_stack([x, np.full_like(x, y), z])
            found.append(np.stack([rim[:-1], rim[1:]], axis=1).reshape(-1, 3))
            found.append(np.array([[body.x_m, y, body.z_m], rim[0]]))
        return np.concatenate(found) if found else np.empty((0, 3))

    def _ends(self, bodies: dict[str, BodyState], force: SpringDamper) -> Iterator[list[float]]:
        places = ((force.body_a, force.point_a_m), (force.body_b, force.point_b_m))
        if all(name == GROUND or name in bodies for name, _ in places):
            for name, point in places:
                yield [point[0], 0.0, point[1]] if name == GROUND else self._world(bodies[name], point)

    def _world(self, body: BodyState, point_m: tuple[float, float] | None) -> list[float]:
        """World place of a point that is given in the reference pose; None: the centre of mass."""
        y = self._lateral_m(body.name)
        if point_m is None or self._scene.mechanism is None:
            return [body.x_m, y, body.z_m]
        reference = self._scene.mechanism.bodies[body.name]
        x, z = point_m[0] - reference.position_m[0], point_m[1] - reference.position_m[1]
        turn = body.angle_rad - reference.angle_rad
        cosine, sine = np.cos(turn), np.sin(turn)
        return [body.x_m + cosine * x - sine * z, y, body.z_m + sine * x + cosine * z]

    def _lateral_m(self, body: str) -> float:
        return next((tool.lateral_m for tool in self._scene.tools.values() if tool.body == body), 0.0)


def _body_points(mechanism: Mechanism) -> dict[str, list[tuple[float, float]]]:
    """Points of each body, in the reference pose, at which joints and springs act."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in mechanism.bodies}
    places: list[tuple[str, tuple[float, float]]] = []
    for joint in mechanism.joints.values():
        if isinstance(joint, Driver) or joint.kind in ("prismatic", "point_on_line"):
            continue  # a driver has no point, and a line acts along its whole length
        places.append((joint.body_a, joint.point_m))
        places.append((joint.body_b, getattr(joint, "point_b_m", None) or joint.point_m))
    for force in mechanism.forces.values():
        if isinstance(force, SpringDamper):
            places += [(force.body_a, force.point_a_m), (force.body_b, force.point_b_m)]
    for name, point in places:
        if name != GROUND:
            found[name].append(point)
    return found
