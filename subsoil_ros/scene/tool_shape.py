"""A tool as a designer sees it, from its mesh: working edge, width, rake and clearance."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

EDGE = 0.01
"""Vertices this part of the tool's height above its lowest one belong to the working edge."""

AT_EDGE = 0.03
"""Rake and clearance are those of facets that reach into this lowest part of the depth, 6 mm of 0.2 m: a
shank above is not the share, and a rounded edge has little area."""

SLANTED = 1e-3
"""Part of a facet's normal along an axis, from which it looks that way: the round-off of an STL file."""


class ToolShape(NamedTuple):
    """In axes with x forward and z upwards."""

    tip_m: tuple[float, float]  # x, z of the foremost place of the lowest edge
    foremost_m: float  # x of the foremost place in the soil
    sides_m: tuple[float, float]  # lowest and highest y of what is in the soil
    height_m: float  # of the whole tool
    rake_deg: float | None  # front at the edge against the horizontal, 90: upright; None: no front there
    clearance_deg: float | None  # underside at the edge against the horizontal, rising to the rear

    @property
    def width_m(self) -> float:
        """Of what is in the soil."""
        return self.sides_m[1] - self.sides_m[0]


def part_below(
    vertices_m: NDArray[np.float64], facets: NDArray[np.integer], height_m: float
) -> NDArray[np.float64]:
    """Corners (n, 3) [m] of the part of a surface that lies below a height, in the axes of the vertices: its
    vertices there, and the places where its edges pass the height."""
    edges = vertices_m[np.stack((facets, np.roll(facets, -1, axis=1)), axis=-1).reshape(-1, 2)]
    below = edges[:, :, 2] <= height_m
    start, end = edges[below[:, 0] != below[:, 1]].swapaxes(0, 1)
    part = (height_m - start[:, 2]) / (end[:, 2] - start[:, 2])
    return np.concatenate((edges[below], start + part[:, None] * (end - start)))


def lowest_tip_m(vertices_m: NDArray[np.float64]) -> tuple[float, float]:
    """x and z of the foremost place of the lowest edge of a tool, from its vertices (n, 3) [m]."""
    x, _, z = vertices_m.T
    low = float(z.min())
    return float(x[z <= low + EDGE * float(np.ptp(z))].max()), low


def tool_shape(vertices_m: NDArray[np.float64], facets: NDArray[np.integer], depth_m: float) -> ToolShape:
    """The shape of a tool whose lowest vertex is `depth_m` below the surface."""
    z = vertices_m[:, 2]
    low, height = float(z.min()), float(np.ptp(z))
    inside = part_below(vertices_m, facets, low + depth_m)
    corners = vertices_m[facets]
    area = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = area / np.linalg.norm(area, axis=1)[:, None]
    at_edge = corners[:, :, 2].min(axis=1) <= low + AT_EDGE * min(depth_m, height)
    front = at_edge & (normal[:, 0] > SLANTED)
    under = at_edge & (normal[:, 2] < -SLANTED) & (-normal[:, 2] >= np.abs(normal[:, 0]))
    return ToolShape(
        tip_m=lowest_tip_m(vertices_m),
        foremost_m=float(inside[:, 0].max()),
        sides_m=(float(inside[:, 1].min()), float(inside[:, 1].max())),
        height_m=height,
        rake_deg=_slope(area[front & (normal[:, 2] > -SLANTED)].sum(axis=0) if front.any() else None),
        clearance_deg=_clearance(area[under].sum(axis=0) if under.any() else None),
    )


def _slope(area: NDArray[np.float64] | None) -> float | None:
    if area is None or not area.any():
        return None
    return math.degrees(math.atan2(float(area[0]), float(area[2])))


def _clearance(area: NDArray[np.float64] | None) -> float | None:
    return None if area is None else math.degrees(math.atan2(-float(area[0]), -float(area[2])))
