"""What a device computes of a soil: the contract of dem.cpu_steps, dem.gpu and dem.lammps."""

from collections.abc import Sequence
from typing import Protocol

from ..messages import ToolMotion
from .cpu_steps import CpuSteps
from .monitors import MotionSums
from .particles import Particles
from .state import SoilState
from .step_checks import StepChecks


class Steps(Protocol):
    """Soil steps on a device: all that is computed differently there."""

    state: SoilState

    def advance(self, tick: int, way: Sequence[tuple[ToolMotion, ...]], checks: StepChecks) -> None:
        """Run the soil steps of a tick, at whose ends the tools are at `way`."""
        ...

    def first_forces(self, motions: tuple[ToolMotion, ...]) -> None:
        """Compute the forces of the initial state."""
        ...

    def rebuild(self, motions: tuple[ToolMotion, ...]) -> None:
        """Build all lists anew, tools being at `motions`."""
        ...

    def damp(self, kept: float) -> None:
        """Every linear and angular velocity times `kept`."""
        ...

    def particles(self) -> Particles:
        """The particles of the state, brought to the end of the last step."""
        ...

    def take_boundaries(self) -> None:
        """Bring the contacts of walls and tools in the state up to date."""
        ...

    def to_host(self) -> CpuSteps:
        """Bring the whole state up to date; steps of it on the CPU."""
        ...

    def from_host(self) -> None:
        """Go on from the state, which was replaced or changed."""
        ...

    def listed_pair_count(self) -> int:
        """Pairs in the neighbour list, the skin included."""
        ...

    def flush_books(self) -> None:
        """Add what was booked to the sinks of the state."""
        ...

    def motion_sums(self) -> MotionSums:
        """Sums over particles from which the monitors judge motion."""
        ...

    def any_outside(self) -> bool:
        """Whether a particle may have left the domain."""
        ...

    def moving_joule(self) -> tuple[float, float]:
        """Kinetic energy and that of gravity, zero at z = 0."""
        ...

    def contacts(self) -> tuple[int, float]:
        """Contacts in reach, and the largest overlap [m]."""
        ...

    def stored_in_pairs_joule(self) -> float:
        """Energy stored between particles, bonds apart."""
        ...
