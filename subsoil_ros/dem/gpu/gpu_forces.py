"""Kernels of a soil step on the GPU: drift, forces of pairs, walls and tools. Laws and contacts are those of
dem.contact, dem.pairs, dem.walls and dem.tools, compiled for the GPU when a kernel here is.

A thread gathers all forces on its particle in the order of its row, so no sum depends on timing. Each pair is
computed twice, with the same numbers in the same order, the particle of the lower number first, so that the
force on one is that on the other to the last bit, with opposite sign.

The kernels are controlled by `report`, (REPORT + results,) float64 on the device, whose first numbers are:
STEP, soil steps done so far; FAR, a particle left the reach of its lists in the drift of the present step;
HALTED, it did, and everything waits for new lists; PENDING, the second half kick of the last step is still to
come; LOST, a particle's place is no longer a number.

Kernels write to arguments that end in _out, to the histories in lists, and to `report`.
"""

import functools
import math
from collections.abc import Hashable
from typing import Any, NamedTuple

from numba import cuda, float64

from ...contact_laws.base import NO, SHARED_SINKS, SPRINGS, YES, ContactMotion, ContactState, Features
from ...contact_laws.features import books_energy, has_rolling, has_tangential, is_periodic, is_unlike
from ...contact_laws.springs import like
from ..bonds.kernel import bond_of_pair, shape_at
from ..contact import (
    components,
    normal_potential,
    numbers_like,
    own_at,
    put_own,
    put_state,
    reach,
    spring_energy,
    state_at,
)
from ..integration import kicked, kicked_and_moved
from ..mixture import ContactModel, pair_of, sphere_of
from ..pairs import contact_of_pair
from ..per_particle import of_particle
from ..periodic import nearest_image
from ..tools.contacts import CANDIDATES, CONTACTS, FOUND
from ..tools.forces import DEEPEST, Room, ToolLoads, row_forces
from ..tools.motion import motion_at
from ..walls import WALLS, contact_at_wall
from .device import THREADS, WARP
from .scan import block_largest, block_total

STEP, FAR, HALTED, PENDING, LOST, REPORT = range(6)

_WALLS = len(WALLS)


class World(NamedTuple):
    """What all particles have in common."""

    gravity: float  # [m/s2]
    period: float  # in y [m]; infinite without
    step: float  # [s]


@cuda.jit(cache=True)
def drift(report, kinematics_out, loads_out, masses, built, held, step, limit_squared):
    """dem.integration.kick_drift, forces left as they are; one half kick only if none is pending."""
    i = cuda.grid(1)
    if i < held.shape[0] and report[HALTED] == 0.0:
        pending = kinematics_out.velocity.dtype.type(report[PENDING])
        moved = kicked_and_moved(i, kinematics_out, loads_out, masses, built, held, step, pending)
        if not moved <= limit_squared:
            report[FAR] = 1.0
            if moved != moved:
                report[LOST] = 1.0


@cuda.jit(cache=True)
def kick_pending(report, kinematics_out, loads_out, masses, held, step):
    """The second half kick of the last step, if it is still to come; `note_kick` follows."""
    i = cuda.grid(1)
    if i < held.shape[0] and report[PENDING] == 1.0:
        kicked(i, kinematics_out, loads_out, masses, held, step)


@cuda.jit(cache=True)
def note_kick(report):
    """Clears PENDING: no half kick is left to make."""
    report[PENDING] = 0.0


@cuda.jit(cache=True)
def damp(kinematics_out, kept):
    """Every linear and angular velocity times `kept`."""
    _, velocity, angular_velocity = kinematics_out
    i = cuda.grid(1)
    if i < velocity.shape[0]:
        for a in range(3):
            velocity[i, a] *= kept
            angular_velocity[i, a] *= kept


@cuda.jit(cache=True)
def end_step(report):
    """Counts a step whose forces are computed, or halts."""
    if report[FAR] == 1.0:
        report[HALTED] = 1.0
    else:
        report[STEP] += 1.0
        report[PENDING] = 1.0


@cuda.jit(cache=True)
def note_new_lists(report):
    """Lets the step that halted go on."""
    report[FAR] = report[HALTED] = 0.0


def without_period(features: Features) -> Features:
    """Features that kernels are compiled for: whether there is a period, not its length."""
    return features._replace(periodic=YES if is_periodic(features) else NO)


def _compiled_once(factory: Any) -> Any:
    """One kernel for each set of features, whatever arrays stand for them, and each further argument."""

    @functools.cache
    def made(kind: Any, flags: tuple[bool, ...], *more: Hashable) -> Any:
        return factory(kind(*(YES if flag else NO for flag in flags)), *more)

    def kernel(features: Any, *more: Hashable) -> Any:
        kind: Any = type(features)
        return made(kind, tuple(part.ndim == 2 for part in features), *more)

    return kernel


