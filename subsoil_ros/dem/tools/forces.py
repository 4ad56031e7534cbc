"""Forces between particles and one tool.

A contact belongs to a feature of the surface: a face, an edge or a vertex, where the distance from the
particle's centre has a minimum. Of minima in nearly one direction the deepest counts, so a flat, convex or
smoothly concave place gives one contact however finely it is meshed, a concave corner one per face. Parts of
a tool that touch or overlap are one surface. Surfaces are one-sided: a contact starts only from outside, and
then stays on its face even when the centre is pressed through it, so a particle cannot flip to the far side
of a thin share; past a sharp edge it goes on at the nearest face. A particle that comes near the depth at
which its contact would end is told by an infinite overlap. Geometry and histories live in the tool's body
frame.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from ...contact_laws.base import SHARED_SINKS, ContactMotion, ContactState
from ...contact_laws.features import books_energy
from ..compiled import inner_kernel
from ..contact import contact, normal_potential, own_at, put_own, reach, spring_energy
from ..mixture import ContactModel, sphere_of
from .facets import closest_feature
from .motion import angular_velocity_of, centre_of, into_body, turned_in, turned_out, velocity_at

CONTACTS = 4
"""Contacts of one particle with one tool that are kept; a convex body gives at most three."""

_CHUNKS = 32
"""Fixed split of the candidates, whatever the number of threads."""

DEEPEST = SHARED_SINKS + 1
"""Place of the largest overlap among the sums of a tool."""

THROUGH = 0.9
"""Part of its radius by which a centre is behind a face when it counts as pressed through: at a radius the
contact would end, and a particle moves less than a tenth of it in a step."""

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


class ToolLoads(NamedTuple):
    """Load of the soil on a tool, about its centre of mass, world axes; a first axis more is of parts."""

    group_force: np.ndarray  # (groups, 3) [N]
    moment: np.ndarray  # (3,) [N m]
    sums: np.ndarray  # sinks of all laws [J], contacts, largest overlap [m], sinks of this law [J]


class Room(NamedTuple):
    """Room to work in, of one thread."""

    found: np.ndarray  # (CANDIDATES, FOUND)
    shear: np.ndarray  # (CONTACTS, 3), and the next: springs as they were
    rolling: np.ndarray  # (CONTACTS, 3 + own numbers of the law)


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
def _find_contacts(row, p, reach, near, facets, out):
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


@inner_kernel()
def _set_aside(row, near, room):
    """Moves the springs of a candidate to `room`; those of inactive contacts are zero there."""
    for s in range(CONTACTS):
        for a in range(3):
            room.shear[s, a] = near.shear[row, s, a] if near.active[row, s] else 0.0
        for a in range(near.rolling.shape[2]):
            room.rolling[s, a] = near.rolling[row, s, a] if near.active[row, s] else 0.0
        near.active[row, s] = False


@inner_kernel()
def _take_springs(slot, tool_motion, room, law):
    """ContactState of the contact that was in this slot, none if it is negative; the slot is then empty."""
    old_shear, old_rolling = room.shear, room.rolling
    sx, sy, sz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    own = own_at(old_rolling[max(slot, 0)], 3, 1, 1.0 if slot >= 0 else 0.0, law)
    if slot >= 0:
        sx, sy, sz = old_shear[slot, 0], old_shear[slot, 1], old_shear[slot, 2]
        tx, ty, tz = old_rolling[slot, 0], old_rolling[slot, 1], old_rolling[slot, 2]
        for a in range(3):  # a slot continues in one contact only
            old_shear[slot, a] = 0.0
        for a in range(old_rolling.shape[1]):
            old_rolling[slot, a] = 0.0
    return ContactState(turned_out(tool_motion, sx, sy, sz), turned_out(tool_motion, tx, ty, tz), own)


@njit(cache=True, nogil=True, error_model="numpy")
def row_forces(row, near, facets, tool_motion, kinematics, model, room, loads_out, load_out):
    """Adds the forces of the tool on candidate `row`, and their reaction on the tool."""
    position, velocity, angular_velocity = kinematics
    force, torque = loads_out
    group_force, moment, sums = load_out
    common_law, mixture, features, step = model
    i = near.particle[row]
    radius, law = sphere_of(i, common_law, mixture, features)
    place = into_body(tool_motion, position[i, 0], position[i, 1], position[i, 2])
    found = _find_contacts(row, place, reach(radius, law, features), near, facets, room.found)
    _set_aside(row, near, room)
    x0, y0, z0 = centre_of(tool_motion)
    ox, oy, oz = angular_velocity_of(tool_motion)
    for k in range(found):
        bx, by, bz, distance = room.found[k, 0], room.found[k, 1], room.found[k, 2], room.found[k, 3]
        group, slot = int(room.found[k, 4]), int(room.found[k, 5])
        nx, ny, nz = turned_out(tool_motion, bx, by, bz)

        # velocity at the contact point, which is at r from the body's centre of mass
        arm = 0.5 * (radius + distance)
        rx = position[i, 0] + arm * nx - x0
        ry = position[i, 1] + arm * ny - y0
        rz = position[i, 2] + arm * nz - z0
        wx, wy, wz = angular_velocity[i, 0], angular_velocity[i, 1], angular_velocity[i, 2]
        ux, uy, uz = velocity_at(tool_motion, rx, ry, rz)
        relative = (
            velocity[i, 0] + arm * (wy * nz - wz * ny) - ux,
            velocity[i, 1] + arm * (wz * nx - wx * nz) - uy,
            velocity[i, 2] + arm * (wx * ny - wy * nx) - uz,
        )
        motion = ContactMotion((nx, ny, nz), relative, (wx - ox, wy - oy, wz - oz))
        state = _take_springs(slot, tool_motion, room, law)
        f, m, state, sinks = contact(radius - distance, motion, state, step, law, features)

        # springs are kept in the tool's frame
        s, r = state.shear, state.rolling
        put_own(state.own, 1.0, near.rolling[row, k], 3, 1)
        near.active[row, k] = True
        near.normal[row, k, 0], near.normal[row, k, 1], near.normal[row, k, 2] = bx, by, bz
        near.shear[row, k, 0], near.shear[row, k, 1], near.shear[row, k, 2] = turned_in(
            tool_motion, s[0], s[1], s[2]
        )
        near.rolling[row, k, 0], near.rolling[row, k, 1], near.rolling[row, k, 2] = turned_in(
            tool_motion, r[0], r[1], r[2]
        )

        for a in range(3):
            force[i, a] += f[a]
            group_force[group, a] -= f[a]
        torque[i, 0] += arm * (ny * f[2] - nz * f[1]) + m[0]
        torque[i, 1] += arm * (nz * f[0] - nx * f[2]) + m[1]
        torque[i, 2] += arm * (nx * f[1] - ny * f[0]) + m[2]
        moment[0] -= ry * f[2] - rz * f[1] + m[0]
        moment[1] -= rz * f[0] - rx * f[2] + m[1]
        moment[2] -= rx * f[1] - ry * f[0] + m[2]
        sums[SHARED_SINKS] += 1.0
        through = distance - facets.setback[0] < -THROUGH * radius
        sums[DEEPEST] = max(sums[DEEPEST], math.inf if through else radius - distance)
        for a in range(SHARED_SINKS):
            sums[a] += sinks[a]
        for a in range(SHARED_SINKS, len(sinks)):
            sums[a + 2] += sinks[a]  # contacts and overlap lie between
    if books_energy(features):
        for s in range(CONTACTS):
            sums[4] += spring_energy(0.0, _springs_at(room.shear[s], room.rolling[s], law), law)


@inner_kernel(forceinline=True)
def _springs_at(shear, rolling, law):
    """ContactState from one contact's rows of arrays as in ToolList."""
    return ContactState(
        (shear[0], shear[1], shear[2]), (rolling[0], rolling[1], rolling[2]), own_at(rolling, 3, 1, 1.0, law)
    )


