"""Time integration and sums over particles.

Velocity Verlet: half kick, drift, forces, half kick. Forces see the half-step velocity, which makes
velocity-dependent forces first order in the step. Where the velocities are not read between two steps,
both half kicks are made in one pass, one after the other, with the same bits. A sphere's inertia is a scalar,
so its spin needs no frame of its own.
"""

import numpy as np
from numba import njit, prange

from .compiled import inner_kernel
from .per_particle import of_particle


@inner_kernel(forceinline=True)
def hold(i, force, torque):
    """Zeroes the force and the torque on particle i, which is held."""
    kind = force.dtype.type
    for a in range(3):
        force[i, a] = kind(0.0)
        torque[i, a] = kind(0.0)


@inner_kernel(forceinline=True)
def kicked_and_moved(i, position, velocity, spin, force, torque, built, held, mass, inertia, step, owed):
    """First half kick and drift of particle i; `owed` is 1 if the second half kick of the step before comes
    first, else 0, in the type of velocities. Returns the square of how far it is from `built` [m]."""
    if held[i]:
        hold(i, force, torque)
        return 0.0
    kind = velocity.dtype.type  # in float32 too no product goes through float64
    half_m = kind(0.5 * step / of_particle(mass, i))
    half_i = kind(0.5 * step / of_particle(inertia, i))
    moved = 0.0
    for a in range(3):
        velocity[i, a] += owed * half_m * force[i, a]
        velocity[i, a] += half_m * force[i, a]
        spin[i, a] += owed * half_i * torque[i, a]
        spin[i, a] += half_i * torque[i, a]
        position[i, a] += step * velocity[i, a]
        d = position[i, a] - built[i, a]
        moved += d * d
    return moved


@inner_kernel(forceinline=True)
def kicked(i, velocity, spin, force, torque, held, mass, inertia, step):
    """Second half kick of particle i."""
    if held[i]:
        hold(i, force, torque)
        return
    kind = velocity.dtype.type
    half_m = kind(0.5 * step / of_particle(mass, i))
    half_i = kind(0.5 * step / of_particle(inertia, i))
    for a in range(3):
        velocity[i, a] += half_m * force[i, a]
        spin[i, a] += half_i * torque[i, a]


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def kick_drift(
    position, velocity, spin, force, torque, built, held, mass, inertia, gravity, step, limit_squared, kicks
):  # fmt: skip
    """First half kick and drift; forces become gravity alone, torques zero.

    mass [kg] and inertia [kg m2] are those of every particle, or arrays (n,). With 2 `kicks` the second half
    kick of the step before comes first.

    Returns the number of particles farther than sqrt(limit_squared) [m] from where the lists were built
    (not a number counts as far).
    """
    far, kind = 0, velocity.dtype.type
    owed = kind(kicks - 1)
    for i in prange(position.shape[0]):
        moved = kicked_and_moved(
            i, position, velocity, spin, force, torque, built, held, mass, inertia, step, owed
        )
        for a in range(3):
            force[i, a] = kind(0.0)
            torque[i, a] = kind(0.0)
        force[i, 2] = kind(-of_particle(mass, i) * gravity)
        far += int(not moved <= limit_squared)
    return far


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def kick(velocity, spin, force, torque, held, mass, inertia, step):
    """Second half kick."""
    for i in prange(velocity.shape[0]):
        kicked(i, velocity, spin, force, torque, held, mass, inertia, step)


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


@njit(cache=True, nogil=True)
def mass_sums(position, velocity, spin, mass, inertia):
    """Kinetic energy [J], sum of m z [kg m], and momentum [kg m/s] of unequal particles, in index order."""
    kinetic, height = 0.0, 0.0
    momentum = np.zeros(3)
    for i in range(velocity.shape[0]):
        for a in range(3):
            kinetic += 0.5 * mass[i] * velocity[i, a] * velocity[i, a]
            kinetic += 0.5 * inertia[i] * spin[i, a] * spin[i, a]
            momentum[a] += mass[i] * velocity[i, a]
        height += mass[i] * position[i, 2]
    return kinetic, height, momentum