@_compiled_once
def pair_kernel(features: Features, bonded: bool) -> Any:
    """The forces of all partners, and weight: dem.pairs.pair_forces.

    The numbers of a bond stand in the histories behind those of the contact; `bonds` has those in common, and
    its book (n, 2).
    """

    @cuda.jit(cache=True)
    def pair_forces(report, rows, bonds, kinematics, masses, law, mixture, world, loads_out, book_out):
        i = cuda.grid(1)
        if i >= kinematics.position.shape[0] or report[FAR] == 1.0:
            return
        count, slice_start, neighbour, history = rows
        position, velocity, angular_velocity = kinematics
        force, torque = loads_out
        common_law, step = law, world.step
        zero, one = like(step, 0.0), like(step, 1.0)
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        wx, wy, wz = angular_velocity[i, 0], angular_velocity[i, 1], angular_velocity[i, 2]
        fx, fy, fz = zero, zero, like(step, -of_particle(masses.mass, i) * world.gravity)
        tx, ty, tz = zero, zero, zero
        radius_i, radius_j = mixture.common_radius, mixture.common_radius
        at = slice_start[i // WARP] + i % WARP
        for _ in range(count[i]):
            listed = neighbour[at]
            active = listed >= 0
            j = listed if active else ~listed
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            if is_periodic(features):
                dy = nearest_image(dy, world.period)
            apart = like(step, dx), like(step, dy), like(step, dz)
            if is_unlike(features):
                first, second, own = pair_of(min(i, j), max(i, j), common_law, mixture, features)
                radius_i, radius_j = like(step, first), like(step, second)
                law = numbers_like(step, own)
            farthest = reach(radius_i + radius_j, law, features)
            squared = apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2]
            length = zero
            if bonded:
                length = history[components(law), at]
            if active or length > zero or squared < farthest * farthest:
                # the contact as the particle of the lower number sees it
                relative = vx - velocity[j, 0], vy - velocity[j, 1], vz - velocity[j, 2]
                here, there = (
                    (wx, wy, wz),
                    (angular_velocity[j, 0], angular_velocity[j, 1], angular_velocity[j, 2]),
                )
                angular_velocities = here, there
                if j < i:
                    apart = -apart[0], -apart[1], -apart[2]
                    relative = -relative[0], -relative[1], -relative[2]
                    angular_velocities = there, here
                column = history[:, at]
                shear, rolling = (zero, zero, zero), (zero, zero, zero)
                if active:
                    if has_tangential(features):
                        shear = column[0], column[1], column[2]
                    if has_rolling(features):
                        rolling = column[3], column[4], column[5]
                state = ContactState(shear, rolling, own_at(column, SPRINGS, 1, one if active else zero, law))
                acts, f, on_first, on_second, state, sinks = contact_of_pair(
                    apart, relative, angular_velocities, (radius_i, radius_j), state, step, law, features
                )
                if acts > zero:
                    if has_tangential(features):
                        column[0], column[1], column[2] = state.shear
                    if has_rolling(features):
                        column[3], column[4], column[5] = state.rolling
                    put_own(state.own, one, column, SPRINGS, 1)
                    if not active:
                        neighbour[at] = j
                elif active:
                    neighbour[at] = ~j

                if bonded and length > zero:
                    b = components(law)
                    slip = column[b + 1], column[b + 2], column[b + 3]
                    turn = column[b + 4], column[b + 5], column[b + 6]
                    whole, g, more_first, more_second, slip, turn, stored, lost = bond_of_pair(
                        apart, relative, angular_velocities, shape_at(column, b, 1, bonds, features), one,
                        slip, turn, step, bonds,
                    )  # fmt: skip
                    column[b] = length if whole > zero else -length
                    column[b + 1], column[b + 2], column[b + 3] = slip
                    column[b + 4], column[b + 5], column[b + 6] = turn
                    f = f[0] + g[0], f[1] + g[1], f[2] + g[2]
                    on_first = (
                        on_first[0] + more_first[0],
                        on_first[1] + more_first[1],
                        on_first[2] + more_first[2],
                    )
                    on_second = (
                        on_second[0] + more_second[0],
                        on_second[1] + more_second[1],
                        on_second[2] + more_second[2],
                    )
                    if books_energy(features) and i < j:
                        bonds.book[i, 0] += step * lost
                        bonds.book[i, 1] += (one - whole) * stored

                if i < j:
                    fx, fy, fz = fx + f[0], fy + f[1], fz + f[2]
                    tx, ty, tz = tx + on_first[0], ty + on_first[1], tz + on_first[2]
                    if books_energy(features):
                        for a in range(SHARED_SINKS):
                            book_out[i, a] += sinks[a]
                        for a in range(SHARED_SINKS, len(sinks)):
                            book_out[i, a] += acts * sinks[a]
                else:
                    fx, fy, fz = fx - f[0], fy - f[1], fz - f[2]
                    tx, ty, tz = tx + on_second[0], ty + on_second[1], tz + on_second[2]
            at += WARP
        force[i, 0], force[i, 1], force[i, 2] = fx, fy, fz
        torque[i, 0], torque[i, 1], torque[i, 2] = tx, ty, tz

    return pair_forces


