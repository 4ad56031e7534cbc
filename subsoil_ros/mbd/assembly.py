"""A consistent start: positions and velocities on the constraints, and what the constraints leave free."""

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np

from ..errors import SceneError
from ..scene.mechanism import Driver, Mechanism
from .equilibrium import settle
from .forces.force_table import FRICTIONS
from .function_tables import function_value
from .geometry import turns_of
from .joints.constraints import evaluate_gamma, evaluate_residual, evaluate_speed
from .joints.rows import DRIVER, RELATIVE_DRIVER
from .machine import Machine, build_machine
from .projection import RANK_TOLERANCE, Closure, scaled_mass

CONTRADICTION = 1e-9
"""Part of the largest entry by which Phi_q q' = -Phi_t may fail before constraints contradict."""


LARGEST_GAP = 0.1
"""Gap of a joint in the pose that the scene gives, over the machine's size, beyond which the scene is
refused. Rounded coordinates and small adjustments pass; a larger gap is more likely an error of input."""

LEAST_GAP = 1e-9
"""Likewise, below which it is round-off."""


MISSED_VELOCITY = 1e-6
"""Part of the largest velocity that the scene gives, or of 1, above which a missed one causes a warning."""


class MovedBodiesWarning(UserWarning):
    """A machine does not start as the scene gives it: joints do not meet, or forbid a velocity."""


class RedundantConstraintsWarning(UserWarning):
    """Some constraints repeat others: motion is determined, some joint reactions are not."""


@dataclass(frozen=True)
class Start:
    """A machine in its initial state."""

    machine: Machine  # drivers start from their coordinate in `q`
    q: np.ndarray  # (n + 3,) float64 [m, m, rad]
    v: np.ndarray  # (n + 3,) float64 [m/s, m/s, rad/s]
    rank: int  # independent constraints
    redundant: tuple[str, ...]  # joints whose reactions are not unique
    moved: str  # how far bodies were moved onto their joints, in words; empty where they fit


def assemble(mechanism: Mechanism, gravity: float, step_s: float) -> Start:
    """Positions and velocities at t = 0.

    Raises:
        SceneError: bodies that cannot be assembled, constraints that contradict each other, or a
            static equilibrium that does not exist; a pose that is singular.
    """
    machine = build_machine(mechanism, gravity, step_s)
    held = {
        machine.coordinate(*key.rsplit(".", 1)): value for key, value in mechanism.initial.coordinates.items()
    }
    q = machine.reference.copy()
    for index, value in held.items():
        q[index] = value
    q = _close(_drivers_from(machine, q), held, q)
    moved = _moved(machine, q, held)
    machine = _drivers_from(machine, q)
    if mechanism.initial.static_equilibrium:
        q = settle(Closure(machine, held=held), q)
        machine = _drivers_from(machine, q)
    rank, redundant = _count(machine, q)
    _refuse_unknown_pressure(machine, redundant)
    v = _velocities(machine, mechanism, q)
    if redundant:
        warnings.warn(
            f"mechanism.joints: {', '.join(redundant)}: {len(machine.row_joint) - rank} of the constraints "
            "repeat others; the motion is determined, but the reactions of these joints are not: the "
            "smallest ones are given. Remove a joint, or use one with fewer constraints.",
            RedundantConstraintsWarning,
            stacklevel=3,
        )
    if moved:
        warnings.warn(f"mechanism.joints: {moved}", MovedBodiesWarning, stacklevel=3)
    return Start(machine, q, v, rank, redundant, moved)


def _drivers_from(machine: Machine, q: np.ndarray) -> Machine:
    """The machine with its drivers starting from their coordinates in `q`."""
    joints = machine.model.joints.copy()
    model = machine.model._replace(joints=joints)
    driven = joints["kind"] == DRIVER
    joints["offset"][driven] = q[joints["coordinate"][driven]]
    relative = joints["kind"] == RELATIVE_DRIVER
    joints["offset"][relative] = 0.0
    phi = np.zeros(len(model.row_scale))
    evaluate_residual(model, 0.0, 0.0, q, turns_of(q), phi)
    rows = joints["row"][relative]
    joints["offset"][relative] = phi[rows] / model.row_scale[rows]
    return replace(machine, model=model)


def _close(machine: Machine, held: dict[int, float], q: np.ndarray) -> np.ndarray:
    """Return `q` closed onto the constraints; driven coordinates keep their values if possible."""
    closed, success = Closure(machine, held=held).close(q)
    if success:
        return closed
    free = Closure(machine, drivers=False, held=held)
    closed, success = free.close(q)
    if success:
        return closed
    phi = np.abs(free.residual(closed))
    gaps: dict[str, float] = {}
    for name, gap in zip(free.names(), phi, strict=True):
        gaps[name] = max(gaps.get(name, 0.0), float(gap))
    open_parts = [f"{name} by {gap:.3g} m" for name, gap in gaps.items() if gap > 0.01 * phi.max()]
    raise SceneError(
        f"mechanism: the bodies cannot be assembled: the nearest pose is open in {', '.join(open_parts)} "
        f"(angles times the machine's size of {machine.model.size:.3g} m). Correct the joint points, the "
        "bodies' positions and angles, or initial.coordinates, so that all meet in one pose."
    )


