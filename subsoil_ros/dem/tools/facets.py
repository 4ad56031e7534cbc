"""Facets of a tool: topology, distance, and which particles are near which facet."""

from typing import NamedTuple

import numpy as np
from numba import njit

from ...scene.tool_mesh import ToolMesh
from .motion import into_body, out_of_body

_NEAR = 1e-2
"""Gap between the boxes of two parts over the size of the tool below which contacts look at both."""


class Facets(NamedTuple):
    """A tool's surface in its body frame. Every closed mesh of the tool keeps its own topology."""

    corner: np.ndarray  # (m, 3, 3) [m]: facet, corner, axis
    normal: np.ndarray  # (m, 3) outward unit
    edge: np.ndarray  # (m, 3) int32: edges ab, bc, ca by number
    vertex: np.ndarray  # (m, 3) int32
    opposite: np.ndarray  # (m, 3) int32: facet across edge ab, bc, ca
    group: np.ndarray  # (m,) int32
    setback: np.ndarray  # (1,) [m], how far particles reach in before they touch
    part: np.ndarray  # (m,) int32, number of the closed part; of length 0 if no two parts are near each other


def facets_of(mesh: ToolMesh) -> Facets:
    """Topology of a watertight mesh: every edge has two facets."""
    facets = np.ascontiguousarray(mesh.facets, np.int32)
    corner = np.ascontiguousarray(mesh.vertices_m[facets], np.float64)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    ends = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=-1), axis=-1)
    _, edge = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    edge = edge.ravel()
    sides = np.argsort(edge, kind="stable").reshape(-1, 2)  # the two places of every edge
    opposite = np.empty(len(edge), np.int32)
    opposite[sides] = sides[:, ::-1] // 3
    return Facets(
        corner,
        np.ascontiguousarray(normal),
        np.ascontiguousarray(edge.reshape(-1, 3).astype(np.int32)),
        facets,
        opposite.reshape(-1, 3),
        np.ascontiguousarray(mesh.facet_group, np.int32),
        np.array([mesh.setback_m]),
        _parts_in_touch(mesh),
    )


def _parts_in_touch(mesh: ToolMesh) -> np.ndarray:
    """(m,) int32: number of each facet's closed part, or (0,) if the boxes of no two parts overlap."""
    part = mesh.part_of_facets()
    corner = mesh.vertices_m[mesh.facets]
    boxes = [(corner[part == k].min((0, 1)), corner[part == k].max((0, 1))) for k in range(part.max() + 1)]
    near = _NEAR * float(np.ptp(mesh.vertices_m, axis=0).max())
    touch = any(
        (low <= other_high + near).all() and (other_low <= high + near).all()
        for k, (low, high) in enumerate(boxes)
        for other_low, other_high in boxes[:k]
    )
    return part if touch else part[:0]


@njit(cache=True, error_model="numpy")
def closest_feature(px, py, pz, corner):
    """Point of a triangle nearest to p, and the feature it lies on.

    corner (3, 3) [m]. Returns x, y, z [m] and 0: face, 1-3: edge ab, bc, ca, 4-6: corner a, b, c.
    The regions follow from the signs of the barycentric coordinates on the plane and on the edges
    (C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
    """
    ax, ay, az = corner[0, 0], corner[0, 1], corner[0, 2]
    abx, aby, abz = corner[1, 0] - ax, corner[1, 1] - ay, corner[1, 2] - az
    acx, acy, acz = corner[2, 0] - ax, corner[2, 1] - ay, corner[2, 2] - az
    qx, qy, qz = px - ax, py - ay, pz - az
    ab_q = abx * qx + aby * qy + abz * qz
    ac_q = acx * qx + acy * qy + acz * qz
    if ab_q <= 0.0 and ac_q <= 0.0:
        return ax, ay, az, 4
    ab_ab = abx * abx + aby * aby + abz * abz
    ac_ac = acx * acx + acy * acy + acz * acz
    ab_ac = abx * acx + aby * acy + abz * acz
    # the same products seen from b and c
    ab_b, ac_b = ab_q - ab_ab, ac_q - ab_ac
    if ab_b >= 0.0 and ac_b <= ab_b:
        return corner[1, 0], corner[1, 1], corner[1, 2], 5
    ab_c, ac_c = ab_q - ab_ac, ac_q - ac_ac
    if ac_c >= 0.0 and ab_c <= ac_c:
        return corner[2, 0], corner[2, 1], corner[2, 2], 6
    weight_c = ab_q * ac_b - ab_b * ac_q
    if weight_c <= 0.0 and ab_q >= 0.0 and ab_b <= 0.0:
        t = ab_q / ab_ab
        return ax + t * abx, ay + t * aby, az + t * abz, 1
    weight_b = ab_c * ac_q - ab_q * ac_c
    if weight_b <= 0.0 and ac_q >= 0.0 and ac_c <= 0.0:
        t = ac_q / ac_ac
        return ax + t * acx, ay + t * acy, az + t * acz, 3
    weight_a = ab_b * ac_c - ab_c * ac_b
    towards_c, towards_b = ac_b - ab_b, ab_c - ac_c
    if weight_a <= 0.0 and towards_c >= 0.0 and towards_b >= 0.0:
        t = towards_c / (towards_c + towards_b)
        return (
            corner[1, 0] + t * (acx - abx),
            corner[1, 1] + t * (acy - aby),
            corner[1, 2] + t * (acz - abz),
            2,
        )
    share = 1.0 / (weight_a + weight_b + weight_c)
    s, t = weight_b * share, weight_c * share
    return ax + s * abx + t * acx, ay + s * aby + t * acy, az + s * abz + t * acz, 0


