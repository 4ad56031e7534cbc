"""Kernels of the Hertz-Mindlin law: stiffness grows with the root of the overlap."""

import math

from ..springs import contact_with_springs, energy_of_springs, like
from .law import HertzNumbers


def contact(overlap, normal, velocity, spin, shear, roll, kept, step, law, features):
    """See dem.contact.contact."""
    zero = like(overlap, 0.0)
    nx, ny, nz = normal
    ux, uy, uz = velocity
    overlap_rate = ux * nx + uy * ny + uz * nz
    force_n = law.stiffness * math.sqrt(max(overlap, zero)) * overlap
    damped = law.damping * overlap_rate
    grown = math.sqrt(max(overlap, zero))
    before = math.sqrt(max(overlap - step * overlap_rate, zero))
    damped *= math.sqrt(grown)
    force_n += damped
    push = -force_n * nx, -force_n * ny, -force_n * nz
    f, m, s, r, lost = contact_with_springs(
        push, max(zero, force_n), overlap_rate, normal, velocity, spin, shear, roll, step, law, features,
        grown, before,
    )  # fmt: skip
    return f, m, s, r, kept, (damped * overlap_rate * step, lost[0], lost[1], lost[2], lost[3])


def normal_potential(overlap, kept, law, features):
    """See dem.contact.normal_potential."""
    return 0.4 * law.stiffness * max(overlap, 0.0) ** 2.5


def spring_energy(overlap, shear, roll, law):
    """See dem.contact.spring_energy."""
    return energy_of_springs(math.sqrt(max(overlap, like(overlap, 0.0))), shear, roll, law)


def reach(touch, law, features):
    """See dem.contact.reach."""
    return touch


def at_size(law, radius, mass):
    """See dem.contact.at_size: stiffnesses with R^(1/2), dashpots with the root of stiffness times mass,
    R^(1/4) m^(1/2); K_Y R^2 and mu R of rolling."""
    normal = math.sqrt(radius)
    damper = math.sqrt(normal * mass)
    return HertzNumbers(
        normal * law.stiffness, normal * law.tangential_stiffness, damper * law.damping,
        damper * law.tangential_damping, law.static_friction, law.sliding_friction,
        normal * radius * radius * law.rolling_stiffness, radius * law.rolling_arm,
    )  # fmt: skip
