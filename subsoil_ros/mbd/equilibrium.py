"""Static equilibrium: the pose of least potential energy that the constraints allow, drivers held."""

import warnings
from typing import NamedTuple

import numpy as np

from ..errors import SceneError
from .forces.evaluation import evaluate_forces, held_at, report_forces
from .forces.force_table import FRICTIONS, POINT_LOAD
from .geometry import turns_of
from .machine_arrays import Model
from .projection import RANK_TOLERANCE, Closure, scaled_mass

RESIDUAL = 1e-10
"""Largest force along the freedoms at rest, as a part of all forces."""

SOFTEST = 1e-8
"""Part of the largest stiffness that is added to every freedom in a step, which avoids division by zero."""

LARGEST_MOVE = 0.1
"""A step moves no coordinate by more than this part of the machine's size."""

LAST_ITERATION = 400
FARTHEST = 100.0
"""Way, in sizes of the machine, after which it is taken to sink without end."""


UNSTABLE = 1e-8
"""Size of a negative stiffness over mass, as a part of the largest one or of gravity over the machine's size,
from which on the equilibrium is unstable: above the error of differences, 1e-10."""


class UnstableEquilibriumWarning(UserWarning):
    """The equilibrium pose is unstable: the machine leaves it at the smallest disturbance."""


class _Pull(NamedTuple):
    """Forces on the machine at a pose, in coordinates weighted by the square roots of the masses."""

    along: np.ndarray  # (f,) forces along the freedoms
    basis: np.ndarray  # (n, f) orthonormal, the freedoms
    total: float  # size of gravity and of the other forces, those that constraints carry included

    @property
    def free(self) -> float:
        """Size of the forces along the freedoms; 0 at rest."""
        return float(np.linalg.norm(self.along))


def settle(closure: Closure, q: np.ndarray) -> np.ndarray:
    """The equilibrium pose (n + 3,) reached from `q` under gravity, springs and wheel contact.

    Newton's method on the potential energy along the freedoms. It uses the magnitude of every stiffness, so
    that the energy falls, and a trust radius. A freedom without force or stiffness (the spin of a wheel)
    stays as it is.

    Raises:
        SceneError: there is no equilibrium below this pose.
    """
    model = _at_rest(closure.machine.model)
    root = np.sqrt(scaled_mass(closure.machine))
    start, radius = q, LARGEST_MOVE * model.size
    pull, energy = _pull(closure, model, q, root), _energy(model, q)
    negligible = 0.0
    for _ in range(LAST_ITERATION):
        negligible = max(negligible, RESIDUAL * pull.total)
        if pull.free <= negligible:
            if pull.basis.shape[1]:
                _say_unstable(closure, _stiffness(closure, model, q, root, pull.basis), pull, root)
            return q
        if np.abs(q - start).max() > FARTHEST * model.size:
            break
        stiffness = _stiffness(closure, model, q, root, pull.basis)
        move = _newton_move(pull, stiffness, negligible, model.size) / root
        move *= min(1.0, radius / np.abs(move).max())
        trial = q.copy()
        trial[: len(move)] += move * model.column_scale
        trial, closed = closure.close(trial)
        trial_energy, trial_pull = _energy(model, trial), _pull(closure, model, trial, root)
        if closed and (trial_energy < energy or trial_pull.free < 0.5 * pull.free):
            q, energy, pull = trial, trial_energy, trial_pull
            radius = min(2.0 * radius, LARGEST_MOVE * model.size)
        else:
            radius = 0.25 * float(np.abs(move).max())
    raise _no_equilibrium(closure, pull, root)


def _say_unstable(closure: Closure, stiffness: np.ndarray, pull: _Pull, root: np.ndarray) -> None:
    values, vectors = np.linalg.eigh(stiffness)
    model = closure.machine.model
    largest = max(float(np.abs(values).max(initial=0.0)), model.gravity / model.size)
    if values.min(initial=0.0) < -UNSTABLE * largest:
        moves = np.abs(pull.basis @ vectors[:, 0] / root).reshape(-1, 3)
        body = closure.machine.bodies[int(moves.max(axis=1).argmax())]
        warnings.warn(
            f"mechanism.initial.static_equilibrium: the pose is an unstable equilibrium: body '{body}' "
            "leaves it at any disturbance. Give the bodies a pose from which they come to rest below.",
            UnstableEquilibriumWarning,
            stacklevel=4,
        )


