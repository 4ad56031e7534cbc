"""Forces between particles, over the half list, slab by slab.

The pairs of a slab are taken in blocks. Of each block the particles' states are gathered into scratch
rows, eight pairs at a time (dem.vectors), the law is computed along the rows, where the compiler makes vector
instructions of it, and the results are scattered to the particles in the order of the list. Histories live in
blocks too, so that no copy is needed (dem.blocks).
"""

import math

import numpy as np
from numba import njit, prange

from ..contact_laws.base import SHARED_SINKS, ContactMotion, ContactState
from ..contact_laws.features import (
    books_energy,
    has_materials,
    has_sizes,
    is_endless,
    is_periodic,
    is_unlike,
)
from ..contact_laws.inverse_root import inverse_root
from ..contact_laws.springs import like
from .blocks import BLOCK, ROW, history_place, scratch_rows
from .bonds.kernel import add_bonds, bond_rows, put_bonds
from .compiled import inner_kernel
from .contact import (
    at_size,
    components,
    contact,
    normal_potential,
    numbers_at,
    numbers_like,
    put_state,
    reach,
    spring_energy,
    state_at,
)
from .mixture import ContactModel, pair_of
from .per_particle import PARTS, added_up
from .periodic import nearest_images
from .vectors import LANES, add_eight, eight_zeros, load_eight, opposite, seen_from, store_eight, transposed

_GATHERED = 12
"""Scratch rows: x_j - x_i, v_i - v_j, w_i, w_j. Results take their place: force on i, torque on i, on j."""

_RESULTS = 2 * LANES
"""Numbers of a pair's results for its particles: force and torque on i and two zeros, the same on j."""


@inner_kernel(forceinline=True)
def stored_energy(overlap, history, pair, law, features):
    """Energy in the normal force and the springs of a pair or wall contact [J]."""
    state = state_at(history, history_place(pair, components(law)), BLOCK, law)
    return normal_potential(overlap, state, law, features), spring_energy(overlap, state, law)


@inner_kernel(forceinline=True)
def _seen(k, last, owner, neighbour, rows):
    """Two eights of pair k, or of the last one before `last`."""
    k = min(k, last - 1)
    return seen_from(rows.place, rows.motion, np.int64(owner[k]), np.int64(neighbour[k]))


@inner_kernel()
def _gather(pair, last, owner, pairs, rows, model, scratch_out):
    """States of the pairs pair <= k < last into the scratch rows."""
    neighbour = pairs.neighbour
    law, mixture, features, _ = model
    for k in range(pair, last, LANES):
        b = k - pair
        a0, b0 = _seen(k, last, owner, neighbour, rows)
        a1, b1 = _seen(k + 1, last, owner, neighbour, rows)
        a2, b2 = _seen(k + 2, last, owner, neighbour, rows)
        a3, b3 = _seen(k + 3, last, owner, neighbour, rows)
        a4, b4 = _seen(k + 4, last, owner, neighbour, rows)
        a5, b5 = _seen(k + 5, last, owner, neighbour, rows)
        a6, b6 = _seen(k + 6, last, owner, neighbour, rows)
        a7, b7 = _seen(k + 7, last, owner, neighbour, rows)
        dx, dy, dz, mass_i, vx, vy, vz, mass_j = transposed((a0, a1, a2, a3, a4, a5, a6, a7))
        store_eight(scratch_out, b, dx)
        store_eight(scratch_out, b + ROW, dy)
        store_eight(scratch_out, b + 2 * ROW, dz)
        store_eight(scratch_out, b + 3 * ROW, vx)
        store_eight(scratch_out, b + 4 * ROW, vy)
        store_eight(scratch_out, b + 5 * ROW, vz)
        wx, wy, wz, radius_i, ox, oy, oz, radius_j = transposed((b0, b1, b2, b3, b4, b5, b6, b7))
        store_eight(scratch_out, b + 6 * ROW, wx)
        store_eight(scratch_out, b + 7 * ROW, wy)
        store_eight(scratch_out, b + 8 * ROW, wz)
        store_eight(scratch_out, b + 9 * ROW, ox)
        store_eight(scratch_out, b + 10 * ROW, oy)
        store_eight(scratch_out, b + 11 * ROW, oz)
        if is_unlike(features):
            store_eight(scratch_out, b + 12 * ROW, radius_i)
            store_eight(scratch_out, b + 13 * ROW, radius_j)
            if not has_materials(features):
                store_eight(scratch_out, b + 14 * ROW, mass_i)
                store_eight(scratch_out, b + 15 * ROW, mass_j)
    if is_periodic(features) or is_endless(features):
        for k in range(pair, last):  # again, in float64: the difference across the box is not rounded
            i, j, b = owner[k], neighbour[k], k - pair
            scratch_out[b], scratch_out[b + ROW], scratch_out[b + 2 * ROW] = nearest_images(
                rows.place[j, 0] - rows.place[i, 0],
                rows.place[j, 1] - rows.place[i, 1],
                rows.place[j, 2] - rows.place[i, 2],
                features,
            )
    if has_materials(features):
        for k in range(pair, last):
            _, _, of_pair = pair_of(owner[k], neighbour[k], law, mixture, features)
            for a, number in enumerate(of_pair):
                scratch_out[k - pair + (14 + a) * ROW] = number


