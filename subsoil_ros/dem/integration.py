"""Time integration and sums over particles.

Velocity Verlet: half kick, drift, forces, half kick. Forces see the half-step velocity, which makes
velocity-dependent forces first order in the step. Where the velocities are not read between two steps,
both half kicks are made in one pass, one after the other, with the same bits. A sphere's inertia is a scalar,
so its angular_velocity needs no frame of its own.
"""

import numpy as np
from numba import njit, prange

from .compiled import inner_kernel
from .per_particle import of_particle


@inner_kernel(forceinline=True)
def hold(i, loads_out):
    """Zeroes the force and the torque on particle i, which is held."""
    force, torque = loads_out
    kind = force.dtype.type
    for a in range(3):
        force[i, a] = kind(0.0)
        torque[i, a] = kind(0.0)


@inner_kernel(forceinline=True)
def kicked_and_moved(i, kinematics_out, loads, masses, built, held, step, pending):
    """First half kick and drift of particle i; `pending` is 1 if the second half kick of the step before
    comes first, else 0, in the type of velocities. Returns the square of how far it is from `built` [m]."""
    if held[i]:
        hold(i, loads)
        return 0.0
    position, velocity, angular_velocity = kinematics_out
    force, torque = loads
    kind = velocity.dtype.type  # in float32 too no product goes through float64
    half_m = kind(0.5 * step / of_particle(masses.mass, i))
    half_i = kind(0.5 * step / of_particle(masses.inertia, i))
    moved = 0.0
    for a in range(3):
        velocity[i, a] += pending * half_m * force[i, a]
        velocity[i, a] += half_m * force[i, a]
        angular_velocity[i, a] += pending * half_i * torque[i, a]
        angular_velocity[i, a] += half_i * torque[i, a]
        position[i, a] += step * velocity[i, a]
        d = position[i, a] - built[i, a]
        moved += d * d
    return moved


@inner_kernel(forceinline=True)
def kicked(i, kinematics_out, loads, masses, held, step):
    """Second half kick of particle i."""
    if held[i]:
        hold(i, loads)
        return
    _, velocity, angular_velocity = kinematics_out
    force, torque = loads
    kind = velocity.dtype.type
    half_m = kind(0.5 * step / of_particle(masses.mass, i))
    half_i = kind(0.5 * step / of_particle(masses.inertia, i))
    for a in range(3):
        velocity[i, a] += half_m * force[i, a]
        angular_velocity[i, a] += half_i * torque[i, a]


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def kick_drift(kinematics_out, loads_out, masses, built, held, gravity, step, limit_squared, kicks):
    """First half kick and drift; forces become gravity alone, torques zero.

    With 2 `kicks` the second half kick of the step before comes first.

    Returns the number of particles farther than sqrt(limit_squared) [m] from where the lists were built
    (not a number counts as far).
    """
    force, torque = loads_out
    far, kind = 0, force.dtype.type
    pending = kind(kicks - 1)
    for i in prange(force.shape[0]):
        moved = kicked_and_moved(i, kinematics_out, loads_out, masses, built, held, step, pending)
        for a in range(3):
            force[i, a] = kind(0.0)
            torque[i, a] = kind(0.0)
        force[i, 2] = kind(-of_particle(masses.mass, i) * gravity)
        far += int(not moved <= limit_squared)
    return far


@njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def kick(kinematics_out, loads, masses, held, step):
    """Second half kick."""
    for i in prange(held.shape[0]):
        kicked(i, kinematics_out, loads, masses, held, step)


@njit(cache=True, nogil=True)
def motion_sums(kinematics):
    """Sum of v.v [m2/s2], of w.w [rad2/s2], of z [m], and of v as a vector [m/s], in index order."""
    position, velocity, angular_velocity = kinematics
    speed2, spin2, height = 0.0, 0.0, 0.0
    total = np.zeros(3)
    for i in range(velocity.shape[0]):
        for a in range(3):
            speed2 += velocity[i, a] * velocity[i, a]
            spin2 += angular_velocity[i, a] * angular_velocity[i, a]
            total[a] += velocity[i, a]
        height += position[i, 2]
    return speed2, spin2, height, total


@njit(cache=True, nogil=True)
def mass_sums(kinematics, masses):
    """Kinetic energy [J], sum of m z [kg m], and momentum [kg m/s] of unequal particles, in index order."""
    position, velocity, angular_velocity = kinematics
    mass, inertia = masses
    kinetic, height = 0.0, 0.0
    momentum = np.zeros(3)
    for i in range(velocity.shape[0]):
        for a in range(3):
            kinetic += 0.5 * mass[i] * velocity[i, a] * velocity[i, a]
            kinetic += 0.5 * inertia[i] * angular_velocity[i, a] * angular_velocity[i, a]
            momentum[a] += mass[i] * velocity[i, a]
        height += mass[i] * position[i, 2]
    return kinetic, height, momentum
