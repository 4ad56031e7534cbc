"""The energy book of the soil."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EnergyBook:
    """Energy of the soil, and its sinks since the start [J]; sinks are booked with `book` only."""

    kinetic_joule: float
    gravity_joule: float  # zero at z = 0
    stored_joule: float  # in contacts: normal, tangential and rolling springs
    sinks_joule: dict[str, float]  # by name: ContactLaw.sinks, and those of bonds
    tool_work_joule: float  # done by the tools on the soil
    carried_joule: float = 0.0  # of soil that was added, less that of soil removed

    @property
    def total_joule(self) -> float:
        """Sum that stays constant: energy in the soil and dissipated, less tool work and carried energy."""
        inside = self.kinetic_joule + self.gravity_joule + self.stored_joule
        return inside + sum(self.sinks_joule.values()) - self.tool_work_joule - self.carried_joule

    @property
    def turned_over_joule(self) -> float:
        """Energy dissipated so far, plus the magnitude of the work of the tools."""
        return sum(self.sinks_joule.values()) + abs(self.tool_work_joule)
