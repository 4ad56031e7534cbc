"""Forces between particles and one tool.

A contact belongs to a feature of the surface: a face, a convex edge or a vertex. A feature counts when
it is the nearest one on every facet that shares it, so a flat or convex place gives one contact however
finely it is meshed, a concave corner one per face. Surfaces are one-sided: a contact starts only from
outside, and then stays on its face even when the centre is pressed through it, so a particle cannot flip
to the far side of a thin share. Geometry and histories live in the tool's body frame.
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

FOUND = 6
"""Numbers of a contact that was found: unit normal towards the tool, distance [m] (negative: centre behind
the face), group, history slot or -1."""

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

    found: np.ndarray  # (CONTACTS, FOUND)
    shear: np.ndarray  # (CONTACTS, 3), and the next: springs as they were
    rolling: np.ndarray  # (CONTACTS, 3 + own numbers of the law)


@inner_kernel()
def _is_nearest(px, py, pz, dx, dy, dz, facets, m, kind):
    """Whether edge or vertex `kind` of facet m is nearest to p on every facet that shares it, m being the
    first of these and p outside of one at least. d [m]: from p to the nearest point.

    Winding is consistent, so the facets across one edge after another lead around a vertex, or back.
    """
    corner = (kind - 1) % 3
    number = facets.edge[m, corner] if kind < 4 else facets.vertex[m, corner]
    outside, other = False, m
    while True:
        nx, ny, nz = facets.normal[other, 0], facets.normal[other, 1], facets.normal[other, 2]
        if dx * nx + dy * ny + dz * nz <= 0.0:
            outside = True
        other = facets.opposite[other, corner]
        if other == m:
            return outside
        if other < m:
            return False
        _, _, _, feature = closest_feature(px, py, pz, facets.corner[other])
        if feature == 0 or (feature < 4) != (kind < 4):
            return False
        corner = (feature - 1) % 3
        if number != (facets.edge[other, corner] if kind < 4 else facets.vertex[other, corner]):
            return False


@inner_kernel()
def _find_contacts(row, place, reach, near, facets, out):
    """Contacts of a centre at `place` [m, body frame] with the facets of its candidate `row`.

    Returns the number found; rows of out (CONTACTS, FOUND), but for the slot's normal.
    """
    px, py, pz = place
    was_active, was_normal = near.active[row], near.normal[row]
    found = 0
    for q in range(near.facet_start[row], near.facet_start[row + 1]):
        m = near.facet[q]
        qx, qy, qz, kind = closest_feature(px, py, pz, facets.corner[m])
        dx, dy, dz = qx - px, qy - py, qz - pz
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        if distance >= reach:
            continue
        nx, ny, nz = facets.normal[m, 0], facets.normal[m, 1], facets.normal[m, 2]
        height = -(dx * nx + dy * ny + dz * nz)
        if kind == 0 or (height < 0.0 and distance + height < 1e-12):  # also behind the seam of a flat face
            nx, ny, nz, distance = -nx, -ny, -nz, height
        else:
            if distance == 0.0 or not _is_nearest(px, py, pz, dx, dy, dz, facets, m, kind):
                continue
            nx, ny, nz = dx / distance, dy / distance, dz / distance
        slot, best = -1, _SAME_NORMAL
        for s in range(CONTACTS):
            if was_active[s]:
                cosine = nx * was_normal[s, 0] + ny * was_normal[s, 1] + nz * was_normal[s, 2]
                if cosine > best:
                    slot, best = s, cosine
        if distance < 0.0 and slot < 0:
            continue  # seen from behind: another face holds this particle
        same = False
        for k in range(found):  # two facets of one plane, both with the nearest point
            if (
                nx * out[k, 0] + ny * out[k, 1] + nz * out[k, 2] > 1.0 - 1e-9
                and abs(distance - out[k, 3]) < 1e-12
            ):
                same = True
        if same or found == CONTACTS:
            continue
        out[found, 0], out[found, 1], out[found, 2] = nx, ny, nz
        out[found, 3], out[found, 4], out[found, 5] = distance, facets.group[m], slot
        found += 1
    return found


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
        sums[DEEPEST] = max(sums[DEEPEST], radius - distance)
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
    room = Room(np.empty((CONTACTS, FOUND)), np.empty((CONTACTS, 3)), np.empty((CONTACTS, own)))
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
    out = np.empty((CONTACTS, FOUND))
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
