"""Forces between particles, over the half list, slab by slab."""

import numpy as np
from numba import njit, prange

from .contact import contact, normal_potential, spring_energy
from .periodic import nearest_image


@njit(cache=True, nogil=True, error_model="numpy")
def _slab_forces(
    first, last, row_start, neighbour, position, velocity, spin, force, torque, shear, roll,
    radius, step, law, features, book,
):  # fmt: skip
    """Pairs of the particles first <= i < last, in list order. `book` (5,) gathers the sinks [J]."""
    reach = 2.0 * radius + law.reach if features.adhesion.ndim == 2 else 2.0 * radius
    reach2 = reach * reach
    period = features.periodic.item()
    for i in range(first, last):
        px, py, pz = position[i, 0], position[i, 1], position[i, 2]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        wx, wy, wz = spin[i, 0], spin[i, 1], spin[i, 2]
        ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(row_start[i], row_start[i + 1]):
            j = neighbour[k]
            dx, dy, dz = position[j, 0] - px, position[j, 1] - py, position[j, 2] - pz
            if features.periodic.ndim == 2:
                dy = nearest_image(dy, period)
            distance2 = dx * dx + dy * dy + dz * dz
            if distance2 >= reach2:
                if features.book.ndim == 2:
                    book[4] += spring_energy(0.0, shear[k], roll[k], law, features)
                for a in range(3):
                    shear[k, a] = 0.0
                    roll[k, a] = 0.0
                continue
            distance = np.sqrt(distance2)
            nx, ny, nz = dx / distance, dy / distance, dz / distance
            arm = 0.5 * distance  # both bodies reach to the middle of overlap or gap
            ox, oy, oz = spin[j, 0], spin[j, 1], spin[j, 2]
            # velocity of i against j at the contact: v_i - v_j + arm (w_i + w_j) x n
            cx, cy, cz = arm * (wx + ox), arm * (wy + oy), arm * (wz + oz)
            relative = (
                vx - velocity[j, 0] + cy * nz - cz * ny,
                vy - velocity[j, 1] + cz * nx - cx * nz,
                vz - velocity[j, 2] + cx * ny - cy * nx,
            )
            f, m, s, r, sinks = contact(
                2.0 * radius - distance, (nx, ny, nz), relative, (wx - ox, wy - oy, wz - oz),
                (shear[k, 0], shear[k, 1], shear[k, 2]), (roll[k, 0], roll[k, 1], roll[k, 2]),
                step, law, features,
            )  # fmt: skip
            for a in range(3):
                shear[k, a] = s[a]
                roll[k, a] = r[a]
                force[j, a] -= f[a]
            # torque arm n x f is the same on both: opposite force on the opposite side
            qx = arm * (ny * f[2] - nz * f[1])
            qy = arm * (nz * f[0] - nx * f[2])
            qz = arm * (nx * f[1] - ny * f[0])
            torque[j, 0] += qx - m[0]
            torque[j, 1] += qy - m[1]
            torque[j, 2] += qz - m[2]
            ax, ay, az = ax + f[0], ay + f[1], az + f[2]
            bx, by, bz = bx + qx + m[0], by + qy + m[1], bz + qz + m[2]
            if features.book.ndim == 2:
                for a in range(5):
                    book[a] += sinks[a]
        force[i, 0] += ax
        force[i, 1] += ay
        force[i, 2] += az
        torque[i, 0] += bx
        torque[i, 1] += by
        torque[i, 2] += bz


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def pair_forces(
    slab_start, row_start, neighbour, position, velocity, spin, force, torque, shear, roll,
    radius, step, law, features, book,
):  # fmt: skip
    """Adds the forces of all pairs. `book` (slabs, 5) [J] gathers the sinks slab by slab."""
    slabs = slab_start.shape[0] - 1
    for color in range(2):
        for half in prange((slabs + 1 - color) // 2):
            slab = 2 * half + color
            _slab_forces(
                slab_start[slab], slab_start[slab + 1], row_start, neighbour, position, velocity, spin,
                force, torque, shear, roll, radius, step, law, features, book[slab],
            )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def pair_scan(row_start, neighbour, position, shear, roll, radius, law, features):
    """Contacts in reach, largest overlap [m], stored energy: normal and springs [J]."""
    contacts, largest, energy = 0, 0.0, 0.0
    reach = law.reach if features.adhesion.ndim == 2 else 0.0
    period = features.periodic.item()
    for i in range(position.shape[0]):
        for k in range(row_start[i], row_start[i + 1]):
            j = neighbour[k]
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            if features.periodic.ndim == 2:
                dy = nearest_image(dy, period)
            overlap = 2.0 * radius - np.sqrt(dx * dx + dy * dy + dz * dz)
            if overlap > -reach:
                contacts += 1
                largest = max(largest, overlap)
                energy += normal_potential(overlap, law, features)
                energy += spring_energy(overlap, shear[k], roll[k], law, features)
    return contacts, largest, energy
