"""Kernels of the Hertz-Mindlin law: stiffness grows with the root of the overlap."""

import math

from ..base import ContactState
from ..springs import contact_with_springs, energy_of_springs, like, overlap_rate
from .law import HertzNumbers


def contact(overlap, motion, state, step, law, features):
    """See dem.contact.contact."""
    zero = like(overlap, 0.0)
    nx, ny, nz = motion.normal
    rate = overlap_rate(motion)
    force_n = law.stiffness * math.sqrt(max(overlap, zero)) * overlap
    damped = law.damping * rate
    grown = math.sqrt(max(overlap, zero))
    before = math.sqrt(max(overlap - step * rate, zero))
    damped *= math.sqrt(grown)
    force_n += damped
    push = -force_n * nx, -force_n * ny, -force_n * nz
    f, m, shear, rolling, lost = contact_with_springs(
        push, max(zero, force_n), motion, state, step, law, features, grown, before
    )
    sinks = (damped * rate * step, lost[0], lost[1], lost[2], lost[3])
    return f, m, ContactState(shear, rolling, state.own), sinks


def normal_potential(overlap, state, law, features):
    """See dem.contact.normal_potential."""
    return 0.4 * law.stiffness * max(overlap, 0.0) ** 2.5


def spring_energy(overlap, state, law):
    """See dem.contact.spring_energy."""
    return energy_of_springs(math.sqrt(max(overlap, like(overlap, 0.0))), state, law)


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
