"""Model, state and workspace of a machine as plain arrays.

Coordinates are q = [x, z, phi] of body 0, of body 1, ... [m, m, rad]; the ground is one more body at the
end, whose three coordinates stay zero, so arrays over coordinates have n + 3 entries, n = 3 bodies.
Scaled: angles are multiplied, and moments divided, by the size of the machine, so that all columns of
the Jacobian are numbers of order one and every residual is a length.
"""

from typing import NamedTuple

import numpy as np

from .function_tables import FunctionTable

# Entries of the books of energy: `powers` has the first three, `work` all four.
BY_DRIVERS, DISSIPATED, BY_LOADS, BY_WRENCHES = 0, 1, 2, 3

# Entries of State.counters.
PAST_COUNT, PARTITION_COUNT, RESTART_COUNT, EVENT_COUNT = 0, 1, 2, 3
NEAR_COUNT = 4  # steps in a row that ended next to a singular pose, see singular_poses.py
PART_COUNT = 5  # parts of steps whose error was too large as a whole (accuracy.py)

# Entries of State.balance.
AT_START, LARGEST, RESIDUAL = 0, 1, 2

ADAMS_MOULTON, RUNGE_KUTTA_4, GENERALIZED_ALPHA = 0, 1, 2

MANY_FREEDOMS = 8
"""With more freedoms the equations of motion are solved as a whole (dynamics.py), faster on chains."""

# Status that a kernel returns.
OK, NOT_CLOSED, SINGULAR, CONTRADICTION, NOT_FINITE, JAMMED, NOT_SOLVED = 0, 1, 2, 3, 4, 5, 6
DOUBTFUL = 7  # too near to a singular pose; never leaves advance.py
INACCURATE = 8  # the error of a step is above the tolerance, however small the step
UNBALANCED = 9  # energy appeared or vanished


class Sparsity(NamedTuple):
    """Structure of the Jacobian and of the equations of motion (sparsity.py); indices into q and Phi."""

    first: np.ndarray  # (m + 1,) int64: entries of row i are first[i] to first[i + 1]
    columns: np.ndarray  # (entries,) int64: coordinate of every entry, without the ground's
    row_order: np.ndarray  # (m,) int64: rows in the order of the band
    column_order: np.ndarray  # (n,) int64: coordinates in the order of the band
    place: np.ndarray  # (n + m,) int64: place of every coordinate, then row, in the order of both together
    band: int  # diagonals on either side of the matrix of the equations of motion in that order


class Model(NamedTuple):
    """Everything that stays the same during a run."""

    mass: np.ndarray  # (n,) float64: mass [kg], mass, inertia [kg m^2] of every body
    joints: np.ndarray  # (joints,) JOINT
    forces: np.ndarray  # (forces,) FORCE
    curves: np.ndarray  # (points, 3) float64: compression, force, energy from there to zero compression
    functions: FunctionTable  # of time
    breakpoints: np.ndarray  # (breakpoints,) float64 [s]: slopes of time functions jump here
    row_scale: np.ndarray  # (m,) float64: 1, or `size` for a row in radians
    column_scale: np.ndarray  # (n,) float64: 1, or 1 / `size` for an angle
    sqrt_mass: np.ndarray  # (n,) float64: roots of the masses of the scaled coordinates [kg^0.5]
    sparsity: Sparsity
    weights: np.ndarray  # (4, order) float64: multistep weights, see integrators/explicit.py
    gravity: float  # [m/s^2], along -z
    size: float  # of the machine [m]
    step: float  # [s]
    tolerance: float  # of the error of a step, see accuracy.py; infinite: not judged
    integrator: int  # ADAMS_MOULTON, RUNGE_KUTTA_4, GENERALIZED_ALPHA
    pressed: bool  # some joint's friction depends on its reaction


class State(NamedTuple):
    """Everything that changes and does not follow from the rest; a checkpoint contains it."""

    q: np.ndarray  # (n + 3,) float64 [m, m, rad]
    v: np.ndarray  # (n + 3,) float64 [m/s, m/s, rad/s]
    a: np.ndarray  # (n + 3,) float64 [m/s^2, m/s^2, rad/s^2]
    past_a: np.ndarray  # (order - 1, n + 3) float64: accelerations of earlier steps, latest first
    multipliers: np.ndarray  # (m,) float64 [N or N m], zero for a row left out as redundant
    wrench: np.ndarray  # (n,) float64: of the soil, constant in this tick [N, N, N m]
    powers: np.ndarray  # (3,) float64 [W]
    past_powers: np.ndarray  # (order - 1, 3) float64 [W]
    work: np.ndarray  # (4,) float64 [J], since the start
    balance: np.ndarray  # (3,) float64 [J]: energy at the start, largest turnover, residual, see accuracy.py
    rows: np.ndarray  # (r,) int64: independent constraints
    dependent: np.ndarray  # (r,) int64: coordinates u
    independent: np.ndarray  # (n - r,) int64: coordinates v
    row_place: np.ndarray  # (m,) int64: place in `rows`, -1 for a row left out
    place: np.ndarray  # (n,) int64: place in `dependent`, or -1 - place in `independent`
    band: np.ndarray  # (2,) int64: diagonals of Phi_u below and above the main one
    condition: (
        np.ndarray
    )  # (3,) float64: of Phi_u when chosen (0: not measured yet); best pivots of Phi_q, Phi_u
    modes: np.ndarray  # (forces,) int64: of the forces, see forces/evaluation.py
    anchors: np.ndarray  # (forces,) float64 [m or rad]: of those that stick, see forces/sticking.py
    counters: np.ndarray  # (6,) int64


