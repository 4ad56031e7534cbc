"""Forces between particles and one tool.

Where contacts are: contacts.py. A particle that comes near the depth at which its contact would end is told
by an infinite overlap. Geometry and histories live in the tool's body frame.
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
from .contacts import CANDIDATES, CONTACTS, FOUND, find_contacts
from .motion import angular_velocity_of, centre_of, into_body, turned_in, turned_out, velocity_at

_CHUNKS = 32
"""Fixed split of the candidates, whatever the number of threads."""

DEEPEST = SHARED_SINKS + 1
"""Place of the largest overlap among the sums of a tool."""

THROUGH = 0.9
"""Part of its radius by which a centre is behind a face when it counts as pressed through: at a radius the
contact would end, and a particle moves less than a tenth of it in a step."""


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
    found = find_contacts(row, place, reach(radius, law, features), near, facets, room.found)
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
        found = find_contacts(row, place, reach(radius, law, features), near, facets, out)
        for k in range(found):  # in the order in which the last step stored them
            state = _springs_at(near.shear[row, k], near.rolling[row, k], law)
            energy += normal_potential(radius - out[k, 3], state, law, features)
            energy += spring_energy(radius - out[k, 3], state, law)
    return energy
