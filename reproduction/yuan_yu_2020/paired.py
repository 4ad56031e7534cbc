"""Difference of two machines on the same beds, with Student's interval of its mean."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from subsoil_ros.analysis.intervals import mean_interval


@dataclass(frozen=True)
class PairedDifference:
    """Of one quantity on n beds: control less case, bed by bed; half-widths are of 95 %."""

    case_mean: float
    control_mean: float
    difference: float
    half_width: float  # infinite for a single pair
    pair_count: int

    @property
    def saving(self) -> float:
        """Part of the control's mean that the case saves."""
        return self.difference / self.control_mean

    @property
    def saving_half_width(self) -> float:
        """Of `saving`, the control's mean taken as known."""
        return self.half_width / abs(self.control_mean)

    def resolved(self, bound: float) -> bool:
        """Whether the half-width is below a part of the control's mean."""
        return self.saving_half_width < bound

    @property
    def verdict(self) -> str:
        """In words."""
        if not math.isfinite(self.half_width):
            return "one pair tells no interval"
        if abs(self.difference) <= self.half_width:
            return "no difference seen"
        return "saves" if self.difference > 0.0 else "costs"


def paired_difference(case: Sequence[float], control: Sequence[float]) -> PairedDifference:
    """Of values on the same beds in the same order: Student's interval of the mean difference."""
    one, two = np.asarray(case, np.float64), np.asarray(control, np.float64)
    if one.shape != two.shape or one.size == 0:
        raise ValueError(f"{one.size} and {two.size} values make no pairs")
    found = mean_interval((two - one).tolist())
    return PairedDifference(
        case_mean=float(one.mean()),
        control_mean=float(two.mean()),
        difference=found.mean,
        half_width=found.half_width if found.count > 1 else math.inf,
        pair_count=found.count,
    )