@njit(cache=True)
def near_facets(position, cell_start, grid, motion, corner, reach):
    """Particles within `reach` [m] of a facet, and which facets.

    motion: see tools.motion. corner in the body frame; particles sorted by cell.
    Returns particle (c,), facet_start (c + 1,), facet (q,), particles increasing.
    """
    n = position.shape[0]
    count = np.zeros(n, np.int32)
    found = np.zeros(n + 1, np.int64)
    facet = np.empty(0, np.int32)
    reach2 = reach * reach
    for fill in range(2):
        for m in range(corner.shape[0]):
            low, high = np.full(3, np.inf), np.full(3, -np.inf)
            for v in range(3):
                world = out_of_body(motion, corner[m, v, 0], corner[m, v, 1], corner[m, v, 2])
                for a in range(3):
                    low[a] = min(low[a], world[a] - reach)
                    high[a] = max(high[a], world[a] + reach)
            first_x = max(int(np.floor((low[0] - grid.origin_x) / grid.edge)), 0)
            last_x = min(int(np.floor((high[0] - grid.origin_x) / grid.edge)), grid.nx - 1)
            first_y = max(int(np.floor((low[1] - grid.origin_y) / grid.edge_y)), 0)
            last_y = min(int(np.floor((high[1] - grid.origin_y) / grid.edge_y)), grid.ny - 1)
            first_z = max(int(np.floor((low[2] - grid.origin_z) / grid.edge)), 0)
            last_z = min(int(np.floor((high[2] - grid.origin_z) / grid.edge)), grid.nz - 1)
            if first_z > last_z:
                continue
            for cx in range(first_x, last_x + 1):
                for cy in range(first_y, last_y + 1):
                    column = (cx * grid.ny + cy) * grid.nz
                    for i in range(cell_start[column + first_z], cell_start[column + last_z + 1]):
                        px, py, pz = into_body(motion, position[i, 0], position[i, 1], position[i, 2])
                        qx, qy, qz, _ = closest_feature(px, py, pz, corner[m])
                        if (px - qx) ** 2 + (py - qy) ** 2 + (pz - qz) ** 2 < reach2:
                            if fill == 1:
                                facet[found[i] + count[i]] = m
                            count[i] += 1
        if fill == 0:
            for i in range(n):
                found[i + 1] = found[i] + count[i]
                count[i] = 0
            facet = np.empty(found[n], np.int32)
    particle = np.flatnonzero(count)
    facet_start = np.empty(len(particle) + 1, np.int64)
    facet_start[0] = 0
    for k in range(len(particle)):
        facet_start[k + 1] = found[particle[k] + 1]
    return particle, facet_start, facet


@njit(cache=True)
def inside_or_near(position, particle, motion, corner, clearance):
    """Of `particle`, those inside the closed surface or closer to it than their clearance: bool (c,).

    clearance [m]: (n,), of all particles. motion: see tools.motion.

    Inside is where the solid angles of the facets sum to more than 2 pi (A. van Oosterom, J. Strackee,
    IEEE Trans. Biomed. Eng. 30, 1983: the angle of one triangle).
    """
    hit = np.zeros(len(particle), np.bool_)
    a, b, c = np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(particle)):
        i = particle[k]
        p = into_body(motion, position[i, 0], position[i, 1], position[i, 2])
        angle = 0.0
        for m in range(corner.shape[0]):
            qx, qy, qz, _ = closest_feature(p[0], p[1], p[2], corner[m])
            if (p[0] - qx) ** 2 + (p[1] - qy) ** 2 + (p[2] - qz) ** 2 < clearance[i] ** 2:
                hit[k] = True
                break
            for axis in range(3):
                a[axis] = corner[m, 0, axis] - p[axis]
                b[axis] = corner[m, 1, axis] - p[axis]
                c[axis] = corner[m, 2, axis] - p[axis]
            la, lb, lc = np.sqrt(np.dot(a, a)), np.sqrt(np.dot(b, b)), np.sqrt(np.dot(c, c))
            volume = (
                a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
            )
            base = la * lb * lc + np.dot(a, b) * lc + np.dot(b, c) * la + np.dot(c, a) * lb
            angle += 2.0 * np.arctan2(volume, base)
        if angle > 2.0 * np.pi:
            hit[k] = True
    return hit
