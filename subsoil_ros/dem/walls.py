"""Plane walls of the bin: x = 0, far x, right y, left y, floor. The top is open.

Forces are computed as those of pairs (dem.pairs): in blocks, gathered, along the rows, scattered.
"""

import numpy as np
from numba import njit, prange

from ..contact_laws.base import SHARED_SINKS, ContactMotion, ContactState
from ..contact_laws.features import books_energy, is_unlike
from ..contact_laws.springs import like
from .blocks import BLOCK, ROW, history_place, scratch_rows
from .compiled import inner_kernel
from .contact import components, contact, numbers_at, put_state, reach, spring_energy, state_at
from .mixture import ContactModel, sphere_of
from .pairs import stored_energy

WALLS = ("near", "far", "right", "left", "floor")

CHUNKS = 16
"""Parts of the list that threads compute one by one."""

_GATHERED = 10
"""Scratch rows: distance of the centre, normal, linear and angular velocity. Results take their place: force,
torque."""


def wall_planes(
    lower: tuple[float, float, float], upper: tuple[float, float], sides: str = "walls"
) -> np.ndarray:
    """(5, 4) rows (nx, ny, nz, offset): normal towards the wall, n . x = offset on it [m].

    `sides` that are periodic are walls infinitely far away, as are all of an endless bed.
    """
    planes = np.array(
        [
            (-1.0, 0.0, 0.0, -lower[0]),
            (1.0, 0.0, 0.0, upper[0]),
            (0.0, -1.0, 0.0, -lower[1]),
            (0.0, 1.0, 0.0, upper[1]),
            (0.0, 0.0, -1.0, -lower[2]),
        ]
    )
    if sides == "periodic":
        planes[2:4, 3] = np.inf
    if sides == "endless":
        planes[:, 3] = np.inf
    return planes