def _newton_move(pull: _Pull, stiffness: np.ndarray, negligible: float, size: float) -> np.ndarray:
    """Step (n,) in mass-weighted coordinates."""
    values, vectors = np.linalg.eigh(stiffness)
    least = pull.free / size
    firm = np.abs(values) + SOFTEST * max(float(np.abs(values).max()), least)
    along = vectors.T @ pull.along
    # Differences have errors of about 1e-10 of the largest stiffness. As much of the whole pull appears along
    # every freedom, and would turn a wheel on which no torque acts.
    noise = max(negligible, SOFTEST * pull.free)
    idle = (np.abs(values) < SOFTEST * firm.max()) & (np.abs(along) < noise)
    return pull.basis @ (vectors @ np.where(idle, 0.0, along / firm))


def _at_rest(model: Model) -> Model:
    """The model without loads, dampers and friction: only what has a potential energy."""
    lost = np.isin(model.forces["kind"], (POINT_LOAD, *FRICTIONS))
    forces = model.forces[~lost].copy()
    forces["damping"] = 0.0
    forces["stop_damping"] = 0.0
    forces["friction"] = 0.0
    forces["stick_stiffness"] = 0.0
    return model._replace(forces=forces)


def _energy(model: Model, q: np.ndarray) -> float:
    """Potential energy [J]."""
    count = len(model.mass)
    turns, still = turns_of(q), np.zeros_like(q)
    held = held_at(model, 0.0, 0.0, q, still)
    stored = report_forces(model, held, 0.0, 0.0, q, turns, still, np.zeros((len(model.forces), 3)))
    return float(stored + model.gravity * np.sum(model.mass[1::3] * q[1:count:3]))


def _forces(model: Model, q: np.ndarray) -> np.ndarray:
    """Scaled generalised forces (n,) [N]."""
    total, still = np.zeros_like(q), np.zeros_like(q)
    held = held_at(model, 0.0, 0.0, q, still)
    evaluate_forces(model, held, 0.0, 0.0, q, turns_of(q), still, total, np.zeros(3))
    return total[: len(model.mass)] * model.column_scale


def _pull(closure: Closure, model: Model, q: np.ndarray, root: np.ndarray) -> _Pull:
    _, values, right = np.linalg.svd(closure.jacobian(q) / root)
    rank = int(np.sum(values > RANK_TOLERANCE * values.max(initial=0.0)))
    basis = right[rank:].T
    force = _forces(model, q) / root
    gravity = _forces(model._replace(forces=model.forces[:0]), q) / root
    return _Pull(basis.T @ force, basis, float(np.linalg.norm(gravity) + np.linalg.norm(force - gravity)))


def _stiffness(
    closure: Closure, model: Model, q: np.ndarray, root: np.ndarray, free: np.ndarray
) -> np.ndarray:
    """Second derivative (f, f) of the energy along the constraints, by central differences.

    The curvature of the constraints enters through the multipliers, held fixed in the differences.
    """
    multipliers = np.linalg.lstsq(closure.jacobian(q).T, _forces(model, q), rcond=1e-9)[0]
    columns = []
    for direction in (free / root[:, None]).T:
        size = 1e-6 * model.size / np.abs(direction).max()
        ends = []
        for side in (size, -size):
            moved = q.copy()
            moved[: len(direction)] += side * direction * model.column_scale
            ends.append(closure.jacobian(moved).T @ multipliers - _forces(model, moved))
        columns.append((ends[0] - ends[1]) / (2.0 * size))
    matrix = free.T @ (np.array(columns).reshape(len(columns), -1).T / root[:, None])
    return 0.5 * (matrix + matrix.T)


def _no_equilibrium(closure: Closure, pull: _Pull, root: np.ndarray) -> SceneError:
    rest = np.abs(root * (pull.basis @ pull.along)).reshape(-1, 3)
    body = closure.machine.bodies[int(rest.max(axis=1).argmax())]
    return SceneError(
        f"mechanism.initial.static_equilibrium: there is no pose of rest below the start: body '{body}' is "
        f"still pulled by {rest.max():.3g} N. Give it a wheel_contact, a spring or a joint that holds it, or "
        "switch static_equilibrium off."
    )