class Workspace(NamedTuple):
    """Memory that kernels write before they read; carries nothing from tick to tick."""

    turns: np.ndarray  # (bodies + 1, 2) float64: cosine and sine of every angle of `q`
    residual: np.ndarray  # (m,) float64, Phi, scaled
    jacobian: np.ndarray  # (m, n + 3) float64, Phi_q, scaled
    gamma: np.ndarray  # (m,) float64
    force: np.ndarray  # (n + 3,) float64 [N, N, N m]
    factor: np.ndarray  # (r, r) float64, LU of the scaled Phi_u, see linear.lu_factor
    pivots: np.ndarray  # (r,) int64
    dependence: np.ndarray  # (n - r, r) float64, columns of B = -Phi_u^-1 Phi_v, scaled
    whole: np.ndarray  # (n + m, n + m) float64: see dynamics.py
    whole_pivots: np.ndarray  # (n + m,) int64
    whole_right: np.ndarray  # (n + m,) float64
    row_length: np.ndarray  # (m,) float64
    right: np.ndarray  # (r,) float64
    other: np.ndarray  # (r,) float64
    reduced: np.ndarray  # (n - r, n - r) float64, Mhat
    reduced_pivots: np.ndarray  # (n - r,) int64
    reduced_force: np.ndarray  # (n - r,) float64, Fhat
    q: np.ndarray  # (n + 3,) float64: the state being tried
    v: np.ndarray
    a: np.ndarray
    powers: np.ndarray  # (3,) float64
    kept: np.ndarray  # (m,) float64: multipliers at the start of the step
    previous: np.ndarray  # (m,) float64: multipliers of the iteration before
    sums: np.ndarray  # (2, n + 3) float64
    guess: np.ndarray  # (2, n + 3) float64: what the end of the step is compared with (accuracy.py)
    report: np.ndarray  # (forces, 3) float64
    power_sums: np.ndarray  # (3,) float64
    modes: np.ndarray  # (forces,) int64
    trial_q: np.ndarray  # (n + 3,) float64: inside a step, where a mode ends
    trial_v: np.ndarray
    pivoted: np.ndarray  # (m, n) float64: Phi_q being eliminated with full pivoting
    row_order: np.ndarray  # (m,) int64
    column_order: np.ndarray  # (n,) int64
    newton: np.ndarray  # (n - r, n - r) float64: generalized-alpha
    newton_pivots: np.ndarray  # (n - r,) int64
    newton_right: np.ndarray  # (n - r,) float64
    unknown: np.ndarray  # (n + 3,) float64 [m/s^2, rad/s^2]


def make_state(coordinates: int, rows: int, rank: int, forces: int, order: int) -> State:
    """A state of zeros: `coordinates` = n, `rows` = m, `rank` = r."""
    return State(
        q=np.zeros(coordinates + 3),
        v=np.zeros(coordinates + 3),
        a=np.zeros(coordinates + 3),
        past_a=np.zeros((order - 1, coordinates + 3)),
        multipliers=np.zeros(rows),
        wrench=np.zeros(coordinates),
        powers=np.zeros(3),
        past_powers=np.zeros((order - 1, 3)),
        work=np.zeros(4),
        balance=np.zeros(3),
        rows=np.zeros(rank, dtype=np.int64),
        dependent=np.zeros(rank, dtype=np.int64),
        independent=np.zeros(coordinates - rank, dtype=np.int64),
        row_place=np.zeros(rows, dtype=np.int64),
        place=np.zeros(coordinates, dtype=np.int64),
        band=np.zeros(2, dtype=np.int64),
        condition=np.zeros(3),
        modes=np.zeros(forces, dtype=np.int64),
        anchors=np.zeros(forces),
        counters=np.zeros(6, dtype=np.int64),
    )


def make_workspace(coordinates: int, rows: int, rank: int, forces: int) -> Workspace:
    """Memory for a machine of n = `coordinates`, m = `rows`, r = `rank`."""
    freedom = coordinates - rank
    reduced = freedom if freedom <= MANY_FREEDOMS else 0
    return Workspace(
        turns=np.zeros((coordinates // 3 + 1, 2)),
        residual=np.zeros(rows),
        jacobian=np.zeros((rows, coordinates + 3)),
        gamma=np.zeros(rows),
        force=np.zeros(coordinates + 3),
        factor=np.zeros((rank, rank)),
        pivots=np.zeros(rank, dtype=np.int64),
        dependence=np.zeros((reduced, rank)),
        whole=np.zeros((coordinates + rows, coordinates + rows)),
        whole_pivots=np.zeros(coordinates + rows, dtype=np.int64),
        whole_right=np.zeros(coordinates + rows),
        row_length=np.zeros(rows),
        right=np.zeros(rank),
        other=np.zeros(rank),
        reduced=np.zeros((reduced, reduced)),
        reduced_pivots=np.zeros(freedom, dtype=np.int64),
        reduced_force=np.zeros(freedom),
        q=np.zeros(coordinates + 3),
        v=np.zeros(coordinates + 3),
        a=np.zeros(coordinates + 3),
        powers=np.zeros(3),
        kept=np.zeros(rows),
        previous=np.zeros(rows),
        sums=np.zeros((2, coordinates + 3)),
        guess=np.zeros((2, coordinates + 3)),
        report=np.zeros((forces, 3)),
        power_sums=np.zeros(3),
        modes=np.zeros(forces, dtype=np.int64),
        trial_q=np.zeros(coordinates + 3),
        trial_v=np.zeros(coordinates + 3),
        pivoted=np.zeros((rows, coordinates)),
        row_order=np.zeros(rows, dtype=np.int64),
        column_order=np.zeros(coordinates, dtype=np.int64),
        newton=np.zeros((freedom, freedom)),
        newton_pivots=np.zeros(freedom, dtype=np.int64),
        newton_right=np.zeros(freedom),
        unknown=np.zeros(coordinates + 3),
    )
