"""Kernels of the cohesive linear law: Yuan & Yu (2020) eq. 12-21 with eq. 17 corrected (continuity).

What the paper leaves open is chosen in docs/contact_laws.md: friction limit, damped zones.
"""

import math

from ..base import ContactState
from ..features import asked_in_kernels
from ..springs import contact_with_springs, energy_of_springs, law_kernel, like, overlap_rate
from .law import CohesiveLinearNumbers


@asked_in_kernels
def has_cohesion(features):
    """Whether particles or boundaries attract."""
    return features.cohesion.ndim == 2


@asked_in_kernels
def damps_all_zones(features):
    """Whether the dashpot acts below the rest overlap too."""
    return features.damp_all_zones.ndim == 2


@asked_in_kernels
def rubs_by_repulsion(features):
    """Whether repulsion alone limits friction."""
    return features.friction_repulsive.ndim == 2


@asked_in_kernels
def rubs_by_magnitude(features):
    """Whether the magnitude of the normal force limits friction."""
    return features.friction_absolute.ndim == 2


@law_kernel()
def _elastic(overlap, law, features):
    """Elastic part of the force along the normal, repulsion positive [N] (Delta = 0)."""
    zero = like(overlap, 0.0)
    force = law.stiffness * max(overlap - law.rest_overlap, zero)
    if has_cohesion(features):
        touching = law.contact_adhesion * min(overlap - law.rest_overlap, zero)
        apart = -law.adhesion * max(law.reach + overlap, zero)
        force += touching if overlap >= zero else apart
    return force


def contact(overlap, motion, state, step, law, features):
    """See dem.contact.contact."""
    zero, one = like(overlap, 0.0), like(overlap, 1.0)
    nx, ny, nz = motion.normal
    rate = overlap_rate(motion)
    force_n = _elastic(overlap, law, features)
    damped = law.damping * rate
    if not damps_all_zones(features):
        damped = damped if overlap > law.rest_overlap else zero
    force_n += damped
    push = -force_n * nx, -force_n * ny, -force_n * nz
    if rubs_by_repulsion(features):
        pressing = max(force_n, zero)
    elif rubs_by_magnitude(features):
        pressing = abs(force_n)
    else:
        pressing = max(force_n + law.peak_attraction, zero)
    f, m, shear, rolling, lost = contact_with_springs(
        push, pressing, motion, state, step, law, features, one, one
    )
    sinks = (damped * rate * step, lost[0], lost[1], lost[2], lost[3])
    return f, m, ContactState(shear, rolling, state.own), sinks


def normal_potential(overlap, state, law, features):
    """See dem.contact.normal_potential."""
    energy = 0.0
    if has_cohesion(features):
        near = min(max(law.reach + overlap, 0.0), law.reach)
        energy -= 0.5 * law.adhesion * near * near
        inside = min(max(overlap, 0.0), law.rest_overlap)
        energy -= law.contact_adhesion * inside * (law.rest_overlap - 0.5 * inside)
    loaded = max(overlap - law.rest_overlap, 0.0)
    return energy + 0.5 * law.stiffness * loaded * loaded


def spring_energy(overlap, state, law):
    """See dem.contact.spring_energy."""
    return energy_of_springs(like(overlap, 1.0), state, law)


def reach(touch, law, features):
    """See dem.contact.reach."""
    return touch + law.reach if has_cohesion(features) else touch


def at_size(law, radius, mass):
    """See dem.contact.at_size: K_Y R^2 and mu R of rolling; dampers that follow from a restitution with
    the root of the mass."""
    damper = math.sqrt(mass) if law.of_restitution > 0.0 else like(mass, 1.0)
    return CohesiveLinearNumbers(
        law.stiffness, law.tangential_stiffness, damper * law.damping, damper * law.tangential_damping,
        law.adhesion, law.contact_adhesion, law.rest_overlap, law.reach, law.peak_attraction,
        law.static_friction, law.sliding_friction,
        radius * radius * law.rolling_stiffness, radius * law.rolling_arm, law.of_restitution,
    )  # fmt: skip
