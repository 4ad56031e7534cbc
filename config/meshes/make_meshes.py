"""Makes the STL files of this folder from declared dimensions: python config/meshes/make_meshes.py [FOLDER]

share.stl and shank.stl (the blade) stand in the reference pose of the machine: x forward, y left, z up,
origin on the soil surface under the hinge H8. wheel.stl stands around its own centre, its axle along y.
Metres. The paper prints no drawing of the tools, so every length here is chosen; where prototypes or a
derived value led to it, that stands beside it. Particles have a radius of 10 mm, so nothing but the
cutting edges is thinner than 20 mm.
"""

import sys
from dataclasses import dataclass
from math import cos, pi, radians, sin, tan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Vertices = NDArray[np.float64]  # (n, 3) [m]
Facets = NDArray[np.int64]  # (m, 3), counter-clockwise seen from outside

RESOLUTION_M = 1e-7
"""Coordinates are rounded to this, so that the last bits of a sine do not show in the files."""

_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True)
class Share:
    """A wedge that becomes a plate: flat top at the rake, underside at the clearance angle."""

    tip_x_m: float = 0.12  # derived: paper/mechanism_parameters, tip
    tip_z_m: float = -0.30  # derived: working depth 0.30 m
    width_m: float = 0.060  # chosen: as the prototype that was measured
    length_m: float = 0.180  # along the top; chosen
    rake_deg: float = 25.0  # top against the horizontal; chosen: as the prototype
    clearance_deg: float = 8.0  # underside behind the tip against the horizontal; chosen
    thickness_m: float = 0.030  # of the plate; chosen


@dataclass(frozen=True)
class Blade:
    """A plate with a wedge-shaped front edge, raked forward, standing in the top of the share."""

    edge_x_m: float = 0.070  # where the front edge meets the top of the share; chosen
    rake_deg: float = 3.0  # front edge against the vertical, foot forward; chosen: H8 lies inside
    thickness_m: float = 0.030  # chosen: as the prototype
    width_m: float = 0.080  # along x, from the edge to the back; chosen
    edge_angle_deg: float = 60.0  # between the two faces of the edge; chosen
    top_z_m: float = 0.40  # derived: height of the hinge H8
    sunk_m: float = 0.005  # foot below the top of the share: hidden in it, no gap; chosen


@dataclass(frozen=True)
class Wheel:
    """A cylinder."""

    radius_m: float = 0.20  # derived: from the printed inertia, paper/mechanism_parameters
    width_m: float = 0.10  # chosen
    segment_count: int = 60  # chosen: chords deviate by 0.27 mm


def loft(near: Vertices, far: Vertices) -> tuple[Vertices, Facets]:
    """Closed convex body between two polygons of equal count.

    `near` (n, 3) runs counter-clockwise seen from outside, looking towards `far`; corner i of `far` lies
    across from corner i of `near`.
    """
    count = len(near)
    this = np.arange(count)
    following = (this + 1) % count
    sides = [
        np.column_stack([following, this, this + count]),
        np.column_stack([following, this + count, following + count]),
    ]
    fan = np.arange(1, count - 1)
    near_cap = np.column_stack([np.zeros_like(fan), fan, fan + 1])
    far_cap = near_cap[:, ::-1] + count
    return np.concatenate([near, far]), np.concatenate([*sides, near_cap, far_cap])


def share(size: Share) -> tuple[Vertices, Facets]:
    """The share: its section in x and z, drawn out along y."""
    rake, clearance = radians(size.rake_deg), radians(size.clearance_deg)
    bevel_m = size.thickness_m / sin(rake - clearance)  # along the underside, to full thickness
    top = (-size.length_m * cos(rake), size.length_m * sin(rake))
    heel = (top[0] - size.thickness_m * sin(rake), top[1] - size.thickness_m * cos(rake))
    bend = (-bevel_m * cos(clearance), bevel_m * sin(clearance))
    section = np.add([(0.0, 0.0), top, heel, bend], (size.tip_x_m, size.tip_z_m))
    right, left = (
        np.column_stack([section[:, 0], np.full(len(section), y), section[:, 1]])
        for y in (-0.5 * size.width_m, 0.5 * size.width_m)
    )
    return loft(right, left)


def blade(size: Blade, below: Share) -> tuple[Vertices, Facets]:
    """The blade: its section in x and y, drawn out from inside the share to its top along the rake."""
    half = 0.5 * size.thickness_m
    nose_m = half / tan(radians(0.5 * size.edge_angle_deg))
    back = -size.width_m
    section = np.array([(0.0, 0.0), (-nose_m, half), (back, half), (back, -half), (-nose_m, -half)])
    slope, lean = tan(radians(below.rake_deg)), tan(radians(size.rake_deg))
    sunk_m = size.sunk_m / cos(radians(below.rake_deg))  # along z

    # A line of the blade is x = x_edge + section_x - lean (z - z_edge); the foot is the plane of the share's
    # top, z = tip_z + slope (tip_x - x), lowered by sunk_m.
    edge_z = below.tip_z_m + slope * (below.tip_x_m - size.edge_x_m)
    foot_z = (edge_z - slope * section[:, 0] - sunk_m - slope * lean * edge_z) / (1.0 - slope * lean)

    def at(z: NDArray[np.float64]) -> Vertices:
        return np.column_stack([size.edge_x_m + section[:, 0] - lean * (z - edge_z), section[:, 1], z])

    return loft(at(np.full(len(section), size.top_z_m)), at(foot_z))


def wheel(size: Wheel) -> tuple[Vertices, Facets]:
    """The wheel: a polygon in x and z, drawn out along y, its sides fanned about their centres."""
    angle = 2.0 * pi * np.arange(size.segment_count) / size.segment_count
    rim = [(size.radius_m * cos(a), size.radius_m * sin(a)) for a in angle]
    right, left = (np.array([(x, y, z) for x, z in rim]) for y in (-0.5 * size.width_m, 0.5 * size.width_m))
    vertices, facets = loft(right, left)
    count = size.segment_count
    this = np.arange(count)
    following = (this + 1) % count
    caps = [
        np.column_stack([np.full(count, 2 * count), this, following]),
        np.column_stack([np.full(count, 2 * count + 1), following + count, this + count]),
    ]
    centres = [(0.0, -0.5 * size.width_m, 0.0), (0.0, 0.5 * size.width_m, 0.0)]
    return np.concatenate([vertices, centres]), np.concatenate([facets[: 2 * count], *caps])


def stl_bytes(vertices: Vertices, facets: Facets) -> bytes:
    """Binary STL of a mesh; equal dimensions give equal bytes."""
    corners = np.round(vertices[facets] / RESOLUTION_M) * RESOLUTION_M + 0.0  # no negative zero
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    records = np.zeros(len(facets), dtype=_STL_FACET)
    records["normal"] = np.round(normal, 5) + 0.0
    records["corners"] = corners
    return b"metres; made by make_meshes.py".ljust(80) + np.uint32(len(facets)).tobytes() + records.tobytes()


def write_meshes(folder: Path) -> None:
    """Write share.stl, shank.stl and wheel.stl into `folder`."""
    meshes = {
        "share.stl": share(Share()),
        "shank.stl": blade(Blade(), Share()),
        "wheel.stl": wheel(Wheel()),
    }
    for name, mesh in meshes.items():
        (folder / name).write_bytes(stl_bytes(*mesh))


if __name__ == "__main__":
    write_meshes(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
