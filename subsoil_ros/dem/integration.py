"""Time integration and sums over particles.

Velocity Verlet: half kick, drift, forces, half kick. Forces see the half-step velocity, which makes
velocity-dependent forces first order in the step. A sphere's inertia is a scalar, so its spin needs no
frame of its own.
"""

import numpy as np
from numba import njit, prange


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def kick_drift(position, velocity, spin, force, torque, built, mass, inertia, gravity, step, limit_squared):
    """First half kick and drift; forces become gravity alone, torques zero.

    Returns the number of particles farther than sqrt(limit_squared) [m] from where the lists were built
    (not a number counts as far).
    """
    half_m, half_i = 0.5 * step / mass, 0.5 * step / inertia
    far = 0
    for i in prange(position.shape[0]):
        moved = 0.0
        for a in range(3):
            velocity[i, a] += half_m * force[i, a]
            spin[i, a] += half_i * torque[i, a]
            position[i, a] += step * velocity[i, a]
            d = position[i, a] - built[i, a]
            moved += d * d
            force[i, a] = 0.0
            torque[i, a] = 0.0
        force[i, 2] = -mass * gravity
        if not moved <= limit_squared:
            far += 1
    return far


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def kick(velocity, spin, force, torque, mass, inertia, step):
    """Second half kick."""
    half_m, half_i = 0.5 * step / mass, 0.5 * step / inertia
    for i in prange(velocity.shape[0]):
        for a in range(3):
            velocity[i, a] += half_m * force[i, a]
            spin[i, a] += half_i * torque[i, a]


@njit(cache=True, nogil=True)
def motion_sums(position, velocity, spin):
    """Sum of v.v [m2/s2], of w.w [rad2/s2], of z [m], and of v as a vector [m/s], in index order."""
    speed2, spin2, height = 0.0, 0.0, 0.0
    total = np.zeros(3)
    for i in range(velocity.shape[0]):
        for a in range(3):
            speed2 += velocity[i, a] * velocity[i, a]
            spin2 += spin[i, a] * spin[i, a]
            total[a] += velocity[i, a]
        height += position[i, 2]
    return speed2, spin2, height, total