def near_walls(position: np.ndarray, planes: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Particles whose centre is closer than `reach` [m] to a wall, and that wall: both (w,) int64.

    One entry for each pair, sorted by particle, then by wall.
    """
    near = np.flatnonzero(_near(position, planes, reach))
    return near // len(planes), near % len(planes)


@njit(cache=True, parallel=True)
def _near(position, planes, reach):
    near = np.empty((position.shape[0], planes.shape[0]), np.bool_)
    for i in prange(position.shape[0]):
        for wall in range(planes.shape[0]):
            gap = planes[wall, 3]
            for a in range(3):
                gap -= planes[wall, a] * position[i, a]
            near[i, wall] = gap < reach
    return near


@njit(cache=True)
def carry_walls(order, old_particle, old_wall, old_history, particle, wall, history, components):
    """Fills `history`, `components` numbers a pair, from the list before the particles were put in `order`,
    and with zeros for new pairs."""
    for k in range(particle.shape[0]):
        i, to = order[particle[k]], history_place(k, components)
        for a in range(components):
            history[to + a * BLOCK] = 0.0
        for m in range(np.searchsorted(old_particle, i), old_particle.shape[0]):
            if old_particle[m] != i:
                break
            if old_wall[m] == wall[k]:
                here = history_place(m, components)
                for a in range(components):
                    history[to + a * BLOCK] = old_history[here + a * BLOCK]


@inner_kernel()
def _gather(first, last, walls, planes, kinematics, model, rows_out):
    particle, wall, rows = walls.particle, walls.wall, rows_out
    position, velocity, angular_velocity = kinematics
    law, mixture, features, _ = model
    for k in range(first, last):
        b, i, plane = np.uint64(k - first), particle[k], planes[wall[k]]
        nx, ny, nz = plane[0], plane[1], plane[2]
        rows[0, b] = plane[3] - (nx * position[i, 0] + ny * position[i, 1] + nz * position[i, 2])
        rows[1, b], rows[2, b], rows[3, b] = nx, ny, nz
        for a in range(3):
            rows[4 + a, b] = velocity[i, a]
            rows[7 + a, b] = angular_velocity[i, a]
        if is_unlike(features):
            rows[10, b], of_particle = sphere_of(i, law, mixture, features)
            for a, number in enumerate(of_particle):
                rows[11 + a, b] = number


@inner_kernel(forceinline=True, fastmath={"contract"})
def contact_at_wall(distance, motion, radius, state, step, law, features):
    """Contact of a particle whose centre is `distance` [m] from a wall, in reach or not.

    motion: ContactMotion, with the velocity of the centre; the rest as in dem.pairs.
    Returns 1 if it is in reach, else 0; force [N], torque [N m], ContactState, sinks [J]; out of reach
    as in dem.pairs.contact_of_pair.
    """
    zero, half, one = like(step, 0.0), like(step, 0.5), like(step, 1.0)
    farthest = reach(radius, law, features)
    nx, ny, nz = motion.normal
    wx, wy, wz = motion.angular_velocity
    velocity = motion.velocity
    arm = half * (radius + distance)
    relative = (
        velocity[0] + arm * (wy * nz - wz * ny),
        velocity[1] + arm * (wz * nx - wx * nz),
        velocity[2] + arm * (wx * ny - wy * nx),
    )
    sliding = ContactMotion(motion.normal, relative, motion.angular_velocity)
    f, m, new, sinks = contact(radius - distance, sliding, state, step, law, features)
    acts = one if distance < farthest else zero
    fx, fy, fz = acts * f[0], acts * f[1], acts * f[2]
    lost = zero
    if books_energy(features):
        lost = (one - acts) * spring_energy(zero, state, law)
    return (
        acts,
        (fx, fy, fz),
        (
            arm * (ny * fz - nz * fy) + acts * m[0],
            arm * (nz * fx - nx * fz) + acts * m[1],
            arm * (nx * fy - ny * fx) + acts * m[2],
        ),
        ContactState(
            (acts * new.shear[0], acts * new.shear[1], acts * new.shear[2]),
            (acts * new.rolling[0], acts * new.rolling[1], acts * new.rolling[2]),
            new.own,
        ),
        (acts * sinks[0], acts * sinks[1], acts * sinks[2], acts * sinks[3], acts * sinks[4] + lost)  # noqa: RUF005
        + sinks[SHARED_SINKS:],
    )


@inner_kernel(fastmath={"contract"})
def _compute(count, scratch, history, common_radius, step, common_law, features, book_out):
    """Replaces the states of `count` pairs by their forces and torques, and updates their histories."""
    law, radius = common_law, common_radius
    for b in range(count):
        if is_unlike(features):
            radius = scratch[b + 10 * ROW]
            law = numbers_at(scratch, b + 11 * ROW, ROW, common_law)
        motion = ContactMotion(
            (scratch[b + ROW], scratch[b + 2 * ROW], scratch[b + 3 * ROW]),
            (scratch[b + 4 * ROW], scratch[b + 5 * ROW], scratch[b + 6 * ROW]),
            (scratch[b + 7 * ROW], scratch[b + 8 * ROW], scratch[b + 9 * ROW]),
        )
        acts, f, on_it, state, sinks = contact_at_wall(
            scratch[b], motion, radius, state_at(history, b, BLOCK, law), step, law, features
        )
        put_state(state, acts, history, b, BLOCK)
        scratch[b], scratch[b + ROW], scratch[b + 2 * ROW] = f
        scratch[b + 3 * ROW], scratch[b + 4 * ROW], scratch[b + 5 * ROW] = on_it
        if books_energy(features):
            for a in range(SHARED_SINKS):
                book_out[a] += sinks[a]
            for a in range(SHARED_SINKS, len(sinks)):
                book_out[a] += acts * sinks[a]


@inner_kernel()
def _part_forces(first, last, walls, planes, kinematics, model, loads_out, wall_force_out, book_out):
    """Pairs first <= k < last of the list. `book_out` (sinks,) gathers the sinks [J]."""
    law, mixture, features, step = model
    force, torque = loads_out
    count = _GATHERED
    if is_unlike(features):
        count += 1 + len(law)  # radius and law
    flat = scratch_rows(count, walls.history.dtype)
    rows = flat.reshape((count, ROW))
    start = first
    while start < last:
        stop = min(last, start - start % BLOCK + BLOCK)
        _gather(start, stop, walls, planes, kinematics, model, rows)
        own = walls.history[history_place(start, components(law)) :]
        _compute(stop - start, flat, own, mixture.common_radius, step, law, features, book_out)
        for k in range(start, stop):
            b, i = np.uint64(k - start), walls.particle[k]
            for a in range(3):
                force[i, a] += rows[a, b]
                torque[i, a] += rows[3 + a, b]
                wall_force_out[k, a] = rows[a, b]
        start = stop


@inner_kernel()
def _first_of_particle(k, particle):
    """The first pair of the particle of pair k, so that no particle is in two parts of the list."""
    while 0 < k < particle.shape[0] and particle[k] == particle[k - 1]:
        k -= 1
    return k


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def wall_forces(walls, planes, kinematics, law, mixture, features, step, loads_out, wall_force_out, book_out):
    """Adds the forces of the walls, and updates their histories. `wall_force_out` (w, 3) [N] receives that of
    each pair, `book_out` (CHUNKS, sinks) gathers the sinks [J]. law to step: ContactModel."""
    count = walls.particle.shape[0]
    for chunk in prange(CHUNKS):
        _part_forces(
            _first_of_particle(chunk * count // CHUNKS, walls.particle),
            _first_of_particle((chunk + 1) * count // CHUNKS, walls.particle),
            walls, planes, kinematics, ContactModel(law, mixture, features, step),
            loads_out, wall_force_out, book_out[chunk],
        )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def wall_scan(walls, planes, position, model):
    """Wall contacts in reach, largest overlap [m], stored energy [J]."""
    common_law, mixture, features, _ = model
    contacts, largest, energy = 0, 0.0, 0.0
    for k in range(walls.particle.shape[0]):
        i, plane = walls.particle[k], planes[walls.wall[k]]
        radius, law = sphere_of(i, common_law, mixture, features)
        overlap = radius - plane[3]
        for a in range(3):
            overlap += plane[a] * position[i, a]
        if overlap > -reach(0.0, law, features):
            contacts += 1
            largest = max(largest, overlap)
            normal, springs = stored_energy(overlap, walls.history, k, law, features)
            energy += normal
            energy += springs
    return contacts, largest, energy