def _moved(machine: Machine, q: np.ndarray, held: dict[int, float]) -> str:
    """Describe how bodies were moved onto joints whose two points differ; `q`: the closed pose.

    Raises:
        SceneError: a gap is beyond LARGEST_GAP.
    """
    free, size = Closure(machine, drivers=False), machine.model.size
    gaps: dict[str, float] = {}
    for name, gap in zip(free.names(), free.residual(machine.reference), strict=True):
        gaps[name] = math.hypot(gaps.get(name, 0.0), float(gap))
    name, gap = max(gaps.items(), key=lambda item: item[1], default=("", 0.0))
    if gap > LARGEST_GAP * size:
        raise SceneError(
            f"mechanism.{name}: its two points are {gap:.3g} m apart in the given pose, more than "
            f"{LARGEST_GAP:.0%} of the machine's size of {size:.3g} m. Correct point_m, point_b_m or the "
            "poses of the bodies."
        )
    if gap <= LEAST_GAP * size:
        return ""
    words = f"the points of {name.removeprefix('joints.')} are {1e3 * gap:.3g} mm apart in the given pose"
    if held:
        return words
    way = np.hypot(*(q - machine.reference)[: 3 * len(machine.bodies)].reshape(-1, 3)[:, :2].T)
    body = machine.bodies[int(np.argmax(way))]
    return f"{words}; bodies were moved onto their joints, {body} by {1e3 * way.max():.3g} mm"


def _null_rows(matrix: np.ndarray) -> tuple[int, np.ndarray]:
    """Rank, and an orthonormal basis (rows, rows - rank) of what the rows repeat."""
    if 0 in matrix.shape:
        return 0, np.eye(matrix.shape[0])
    left, values, _ = np.linalg.svd(matrix)
    rank = int(np.sum(values > RANK_TOLERANCE * values[0])) if values[0] > 0.0 else 0
    return rank, left[:, rank:]


def _joints_of(machine: Machine, vectors: np.ndarray, part: float) -> tuple[str, ...]:
    """Joints whose rows have entries above `part` of the largest in `vectors` (m, any); none without rows."""
    if len(vectors) == 0:
        return ()
    strength = np.abs(vectors).max(axis=1)
    found = {int(machine.row_joint[i]) for i in np.flatnonzero(strength > part * strength.max())}
    return tuple(machine.joints[i] for i in sorted(found))


def weakest_joints(machine: Machine, q: np.ndarray) -> tuple[str, ...]:
    """The joints whose constraints come nearest to repeating each other at `q`."""
    left, _, _ = np.linalg.svd(Closure(machine).jacobian(q))
    return _joints_of(machine, left[:, min(left.shape[0], len(machine.model.mass)) - 1 :], 0.1)


def _count(machine: Machine, q: np.ndarray) -> tuple[int, tuple[str, ...]]:
    """Number of independent constraints, and the joints that repeat others.

    Raises:
        SceneError: the rank is higher in a neighbouring pose.
    """
    matrix = Closure(machine).jacobian(q)
    rank, null = _null_rows(matrix)
    if rank == matrix.shape[0]:
        return rank, ()
    if _neighbour_rank(machine, q) > rank:
        raise SceneError(
            f"mechanism: the initial pose is singular (a dead centre or a stretched linkage): joints "
            f"{', '.join(_joints_of(machine, null, 0.1))} do not determine the motion there. Start from "
            "another pose: change the bodies' positions or initial.coordinates."
        )
    return rank, _joints_of(machine, null, 1e-6)


def _refuse_unknown_pressure(machine: Machine, redundant: tuple[str, ...]) -> None:
    """Raise SceneError if friction depends on a reaction that is not unique."""
    for force in machine.model.forces:
        if force["kind"] in FRICTIONS and force["friction"] > 0.0:
            name = machine.joints[force["joint"]]
            if name in redundant:
                raise SceneError(
                    f"mechanism.joints.{name}.friction.coefficient: its reaction is not unique, "
                    f"as {', '.join(redundant)} repeat each other. Remove one of these joints, or give a "
                    "preload instead of a coefficient."
                )


def _neighbour_rank(machine: Machine, q: np.ndarray) -> int:
    """Largest rank of the Jacobian in poses a little along the freedoms of the undriven machine."""
    closure = Closure(machine, drivers=False)
    matrix = closure.jacobian(q)
    _, null = _null_rows(matrix.T)
    generator = np.random.default_rng(0)
    best = 0
    for _ in range(3):
        trial = q.copy()
        direction = null @ generator.normal(size=null.shape[1])
        trial[: len(direction)] += 1e-2 * machine.model.size * machine.model.column_scale * direction
        trial, closed = closure.close(trial)
        if closed:
            best = max(best, _null_rows(Closure(machine).jacobian(trial))[0])
    return best


