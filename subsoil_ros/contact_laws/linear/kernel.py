"""Kernels of the linear law: a spring and a dashpot while the spheres overlap."""

import math

from ..base import ContactState
from ..springs import contact_with_springs, energy_of_springs, like, overlap_rate
from .law import LinearNumbers


def contact(overlap, motion, state, step, law, features):
    """See dem.contact.contact."""
    zero, one = like(overlap, 0.0), like(overlap, 1.0)
    nx, ny, nz = motion.normal
    rate = overlap_rate(motion)
    force_n = law.stiffness * max(overlap, zero)
    damped = law.damping * rate
    damped = damped if overlap > zero else zero
    force_n += damped
    push = -force_n * nx, -force_n * ny, -force_n * nz
    f, m, shear, rolling, lost = contact_with_springs(
        push, max(force_n, zero), motion, state, step, law, features, one, one
    )
    sinks = (damped * rate * step, lost[0], lost[1], lost[2], lost[3])
    return f, m, ContactState(shear, rolling, state.own), sinks


def normal_potential(overlap, state, law, features):
    """See dem.contact.normal_potential."""
    loaded = max(overlap, 0.0)
    return 0.5 * law.stiffness * loaded * loaded


def spring_energy(overlap, state, law):
    """See dem.contact.spring_energy."""
    return energy_of_springs(like(overlap, 1.0), state, law)


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
