"""Plane walls of the bin: x = 0, far x, right y, left y, floor. The top is open."""

import numpy as np
from numba import njit, prange

from .contact import contact, normal_potential, spring_energy
from .mixture import sphere_of

WALLS = ("near", "far", "right", "left", "floor")

_CHUNKS = 16
"""Split of the listed particles among threads."""


def wall_planes(
    lower: tuple[float, float, float], upper: tuple[float, float], sides: str = "walls"
) -> np.ndarray:
    """(5, 4) rows (nx, ny, nz, offset): normal towards the wall, n . x = offset on it [m].

    `sides` that are periodic are walls infinitely far away.
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
    return planes


def near_walls(position: np.ndarray, planes: np.ndarray, reach: float) -> np.ndarray:
    """Particles whose centre is closer than `reach` [m] to a wall, in increasing order."""
    return np.flatnonzero(_near(position, planes, reach))


@njit(cache=True, parallel=True)
def _near(position, planes, reach):
    near = np.zeros(position.shape[0], np.bool_)
    for i in prange(position.shape[0]):
        for wall in range(planes.shape[0]):
            gap = planes[wall, 3]
            for a in range(3):
                gap -= planes[wall, a] * position[i, a]
            if gap < reach:
                near[i] = True
    return near


@njit(cache=True, nogil=True, error_model="numpy")
def _rows_forces(
    first, last, particle, planes, position, velocity, spin, force, torque, shear, roll,
    common_radius, step, common_law, mixture, features, wall_force, book,
):  # fmt: skip
    """Walls on the listed particles first <= row < last."""
    for row in range(first, last):
        i = particle[row]
        radius, law = sphere_of(i, common_radius, common_law, mixture, features)
        reach = radius + (law.reach if features.adhesion.ndim == 2 else 0.0)
        for a in range(3):
            wall_force[row, a] = 0.0
        for wall in range(5):
            nx, ny, nz = planes[wall, 0], planes[wall, 1], planes[wall, 2]
            distance = planes[wall, 3] - (nx * position[i, 0] + ny * position[i, 1] + nz * position[i, 2])
            if distance >= reach:
                if features.book.ndim == 2:
                    book[row, 4] += spring_energy(0.0, shear[row, wall], roll[row, wall], law, features)
                for a in range(3):
                    shear[row, wall, a] = 0.0
                    roll[row, wall, a] = 0.0
                continue
            arm = 0.5 * (radius + distance)
            wx, wy, wz = spin[i, 0], spin[i, 1], spin[i, 2]
            relative = (
                velocity[i, 0] + arm * (wy * nz - wz * ny),
                velocity[i, 1] + arm * (wz * nx - wx * nz),
                velocity[i, 2] + arm * (wx * ny - wy * nx),
            )
            f, m, s, r, sinks = contact(
                radius - distance, (nx, ny, nz), relative, (wx, wy, wz),
                (shear[row, wall, 0], shear[row, wall, 1], shear[row, wall, 2]),
                (roll[row, wall, 0], roll[row, wall, 1], roll[row, wall, 2]),
                step, law, features,
            )  # fmt: skip
            for a in range(3):
                shear[row, wall, a] = s[a]
                roll[row, wall, a] = r[a]
                force[i, a] += f[a]
                wall_force[row, a] += f[a]
            torque[i, 0] += arm * (ny * f[2] - nz * f[1]) + m[0]
            torque[i, 1] += arm * (nz * f[0] - nx * f[2]) + m[1]
            torque[i, 2] += arm * (nx * f[1] - ny * f[0]) + m[2]
            if features.book.ndim == 2:
                for a in range(5):
                    book[row, a] += sinks[a]


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def wall_forces(
    particle, planes, position, velocity, spin, force, torque, shear, roll,
    radius, step, law, mixture, features, wall_force, book,
):  # fmt: skip
    """Adds the forces of the walls. `wall_force` (w, 3) [N] receives what the walls put on each particle,
    `book` (w, 5) the sinks [J] of its wall contacts. `mixture`: see pair_forces."""
    count = particle.shape[0]
    for chunk in prange(_CHUNKS):
        _rows_forces(
            chunk * count // _CHUNKS, (chunk + 1) * count // _CHUNKS, particle, planes, position, velocity,
            spin, force, torque, shear, roll, radius, step, law, mixture, features, wall_force, book,
        )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def wall_scan(particle, planes, position, shear, roll, common_radius, common_law, mixture, features):
    """Wall contacts in reach, largest overlap [m], stored energy [J]."""
    contacts, largest, energy = 0, 0.0, 0.0
    for row in range(particle.shape[0]):
        i = particle[row]
        radius, law = sphere_of(i, common_radius, common_law, mixture, features)
        reach = law.reach if features.adhesion.ndim == 2 else 0.0
        for wall in range(5):
            overlap = radius - planes[wall, 3]
            for a in range(3):
                overlap += planes[wall, a] * position[i, a]
            if overlap > -reach:
                contacts += 1
                largest = max(largest, overlap)
                energy += normal_potential(overlap, law, features)
                energy += spring_energy(overlap, shear[row, wall], roll[row, wall], law, features)
    return contacts, largest, energy
