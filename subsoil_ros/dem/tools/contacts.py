"""Contacts of a particle with the surface of a tool: where they are, and which of before they continue.

A contact belongs to a feature of the surface: a face, an edge or a vertex, where the distance from the
particle's centre has a minimum. Of minima in nearly one direction the deepest counts, so a flat, convex or
smoothly concave place gives one contact however finely it is meshed, a concave corner one per face. Parts of
a tool that touch or overlap are one surface. Surfaces are one-sided: a contact starts only from outside, and
then stays on its face even when the centre is pressed through it, so a particle cannot flip to the far side
of a thin share; past a sharp edge it goes on at the nearest face.
"""

import math

from ..compiled import inner_kernel
from .facets import closest_feature

CONTACTS = 4
"""Contacts of one particle with one tool that are kept; a convex body gives at most three."""

CANDIDATES = 12
"""Minima of the distance that are compared; the shallowest of more are left out."""

FOUND = 7
"""Numbers of a contact that was found: unit normal towards the tool, distance [m] (negative: centre behind
the face), group, history slot or -1, and whether it counts (0: not yet decided)."""

_ROUNDING_M = 1e-9
"""Distances that differ by less count as equal: far above the round-off of coordinates of some metres,
1e-15 m, and far below an overlap."""

_ONE_CONTACT = math.cos(math.radians(30.0))
"""Cosine of the angle between normals below which contacts are one: facets of a smooth concave surface meet
at less, those of a corner at more."""

_LEVEL = 0.01
"""Slope of the distance along a surface below which its points are equally near: the direction of the contact
is then known to half a degree."""

_JOINED = 1e-3
"""Gap over a particle's reach below which parts of a tool are one surface: more than the float32 of an STL
file leaves between flush faces, less than an overlap."""

_SAME_NORMAL = 0.7
"""Least cosine between normals of a contact and the one it continues: its springs pass between facets that
meet at less than 45 degrees."""


@inner_kernel()
def _is_nearest(p, d, distance, facets, m, kind):
    """Whether no facet at edge or vertex `kind` of facet m is nearer to p than `distance`, and p is outside
    of one of them at least. d [m]: from p to the edge or vertex.

    Winding is consistent, so the facets across one edge after another lead around a vertex, or back. Only
    distances are compared, with a tolerance: whichever of the facets finds an edge or a vertex nearest, by
    rounding, a contact there is found once at least.
    """
    dx, dy, dz = d
    corner = (kind - 1) % 3
    outside, other = False, m
    while True:
        nx, ny, nz = facets.normal[other, 0], facets.normal[other, 1], facets.normal[other, 2]
        if dx * nx + dy * ny + dz * nz <= _ROUNDING_M:
            outside = True
        across = facets.opposite[other, corner]
        if across == m:
            return outside
        corner = 0
        while not (
            facets.edge[across, corner] == facets.edge[m, kind - 1]
            if kind < 4
            else facets.vertex[across, corner] == facets.vertex[m, kind - 4]
        ):
            corner += 1
        other = across
        qx, qy, qz, _ = closest_feature(p[0], p[1], p[2], facets.corner[other])
        if math.sqrt((qx - p[0]) ** 2 + (qy - p[1]) ** 2 + (qz - p[2]) ** 2) < distance - _ROUNDING_M:
            return False


@inner_kernel()
def _enters(p, d, near, corner, normal):
    """Whether the way from p along d [m] enters a facet before its last part `near` (of its length)."""
    along = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2]
    if along >= 0.0:
        return False
    qx, qy, qz = corner[0, 0] - p[0], corner[0, 1] - p[1], corner[0, 2] - p[2]
    part = (qx * normal[0] + qy * normal[1] + qz * normal[2]) / along
    if not 0.0 <= part <= 1.0 - near:
        return False
    x, y, z = p[0] + part * d[0], p[1] + part * d[1], p[2] + part * d[2]
    sx, sy, sz, _ = closest_feature(x, y, z, corner)
    return (x - sx) ** 2 + (y - sy) ** 2 + (z - sz) ** 2 <= _ROUNDING_M**2


