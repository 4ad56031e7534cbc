"""Forces of bonds, pair by pair beside those of the contacts (dem.pairs).

A bond is a beam of round section A = pi R^2 between two particles, without stress at the distance at which it
was made. With E its modulus, L the sum of the particles' radii and kappa the ratio of stiffnesses, its
springs and their stresses are

    normal    E A / L          on the change of distance        T / A
    shear     E A / (kappa L)  on the slip at its middle        S / A
    bending   normal R^2 / 4   on the turn across its axis      4 M / (A R)
    torsion   shear  R^2 / 2   on the turn about its axis       2 M / (A R)

(Potyondy and Cundall 2004). Slip and turn are kept as vectors and go with the pair as a rigid body does.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

from ...contact_laws.base import NO
from ...contact_laws.features import books_energy, is_unlike
from ...contact_laws.inverse_root import inverse_root
from ...contact_laws.springs import like
from ..blocks import BLOCK, ROW, history_place
from ..compiled import inner_kernel
from ..periodic import nearest_images

STATE = ("length", *("slip",) * 3, *("turn",) * 3)
"""Numbers kept of a listed pair: distance without force [m], negative once the bond broke, 0 without one;
slip [m] and turn [rad] of i against j."""

SHAPE = ("radius", "longer", "stiffness", "damper")
"""Further numbers of a pair of unlike particles: radius of the bond [m], half the radius of i less that of j
[m], normal stiffness [N/m], damper [N s/m]."""

PARITY = np.array([1.0] + [-1.0] * 6 + [1.0, -1.0, 1.0, 1.0])
"""Factors of STATE and SHAPE when seen from the other side: -1 if the sign changes."""

_RESULTS = 9
"""Scratch rows of a block: force on i, torque on i, on j."""


class NoBonds(NamedTuple):
    """Placeholder for soil without bonds: no code is compiled for them."""

    nothing: np.ndarray


NO_BONDS = NoBonds(NO)


class BondArrays(NamedTuple):
    """Bonds of a soil, SI."""

    state: np.ndarray  # STATE, and SHAPE of unlike particles, of the listed pairs, in blocks as histories
    book: np.ndarray  # (slabs, 2) [J] what dashpots took, and what broke
    shear_part: float  # shear over normal stiffness
    shear_root: float  # its root: the same ratio of the dampers
    tension: float  # tensile strength [Pa]
    cohesion: float  # [Pa]
    slope: float  # tangent of the friction angle
    radius: float  # this and the next two: of equal particles
    stiffness: float
    damper: float


def kept_count(features: Any) -> int:
    """Numbers kept of a pair."""
    return len(STATE) + len(SHAPE) if is_unlike(features) else len(STATE)


@njit(forceinline=True, error_model="numpy", fastmath={"contract"})
def _carried(vector, turned):
    """`vector` turned by the small angle and about the axis of the vector `turned` [rad], to second order."""
    half = like(turned[0], 0.5)
    x, y, z = vector
    wx, wy, wz = turned
    ax, ay, az = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
    mx, my, mz = x + half * ax, y + half * ay, z + half * az
    return x + wy * mz - wz * my, y + wz * mx - wx * mz, z + wx * my - wy * mx


@inner_kernel(forceinline=True, fastmath={"contract"})
def bond_of_pair(apart, relative, angular_velocities, shape, whole, slip, turn, step, law):
    """Forces of one bond after a step with these velocities.

    apart [m]: x_j - x_i; relative [m/s]: v_i - v_j of the centres; angular_velocities [rad/s] of i and j;
    shape: length without force, radius, half the radius of i less that of j [m], stiffness [N/m], damper
    [N s/m].
    Returns 1 if it is still whole, else 0; force on i [N]; torques on i and on j [N m]; slip, turn; stored
    energy [J], before it is lost with a bond that breaks; loss of the dashpots [W].
    """
    quarter, half, one = like(step, 0.25), like(step, 0.5), like(step, 1.0)
    two, four, zero = like(step, 2.0), like(step, 4.0), like(step, 0.0)
    length, radius, longer, normal, damper = shape
    dx, dy, dz = apart
    squared = dx * dx + dy * dy + dz * dz
    inverse = inverse_root(squared)
    distance = squared * inverse
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    rx, ry, rz = relative
    wx, wy, wz = angular_velocities[0]
    ox, oy, oz = angular_velocities[1]
    # axis half way through the step: what turns as a rigid body then keeps slip and turn to second order
    middle = half * step * inverse
    hx, hy, hz = nx + middle * rx, ny + middle * ry, nz + middle * rz
    about, swung = half * step * ((wx + ox) * hx + (wy + oy) * hy + (wz + oz) * hz), -step * inverse
    turned = (
        about * hx + swung * (hy * rz - hz * ry),
        about * hy + swung * (hz * rx - hx * rz),
        about * hz + swung * (hx * ry - hy * rx),
    )
    slip = _carried(slip, turned)
    turn = _carried(turn, turned)

    arm_i, arm_j = half * distance + longer, half * distance - longer
    cx, cy, cz = arm_i * wx + arm_j * ox, arm_i * wy + arm_j * oy, arm_i * wz + arm_j * oz
    ux, uy, uz = rx + cy * hz - cz * hy, ry + cz * hx - cx * hz, rz + cx * hy - cy * hx
    nearing = ux * nx + uy * ny + uz * nz
    ux, uy, uz = ux - nearing * nx, uy - nearing * ny, uz - nearing * nz
    sx, sy, sz = slip[0] + step * ux, slip[1] + step * uy, slip[2] + step * uz
    along = sx * nx + sy * ny + sz * nz
    sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
    wx, wy, wz = wx - ox, wy - oy, wz - oz
    tx, ty, tz = turn[0] + step * wx, turn[1] + step * wy, turn[2] + step * wz
    twist = tx * nx + ty * ny + tz * nz
    twisting = wx * nx + wy * ny + wz * nz
    ex, ey, ez = tx - twist * nx, ty - twist * ny, tz - twist * nz
    wx, wy, wz = wx - twisting * nx, wy - twisting * ny, wz - twisting * nz

    squared = radius * radius
    section = like(step, math.pi) * squared
    shear = law.shear_part * normal
    bending, torsion = quarter * squared * normal, half * squared * shear
    tension = normal * (distance - length)
    slipped, bent = sx * sx + sy * sy + sz * sz, ex * ex + ey * ey + ez * ez
    # what the strength leaves for bending and for shear [N m]; without roots
    pull = radius * (law.tension * section - tension)
    sheared = radius * max(law.cohesion * section - law.slope * tension, zero) - two * torsion * abs(twist)
    bends, shears = four * bending, radius * shear
    holds = (bends * bends * bent <= pull * pull) & (pull >= zero)
    holds = holds & (shears * shears * slipped <= sheared * sheared) & (sheared >= zero)
    holds = one if holds else zero
    stored = half * (
        tension * (distance - length) + shear * slipped + bending * bent + torsion * twist * twist
    )

    # of equal spheres: inertia 0.4 m r^2, so sqrt(bending * inertia) = sqrt(0.1) R^2 sqrt(normal * mass)
    sliding = law.shear_root * damper
    rocking = like(step, math.sqrt(0.1)) * squared * damper
    spinning = like(step, math.sqrt(0.2)) * squared * sliding
    lost = (
        damper * nearing * nearing
        + sliding * (ux * ux + uy * uy + uz * uz)
        + rocking * (wx * wx + wy * wy + wz * wz)
        + spinning * twisting * twisting
    )

    acts = whole * holds
    along = tension - damper * nearing
    fx = acts * (along * nx - shear * sx - sliding * ux)
    fy = acts * (along * ny - shear * sy - sliding * uy)
    fz = acts * (along * nz - shear * sz - sliding * uz)
    along = torsion * twist + spinning * twisting
    mx = -acts * (bending * ex + rocking * wx + along * nx)
    my = -acts * (bending * ey + rocking * wy + along * ny)
    mz = -acts * (bending * ez + rocking * wz + along * nz)
    qx, qy, qz = ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx
    return (
        acts,
        (fx, fy, fz),
        (arm_i * qx + mx, arm_i * qy + my, arm_i * qz + mz),
        (arm_j * qx - mx, arm_j * qy - my, arm_j * qz - mz),
        (acts * sx, acts * sy, acts * sz),
        (acts * tx, acts * ty, acts * tz),
        stored,
        acts * lost,
    )


@inner_kernel(forceinline=True)
def shape_at(state, start, stride, bonds, features):
    """Shape of a bond for bond_of_pair; its numbers are every stride-th of `state` (n,) from `start` on."""
    if is_unlike(features):
        first = start + len(STATE) * stride
        return (
            abs(state[start]), state[first], state[first + stride], state[first + 2 * stride],
            state[first + 3 * stride],
        )  # fmt: skip
    return abs(state[start]), bonds.radius, like(bonds.radius, 0.0), bonds.stiffness, bonds.damper


@inner_kernel(fastmath={"contract"})
def _compute(count, scratch, results, state, step, bonds, features, book):
    """Writes forces and torques of the bonds of `count` pairs, whose states are in the scratch rows, into
    those of `results`; updates the states of the bonds."""
    for b in range(count):
        length = state[b]
        whole = like(step, 1.0) if length > like(step, 0.0) else like(step, 0.0)
        acts, f, on_i, on_j, slip, turn, stored, lost = bond_of_pair(
            (scratch[b], scratch[b + ROW], scratch[b + 2 * ROW]),
            (scratch[b + 3 * ROW], scratch[b + 4 * ROW], scratch[b + 5 * ROW]),
            (
                (scratch[b + 6 * ROW], scratch[b + 7 * ROW], scratch[b + 8 * ROW]),
                (scratch[b + 9 * ROW], scratch[b + 10 * ROW], scratch[b + 11 * ROW]),
            ),
            shape_at(state, b, BLOCK, bonds, features),
            whole,
            (state[b + BLOCK], state[b + 2 * BLOCK], state[b + 3 * BLOCK]),
            (state[b + 4 * BLOCK], state[b + 5 * BLOCK], state[b + 6 * BLOCK]),
            step,
            bonds,
        )
        state[b] = length if acts == whole else -length
        state[b + BLOCK], state[b + 2 * BLOCK], state[b + 3 * BLOCK] = slip
        state[b + 4 * BLOCK], state[b + 5 * BLOCK], state[b + 6 * BLOCK] = turn
        results[b], results[b + ROW], results[b + 2 * ROW] = f
        results[b + 3 * ROW], results[b + 4 * ROW], results[b + 5 * ROW] = on_i
        results[b + 6 * ROW], results[b + 7 * ROW], results[b + 8 * ROW] = on_j
        if books_energy(features):
            book[0] += step * lost
            book[1] += (whole - acts) * stored


def bond_rows(bonds):
    """Scratch rows that bonds need."""
    return 0 if isinstance(bonds, NoBonds) else _RESULTS


@overload(bond_rows, inline="always")
def _bond_rows(bonds):
    if bonds.instance_class is NoBonds:
        return lambda bonds: 0
    return lambda bonds: _RESULTS


_here = {"forceinline": True, "error_model": "numpy"}


def _put(count, pair, scratch, results, slab, step, bonds, features):
    kept = len(STATE) + len(SHAPE) if is_unlike(features) else len(STATE)
    own = bonds.state[history_place(pair, kept) :]
    _compute(count, scratch, results, own, step, bonds, features, bonds.book[slab])


def put_bonds(count, pair, scratch, results, slab, step, bonds, features):
    """Writes the bond forces of the pairs of a block, from `pair` on, into `results`, rows of their own."""
    if not isinstance(bonds, NoBonds):
        _put(count, pair, scratch, results, slab, step, bonds, features)


@overload(put_bonds, jit_options=_here)
def _put_bonds(count, pair, scratch, results, slab, step, bonds, features):
    if bonds.instance_class is NoBonds:
        return lambda count, pair, scratch, results, slab, step, bonds, features: None
    return _put


def _add(count, scratch, results, bonds):
    for b in range(count):
        for row in range(_RESULTS):
            scratch[b + row * ROW] += results[b + row * ROW]


def add_bonds(count, scratch, results, bonds):
    """Adds the results of put_bonds to those of the contacts."""
    if not isinstance(bonds, NoBonds):
        _add(count, scratch, results, bonds)


@overload(add_bonds, jit_options=_here)
def _add_bonds(count, scratch, results, bonds):
    if bonds.instance_class is NoBonds:
        return lambda count, scratch, results, bonds: None
    return _add


@njit(cache=True, error_model="numpy")
def bond_sums(pairs, position, bonds, features):
    """Stored energy [J], and force times distance (3, 3) [N m], compression positive, of all bonds."""
    row_start, neighbour, total, stored = pairs.row_start, pairs.neighbour, np.zeros((3, 3)), 0.0
    still, state = (0.0, 0.0, 0.0), bonds.state
    kept = len(STATE) + len(SHAPE) if is_unlike(features) else len(STATE)
    for i in range(row_start.shape[0] - 1):
        for k in range(row_start[i], row_start[i + 1]):
            j, h = neighbour[k], history_place(k, kept)
            if state[h] <= 0.0:
                continue
            apart = nearest_images(
                position[j, 0] - position[i, 0],
                position[j, 1] - position[i, 1],
                position[j, 2] - position[i, 2],
                features,
            )
            found = bond_of_pair(
                apart, still, (still, still), shape_at(state, h, BLOCK, bonds, features), 1.0,
                (state[h + BLOCK], state[h + 2 * BLOCK], state[h + 3 * BLOCK]),
                (state[h + 4 * BLOCK], state[h + 5 * BLOCK], state[h + 6 * BLOCK]), 0.0, bonds,
            )  # fmt: skip
            stored += found[6]
            for a in range(3):
                for b in range(3):
                    total[a, b] -= found[1][a] * apart[b]
    return stored, total


@njit(cache=True, error_model="numpy")
def stretch_bonds(pairs, position, bonds, strain, features):
    """Updates slips and turns as dem.homogeneous.stretch_springs does the springs of contacts."""
    row_start, neighbour, state = pairs.row_start, pairs.neighbour, bonds.state
    kept = len(STATE) + len(SHAPE) if is_unlike(features) else len(STATE)
    for i in range(row_start.shape[0] - 1):
        for k in range(row_start[i], row_start[i + 1]):
            j, h = neighbour[k], history_place(k, kept)
            dx, dy, dz = nearest_images(
                position[j, 0] - position[i, 0],
                position[j, 1] - position[i, 1],
                position[j, 2] - position[i, 2],
                features,
            )
            ex, ey, ez = strain[0] * dx, strain[1] * dy, strain[2] * dz
            inverse = 1.0 / (dx * dx + dy * dy + dz * dz)
            along = (ex * dx + ey * dy + ez * dz) * inverse
            turned = (
                (dy * ez - dz * ey) * inverse, (dz * ex - dx * ez) * inverse, (dx * ey - dy * ex) * inverse
            )  # fmt: skip
            for first in (1, 4):
                at = h + first * BLOCK
                x, y, z = _carried((state[at], state[at + BLOCK], state[at + 2 * BLOCK]), turned)
                if first == 1:
                    x, y, z = x - ex + along * dx, y - ey + along * dy, z - ez + along * dz
                state[at], state[at + BLOCK], state[at + 2 * BLOCK] = x, y, z
