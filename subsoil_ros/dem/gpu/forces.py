"""Kernels of a soil step on the GPU: drift, forces of pairs, walls and tools. Laws and contacts are those of
dem.contact, dem.pairs, dem.walls and dem.tools, compiled for the GPU when a kernel here is.

A thread gathers all forces on its particle in the order of its row, so no sum depends on timing. Each pair is
computed twice, with the same numbers in the same order, the particle of the lower number first, so that the
force on one is that on the other to the last bit, with opposite sign.

The kernels are controlled by `report`, (REPORT + results,) float64 on the device, whose first numbers are:
STEP, soil steps done so far; FAR, a particle left the reach of its lists in the drift of the present step;
HALTED, it did, and everything waits for new lists; OWES, the second half kick of the last step is still to
come; LOST, a particle's place is no longer a number.
"""

import functools
import math
from typing import Any

from numba import cuda, float64

from ...contact_laws.base import NO, YES, Features
from ...contact_laws.springs import like
from ..contact import normal_potential, numbers_like, reach, spring_energy
from ..integration import kicked, kicked_and_moved
from ..mixture import pair_of, sphere_of
from ..pairs import contact_of_pair
from ..per_particle import of_particle
from ..periodic import nearest_image
from ..tools.forces import CANDIDATES, CONTACTS, FOUND, row_forces
from ..walls import WALLS, contact_at_wall
from .device import THREADS, WARP
from .scan import block_largest, block_total

STEP, FAR, HALTED, OWES, LOST, REPORT = range(6)

_WALLS = len(WALLS)

TOOL_SUMS = 10
"""Columns of a tool's results after those of its groups: moment, sinks, contacts, largest overlap."""


@cuda.jit(cache=True)
def drift(report, position, velocity, spin, force, torque, built, held, mass, inertia, step, limit_squared):
    """dem.integration.kick_drift, forces left as they are; one half kick only if none is owed."""
    i = cuda.grid(1)
    if i < position.shape[0] and report[HALTED] == 0.0:
        owed = velocity.dtype.type(report[OWES])
        moved = kicked_and_moved(
            i, position, velocity, spin, force, torque, built, held, mass, inertia, step, owed
        )
        if not moved <= limit_squared:
            report[FAR] = 1.0
            if moved != moved:
                report[LOST] = 1.0


@cuda.jit(cache=True)
def kick_owed(report, velocity, spin, force, torque, held, mass, inertia, step):
    """The second half kick of the last step, if it is still to come; `kick_paid` follows."""
    i = cuda.grid(1)
    if i < velocity.shape[0] and report[OWES] == 1.0:
        kicked(i, velocity, spin, force, torque, held, mass, inertia, step)


@cuda.jit(cache=True)
def kick_paid(report):
    """Clears OWES: no half kick is left to make."""
    report[OWES] = 0.0


@cuda.jit(cache=True)
def damp(velocity, spin, kept):
    """Every velocity and spin times `kept`."""
    i = cuda.grid(1)
    if i < velocity.shape[0]:
        for a in range(3):
            velocity[i, a] *= kept
            spin[i, a] *= kept


@cuda.jit(cache=True)
def end_step(report):
    """Counts a step whose forces are computed, or halts."""
    if report[FAR] == 1.0:
        report[HALTED] = 1.0
    else:
        report[STEP] += 1.0
        report[OWES] = 1.0


@cuda.jit(cache=True)
def lists_are_new(report):
    """Lets the step that halted go on."""
    report[FAR] = report[HALTED] = 0.0


def without_period(features: Features) -> Features:
    """Features that kernels are compiled for: whether there is a period, not its length."""
    return features._replace(periodic=YES if features.periodic.ndim == 2 else NO)


def _compiled_once(factory: Any) -> Any:
    """One kernel for each set of features, whatever arrays stand for them."""
    made: Any = functools.cache(lambda kind, flags: factory(kind(*(YES if flag else NO for flag in flags))))
    return lambda features: made(type(features), tuple(feature.ndim == 2 for feature in features))


