"""Kernels of the elasto-plastic adhesive law.

With h = overlap^n and what is kept of a contact, plastic overlap p and ratio q of adhesive to unloading
stiffness, the spring carries the larger of k2 (h - p^n) and -q k2 h. When pressed further than before, p
grows with the overlap and q follows from the attraction 3/2 pi dgamma a, a^2 = 2 R p, at most half of what k2
could bear; on the branch -q k2 h the plastic overlap shrinks with h, and loading starts again from there.
"""

import math

from ..base import ContactState
from ..features import books_energy
from ..springs import contact_with_springs, energy_of_springs, law_kernel, like, overlap_rate
from .law import ElastoPlasticAdhesiveNumbers

_TINY = 1e-30
"""Keeps a quotient finite; far below any stiffness times overlap [N], also in float32."""


@law_kernel()
def _rooted(length, law):
    """Root of a length, or 1 where the exponent is 1."""
    return math.sqrt(length) if law.hertzian > like(length, 0.0) else like(length, 1.0)


@law_kernel()
def _power_of(ratio, law):
    """ratio^(1 / n), 1 <= ratio <= 2; for n = 3/2 the cube root of its square, by Newton steps."""
    squared, third = ratio * ratio, like(ratio, 1.0 / 3.0)
    root = like(ratio, 0.6) * ratio + like(ratio, 0.4)  # right to 2 % from 1 to 2
    for _ in range(4):
        root -= third * (root - squared / (root * root))
    return root if law.hertzian > like(ratio, 0.0) else ratio


@law_kernel()
def _elastic(overlap, plastic, law):
    """Energy that unloading from the plastic overlap gives [J]; negative overlaps have none."""
    near = max(overlap, like(overlap, 0.0))
    up, down = near * _rooted(near, law), plastic * _rooted(plastic, law)
    half, part = like(overlap, 0.5), like(overlap, 0.4)
    part = part if law.hertzian > like(overlap, 0.0) else half  # 1 / (n + 1)
    return law.unloading_stiffness * (part * (near * up - plastic * down) - down * (near - plastic))


def contact(overlap, motion, state, step, law, features):
    """See dem.contact.contact."""
    zero, half, one = like(overlap, 0.0), like(overlap, 0.5), like(overlap, 1.0)
    nx, ny, nz = motion.normal
    rate = overlap_rate(motion)
    near = max(overlap, zero)
    grown = _rooted(near, law)
    height = law.unloading_stiffness * near * grown

    old_plastic, old_ratio = state.own
    virgin = law.plastic_part * near
    plastic = max(virgin, old_plastic)
    yielded = law.unloading_stiffness * plastic * _rooted(plastic, law)
    attraction = min(law.adhesion_root * math.sqrt(plastic), half * yielded)
    ratio = attraction / max(yielded - attraction, like(overlap, _TINY))
    ratio = ratio if virgin > old_plastic else old_ratio
    pulled = ratio * height
    spring = max(height - yielded, -pulled)
    wider = _power_of(one + ratio, law)  # plastic overlap over the overlap where the spring begins to pull so
    plastic = near * wider if height - yielded < -pulled else plastic

    before = _rooted(max(overlap - step * rate, zero), law)
    damped = max(law.damping * math.sqrt(grown) * rate, -max(spring, zero))  # it never pulls
    force_n = spring - law.pull_off + damped
    pressing = max(force_n + (pulled + law.pull_off), zero)
    push = -force_n * nx, -force_n * ny, -force_n * nz
    f, m, shear, rolling, lost = contact_with_springs(
        push, pressing, motion, state, step, law, features, grown, before
    )
    yielding = adhesion = zero
    if books_energy(features):  # the integral of k2 (overlap - p) d(p^n) along the two branches
        moved = plastic * plastic * _rooted(plastic, law) - old_plastic * old_plastic * _rooted(
            old_plastic, law
        )
        grows = (one - law.plastic_part) / max(law.plastic_part, like(overlap, _TINY))
        shrinks = one / wider - one
        part = like(overlap, 0.6) if law.hertzian > zero else half  # n / (n + 1)
        taken = part * law.unloading_stiffness * moved
        yielding = max(taken * grows, zero)
        adhesion = max(-taken, zero) * -shrinks
    dashpot = damped * rate * step
    sinks = (dashpot, lost[0], lost[1], lost[2], lost[3], yielding, adhesion)
    return f, m, ContactState(shear, rolling, (plastic, ratio)), sinks


def normal_potential(overlap, state, law, features):
    """See dem.contact.normal_potential."""
    near = max(overlap, 0.0)
    return _elastic(near, state.own[0], law) - near * law.pull_off if overlap > 0.0 else 0.0


def spring_energy(overlap, state, law):
    """See dem.contact.spring_energy."""
    return energy_of_springs(_rooted(max(overlap, like(overlap, 0.0)), law), state, law)


def reach(touch, law, features):
    """See dem.contact.reach."""
    return touch


def at_size(law, radius, mass):
    """See dem.contact.at_size: stiffnesses with R, or with its root for exponent 3/2, dashpots with the root
    of stiffness times mass, adhesion with the root of R."""
    root = math.sqrt(radius)
    normal = root if law.hertzian > 0.0 else radius
    damper = math.sqrt(normal * mass)
    return ElastoPlasticAdhesiveNumbers(
        normal * law.unloading_stiffness, normal * law.tangential_stiffness, damper * law.damping,
        damper * law.tangential_damping, law.plastic_part, root * law.adhesion_root,
        law.pull_off, law.static_friction, law.sliding_friction,
        normal * radius * radius * law.rolling_stiffness, radius * law.rolling_arm, law.hertzian,
    )  # fmt: skip
