"""The machine linearised about a pose: natural frequencies, damping, and the shape of every mode."""

import math
from dataclasses import dataclass

import numpy as np

from .forces.elastic import engaged_mode
from .forces.evaluation import Held, evaluate_forces, held_at
from .forces.force_table import WHEEL_CONTACT
from .forces.wheel_contact import PRESSED
from .geometry import turns_of
from .machine import Machine
from .projection import RANK_TOLERANCE, Closure, scaled_mass

RIGID = 1e-5
"""An eigenvalue below this part of the largest (or of 1 rad/s) belongs to a motion without stiffness."""

NAMED_PART = 0.3
"""Coordinates with this part of the largest displacement are named in a mode."""

NAMED_COUNT = 4
COORDINATES = ("x", "z", "angle")


@dataclass(frozen=True)
class Linearised:
    """M y'' + C y' + K y = 0 for the freedoms y."""

    mass: np.ndarray  # (f, f) float64
    damping: np.ndarray  # (f, f)
    stiffness: np.ndarray  # (f, f)
    basis: np.ndarray  # (n, f): scaled coordinates per freedom


@dataclass(frozen=True)
class Mode:
    """One mode of free motion, which changes as exp(eigenvalue t)."""

    eigenvalue: complex  # [1/s], of non-negative imaginary part
    shape: np.ndarray  # (n,) complex128: scaled coordinates [m], the largest is 1
    words: str  # the largest coordinates

    @property
    def oscillates(self) -> bool:
        return self.eigenvalue.imag > 0.0

    @property
    def frequency_hz(self) -> float:
        """Natural (undamped) frequency."""
        return abs(self.eigenvalue) / (2.0 * math.pi)

    @property
    def damping_ratio(self) -> float:
        """1 where it is critically damped; negative where it grows."""
        return -self.eigenvalue.real / abs(self.eigenvalue) if self.eigenvalue != 0.0 else 0.0


def linearise(machine: Machine, q: np.ndarray, *, engaged: bool = False) -> Linearised:
    """Linearise about the pose `q` (n + 3,) at rest, at t = 0; with `engaged` all one-sided forces act.

    Stiffness: K = N^T d(Phi_q^T lambda - F)/dq N by central differences, multipliers held, so that it has
    the rotation of loaded joints. The columns of N are the motions that the constraints allow.
    """
    model, closure = machine.model, Closure(machine)
    count, still = len(model.mass), np.zeros_like(q)
    root = np.sqrt(scaled_mass(machine))
    jacobian = closure.jacobian(q)
    _, values, right = np.linalg.svd(jacobian / root)
    rank = int(np.sum(values > RANK_TOLERANCE * values.max(initial=0.0)))
    free = right[rank:].T  # orthonormal in coordinates weighted by the roots of the masses
    held = held_at(model, 0.0, 0.0, q, still)
    scaled = np.linalg.lstsq(jacobian.T, _forces(machine, held, q, still), rcond=RANK_TOLERANCE)[0]
    held = held._replace(multipliers=model.row_scale * scaled)
    if engaged:
        held = held._replace(modes=_engaged(machine, held))

    def unbalanced(at: np.ndarray) -> np.ndarray:
        pull: np.ndarray = closure.jacobian(at).T @ scaled - _forces(machine, held, at, still)
        return pull

    stiffness, damping = [], []
    for direction in (free / root[:, None]).T:
        size = 1e-6 * model.size / np.abs(direction).max()
        move = np.zeros_like(q)
        move[:count] = size * direction * model.column_scale
        stiffness.append((unbalanced(q + move) - unbalanced(q - move)) / (2.0 * size))
        ends = [_forces(machine, held, q, side * move * 1e-2) for side in (1.0, -1.0)]
        damping.append((ends[1] - ends[0]) / (2.0 * size * 1e-2))
    freedom = free.shape[1]
    inner = (free / root[:, None]).T
    return Linearised(
        mass=np.eye(freedom),
        damping=inner @ np.array(damping).reshape(freedom, count).T,
        stiffness=inner @ np.array(stiffness).reshape(freedom, count).T,
        basis=free / root[:, None],
    )


def _forces(machine: Machine, held: Held, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Scaled generalised forces (n,) [N]."""
    model, total = machine.model, np.zeros_like(q)
    evaluate_forces(model, held, 0.0, 0.0, q, turns_of(q), v, total, np.zeros(3))
    return total[: len(model.mass)] * model.column_scale


def _engaged(machine: Machine, held: Held) -> np.ndarray:
    """Modes in which every one-sided force acts and every table is on its steepest segment."""
    model, modes = machine.model, held.modes.copy()
    for i, force in enumerate(model.forces):
        if force["kind"] == WHEEL_CONTACT:
            modes[i] = PRESSED
        else:
            modes[i] = engaged_mode(force, model.curves, int(modes[i]))
    return modes


def modes_of(machine: Machine, system: Linearised) -> tuple[Mode, ...]:
    """All modes, slowest first; one for each pair of complex eigenvalues."""
    freedom = len(system.mass)
    if freedom == 0:
        return ()
    matrix = np.block([[np.zeros((freedom, freedom)), np.eye(freedom)], [-system.stiffness, -system.damping]])
    values, vectors = np.linalg.eig(matrix)
    floor = RIGID * max(1.0, float(np.abs(values).max()) ** 0.5)
    modes = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag < 0.0:
            continue
        eigenvalue = complex(value) if abs(value) > floor else 0.0j
        shape = system.basis @ vector[:freedom]
        largest = shape[np.abs(shape).argmax()]
        if largest == 0.0:
            continue
        shape = shape / largest
        modes.append(Mode(eigenvalue, shape, _words(machine, shape)))
    return tuple(sorted(modes, key=lambda mode: (abs(mode.eigenvalue), mode.words)))


def _words(machine: Machine, shape: np.ndarray) -> str:
    """'shank angle 1, frame z -0.4': parts of the largest displacement, angles times the machine's size."""
    order = np.argsort(-np.abs(shape), kind="stable")
    named = [i for i in order[:NAMED_COUNT] if abs(shape[i]) >= NAMED_PART]
    parts = np.copysign(np.abs(shape), shape.real)
    return ", ".join(f"{machine.bodies[i // 3]} {COORDINATES[i % 3]} {parts[i]:.2g}" for i in named)
