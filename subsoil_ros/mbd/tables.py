"""Model, state and workspace of a machine as plain arrays.

Coordinates are q = [x, z, phi] of body 0, of body 1, ... [m, m, rad]; the ground is one more body at the
end, whose three coordinates stay zero, so arrays over coordinates have n + 3 entries, n = 3 bodies.
Scaled: angles are multiplied, and moments divided, by the size of the machine, so that all columns of
the Jacobian are numbers of order one and every residual is a length.
"""

from typing import NamedTuple

import numpy as np

from .laws import LawTable

REVOLUTE, PRISMATIC, FIXED, DRIVER = 0, 1, 2, 3
SPRING_DAMPER, COORDINATE_SPRING, POINT_LOAD, WHEEL_CONTACT = 0, 1, 2, 3

JOINT = np.dtype(
    [
        ("kind", np.int64),
        ("body_a", np.int64),
        ("body_b", np.int64),
        ("row", np.int64),  # its first row of Phi
        ("coordinate", np.int64),  # driver: index into q
        ("law", np.int64),  # driver: its speed
        ("point_a", np.float64, 2),  # in the frame of body_a [m]
        ("point_b", np.float64, 2),  # in the frame of body_b [m]
        ("normal", np.float64, 2),  # prismatic: unit normal of the line, in the frame of body_a
        ("offset", np.float64),  # phi_b - phi_a [rad]; driver: start of the coordinate
    ],
    align=True,
)

FORCE = np.dtype(
    [
        ("kind", np.int64),
        ("body_a", np.int64),
        ("body_b", np.int64),  # the only body of a one-body force
        ("coordinate", np.int64),  # coordinate spring: index into q
        ("laws", np.int64, 3),  # coordinate spring: target; point load: x, z, moment
        ("way", np.int64),  # coordinate spring: 0 both ways, 1 only positive, -1 only negative force
        ("point_a", np.float64, 2),  # in the frame of body_a [m]
        ("point_b", np.float64, 2),  # in the frame of body_b [m]
        ("stiffness", np.float64),  # [N/m] or [N m/rad]
        ("damping", np.float64),  # [N s/m] or [N m s/rad]
        ("length", np.float64),  # spring: free length; wheel: radius [m]
        ("ground", np.float64),  # wheel: height of the ground [m]
        ("friction", np.float64),
        ("slip_speed", np.float64),  # [m/s]
    ],
    align=True,
)

ROWS_OF_KIND = {REVOLUTE: 2, PRISMATIC: 2, FIXED: 3, DRIVER: 1}

# Entries of the books of energy: `powers` has the first three, `work` all four.
BY_DRIVERS, DISSIPATED, BY_LOADS, BY_WRENCHES = 0, 1, 2, 3

# Entries of State.counters.
PAST_COUNT, PARTITION_COUNT, RESTART_COUNT = 0, 1, 2

# What a kernel answers.
OK, NOT_CLOSED, SINGULAR, CONTRADICTION, NOT_FINITE = 0, 1, 2, 3, 4


class Model(NamedTuple):
    """Everything that stays the same during a run."""

    mass: np.ndarray  # (n,) float64: mass [kg], mass, inertia [kg m^2] of every body
    joints: np.ndarray  # (joints,) JOINT
    forces: np.ndarray  # (forces,) FORCE
    laws: LawTable
    corners: np.ndarray  # (corners,) float64 [s]: slopes of laws jump here
    row_scale: np.ndarray  # (m,) float64: 1, or `size` for a row in radians
    column_scale: np.ndarray  # (n,) float64: 1, or 1 / `size` for an angle
    weights: np.ndarray  # (4, order) float64: multistep weights, see adams_moulton.py
    gravity: float  # [m/s^2], along -z
    size: float  # of the machine [m]
    step: float  # [s]


