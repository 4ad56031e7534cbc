"""Results of a virtual soil test."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .specimen import Size, Specimen

RESIDUAL_PART = 0.15
"""Last part of the travel, over which the residual stress is averaged; `residual_dilatancy` near 0 shows that
the soil has reached its critical state there."""


@dataclass(frozen=True)
class ShearCurve:
    """One direct shear test, or one over a plate; arrays (n,), from the first movement on."""

    nominal_pa: float  # normal stress on the plane of shear at its full section
    displacement_m: NDArray[np.float64]
    shear_pa: NDArray[np.float64]
    normal_pa: NDArray[np.float64]
    rise_m: NDArray[np.float64]  # of the lid, from the first movement on
    settled: float  # strain of the height under the load alone
    speed_m_per_s: float
    imbalance: (
        float  # |driver force - soil on the upper box| over the largest driver force, mean while moving
    )

    def peak(self) -> tuple[float, float]:
        """Normal and shear stress [Pa] where shear is largest."""
        k = int(np.argmax(self.shear_pa))
        return float(self.normal_pa[k]), float(self.shear_pa[k])

    @property
    def normal_error(self) -> float:
        """Largest difference of the normal stress from the nominal one, over the nominal, of means over a
        twentieth of the travel, once the speed is reached."""
        parts = np.floor(20.0 * self.displacement_m / self.displacement_m[-1])
        means = [self.normal_pa[parts == part].mean() for part in np.unique(parts) if 1 <= part < 20]
        return float(np.abs(np.array(means) / self.nominal_pa - 1.0).max())

    @property
    def _last(self) -> NDArray[np.bool_]:
        return self.displacement_m >= (1.0 - RESIDUAL_PART) * self.displacement_m[-1]

    def residual(self) -> tuple[float, float]:
        """Normal and shear stress [Pa], mean over the last RESIDUAL_PART of the travel."""
        return float(self.normal_pa[self._last].mean()), float(self.shear_pa[self._last].mean())

    @property
    def residual_dilatancy(self) -> float:
        """Rise of the lid over displacement in the last RESIDUAL_PART: near 0 in the critical state."""
        return float(np.polyfit(self.displacement_m[self._last], self.rise_m[self._last], 1)[0])


@dataclass(frozen=True)
class TensionCurve:
    """One tension test; arrays (n,)."""

    opening_m: NDArray[np.float64]
    tension_pa: NDArray[np.float64]
    break_height: float  # part of the height below the crack, 0.5: in the middle
    speed_m_per_s: float

    @property
    def strength_pa(self) -> float:
        """Largest tension."""
        return float(self.tension_pa.max())


@dataclass(frozen=True)
class SoilTests:
    """All tests of one soil."""

    specimen: Specimen
    size_m: Size
    shear: tuple[ShearCurve, ...]
    plate: tuple[ShearCurve, ...]  # over metal; empty: not run
    tension: TensionCurve | None  # none: a soil without adhesion