def _refuse_contradiction(machine: Machine, matrix: np.ndarray, right: np.ndarray, what: str) -> None:
    """Raise SceneError if matrix x = right has no solution x."""
    _, null = _null_rows(matrix)
    surplus = null @ (null.T @ right)
    if np.abs(surplus).max(initial=0.0) > CONTRADICTION * max(1.0, np.abs(right).max(initial=0.0)):
        raise SceneError(
            f"mechanism.joints: {', '.join(_joints_of(machine, surplus[:, None], 0.01))} contradict each "
            f"other: no {what} at t = 0 satisfies all of them. Remove one of these joints, or give drivers "
            "that agree."
        )


def _velocities(machine: Machine, mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """Velocities (n + 3,) at t = 0.

    Those given in the scene are met as far as constraints and drivers allow. The others have the least
    kinetic energy relative to a motion along with the drivers of x and z.
    """
    model = machine.model
    matrix = Closure(machine).jacobian(q)
    speed = np.zeros(len(model.row_scale))
    evaluate_speed(model, 0.0, 0.0, speed)
    _refuse_contradiction(machine, matrix, speed, "velocity")
    guess, given = _guessed_velocities(machine, mechanism)
    guess = guess / model.column_scale
    root = np.sqrt(scaled_mass(machine))
    _, free = _null_rows(matrix.T)
    scaled = np.linalg.lstsq(matrix, speed, rcond=RANK_TOLERANCE)[0] if len(speed) else np.zeros(len(root))
    for chosen in (given, ~given):
        if np.abs(free[chosen]).max(initial=0.0) < RANK_TOLERANCE:
            continue  # round-off, which would count as a direction: these bodies are held
        weighted = root[chosen, None] * free[chosen]
        scaled = scaled + free @ _least(weighted, root[chosen] * (guess - scaled)[chosen])
        free = free @ _null_rows(weighted.T)[1] if free.shape[1] else free
    _say_missed(machine, (scaled - guess) * model.column_scale, guess * model.column_scale, given)
    v = np.zeros_like(q)
    v[: len(scaled)] = scaled * model.column_scale
    gamma = np.zeros(len(model.row_scale))
    evaluate_gamma(model, 0.0, 0.0, q, turns_of(q), v, gamma)
    _refuse_contradiction(machine, matrix, gamma, "acceleration")
    return v


def _say_missed(machine: Machine, missed: np.ndarray, wanted: np.ndarray, given: np.ndarray) -> None:
    """Warn where joints and drivers forbid a velocity of the scene; arrays (n,) [m/s, rad/s]."""
    off = np.where(given, np.abs(missed), 0.0)
    if off.max(initial=0.0) > MISSED_VELOCITY * max(1.0, np.abs(wanted).max(initial=0.0)):
        k = int(np.argmax(off))
        what = ("velocity_m_per_s (x)", "velocity_m_per_s (z)", "angular_velocity_rad_per_s")[k % 3]
        warnings.warn(
            f"mechanism.bodies.{machine.bodies[k // 3]}.{what}: given {wanted[k]:.4g}, which joints and "
            f"drivers do not allow; the run starts with {wanted[k] + missed[k]:.4g}",
            MovedBodiesWarning,
            stacklevel=4,
        )


def _least(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Least-squares solution of least norm; zeros where there is nothing to solve."""
    if 0 in matrix.shape:
        return np.zeros(matrix.shape[1])
    return np.linalg.lstsq(matrix, right, rcond=RANK_TOLERANCE)[0]


def _guessed_velocities(machine: Machine, mechanism: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Guess (n,) [m/s, rad/s], and which of its entries the scene gives."""
    functions = machine.model.functions
    along: dict[str, list[float]] = {"x": [], "z": []}  # speeds of the drivers of translation
    for row, joint in zip(machine.model.joints, mechanism.joints.values(), strict=False):  # locks come last
        if isinstance(joint, Driver) and joint.relative_to is None and joint.coordinate in along:
            along[joint.coordinate].append(function_value(functions, row["function"], 0.0, 0.0))
    common = [float(np.mean(along[key])) if along[key] else 0.0 for key in ("x", "z")]
    guess, given = [], []
    for body in mechanism.bodies.values():
        velocity, spin = body.velocity_m_per_s, body.angular_velocity_rad_per_s
        guess += [*(common if velocity is None else velocity), 0.0 if spin is None else spin]
        given += [velocity is not None, velocity is not None, spin is not None]
    return np.array(guess, dtype=np.float64), np.array(given)


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
