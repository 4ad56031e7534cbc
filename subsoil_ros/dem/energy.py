"""Where the soil's energy is and went."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EnergyBook:
    """Where the soil's energy is and went [J]. Sinks count from the start, with `book` only."""

    kinetic_joule: float
    gravity_joule: float  # zero at z = 0
    stored_joule: float  # in contacts: normal, tangential and rolling springs
    sinks_joule: dict[str, float]  # by dem.contact.SINKS
    tool_work_joule: float  # done by the tools on the soil
    carried_joule: float = 0.0  # that came in with soil laid out, less what left with soil taken away

    @property
    def total_joule(self) -> float:
        """What stays constant: stored, moving and dissipated energy less the work put in."""
        inside = self.kinetic_joule + self.gravity_joule + self.stored_joule
        return inside + sum(self.sinks_joule.values()) - self.tool_work_joule - self.carried_joule

    @property
    def turned_over_joule(self) -> float:
        """Dissipated, and put in by tools or taken out, so far."""
        return sum(self.sinks_joule.values()) + abs(self.tool_work_joule)
