"""What the constraints of a machine leave free."""

import warnings
from dataclasses import dataclass

from ..scene.mechanism import Mechanism
from .assembly import RedundantConstraintsWarning, Start, assemble


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


def analyse_topology(mechanism: Mechanism, gravity_m_per_s2: float = 9.81) -> Topology:
    """Assemble a machine and count its freedoms; no warning about redundancy.

    Raises:
        SceneError, SingularMechanismError: as assembly.assemble.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RedundantConstraintsWarning)
        return Topology.of(assemble(mechanism, gravity_m_per_s2, step_s=1.0))