@_compiled_once
def wall_kernel(features: Features) -> Any:
    """Adds the forces of the walls, a thread for each particle near one: dem.walls.wall_forces."""

    @cuda.jit(cache=True)
    def wall_forces(report, size, near, planes, kinematics, law, mixture, step, loads_out, book_out):
        row = cuda.grid(1)
        if row >= size[0] or row >= near.particle.shape[0] or report[FAR] == 1.0:
            return
        position, velocity, angular_velocity = kinematics
        force, torque = loads_out
        i, springs = near.particle[row], near.springs[:, row]
        radius, law = sphere_of(i, law, mixture, features)
        farthest = reach(radius, law, features)
        moving = float64(velocity[i, 0]), float64(velocity[i, 1]), float64(velocity[i, 2])
        turning = (
            float64(angular_velocity[i, 0]),
            float64(angular_velocity[i, 1]),
            float64(angular_velocity[i, 2]),
        )
        touching = 0
        for wall in range(_WALLS):
            nx, ny, nz = planes[wall, 0], planes[wall, 1], planes[wall, 2]
            distance = planes[wall, 3] - (nx * position[i, 0] + ny * position[i, 1] + nz * position[i, 2])
            was = (near.active[row] >> wall) & 1 == 1
            first = components(law) * wall
            fx, fy, fz = 0.0, 0.0, 0.0
            if was or distance < farthest:
                if not was:
                    for a in range(components(law)):
                        springs[first + a] = 0.0
                motion = ContactMotion((nx, ny, nz), moving, turning)
                state = state_at(springs, first, 1, law)
                acts, f, on_it, state, sinks = contact_at_wall(
                    distance, motion, radius, state, step, law, features
                )
                if acts > 0.0:
                    touching |= 1 << wall
                    put_state(state, acts, springs, first, 1)
                fx, fy, fz = f
                for a in range(3):
                    force[i, a] += f[a]
                    torque[i, a] += on_it[a]
                if books_energy(features):
                    for a in range(SHARED_SINKS):
                        book_out[i, a] += sinks[a]
                    for a in range(SHARED_SINKS, len(sinks)):
                        book_out[i, a] += acts * sinks[a]
            near.force[3 * wall, row], near.force[3 * wall + 1, row] = fx, fy
            near.force[3 * wall + 2, row] = fz
        near.active[row] = touching

    return wall_forces


@_compiled_once
def tool_kernel(features: Features, rolling_numbers: int) -> Any:
    """Adds the forces of one tool, a thread for each candidate: dem.tools.forces.tool_forces.

    The load of each candidate on the tool goes into load_out, the candidates along its last axis.
    rolling_numbers: of a contact in ToolList.rolling.
    """

    @cuda.jit(cache=True)
    def tool_forces(report, size, motions, near, facets, kinematics, law, mixture, step, loads_out, load_out):
        row = cuda.grid(1)
        if row >= size[0] or row >= near.particle.shape[0] or report[FAR] == 1.0:
            return
        room = Room(
            cuda.local.array((CANDIDATES, FOUND), float64),
            cuda.local.array((CONTACTS, 3), float64),
            cuda.local.array((CONTACTS, rolling_numbers), float64),
        )
        load = ToolLoads(load_out.group_force[:, :, row], load_out.moment[:, row], load_out.sums[:, row])
        for a in range(3):
            load.moment[a] = 0.0
            for group in range(load.group_force.shape[0]):
                load.group_force[group, a] = 0.0
        for a in range(load.sums.shape[0]):
            load.sums[a] = 0.0
        motion = motion_at(motions[int(report[STEP]) % motions.shape[0]])
        model = ContactModel(law, mixture, features, step)
        row_forces(row, near, facets, motion, kinematics, model, room, loads_out, load)

    return tool_forces


