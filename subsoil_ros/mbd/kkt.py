"""The equations of motion as a whole, M q'' + Phi_q^T lambda = F and Phi_q q'' = gamma (paper eq. 6, 8).

Used for machines with many freedoms: eliminating the dependent coordinates leaves a full matrix of the
freedoms, whose cost grows with their cube, while this matrix is a narrow band (sparsity.py). Also used for
all machines next to singular poses (singular_poses.py). Coordinates are scaled by the roots of their masses
and rows to length one, so that light and heavy bodies count alike in the pivoting.
"""

import math

from .kernel_options import inner_kernel
from .linear import lu_factor, lu_solve


@inner_kernel
def factor_whole(model, state, work, yielding):
    """LU of the whole matrix from the Jacobian in `work`; False if singular. Rows left out get lambda = 0.

    `yielding`: 0, or YIELDING of singular_poses.py; the diagonal of the rows is its negative.
    """
    shape, matrix = model.sparsity, work.whole
    size, band, coordinates = matrix.shape[0], model.sparsity.band, model.mass.shape[0]
    for j in range(size):
        for i in range(max(j - 2 * band, 0), min(j + band, size - 1) + 1):
            matrix[j, i] = 0.0
    for c in range(coordinates):
        matrix[shape.place[c], shape.place[c]] = 1.0
    for row in range(work.row_length.shape[0]):
        at = shape.place[coordinates + row]
        if state.row_place[row] < 0:
            matrix[at, at] = 1.0
            continue
        total = 0.0
        for entry in range(shape.first[row], shape.first[row + 1]):
            c = shape.columns[entry]
            total += (work.jacobian[row, c] / model.sqrt_mass[c]) ** 2
        length = math.sqrt(total)
        work.row_length[row] = length
        if yielding > 0.0:
            matrix[at, at] = -yielding
        for entry in range(shape.first[row], shape.first[row + 1]):
            c = shape.columns[entry]
            value = work.jacobian[row, c] / (model.sqrt_mass[c] * length)
            matrix[shape.place[c], at] = value
            matrix[at, shape.place[c]] = value
    return lu_factor(matrix, work.whole_pivots, band, band)


@inner_kernel
def solve_whole(model, state, work, a, yielding):
    """From `force`, `gamma`: accelerations [m/s^2, rad/s^2] into `a`, multipliers [N, N m] to the state.

    With `yielding` above 0, a call improves the multipliers in the state, as one iteration.
    """
    shape, right, coordinates = model.sparsity, work.whole_right, model.mass.shape[0]
    for c in range(coordinates):
        right[shape.place[c]] = model.column_scale[c] * work.force[c] / model.sqrt_mass[c]
    for row in range(work.row_length.shape[0]):
        at, used = shape.place[coordinates + row], state.row_place[row] >= 0
        right[at] = work.gamma[row] / work.row_length[row] if used else 0.0
        if used and yielding > 0.0:
            right[at] -= yielding * state.multipliers[row] / model.row_scale[row] * work.row_length[row]
    lu_solve(work.whole, work.whole_pivots, shape.band, shape.band, right)
    for c in range(coordinates):
        a[c] = model.column_scale[c] * right[shape.place[c]] / model.sqrt_mass[c]
    for row in range(work.row_length.shape[0]):
        if state.row_place[row] >= 0:
            share = right[shape.place[coordinates + row]] / work.row_length[row]
            state.multipliers[row] = model.row_scale[row] * share
        else:
            state.multipliers[row] = 0.0
