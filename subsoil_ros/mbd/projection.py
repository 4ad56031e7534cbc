"""Projection of a guessed pose onto the constraints by the least motion, each part weighted by inertia."""

from dataclasses import dataclass, field

import numpy as np

from .geometry import turns_of
from .joints.constraints import evaluate_jacobian, evaluate_residual
from .joints.rows import DRIVER
from .machine import Machine

TOLERANCE = 1e-13
"""Largest residual of closed positions, as a part of the machine's size, if round-off allows it."""

RANK_TOLERANCE = 1e-9
"""Singular values of the scaled Jacobian below this part of the largest count as zero."""

LAST_ITERATION = 300
LARGEST_MOVE = 0.2
"""A step moves no coordinate by more than this part of the machine's size."""


@dataclass(frozen=True)
class Closure:
    """The constraints of a machine at t = 0, with coordinates held beside them."""

    machine: Machine
    drivers: bool = True  # rows of drivers count
    held: dict[int, float] = field(default_factory=dict)  # index into q: value [m, rad]

    def _rows(self) -> np.ndarray:
        kinds = self.machine.model.joints["kind"][self.machine.row_joint]
        return np.ones(len(kinds), dtype=bool) if self.drivers else kinds < DRIVER

    def names(self) -> list[str]:
        """Scene keys of the joints and coordinates that the rows belong to, one a row."""
        machine = self.machine
        names = [f"joints.{machine.joints[j]}" for j in machine.row_joint[self._rows()]]
        units = ("x_m", "z_m", "angle_rad")
        held = [f"initial.coordinates.{machine.bodies[i // 3]}.{units[i % 3]}" for i in self.held]
        return names + held

    def residual(self, q: np.ndarray) -> np.ndarray:
        """Scaled residual [m] of all rows."""
        model = self.machine.model
        phi = np.zeros(len(model.row_scale))
        evaluate_residual(model, 0.0, 0.0, q, turns_of(q), phi)
        held = [(q[i] - value) / model.column_scale[i] for i, value in self.held.items()]
        return np.concatenate([phi[self._rows()], held])

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Scaled Jacobian (rows, n)."""
        model = self.machine.model
        matrix = np.zeros((len(model.row_scale), len(q)))
        evaluate_jacobian(model, q, turns_of(q), matrix)
        held = np.zeros((len(self.held), len(q)))
        held[np.arange(len(self.held)), list(self.held)] = 1.0
        return np.concatenate([matrix[self._rows()], held])[:, : len(model.mass)]

    def tolerance(self, q: np.ndarray) -> float:
        """Largest residual [m] of a closed pose."""
        return max(TOLERANCE * self.machine.model.size, 2e-15 * float(np.abs(q).max()))

    def close(self, q: np.ndarray) -> tuple[np.ndarray, bool]:
        """The closed pose nearest to `q` (to first order), or the least-squares pose and False.

        Levenberg-Marquardt in coordinates weighted by the square roots of the masses.
        """
        model = self.machine.model
        weight = model.column_scale / np.sqrt(scaled_mass(self.machine))
        q = q.copy()
        phi = self.residual(q)
        damping = 0.0
        for _ in range(LAST_ITERATION):
            if np.abs(phi).max(initial=0.0) <= self.tolerance(q):
                return q, True
            left, values, right = np.linalg.svd(
                self.jacobian(q) / np.sqrt(scaled_mass(self.machine)), full_matrices=False
            )
            kept = values > RANK_TOLERANCE * values[0]
            factors = np.where(kept, values, 0.0) / (values**2 + damping * values[0] ** 2 + ~kept)
            move = -weight * (right.T @ (factors * (left.T @ phi)))
            largest = float(np.abs(move / model.column_scale).max(initial=1e-300))
            move *= min(1.0, LARGEST_MOVE * model.size / largest)
            trial = q.copy()
            trial[: len(move)] += move
            trial_phi = self.residual(trial)
            if np.linalg.norm(trial_phi) < np.linalg.norm(phi):
                q, phi = trial, trial_phi
                damping = 0.0 if damping < 1e-6 else 0.1 * damping
            else:
                damping = max(10.0 * damping, 1e-6)
                if damping > 1e12:
                    break
        return q, bool(np.abs(phi).max(initial=0.0) <= 10.0 * self.tolerance(q))


def scaled_mass(machine: Machine) -> np.ndarray:
    """Masses (n,) [kg] of the scaled coordinates."""
    return machine.model.mass * machine.model.column_scale**2
