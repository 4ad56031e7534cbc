"""Geometry of a tool for the wedge model, from its mesh: cutting faces, sides, wheels."""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import SceneError
from .tool_mesh import ToolMesh

FORWARD = 1e-3
"""A facet cuts if the x part of its normal is above this, the round-off of an STL file."""

SIDEWAYS = 0.9
"""A facet is a side if the y part of its normal is above this: within 26 degrees of the y axis."""

ROUNDNESS = 0.02
"""Largest relative deviation of a wheel's rim from a circle: polygons of 20 and more segments pass."""


@dataclass(frozen=True)
class CuttingFace:
    """The front of one group of a tool, taken as one plane plate, in the frame of its body."""

    group: int
    width_m: float  # along y
    rake_rad: float  # front against the horizontal, in the reference pose: 90 degrees is a vertical blade
    tip_m: tuple[float, float]  # x, z of its lowest point
    top_m: tuple[float, float]  # x, z of its highest point
    side_m2: float  # area of one side
    is_share: bool  # the lowest of its tool; the others stand in what it has broken
    middle_m: float = 0.0  # y of the middle of its width
    aside_rad: float = 0.0  # by how much its mean normal looks to +y

    @property
    def side_part(self) -> float:
        """Mean length of its sides, along x, over its width."""
        tall = self.top_m[1] - self.tip_m[1]
        return self.side_m2 / (tall * self.width_m) if tall > 0.0 else math.inf

    @property
    def area_m2(self) -> float:
        """Area of the plate."""
        return self.width_m * math.hypot(self.top_m[0] - self.tip_m[0], self.top_m[1] - self.tip_m[1])


@dataclass(frozen=True)
class WheelFace:
    """A cylinder about its body's centre of mass."""

    radius_m: float
    width_m: float


def cutting_faces(mesh: ToolMesh, place: str) -> tuple[CuttingFace, ...]:
    """One face per group that has a front, the share first.

    Raises:
        SceneError: no group has a facet that looks forward.
    """
    corners = mesh.vertices_m[mesh.facets]
    area_normal = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(area_normal, axis=1)
    normal = area_normal / area[:, None]
    found = []
    for group in range(len(mesh.groups)):
        here = mesh.facet_group == group
        front = here & (normal[:, 0] > FORWARD)
        if not front.any():
            continue
        points = corners[front].reshape(-1, 3)
        mean = area_normal[front].sum(axis=0)
        low, high = points[np.argmin(points[:, 2])], points[np.argmax(points[:, 2])]
        sides = area[here & (normal[:, 1] > SIDEWAYS)].sum()
        found.append(
            CuttingFace(
                group=group,
                width_m=float(np.ptp(points[:, 1])),
                rake_rad=math.atan2(float(mean[0]), float(mean[2])),
                tip_m=(float(low[0]), float(low[2])),
                top_m=(float(high[0]), float(high[2])),
                side_m2=float(sides),
                is_share=False,
                middle_m=0.5 * float(points[:, 1].min() + points[:, 1].max()),
                aside_rad=math.atan2(float(mean[1]), math.hypot(float(mean[0]), float(mean[2]))),
            )
        )
    if not found:
        raise SceneError(f"{place}: no facet of its meshes looks forward (+x), so it has no face that cuts")
    found.sort(key=lambda face: face.tip_m[1])
    share = found[0]
    return (CuttingFace(**{**share.__dict__, "is_share": True}), *found[1:])


def wheel_face(mesh: ToolMesh, place: str) -> WheelFace:
    """The wheel that a tool with `role: wheel` is.

    Raises:
        SceneError: it is not round about its body's centre of mass.
    """
    radius = np.hypot(mesh.vertices_m[:, 0], mesh.vertices_m[:, 2])
    rim = radius[radius > 0.5 * radius.max()]
    if np.ptp(rim) > ROUNDNESS * rim.max():
        raise SceneError(
            f"{place}: 'role: wheel' makes it a wheel in a wedge model, but its mesh is not round about "
            f"the body's centre of mass (radius {rim.min():.4g} to {rim.max():.4g} m); give a wheel, or "
            "leave out 'role: wheel'"
        )
    return WheelFace(float(rim.max()), float(np.ptp(mesh.vertices_m[:, 1])))
