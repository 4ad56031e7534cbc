"""Kernels of the linear law: a spring and a dashpot while the spheres overlap."""

import math

from ..springs import contact_with_springs, energy_of_springs, like
from .law import LinearNumbers


def contact(overlap, normal, velocity, spin, shear, roll, kept, step, law, features):
    """See dem.contact.contact."""
    zero, one = like(overlap, 0.0), like(overlap, 1.0)
    nx, ny, nz = normal
    ux, uy, uz = velocity
    overlap_rate = ux * nx + uy * ny + uz * nz
    force_n = law.stiffness * max(overlap, zero)
    damped = law.damping * overlap_rate
    damped = damped if overlap > zero else zero
    force_n += damped
    push = -force_n * nx, -force_n * ny, -force_n * nz
    f, m, s, r, lost = contact_with_springs(
        push, max(force_n, zero), overlap_rate, normal, velocity, spin, shear, roll, step, law, features,
        one, one,
    )  # fmt: skip
    return f, m, s, r, kept, (damped * overlap_rate * step, lost[0], lost[1], lost[2], lost[3])


def normal_potential(overlap, kept, law, features):
    """See dem.contact.normal_potential."""
    loaded = max(overlap, 0.0)
    return 0.5 * law.stiffness * loaded * loaded


def spring_energy(overlap, shear, roll, law):
    """See dem.contact.spring_energy."""
    return energy_of_springs(like(overlap, 1.0), shear, roll, law)


def reach(touch, law, features):
    """See dem.contact.reach."""
    return touch


def at_size(law, radius, mass):
    """See dem.contact.at_size: K_t R^2 and mu R of rolling; dampers that follow from a restitution with
    the root of the mass."""
    damper = math.sqrt(mass) if law.of_restitution > 0.0 else like(mass, 1.0)
    return LinearNumbers(
        law.stiffness, law.tangential_stiffness, damper * law.damping, damper * law.tangential_damping,
        law.static_friction, law.sliding_friction,
        radius * radius * law.rolling_stiffness, radius * law.rolling_arm, law.of_restitution,
    )  # fmt: skip