@inner_kernel(forceinline=True, fastmath={"contract"})
def contact_of_pair(apart, relative, angular_velocities, radii, state, step, law, features):
    """Contact of particles i and j, in reach or not.

    apart [m]: x_j - x_i; relative [m/s]: v_i - v_j of the centres; angular velocities [rad/s] and radii [m]
    of both; state: ContactState.
    Returns 1 if they are in reach, else 0; force on i [N]; torques on i and on j [N m]; ContactState; sinks
    [J]. Out of reach all are zero, except the sink `separation`, the energy of the lost springs, and
    the law's own sinks and numbers, which the caller multiplies by the first value.
    """
    zero, half, one = like(step, 0.0), like(step, 0.5), like(step, 1.0)
    radius_i, radius_j = radii
    touch = radius_i + radius_j
    farthest = reach(touch, law, features)
    dx, dy, dz = apart
    squared = dx * dx + dy * dy + dz * dz
    inverse = inverse_root(squared)
    distance = squared * inverse
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    arm_i = arm_j = half * distance  # both bodies reach to the middle of overlap or gap
    wx, wy, wz = angular_velocities[0]
    ox, oy, oz = angular_velocities[1]
    # velocity of i against j at the contact: v_i - v_j + (arm_i w_i + arm_j w_j) x n
    if has_sizes(features):
        longer = half * (radius_i - radius_j)
        arm_i += longer
        arm_j -= longer
        cx, cy, cz = arm_i * wx + arm_j * ox, arm_i * wy + arm_j * oy, arm_i * wz + arm_j * oz
    else:
        cx, cy, cz = arm_i * (wx + ox), arm_i * (wy + oy), arm_i * (wz + oz)
    sliding = (
        relative[0] + cy * nz - cz * ny,
        relative[1] + cz * nx - cx * nz,
        relative[2] + cx * ny - cy * nx,
    )
    motion = ContactMotion((nx, ny, nz), sliding, (wx - ox, wy - oy, wz - oz))
    f, m, new, sinks = contact(touch - distance, motion, state, step, law, features)
    acts = one if distance < farthest else zero
    fx, fy, fz = acts * f[0], acts * f[1], acts * f[2]
    mx, my, mz = acts * m[0], acts * m[1], acts * m[2]
    # torques arm n x f have one sign: opposite force on the opposite side
    qx, qy, qz = ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx
    lost = zero
    if books_energy(features):
        lost = (one - acts) * spring_energy(zero, state, law)
    return (
        acts,
        (fx, fy, fz),
        (arm_i * qx + mx, arm_i * qy + my, arm_i * qz + mz),
        (arm_j * qx - mx, arm_j * qy - my, arm_j * qz - mz),
        ContactState(
            (acts * new.shear[0], acts * new.shear[1], acts * new.shear[2]),
            (acts * new.rolling[0], acts * new.rolling[1], acts * new.rolling[2]),
            new.own,
        ),
        (acts * sinks[0], acts * sinks[1], acts * sinks[2], acts * sinks[3], acts * sinks[4] + lost)  # noqa: RUF005
        + sinks[SHARED_SINKS:],
    )