@inner_kernel()
def _is_hidden(row, p, d, distance, joined, near, facets, m):
    """Whether another part of the tool covers the point p + d [m] of facet m, or goes on from it towards p.

    Only facets of candidate `row` may do so. Parts that are nearer to each other than `joined` [m] are one
    surface.
    """
    x, y, z = p[0] + d[0], p[1] + d[1], p[2] + d[2]
    for q in range(near.facet_start[row], near.facet_start[row + 1]):
        other = near.facet[q]
        if facets.part[other] == facets.part[m]:
            continue
        if _enters(p, d, joined / distance, facets.corner[other], facets.normal[other]):
            return True
        qx, qy, qz, _ = closest_feature(p[0], p[1], p[2], facets.corner[other])
        nearer = distance - math.sqrt((qx - p[0]) ** 2 + (qy - p[1]) ** 2 + (qz - p[2]) ** 2)
        way = math.sqrt((qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2)
        if nearer > _ROUNDING_M + _LEVEL * way:
            qx, qy, qz, _ = closest_feature(x, y, z, facets.corner[other])
            if (qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2 <= joined**2:
                return True
    return False


@inner_kernel()
def _one_of_each_direction(found, out):
    """Of `found` candidates, the deepest of every direction, in their order; returns how many."""
    for _ in range(found):
        deepest = -1
        for k in range(found):
            if out[k, 6] == 0.0 and (deepest < 0 or out[k, 3] < out[deepest, 3]):
                deepest = k
        if deepest < 0:
            break
        out[deepest, 6] = 1.0
        for k in range(found):
            cosine = out[k, 0] * out[deepest, 0] + out[k, 1] * out[deepest, 1] + out[k, 2] * out[deepest, 2]
            if out[k, 6] == 0.0 and cosine > _ONE_CONTACT:
                out[k, 6] = -1.0
    kept = 0
    for k in range(found):
        if out[k, 6] > 0.0 and kept < CONTACTS:
            for a in range(FOUND):
                out[kept, a] = out[k, a]
            kept += 1
    return kept


@inner_kernel()
def find_contacts(row, p, reach, near, facets, out):
    """Contacts of a centre p [m, body frame] with the facets of its candidate `row`.

    Returns the number found; rows of out (CANDIDATES, FOUND), but for the slot's normal. Distances are to
    the surface, increased by its setback.
    """
    px, py, pz = p
    setback = facets.setback[0]
    was_active, was_normal = near.active[row], near.normal[row]
    found, nearest, behind, inner = 0, reach, -reach, (0.0, 0.0, 0.0, 0.0)
    for q in range(near.facet_start[row], near.facet_start[row + 1]):
        m = near.facet[q]
        qx, qy, qz, kind = closest_feature(px, py, pz, facets.corner[m])
        dx, dy, dz = qx - px, qy - py, qz - pz
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        if distance >= reach:
            continue
        nearest = min(nearest, distance)
        nx, ny, nz = facets.normal[m, 0], facets.normal[m, 1], facets.normal[m, 2]
        height = -(dx * nx + dy * ny + dz * nz)
        if kind == 0 or (height < 0.0 and distance + height < 1e-12):  # also behind the seam of a flat face
            nx, ny, nz, distance = -nx, -ny, -nz, height
        else:
            if distance == 0.0 or not _is_nearest(p, (dx, dy, dz), distance, facets, m, kind):
                continue
            nx, ny, nz = dx / distance, dy / distance, dz / distance
        if distance >= reach - setback:  # negative behind the face: contacts go on there to the full reach
            continue
        slot, best = -1, _SAME_NORMAL
        for s in range(CONTACTS):
            if was_active[s]:
                cosine = nx * was_normal[s, 0] + ny * was_normal[s, 1] + nz * was_normal[s, 2]
                if cosine > best:
                    slot, best = s, cosine
        if distance < 0.0 and slot < 0:  # seen from behind: another face holds this particle
            if distance > behind:
                behind = distance
                inner = nx, ny, nz, float(facets.group[m])
            continue
        if distance > 0.0 and len(facets.part) > 0:
            d, joined = (distance * nx, distance * ny, distance * nz), _JOINED * reach
            if _is_hidden(row, p, d, distance, joined, near, facets, m):
                continue
        place = found
        if found == CANDIDATES:  # in place of the shallowest
            place = 0
            for k in range(found):
                if out[k, 3] > out[place, 3]:
                    place = k
            if distance >= out[place, 3]:
                continue
        out[place, 0], out[place, 1], out[place, 2] = nx, ny, nz
        out[place, 3], out[place, 4], out[place, 5], out[place, 6] = distance, facets.group[m], slot, 0.0
        found = max(found, place + 1)
    kept = _one_of_each_direction(found, out)
    kept = _from_one_side(kept, out)
    if (
        behind > -reach and -behind < nearest + _ROUNDING_M
    ):  # inside the tool: past a sharp edge, if that held it
        for s in range(CONTACTS):
            if kept == 0 and was_active[s]:
                out[0, 0], out[0, 1], out[0, 2] = inner[0], inner[1], inner[2]
                out[0, 3], out[0, 4], out[0, 5], out[0, 6] = behind, inner[3], s, 1.0
                kept = 1
    for k in range(kept):
        out[k, 3] += setback
    return kept


@inner_kernel()
def _from_one_side(found, out):
    """Leaves out contacts that begin where another one has pressed the centre through a thin part; returns
    the number that is left."""
    kept = 0
    for k in range(found):
        pressed = False
        for other in range(found):
            cosine = out[k, 0] * out[other, 0] + out[k, 1] * out[other, 1] + out[k, 2] * out[other, 2]
            pressed |= out[other, 3] < 0.0 and cosine < -_SAME_NORMAL
        if out[k, 5] < 0.0 and pressed:
            continue
        for a in range(FOUND):
            out[kept, a] = out[k, a]
        kept += 1
    return kept