class State(NamedTuple):
    """Everything that changes, and nothing that follows from it: what a checkpoint holds."""

    q: np.ndarray  # (n + 3,) float64 [m, m, rad]
    v: np.ndarray  # (n + 3,) float64 [m/s, m/s, rad/s]
    a: np.ndarray  # (n + 3,) float64 [m/s^2, m/s^2, rad/s^2]
    past_a: np.ndarray  # (order - 1, n + 3) float64: accelerations of earlier steps, latest first
    multipliers: np.ndarray  # (m,) float64 [N or N m], zero for a row left out as redundant
    wrench: np.ndarray  # (n,) float64: held from outside in this tick [N, N, N m]
    powers: np.ndarray  # (3,) float64 [W]
    past_powers: np.ndarray  # (order - 1, 3) float64 [W]
    work: np.ndarray  # (4,) float64 [J], since the start
    rows: np.ndarray  # (r,) int64: independent constraints
    dependent: np.ndarray  # (r,) int64: coordinates u
    independent: np.ndarray  # (n - r,) int64: coordinates v
    condition: np.ndarray  # (1,) float64: of Phi_u when chosen; 0: not measured yet
    regimes: np.ndarray  # (forces,) int64: which branch each unilateral force is on
    counters: np.ndarray  # (3,) int64


class Workspace(NamedTuple):
    """Memory that kernels write before they read; carries nothing from tick to tick."""

    residual: np.ndarray  # (m,) float64, Phi, scaled
    jacobian: np.ndarray  # (m, n + 3) float64, Phi_q, scaled
    gamma: np.ndarray  # (m,) float64
    force: np.ndarray  # (n + 3,) float64 [N, N, N m]
    factor: np.ndarray  # (r, r) float64, LU of the scaled Phi_u
    pivots: np.ndarray  # (r,) int64
    dependence: np.ndarray  # (r, n - r) float64, B = -Phi_u^-1 Phi_v, scaled
    right: np.ndarray  # (r,) float64
    other: np.ndarray  # (r,) float64
    reduced: np.ndarray  # (n - r, n - r) float64, Mhat
    reduced_pivots: np.ndarray  # (n - r,) int64
    reduced_force: np.ndarray  # (n - r,) float64, Fhat
    q: np.ndarray  # (n + 3,) float64: the state being tried
    v: np.ndarray
    a: np.ndarray
    powers: np.ndarray  # (3,) float64
    sums: np.ndarray  # (2, n + 3) float64
    power_sums: np.ndarray  # (3,) float64
    regimes: np.ndarray  # (forces,) int64


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
        rows=np.zeros(rank, dtype=np.int64),
        dependent=np.zeros(rank, dtype=np.int64),
        independent=np.zeros(coordinates - rank, dtype=np.int64),
        condition=np.ones(1),
        regimes=np.zeros(forces, dtype=np.int64),
        counters=np.zeros(3, dtype=np.int64),
    )


def make_workspace(coordinates: int, rows: int, rank: int, forces: int) -> Workspace:
    """Memory for a machine of n = `coordinates`, m = `rows`, r = `rank`."""
    freedom = coordinates - rank
    return Workspace(
        residual=np.zeros(rows),
        jacobian=np.zeros((rows, coordinates + 3)),
        gamma=np.zeros(rows),
        force=np.zeros(coordinates + 3),
        factor=np.zeros((rank, rank)),
        pivots=np.zeros(rank, dtype=np.int64),
        dependence=np.zeros((rank, freedom)),
        right=np.zeros(rank),
        other=np.zeros(rank),
        reduced=np.zeros((freedom, freedom)),
        reduced_pivots=np.zeros(freedom, dtype=np.int64),
        reduced_force=np.zeros(freedom),
        q=np.zeros(coordinates + 3),
        v=np.zeros(coordinates + 3),
        a=np.zeros(coordinates + 3),
        powers=np.zeros(3),
        sums=np.zeros((2, coordinates + 3)),
        power_sums=np.zeros(3),
        regimes=np.zeros(forces, dtype=np.int64),
    )