@inner_kernel(fastmath={"contract"})
def _compute(count, scratch, history, radius, step, common_law, features, book_out):
    """Replaces the states of `count` pairs by their forces and torques, and updates their histories.

    `scratch` and `history` are flat, so that the distance of their rows is a constant of the compiled code.
    """
    law, radius_i, radius_j = common_law, radius, radius
    for b in range(count):
        if is_unlike(features):
            radius_i, radius_j = scratch[b + 12 * ROW], scratch[b + 13 * ROW]
            if has_materials(features):
                law = numbers_at(scratch, b + 14 * ROW, ROW, common_law)
            else:
                reduced = radius_i * radius_j / (radius_i + radius_j)
                mass_i, mass_j = scratch[b + 14 * ROW], scratch[b + 15 * ROW]
                law = numbers_like(step, at_size(common_law, reduced, mass_i * mass_j / (mass_i + mass_j)))
        acts, f, on_i, on_j, state, sinks = contact_of_pair(
            (scratch[b], scratch[b + ROW], scratch[b + 2 * ROW]),
            (scratch[b + 3 * ROW], scratch[b + 4 * ROW], scratch[b + 5 * ROW]),
            (
                (scratch[b + 6 * ROW], scratch[b + 7 * ROW], scratch[b + 8 * ROW]),
                (scratch[b + 9 * ROW], scratch[b + 10 * ROW], scratch[b + 11 * ROW]),
            ),
            (radius_i, radius_j),
            state_at(history, b, BLOCK, law),
            step,
            law,
            features,
        )
        put_state(state, acts, history, b, BLOCK)
        scratch[b], scratch[b + ROW], scratch[b + 2 * ROW] = f
        scratch[b + 3 * ROW], scratch[b + 4 * ROW], scratch[b + 5 * ROW] = on_i
        scratch[b + 6 * ROW], scratch[b + 7 * ROW], scratch[b + 8 * ROW] = on_j
        if books_energy(features):
            for a in range(SHARED_SINKS):
                book_out[a] += sinks[a]
            for a in range(SHARED_SINKS, len(sinks)):
                book_out[a] += acts * sinks[a]


@inner_kernel(forceinline=True)
def _vector_at(scratch, b):
    """Three eights: components of a vector of eight pairs from b on."""
    return load_eight(scratch, b), load_eight(scratch, b + ROW), load_eight(scratch, b + 2 * ROW)


@inner_kernel(forceinline=True)
def _put_results(pair, on_i, on_j, results_out):
    """Results of a pair of the block, from its two eights."""
    store_eight(results_out, _RESULTS * pair, on_i)
    store_eight(results_out, _RESULTS * pair + LANES, opposite(on_i, on_j))


@inner_kernel()
def _by_pair(count, scratch, results_out):
    """Results of `count` pairs, row by row in `scratch`, pair by pair: (pairs, _RESULTS)."""
    zero = eight_zeros(scratch)
    for b in range(0, count, LANES):
        fx, fy, fz = _vector_at(scratch, b)
        ix, iy, iz = _vector_at(scratch, b + 3 * ROW)
        jx, jy, jz = _vector_at(scratch, b + 6 * ROW)
        on_i = transposed((fx, fy, fz, ix, iy, iz, zero, zero))
        on_j = transposed((zero, zero, zero, jx, jy, jz, zero, zero))
        _put_results(b, on_i[0], on_j[0], results_out)
        _put_results(b + 1, on_i[1], on_j[1], results_out)
        _put_results(b + 2, on_i[2], on_j[2], results_out)
        _put_results(b + 3, on_i[3], on_j[3], results_out)
        _put_results(b + 4, on_i[4], on_j[4], results_out)
        _put_results(b + 5, on_i[5], on_j[5], results_out)
        _put_results(b + 6, on_i[6], on_j[6], results_out)
        _put_results(b + 7, on_i[7], on_j[7], results_out)


@inner_kernel()
def _scatter(first_row, pair, last, pairs, results, load_out):
    """Adds the results of the pairs pair <= k < last. Returns the row of the last one."""
    row_start, neighbour = pairs.row_start, pairs.neighbour
    i, end = first_row, row_start[first_row + 1]
    start = pair
    while start < last:
        while end <= start:
            i += 1
            end = row_start[i + 1]
        stop = min(end, last)
        on_i = load_eight(load_out, LANES * i)
        for k in range(start, stop):
            on_j, found = LANES * np.int64(neighbour[k]), _RESULTS * (k - pair)
            on_i = add_eight(on_i, load_eight(results, found))
            store_eight(
                load_out, on_j, add_eight(load_eight(load_out, on_j), load_eight(results, found + LANES))
            )
        store_eight(load_out, LANES * i, on_i)
        start = stop
    return i


