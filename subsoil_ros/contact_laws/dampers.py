"""Dampers of linear springs: given as they are, or by the restitution of a pair."""

import math
from dataclasses import replace
from typing import Any

from pydantic import model_validator

from ..strict_model import Fraction, NonNegative, Positive, StrictModel
from .base import ContactLaw, PairValues

TANGENTIAL_DAMPING = 0.5
"""Tangential damper over the normal one, where a restitution gives both. A sticking contact then swings on
2/7 of the mass with at least half of the damping ratio along the normal, so that tangential motion stops in
a few periods too."""


def restitution_at(damping_ratio: float) -> float:
    """Restitution of spring and dashpot, no cohesion: exp(-pi z / sqrt(1 - z^2)), 0 from z = 1 on."""
    if damping_ratio >= 1.0:
        return 0.0
    return math.exp(-math.pi * damping_ratio / math.sqrt(1.0 - damping_ratio**2))


def damping_ratio_at(restitution: float) -> float:
    """The inverse of restitution_at, for 0 < restitution <= 1: -ln e / sqrt(pi^2 + ln^2 e)."""
    logarithm = math.log(restitution)
    return abs(logarithm) / math.hypot(logarithm, math.pi)


_DAMPERS, _RESTITUTION = ("damping_newton_s_per_m", "tangential_damping_newton_s_per_m"), "restitution"


class DampedValues(StrictModel):
    """Springs of a row, and both dampers or the restitution that they follow from."""

    stiffness_newton_per_m: Positive
    tangential_stiffness_newton_per_m: NonNegative
    damping_newton_s_per_m: NonNegative | None = None
    tangential_damping_newton_s_per_m: NonNegative | None = None
    restitution: Fraction | None = None

    @model_validator(mode="after")
    def _one_form(self) -> "DampedValues":
        given = [key for key in (*_DAMPERS, _RESTITUTION) if getattr(self, key) is not None]
        if given not in ([_RESTITUTION], [*_DAMPERS]):
            raise ValueError(
                f"{_DAMPERS[0]}: given {' and '.join(given) or 'no damper'}; allowed is '{_RESTITUTION}' "
                f"alone, or '{_DAMPERS[0]}' with '{_DAMPERS[1]}'; give one of the two"
            )
        return self


class DampedLaw(ContactLaw):
    """A law of linear springs whose rows, and those of its layers, all have dampers or all a restitution."""

    @model_validator(mode="after")
    def _one_form(self) -> "DampedLaw":
        if (self.particle.restitution is None) != (self.boundary.restitution is None):
            row, other = ("boundary", "particle") if self.particle.restitution else ("particle", "boundary")
            raise ValueError(
                f"{row}.{_RESTITUTION}: not given, while {other} has one; give it in both rows, or dampers "
                "in both"
            )
        return self

    def refused(self, change: Any) -> str:
        """See ContactLaw; a layer must keep the form of the law, dampers or a restitution."""
        for row in ("particle", "boundary"):
            damped = getattr(self, row).restitution is None
            for key in (_RESTITUTION,) if damped else _DAMPERS:
                if (given := getattr(getattr(change, row), key)) is not None:
                    form = "dampers" if damped else f"'{_RESTITUTION}'"
                    return f"{row}.{key}: given {given:g}, but soil.law has {form}; a layer changes that form"
        return ""


def smaller_restitution(one: DampedValues, other: DampedValues) -> float | None:
    """Restitution of a pair of two layers; None if they have dampers."""
    if one.restitution is None or other.restitution is None:
        return None
    return min(one.restitution, other.restitution)


def damped(values: PairValues, restitution: float | None, mass_kg: float) -> PairValues:
    """`values` with the dampers that give a pair of this reduced mass the restitution; None: as they are.

    C = 2 zeta sqrt(K m), without cohesion; the tangential damper is TANGENTIAL_DAMPING of it.
    """
    if restitution is None:
        return values
    damping = 2.0 * damping_ratio_at(restitution) * math.sqrt(values.stiffness * mass_kg)
    return replace(
        values,
        damping=damping,
        tangential_damping=TANGENTIAL_DAMPING * damping,
        damping_of_restitution=True,
    )
