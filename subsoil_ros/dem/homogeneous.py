"""Strain and stress of homogeneous soil: an endless bed."""

import numpy as np
from numba import njit

from .blocks import BLOCK, history_place
from .contact import components, reach, state_at
from .mixture import pair_of
from .pairs import contact_of_pair
from .periodic import nearest_images


@njit(cache=True, error_model="numpy")
def stretch_springs(pairs, position, strain, law, mixture, features):
    """Updates the tangential springs of all contacts after a stretch of the bed by `strain` (3,)
    along x, y and z.

    In a pair a vector l apart, particle i moves by -strain l against j. Only the class of `law` is used.
    """
    row_start, neighbour, history, _ = pairs
    for i in range(position.shape[0]):
        for k in range(row_start[i], row_start[i + 1]):
            j = neighbour[k]
            dx, dy, dz = nearest_images(
                position[j, 0] - position[i, 0],
                position[j, 1] - position[i, 1],
                position[j, 2] - position[i, 2],
                features,
            )
            squared = dx * dx + dy * dy + dz * dz
            radius_i, radius_j, between = pair_of(i, j, law, mixture, features)
            if squared >= reach(radius_i + radius_j, between, features) ** 2:
                continue
            ex, ey, ez = strain[0] * dx, strain[1] * dy, strain[2] * dz
            along = (ex * dx + ey * dy + ez * dz) / squared
            h = history_place(k, components(between))
            history[h] -= ex - along * dx
            history[h + BLOCK] -= ey - along * dy
            history[h + 2 * BLOCK] -= ez - along * dz


@njit(cache=True, error_model="numpy")
def pair_stress(pairs, position, law, mixture, features):
    """Sum over all pairs of force times distance (3, 3) [N m], compression positive, without dampers.

    Only the class of `law` is used. Divided by the volume it is the mean stress (Love; J. Christoffersen,
    M.M. Mehrabadi, S. Nemat-Nasser, J. Appl. Mech. 48 (1981) 339-344).
    """
    row_start, neighbour, history, _ = pairs
    total = np.zeros((3, 3))
    still = (0.0, 0.0, 0.0)
    for i in range(position.shape[0]):
        for k in range(row_start[i], row_start[i + 1]):
            j = neighbour[k]
            apart = nearest_images(
                position[j, 0] - position[i, 0],
                position[j, 1] - position[i, 1],
                position[j, 2] - position[i, 2],
                features,
            )
            radius_i, radius_j, between = pair_of(i, j, law, mixture, features)
            state = state_at(history, history_place(k, components(between)), BLOCK, between)
            found = contact_of_pair(
                apart, still, (still, still), (radius_i, radius_j), state, 0.0, between, features
            )
            force = found[1]
            for a in range(3):
                for b in range(3):
                    total[a, b] -= force[a] * apart[b]
    return total
