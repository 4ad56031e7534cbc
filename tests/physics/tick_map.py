"""The exact map of one tick for a mass on a linear soil, with exchange and integrators of docs/coupling.md.

Everything is linear, so the map of the whole state is a matrix, found column by column from unit states; its
spectral radius says whether the exchange is stable. Written apart from the engines: only the weights of
the multistep formulas are theirs (test_mbd_orders.py verifies those).
"""

from dataclasses import dataclass

import numpy as np

from subsoil_ros.mbd.explicit_integrators import CORRECT_Q, CORRECT_V, PREDICT_Q, PREDICT_V, multistep_weights

DAMPING_RADIUS = 0.8
ALPHA_M = (2.0 * DAMPING_RADIUS - 1.0) / (DAMPING_RADIUS + 1.0)
ALPHA_F = DAMPING_RADIUS / (DAMPING_RADIUS + 1.0)
GAMMA = 0.5 + ALPHA_F - ALPHA_M
BETA = 0.25 * (GAMMA + 0.5) ** 2


@dataclass(frozen=True)
class Exchange:
    """A mass on its own spring and damper, and on a soil of one spring and one damper. SI."""

    interval: float
    stiffness: float  # soil
    damping: float  # soil
    mass: float = 1.0
    own_stiffness: float = 0.0  # mechanism
    own_damping: float = 0.0
    force: str = "tick_end"
    soil_steps: int = 1
    mechanism_steps: int = 1
    integrator: str = "adams_moulton"
    order: int = 4

    @property
    def past_count(self) -> int:
        """Accelerations the integrator remembers beside the present one."""
        return {"adams_moulton": self.order - 1, "runge_kutta_4": 0, "generalized_alpha": 1}[self.integrator]

    @property
    def size(self) -> int:
        """State: place, speed, acceleration, past accelerations, force held next; of a predicted exchange all
        but the force are those at the start of the tick that the force is of."""
        return 3 + self.past_count + 1

    def tick(self, state: np.ndarray) -> np.ndarray:
        """The state one tick later."""
        past = self.past_count
        x, v, a = state[:3]
        history, force = state[3 : 3 + past], state[3 + past]
        x_end, v_end, a_end, history = self._mechanism(x, v, a, history, force)
        ahead = self.interval if self.force == "predicted" else 0.0
        answer = self._soil(x + ahead * v, v, x_end + ahead * v_end, v_end)
        return np.array([x_end, v_end, a_end, *history, answer])

    def matrix(self) -> np.ndarray:
        """(size, size) float64 map of a tick."""
        return np.stack([self.tick(unit) for unit in np.eye(self.size)], axis=1)

    def radius(self) -> float:
        """Spectral radius of the map."""
        return float(np.abs(np.linalg.eigvals(self.matrix())).max())

    def _soil(self, x0: float, v0: float, x1: float, v1: float) -> float:
        """Force on the mass: the tool goes along the cubic through both ends in `soil_steps` equal steps."""
        h = self.interval
        # x0 + v0 t + b t^2 + c t^3 with both ends met
        b = (3.0 * (x1 - x0) / h - 2.0 * v0 - v1) / h
        c = (v0 + v1 - 2.0 * (x1 - x0) / h) / h**2
        t = h * np.arange(1, self.soil_steps + 1) / self.soil_steps
        x = x0 + t * (v0 + t * (b + t * c))
        v = v0 + t * (2.0 * b + t * 3.0 * c)
        forces = -self.stiffness * x - self.damping * v
        return float(forces[-1] if self.force == "tick_end" else forces.mean())

    def _acceleration(self, x: float, v: float, force: float) -> float:
        return (force - self.own_stiffness * x - self.own_damping * v) / self.mass

    def _mechanism(
        self, x: float, v: float, a: float, history: np.ndarray, force: float
    ) -> tuple[float, float, float, np.ndarray]:
        """One tick under a held force; the change it causes now moves all that is remembered."""
        now = self._acceleration(x, v, force)
        history = history + (now - a)
        step = self.interval / self.mechanism_steps
        advance = {
            "adams_moulton": self._adams_moulton,
            "runge_kutta_4": self._runge_kutta,
            "generalized_alpha": self._generalized_alpha,
        }[self.integrator]
        for _ in range(self.mechanism_steps):
            x, v, history = advance(x, v, now, history, force, step)
            now = self._acceleration(x, v, force)
        return x, v, now, history

    def _adams_moulton(self, x, v, now, history, force, h):
        weights, known = multistep_weights(self.order), np.array([now, *history])
        ahead_x = x + h * (v + h * weights[PREDICT_Q] @ known)
        ahead_v = v + h * weights[PREDICT_V] @ known
        newest = np.array([self._acceleration(ahead_x, ahead_v, force), *known[:-1]])
        x, v = x + h * (v + h * weights[CORRECT_Q] @ newest), v + h * weights[CORRECT_V] @ newest
        return x, v, known[:-1]

    def _runge_kutta(self, x, v, now, history, force, h):
        """Of a linear system: the Taylor series to the fourth order, acceleration a = a(force) - ..."""
        rate = np.array([[0.0, 1.0], [-self.own_stiffness / self.mass, -self.own_damping / self.mass]])
        term, state = np.array([v, now]) * h, np.array([x, v])
        for order in range(2, 6):
            state = state + term
            term = rate @ term * h / order
        return state[0], state[1], history

    def _generalized_alpha(self, x, v, now, history, force, h):
        """Chung & Hulbert 1993 with the auxiliary acceleration p, which is what is remembered."""
        (p,) = history

        def ahead(q):
            return (
                x + h * (v + h * ((0.5 - BETA) * p + BETA * q)),
                v + h * ((1.0 - GAMMA) * p + GAMMA * q),
            )

        def miss(q):
            sought = (1.0 - ALPHA_F) * self._acceleration(*ahead(q), force) + ALPHA_F * now
            return (1.0 - ALPHA_M) * q + ALPHA_M * p - sought

        q = miss(0.0) / (miss(0.0) - miss(1.0))  # it is linear in q
        return *ahead(q), np.array([q])
