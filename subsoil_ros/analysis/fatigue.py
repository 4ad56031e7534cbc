"""Load cycles of a spring: rainflow count (ASTM E1049-85), and one range that does the same damage.

By Palmgren and Miner with a Woehler line N ~ range^-m, cycles n_i of ranges R_i do the damage of f T cycles
of

    R_eq = (sum n_i R_i^m / (f T))^(1/m)

in the time T. Mean loads are listed but not weighed: that needs the wire's diameter and the spring's stress.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .series import write_table_csv

EXPONENT = 5.0
"""m of steel that is not welded, normal stress (FKM guideline, Analytical Strength Assessment, 6th ed.
2012)."""

REFERENCE_HZ = 1.0
"""f: cycles per second of the equivalent range, the frequency that the paper prints."""


@dataclass(frozen=True)
class LoadCycles:
    """Cycles of one force in the order they close; arrays (k,)."""

    range_newton: NDArray[np.float64]
    mean_newton: NDArray[np.float64]
    count: NDArray[np.float64]  # 1, or 1/2 for what never closes
    duration_s: float

    @property
    def max_range_newton(self) -> float:
        """Largest range [N]; 0 without a cycle."""
        return float(self.range_newton.max(initial=0.0))

    def equivalent_range_newton(
        self, exponent: float = EXPONENT, frequency_hz: float = REFERENCE_HZ
    ) -> float:
        """Range that does the same damage at `frequency_hz`."""
        damage = float(self.count @ self.range_newton**exponent)
        return float((damage / (frequency_hz * self.duration_s)) ** (1.0 / exponent))


def load_cycles(force_newton: NDArray[np.float64], duration_s: float) -> LoadCycles:
    """Rainflow count of a force (n,) [N] recorded for `duration_s`."""
    import rainflow

    found = [cycle[:3] for cycle in rainflow.extract_cycles(force_newton.tolist()) if cycle[0] > 0.0]
    table = np.array(found, dtype=np.float64).reshape(-1, 3)
    return LoadCycles(table[:, 0], table[:, 1], table[:, 2], duration_s)


def write_cycles_csv(cycles: LoadCycles, path: Path) -> None:
    """One row for each cycle, the largest range first."""
    order = np.argsort(-cycles.range_newton, kind="stable")
    names = ("range_newton", "mean_newton", "count")
    write_table_csv({name: getattr(cycles, name)[order] for name in names}, path)