@inner_kernel()
def _rows_forces(first, last, near, facets, tool_motion, kinematics, model, loads_out, load_out):
    """Candidates first <= row < last; `load_out` is theirs alone."""
    own = near.rolling.shape[2]
    room = Room(np.empty((CANDIDATES, FOUND)), np.empty((CONTACTS, 3)), np.empty((CONTACTS, own)))
    load_out.group_force[:] = 0.0
    load_out.moment[:] = 0.0
    load_out.sums[:] = 0.0
    for row in range(first, last):
        row_forces(row, near, facets, tool_motion, kinematics, model, room, loads_out, load_out)


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def tool_forces(near, facets, kinematics, law, mixture, features, step, loads_out, parts_out, tool_motion):
    """Adds the forces of one tool on its candidate particles, and updates their springs.

    near: ToolList. law to step: ContactModel. tool_motion: see tools.motion. `parts_out` (ToolLoads) is
    filled chunk by chunk and summed in order.

    Returns the load of the soil on the tool: fields of ToolLoads.
    """
    count = near.particle.shape[0]
    for chunk in prange(_CHUNKS):
        load = ToolLoads(parts_out.group_force[chunk], parts_out.moment[chunk], parts_out.sums[chunk])
        _rows_forces(
            chunk * count // _CHUNKS, (chunk + 1) * count // _CHUNKS, near, facets, tool_motion, kinematics,
            ContactModel(law, mixture, features, step), loads_out, load,
        )  # fmt: skip
    group_force, moment, sums = parts_out
    by_group, torque, total = np.zeros(group_force.shape[1:]), np.zeros(3), np.zeros(sums.shape[1])
    for chunk in range(_CHUNKS):
        for group in range(by_group.shape[0]):
            for a in range(3):
                by_group[group, a] += group_force[chunk, group, a]
        for a in range(3):
            torque[a] += moment[chunk, a]
        for a in range(len(total)):
            total[a] = max(total[a], sums[chunk, a]) if a == DEEPEST else total[a] + sums[chunk, a]
    return by_group, torque, total


def parts_of_loads(groups: int, sinks: int) -> ToolLoads:
    """What tool_forces fills, a row for each part of the candidates."""
    return ToolLoads(np.zeros((_CHUNKS, groups, 3)), np.zeros((_CHUNKS, 3)), np.zeros((_CHUNKS, sinks + 2)))


@njit(cache=True, nogil=True, error_model="numpy")
def tool_scan(near, facets, tool_motion, position, model):
    """Stored energy of one tool's contacts [J]."""
    common_law, mixture, features, _ = model
    energy = 0.0
    out = np.empty((CANDIDATES, FOUND))
    for row in range(near.particle.shape[0]):
        i = near.particle[row]
        radius, law = sphere_of(i, common_law, mixture, features)
        place = into_body(tool_motion, position[i, 0], position[i, 1], position[i, 2])
        found = _find_contacts(row, place, reach(radius, law, features), near, facets, out)
        for k in range(found):  # in the order in which the last step stored them
            state = _springs_at(near.shear[row, k], near.rolling[row, k], law)
            energy += normal_potential(radius - out[k, 3], state, law, features)
            energy += spring_energy(radius - out[k, 3], state, law)
    return energy