@inner_kernel()
def _slab_forces(slab, pairs, owner, bonds, rows, model, book_out):
    """Pairs of the particles of a slab, in list order. `book_out` (sinks,) gathers the sinks [J]."""
    law, mixture, features, step = model
    first, last = pairs.slab_start[slab], pairs.slab_start[slab + 1]
    count, common = _GATHERED, law
    if has_sizes(features) and not has_materials(features):
        count += 4  # radii and masses of i and j
        common = numbers_like(step, numbers_at(mixture.laws[0], 0, 1, law))
    elif is_unlike(features):
        count += 2 + len(law)  # radii of i and j, and the law of the pair
    kind = pairs.history.dtype
    scratch, of_bonds = scratch_rows(count, kind), scratch_rows(bond_rows(bonds), kind)
    results = scratch_rows(_RESULTS, kind)
    pair, end = pairs.row_start[first], pairs.row_start[last]
    row = first
    while pair < end:
        stop = min(end, pair - pair % BLOCK + BLOCK)
        _gather(pair, stop, owner, pairs, rows, model, scratch)
        own = pairs.history[history_place(pair, components(law)) :]
        put_bonds(stop - pair, pair, scratch, of_bonds, slab, step, bonds, features)
        _compute(stop - pair, scratch, own, mixture.common_radius, step, common, features, book_out)
        add_bonds(stop - pair, scratch, of_bonds, bonds)
        _by_pair(stop - pair, scratch, results)
        row = _scatter(row, pair, stop, pairs, results, rows.load)
        pair = stop


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def pair_forces(pairs, owner, bonds, rows, law, mixture, features, step, book_out):
    """Adds the forces of all pairs to the loads of `rows`, and updates the pairs' histories. `book_out`
    (slabs, sinks) [J] gathers the sinks slab by slab. owner (p,) int32: particle i of each pair. bonds:
    NoBonds or BondArrays. rows: ParticleRows. law to step: ContactModel."""
    slabs = pairs.slab_start.shape[0] - 1
    for color in range(2):
        for half in prange((slabs + 1 - color) // 2):
            slab = 2 * half + color
            model = ContactModel(law, mixture, features, step)
            _slab_forces(slab, pairs, owner, bonds, rows, model, book_out[slab])


@inner_kernel()
def _overlap_and_law(i, j, position, law, mixture, features):
    """Overlap [m], negative across a gap, of particles i and j, and their law."""
    dx, dy, dz = nearest_images(
        position[j, 0] - position[i, 0],
        position[j, 1] - position[i, 1],
        position[j, 2] - position[i, 2],
        features,
    )
    radius_i, radius_j, between = pair_of(i, j, law, mixture, features)
    return radius_i + radius_j - math.sqrt(dx * dx + dy * dy + dz * dz), between


@inner_kernel()
def _rows_scan(first, last, pairs, position, law, mixture, features):
    contacts, largest = 0, 0.0
    for i in range(first, last):
        for k in range(pairs.row_start[i], pairs.row_start[i + 1]):
            overlap, between = _overlap_and_law(i, pairs.neighbour[k], position, law, mixture, features)
            contacts += int(overlap > -reach(0.0, between, features))
            largest = max(largest, overlap)
    return contacts, largest


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def contact_scan(pairs, position, law, mixture, features):
    """Contacts in reach, and the largest overlap [m]. Only the class of `law` is used."""
    n = position.shape[0]
    contacts, largest = np.zeros(PARTS, np.int64), np.zeros(PARTS)
    for part in prange(PARTS):
        contacts[part], largest[part] = _rows_scan(
            part * n // PARTS, (part + 1) * n // PARTS, pairs, position, law, mixture, features
        )
    return contacts.sum(), largest.max()  # integers and a maximum: in any order


@inner_kernel()
def _rows_energy(first, last, pairs, position, law, mixture, features):
    energy = 0.0
    for i in range(first, last):
        for k in range(pairs.row_start[i], pairs.row_start[i + 1]):
            overlap, between = _overlap_and_law(i, pairs.neighbour[k], position, law, mixture, features)
            if overlap > -reach(0.0, between, features):
                normal, springs = stored_energy(overlap, pairs.history, k, between, features)
                energy += normal
                energy += springs
    return energy


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def pair_energy(pairs, position, law, mixture, features):
    """Energy stored between particles: normal and springs [J]. Only the class of `law` is used."""
    n = position.shape[0]
    energy = np.zeros(PARTS)
    for part in prange(PARTS):
        energy[part] = _rows_energy(
            part * n // PARTS, (part + 1) * n // PARTS, pairs, position, law, mixture, features
        )
    return added_up(energy)