@_compiled_once
def pair_kernel(features: Features) -> Any:
    """The forces of all partners, and weight: dem.pairs.pair_forces."""

    @cuda.jit(cache=True)
    def pair_forces(
        report, count, slice_start, neighbour, history, position, velocity, spin, force, torque,
        mass, gravity, radius, step, common_law, mixture, period, book,
    ):  # fmt: skip
        i = cuda.grid(1)
        if i >= position.shape[0] or report[FAR] == 1.0:
            return
        zero = like(step, 0.0)
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        wx, wy, wz = spin[i, 0], spin[i, 1], spin[i, 2]
        fx, fy, fz = zero, zero, like(step, -of_particle(mass, i) * gravity)
        tx, ty, tz = zero, zero, zero
        law, radius_i, radius_j = common_law, radius, radius
        at = slice_start[i // WARP] + i % WARP
        for _ in range(count[i]):
            listed = neighbour[at]
            held = listed >= 0
            j = listed if held else ~listed
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            if features.periodic.ndim == 2:
                dy = nearest_image(dy, period)
            apart = like(step, dx), like(step, dy), like(step, dz)
            if features.sizes.ndim == 2 or features.materials.ndim == 2:
                first, second, own = pair_of(
                    min(i, j), max(i, j), float64(radius), common_law, mixture, features
                )
                radius_i, radius_j = like(step, first), like(step, second)
                law = numbers_like(step, own)
            farthest = reach(radius_i + radius_j, law, features)
            squared = apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2]
            if held or squared < farthest * farthest:
                relative = vx - velocity[j, 0], vy - velocity[j, 1], vz - velocity[j, 2]
                spin_i, spin_j = (wx, wy, wz), (spin[j, 0], spin[j, 1], spin[j, 2])
                shear, roll = (zero, zero, zero), (zero, zero, zero)
                if held:
                    if features.tangential.ndim == 2:
                        shear = history[0, at], history[1, at], history[2, at]
                    if features.rolling.ndim == 2:
                        roll = history[3, at], history[4, at], history[5, at]
                if j < i:
                    apart = -apart[0], -apart[1], -apart[2]
                    relative = -relative[0], -relative[1], -relative[2]
                    spin_i, spin_j = spin_j, spin_i
                acts, f, on_first, on_second, s, r, sinks, _ = contact_of_pair(
                    apart, relative, spin_i, spin_j, radius_i, radius_j, shear, roll, (), step, law, features
                )
                if acts > zero:
                    if features.tangential.ndim == 2:
                        history[0, at], history[1, at], history[2, at] = s
                    if features.rolling.ndim == 2:
                        history[3, at], history[4, at], history[5, at] = r
                    if not held:
                        neighbour[at] = j
                elif held:
                    neighbour[at] = ~j
                if i < j:
                    fx, fy, fz = fx + f[0], fy + f[1], fz + f[2]
                    tx, ty, tz = tx + on_first[0], ty + on_first[1], tz + on_first[2]
                    if features.book.ndim == 2:
                        for a in range(len(sinks)):
                            book[i, a] += sinks[a]
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
    def wall_forces(
        report, sizes, k, particle, held, springs, planes, position, velocity, spin, force, torque,
        common_radius, step, common_law, mixture, wall_force, book,
    ):  # fmt: skip
        row = cuda.grid(1)
        if row >= sizes[k] or row >= particle.shape[0] or report[FAR] == 1.0:
            return
        i = particle[row]
        radius, law = sphere_of(i, common_radius, common_law, mixture, features)
        farthest = reach(radius, law, features)
        touching = 0
        for wall in range(_WALLS):
            nx, ny, nz = planes[wall, 0], planes[wall, 1], planes[wall, 2]
            distance = planes[wall, 3] - (nx * position[i, 0] + ny * position[i, 1] + nz * position[i, 2])
            was = (held[row] >> wall) & 1 == 1
            c = 6 * wall
            fx, fy, fz = 0.0, 0.0, 0.0
            if was or distance < farthest:
                shear, roll = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
                if was:
                    shear = springs[c, row], springs[c + 1, row], springs[c + 2, row]
                    roll = springs[c + 3, row], springs[c + 4, row], springs[c + 5, row]
                acts, f, on_it, s, r, sinks, _ = contact_at_wall(
                    distance,
                    (nx, ny, nz),
                    (float64(velocity[i, 0]), float64(velocity[i, 1]), float64(velocity[i, 2])),
                    (float64(spin[i, 0]), float64(spin[i, 1]), float64(spin[i, 2])),
                    radius,
                    shear,
                    roll,
                    (),
                    step,
                    law,
                    features,
                )
                if acts > 0.0:
                    touching |= 1 << wall
                    springs[c, row], springs[c + 1, row], springs[c + 2, row] = s
                    springs[c + 3, row], springs[c + 4, row], springs[c + 5, row] = r
                fx, fy, fz = f
                for a in range(3):
                    force[i, a] += f[a]
                    torque[i, a] += on_it[a]
                if features.book.ndim == 2:
                    for a in range(len(sinks)):
                        book[i, a] += sinks[a]
            wall_force[3 * wall, row], wall_force[3 * wall + 1, row] = fx, fy
            wall_force[3 * wall + 2, row] = fz
        held[row] = touching

    return wall_forces


