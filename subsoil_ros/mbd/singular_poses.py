"""Crossing a singular pose (a dead centre, a flat parallelogram): joints do not determine the motion there.

With s the smallest pivot of the constraints, dependent coordinates have errors of round-off / s there, and
their velocities of round-off / s^2: a step that ends next to such a pose can leave it on another branch of
the motion, with any energy. So near it no coordinate depends on another. Positions and velocities are brought
onto the constraints by the change of least inertia, which is orthogonal to the motion that the constraints
allow, so that errors of the joints change the energy only by their square. The constraints yield: a
direction that they hold by less than the root of YIELDING is left to the integration. And a step is taken in
four parts: in a direction held by s, an error of the velocity makes one of the acceleration that is 1 / s
larger, and a history of accelerations would carry it on.
Source: Bayo, Garcia de Jalon and Serna 1988; the change is one step of their augmented Lagrangian.
"""

from .dynamics import accelerate, factor_whole
from .geometry import evaluate_turns
from .joints.constraints import evaluate_jacobian, evaluate_residual, evaluate_speed
from .kernel_options import inner_kernel
from .linear import lu_solve, pivot_ratio
from .machine_arrays import NEAR_COUNT, NOT_CLOSED, SINGULAR
from .partition import NEAR, factor_dependent

YIELDING = 1e-7
"""Square of the singular value (rows of length one, coordinates by the roots of their masses) below which
the constraints do not hold a direction. Errors of the joints grow by its inverse root, 3,000; a machine that
misses a singular pose by 1e-3 is still led by its joints, to 1e-4 of a step."""

CLOSING_COUNT = 4
"""Corrections of position, and of velocity: a direction held by s is closed to (YIELDING / s^2)^4."""

OPEN = 1e-8
"""Largest gap of constraints next to a singular pose, as a part of the machine's size: the one that redundant
constraints may have elsewhere (CONTRADICTION_GAP of advance.py)."""

NOT_JUDGED = 1.0 / 30.0
"""Part of NEAR below which a step is not judged: errors of the joints are above that of the step there."""

NEAR_PART = 0.4
"""Parts of a step next to a singular pose are shorter than this: the quarter that NEAR_EXCESS asks for, or a
quarter and a rest of less than an eighth."""

NEAR_EXCESS = 17.0
"""Error over tolerance that halves a step twice (accuracy.halvings_for)."""

MOST_NEAR = 4000
"""Parts of steps in a row so near to the pose that they are not judged, after which the machine is taken to
stay in it and the run ends. With a larger number such runs only end later."""


@inner_kernel
def is_near(state, work):
    """Whether Phi_u, as factored in `work`, is nearly singular."""
    return pivot_ratio(work.factor) < NEAR * state.condition[2]


@inner_kernel
def count_near(model, state, work):
    """Count the steps in a row that ended next to a singular pose; the end of this one is in `work`.

    0: the next step needs no care; above 1: steps whose error is not judged.
    """
    evaluate_turns(work.q, work.turns)
    held = factor_dependent(model, state, work, work.q)
    ratio = pivot_ratio(work.factor) if held else 0.0
    if ratio >= NEAR * state.condition[2]:
        return 0
    return 1 if ratio >= NOT_JUDGED * NEAR * state.condition[2] else state.counters[NEAR_COUNT] + 1


@inner_kernel
def _least_change(model, state, work, change):
    """Compute the `change` of coordinates of least inertia that changes the constraints by `gamma`."""
    shape, right, coordinates = model.sparsity, work.whole_right, model.mass.shape[0]
    for c in range(coordinates):
        right[shape.place[c]] = 0.0
    for row in range(work.row_length.shape[0]):
        used = state.row_place[row] >= 0
        right[shape.place[coordinates + row]] = work.gamma[row] / work.row_length[row] if used else 0.0
    lu_solve(work.whole, work.whole_pivots, shape.band, shape.band, right)
    for c in range(coordinates):
        change[c] = model.column_scale[c] * right[shape.place[c]] / model.sqrt_mass[c]


@inner_kernel
def _prepare(model, state, work, time, select):
    """Residual, Jacobian and factors at the pose in `work`: (whether regular, largest residual [m])."""
    evaluate_turns(work.q, work.turns)
    evaluate_residual(model, time, select, work.q, work.turns, work.residual)
    evaluate_jacobian(model, work.q, work.turns, work.jacobian)
    largest = 0.0
    for row in range(work.residual.shape[0]):
        if state.row_place[row] >= 0:
            largest = max(largest, abs(work.residual[row]))
    return factor_whole(model, state, work, YIELDING), largest


@inner_kernel
def complete_near(model, state, work, time, select, closing):
    """Close positions and velocities in `work` (if `closing`), then accelerate; return the status."""
    regular, gap = _prepare(model, state, work, time, select)
    if closing:
        for _ in range(CLOSING_COUNT):
            for row in range(work.gamma.shape[0]):
                work.gamma[row] = -work.residual[row]
            _least_change(model, state, work, work.a)
            for c in range(model.mass.shape[0]):
                work.q[c] += work.a[c]
            regular, gap = _prepare(model, state, work, time, select)
            if not regular:
                return SINGULAR
        if not gap <= OPEN * model.size:
            return NOT_CLOSED
        evaluate_speed(model, time, select, work.residual)
        for _ in range(CLOSING_COUNT):
            for row in range(work.gamma.shape[0]):
                total = work.residual[row]
                for entry in range(model.sparsity.first[row], model.sparsity.first[row + 1]):
                    c = model.sparsity.columns[entry]
                    total -= work.jacobian[row, c] * work.v[c] / model.column_scale[c]
                work.gamma[row] = total
            _least_change(model, state, work, work.a)
            for c in range(model.mass.shape[0]):
                work.v[c] += work.a[c]
    if not regular:
        return SINGULAR
    return accelerate(model, state, work, time, select, YIELDING)