@cuda.jit(cache=True)
def add_up_tool(report, size, load, first_result, per_step, slots):
    """Adds up column blockIdx.x of a tool's load in the present step, into its place among the results."""
    if report[FAR] == 1.0:
        return
    shared = cuda.shared.array(THREADS, float64)
    column, of_groups = cuda.blockIdx.x, 3 * load.group_force.shape[0]
    rows = min(size[0], load.moment.shape[1])
    deepest = of_groups + 3 + DEEPEST
    total = 0.0
    for row in range(cuda.threadIdx.x, rows, THREADS):
        if column < of_groups:
            total += load.group_force[column // 3, column % 3, row]
        elif column < of_groups + 3:
            total += load.moment[column - of_groups, row]
        elif column != deepest:
            total += load.sums[column - of_groups - 3, row]
        else:
            total = max(total, load.sums[column - of_groups - 3, row])
    total = block_total(total, shared) if column != deepest else block_largest(total, shared)
    if cuda.threadIdx.x == 0:
        report[REPORT + int(report[STEP]) % slots * per_step + first_result + column] = total


@cuda.jit(cache=True)
def reduce_particles(kinematics, loads, masses, step, planes, radius, ceiling, partial_out):
    """Sums over particles, block by block, (SUM_BLOCKS, 8): those of monitors.MotionSums, the kinetic energy
    [J], m z [kg m], and the particles outside the domain."""
    shared = cuda.shared.array(THREADS, float64)
    position, velocity, angular_velocity = kinematics
    v2, a2, w2, t2, place, kinetic, height, outside = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(cuda.grid(1), position.shape[0], cuda.gridsize(1)):
        m, inert = of_particle(masses.mass, i), of_particle(masses.inertia, i)
        by_force, by_torque = 0.5 * step / m, 0.5 * step / inert
        speed2, spin2 = 0.0, 0.0
        for a in range(3):
            v, w = float64(velocity[i, a]), float64(angular_velocity[i, a])
            f, t = by_force * loads.force[i, a], by_torque * loads.torque[i, a]
            speed2 += v * v
            spin2 += w * w
            a2 += f * f
            t2 += t * t
            place += position[i, a]
        v2 += speed2
        w2 += spin2
        kinetic += 0.5 * (m * speed2 + inert * spin2)
        height += m * position[i, 2]
        out = position[i, 2] > ceiling
        for k in range(_WALLS):
            gap = planes[k, 3]
            for a in range(3):
                gap -= planes[k, a] * position[i, a]
            out = out or gap < -of_particle(radius, i)
        outside += 1.0 if out else 0.0
    columns = v2, a2, w2, t2, place, kinetic, height, outside
    for c in range(8):
        total = block_total(columns[c], shared)
        if cuda.threadIdx.x == 0:
            partial_out[cuda.blockIdx.x, c] = total


@_compiled_once
def reduce_pairs_kernel(features: Features) -> Any:
    """Contacts in reach, largest overlap [m] and stored energy [J], bonds apart, block by block."""

    @cuda.jit(cache=True)
    def reduce_pairs(rows, position, common_law, mixture, period, partial_out):
        shared = cuda.shared.array(THREADS, float64)
        contacts, largest, energy = 0.0, 0.0, 0.0
        for i in range(cuda.grid(1), position.shape[0], cuda.gridsize(1)):
            at = rows.slice_start[i // WARP] + i % WARP
            for _ in range(rows.count[i]):
                listed = rows.neighbour[at]
                j = listed if listed >= 0 else ~listed
                if i < j:
                    dy = position[j, 1] - position[i, 1]
                    if is_periodic(features):
                        dy = nearest_image(dy, period)
                    dx, dz = position[j, 0] - position[i, 0], position[j, 2] - position[i, 2]
                    first, second, law = pair_of(i, j, common_law, mixture, features)
                    overlap = first + second - math.sqrt(dx * dx + dy * dy + dz * dz)
                    largest = max(largest, overlap)
                    if overlap > -reach(0.0, law, features):
                        contacts += 1.0
                        column = rows.history[:, at]
                        kept = 1.0 if listed >= 0 else 0.0
                        state = ContactState(
                            (kept * column[0], kept * column[1], kept * column[2]),
                            (kept * column[3], kept * column[4], kept * column[5]),
                            own_at(column, SPRINGS, 1, kept, law),
                        )
                        energy += normal_potential(overlap, state, law, features)
                        energy += spring_energy(overlap, state, law)
                at += WARP
        contacts = block_total(contacts, shared)
        energy = block_total(energy, shared)
        largest = block_largest(largest, shared)
        if cuda.threadIdx.x == 0:
            partial_out[cuda.blockIdx.x, 0] = contacts
            partial_out[cuda.blockIdx.x, 1] = largest
            partial_out[cuda.blockIdx.x, 2] = energy

    return reduce_pairs