@_compiled_once
def tool_kernel(features: Features) -> Any:
    """Adds the forces of one tool, a thread for each candidate: dem.tools.forces.tool_forces.

    The load of each candidate on the tool goes into group_force (groups, 3, rows), moment (3, rows) and sums
    (7, rows).
    """

    @cuda.jit(cache=True)
    def tool_forces(
        report, sizes, k, motions, tool, particle, facet_start, facet, facets, position, velocity, spin,
        force, torque, active, normal, shear, roll, radius, step, law, mixture, group_force, moment, sums,
    ):  # fmt: skip
        row = cuda.grid(1)
        if row >= sizes[k] or row >= particle.shape[0] or report[FAR] == 1.0:
            return
        out = cuda.local.array((CANDIDATES, FOUND), float64)
        old_shear = cuda.local.array((CONTACTS, 3), float64)
        old_roll = cuda.local.array((CONTACTS, 3), float64)
        for a in range(3):
            moment[a, row] = 0.0
            for group in range(group_force.shape[0]):
                group_force[group, a, row] = 0.0
        for a in range(7):
            sums[a, row] = 0.0
        at = motions[int(report[STEP]) % motions.shape[0], tool]
        motion = (at[0], at[1], at[2], at[3], at[4], at[5], at[6], at[7])
        row_forces(
            row, particle, facet_start, facet, facets, motion, position, velocity, spin, force, torque,
            active, normal, shear, roll, radius, step, law, mixture, features,
            out, old_shear, old_roll, group_force[:, :, row], moment[:, row], sums[:, row],
        )  # fmt: skip

    return tool_forces


@cuda.jit(cache=True)
def add_up_tool(report, sizes, k, group_force, moment, sums, first_result, per_step, slots):
    """Adds up column blockIdx.x of a tool's load in the present step, into its place among the results."""
    if report[FAR] == 1.0:
        return
    shared = cuda.shared.array(THREADS, float64)
    column, of_groups = cuda.blockIdx.x, 3 * group_force.shape[0]
    rows = min(sizes[k], moment.shape[1])
    last = of_groups + TOOL_SUMS - 1
    total = 0.0
    for row in range(cuda.threadIdx.x, rows, THREADS):
        if column < of_groups:
            total += group_force[column // 3, column % 3, row]
        elif column < of_groups + 3:
            total += moment[column - of_groups, row]
        elif column < last:
            total += sums[column - of_groups - 3, row]
        else:
            total = max(total, sums[column - of_groups - 3, row])
    total = block_total(total, shared) if column < last else block_largest(total, shared)
    if cuda.threadIdx.x == 0:
        report[REPORT + int(report[STEP]) % slots * per_step + first_result + column] = total


@cuda.jit(cache=True)
def look_at_particles(
    position, velocity, spin, force, torque, mass, inertia, step, planes, radius, ceiling, partial
):
    """Sums over particles, block by block, into `partial` (SUM_BLOCKS, 8): those of monitors.MotionSums, the
    kinetic energy [J], m z [kg m], and the particles outside the domain."""
    shared = cuda.shared.array(THREADS, float64)
    v2, a2, w2, t2, place, kinetic, height, outside = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(cuda.grid(1), position.shape[0], cuda.gridsize(1)):
        m, inert = of_particle(mass, i), of_particle(inertia, i)
        by_force, by_torque = 0.5 * step / m, 0.5 * step / inert
        speed2, spin2 = 0.0, 0.0
        for a in range(3):
            v, w = float64(velocity[i, a]), float64(spin[i, a])
            f, t = by_force * force[i, a], by_torque * torque[i, a]
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
            partial[cuda.blockIdx.x, c] = total


@_compiled_once
def look_at_pairs_kernel(features: Features) -> Any:
    """Contacts in reach, largest overlap [m] and stored energy [J], block by block."""

    @cuda.jit(cache=True)
    def look_at_pairs(
        count, slice_start, neighbour, history, position, common_radius, common_law, mixture, period, partial
    ):
        shared = cuda.shared.array(THREADS, float64)
        contacts, largest, energy = 0.0, 0.0, 0.0
        for i in range(cuda.grid(1), position.shape[0], cuda.gridsize(1)):
            at = slice_start[i // WARP] + i % WARP
            for _ in range(count[i]):
                listed = neighbour[at]
                j = listed if listed >= 0 else ~listed
                if i < j:
                    dy = position[j, 1] - position[i, 1]
                    if features.periodic.ndim == 2:
                        dy = nearest_image(dy, period)
                    dx, dz = position[j, 0] - position[i, 0], position[j, 2] - position[i, 2]
                    first, second, law = pair_of(i, j, common_radius, common_law, mixture, features)
                    overlap = first + second - math.sqrt(dx * dx + dy * dy + dz * dz)
                    largest = max(largest, overlap)
                    if overlap > -reach(0.0, law, features):
                        contacts += 1.0
                        energy += normal_potential(overlap, (), law, features)
                        if listed >= 0:
                            shear = (
                                float64(history[0, at]), float64(history[1, at]), float64(history[2, at])
                            )  # fmt: skip
                            roll = (
                                float64(history[3, at]), float64(history[4, at]), float64(history[5, at])
                            )  # fmt: skip
                            energy += spring_energy(overlap, shear, roll, law)
                at += WARP
        contacts = block_total(contacts, shared)
        energy = block_total(energy, shared)
        largest = block_largest(largest, shared)
        if cuda.threadIdx.x == 0:
            partial[cuda.blockIdx.x, 0] = contacts
            partial[cuda.blockIdx.x, 1] = largest
            partial[cuda.blockIdx.x, 2] = energy

    return look_at_pairs
