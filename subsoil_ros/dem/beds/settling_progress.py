"""Progress of the preparation of a bed."""

from collections.abc import Callable
from typing import NamedTuple


class SettlingProgress(NamedTuple):
    """Progress of one phase of a preparation."""

    phase: str
    simulated_s: float
    longest_s: float  # the phase ends then at the latest
    rms_speed_m_per_s: float
    rest_speed_m_per_s: float  # the phase ends below it


OnProgress = Callable[[SettlingProgress], None]
"""Called from time to time with the progress of a preparation."""


def ignore_progress(progress: SettlingProgress) -> None:
    """Show no progress."""
