"""Numbers of constraints and freedoms of a machine."""

from dataclasses import dataclass

from .assembly import Start


@dataclass(frozen=True)
class Topology:
    """Counts of a machine in its initial pose."""

    coordinate_count: int
    constraint_count: int  # all rows, drivers included
    freedom_count: int  # coordinates less independent constraints
    redundant_count: int  # constraints that repeat others
    redundant_joints: tuple[str, ...]  # their reactions are not unique

    @classmethod
    def of(cls, start: Start) -> "Topology":
        """Counts of an assembled machine."""
        coordinates, rows = len(start.machine.model.mass), len(start.machine.row_joint)
        return cls(coordinates, rows, coordinates - start.rank, rows - start.rank, start.redundant)
