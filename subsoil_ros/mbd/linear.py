"""Linear algebra for the band matrices of a machine. Arrays float64, C order."""

from .kernel_options import inner_kernel


@inner_kernel
def copy(target, source):
    """The first entries of `source` (any number more) into all of `target`; both 1-D."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@inner_kernel
def lu_factor(columns, pivots, lower, upper):
    """LU of a square band matrix A in place, rows exchanged for the largest pivot; False if singular.

    columns[j, i] = A[i, j], so that a column is contiguous. A is zero outside of `lower` diagonals below the
    main one and `upper` above it (size - 1 each: a full matrix); `lower` more above are filled in. As in
    LAPACK's dgbtrf, later row exchanges are not applied to earlier columns of L, so that L stays in the band.
    """
    size = columns.shape[0]
    reach = 0
    for k in range(size):
        last = min(k + lower, size - 1)
        best, chosen = 0.0, k
        for i in range(k, last + 1):
            if abs(columns[k, i]) > best:
                best, chosen = abs(columns[k, i]), i
        pivots[k] = chosen
        if best == 0.0:
            return False
        reach = max(reach, min(chosen + upper, size - 1))
        if chosen != k:
            for j in range(k, reach + 1):
                columns[j, k], columns[j, chosen] = columns[j, chosen], columns[j, k]
        inverse = 1.0 / columns[k, k]
        for i in range(k + 1, last + 1):
            columns[k, i] *= inverse
        for j in range(k + 1, reach + 1):
            share = columns[j, k]
            if share != 0.0:
                for i in range(k + 1, last + 1):
                    columns[j, i] -= columns[k, i] * share
    return True


@inner_kernel
def pivot_ratio(columns):
    """Smallest over largest pivot of a matrix as lu_factor leaves it; 1 for none."""
    smallest, largest = 1.0, 1.0
    for k in range(columns.shape[0]):
        size = abs(columns[k, k])
        smallest = size if k == 0 else min(smallest, size)
        largest = size if k == 0 else max(largest, size)
    return smallest / largest


@inner_kernel
def lu_solve(columns, pivots, lower, upper, right):
    """Solve A x = right in place, A given by lu_factor."""
    size = columns.shape[0]
    for k in range(size):
        chosen = pivots[k]
        x = right[chosen]
        right[chosen] = right[k]
        right[k] = x
        if x != 0.0:
            for i in range(k + 1, min(k + lower, size - 1) + 1):
                right[i] -= columns[k, i] * x
    for k in range(size - 1, -1, -1):
        x = right[k] / columns[k, k]
        right[k] = x
        if x != 0.0:
            for i in range(max(k - lower - upper, 0), k):
                right[i] -= columns[k, i] * x


@inner_kernel
def lu_solve_transposed(columns, pivots, lower, upper, right):
    """Solve A^T x = right in place, A given by lu_factor."""
    size = columns.shape[0]
    for k in range(size):
        total = right[k]
        for i in range(max(k - lower - upper, 0), k):
            total -= columns[k, i] * right[i]
        right[k] = total / columns[k, k]
    for k in range(size - 1, -1, -1):
        total = right[k]
        for i in range(k + 1, min(k + lower, size - 1) + 1):
            total -= columns[k, i] * right[i]
        chosen = pivots[k]
        right[k] = right[chosen]
        right[chosen] = total


@inner_kernel
def inverse_norm(columns, pivots, lower, upper, trial, signs):
    """Estimate of the 1-norm of A^-1 (Hager's method, two rounds); `trial`, `signs` (size,) are workspace.

    Source: Hager (1984), Condition estimates, SIAM J. Sci. Stat. Comput. 5(2).
    """
    size = columns.shape[0]
    estimate = 0.0
    trial[:] = 1.0 / max(size, 1)
    for turn in range(2):
        lu_solve(columns, pivots, lower, upper, trial)
        total = 0.0
        for i in range(size):
            total += abs(trial[i])
            signs[i] = 1.0 if trial[i] >= 0.0 else -1.0
        estimate = max(estimate, total)
        if turn == 1:
            return estimate
        lu_solve_transposed(columns, pivots, lower, upper, signs)
        steepest = 0
        for i in range(size):
            if abs(signs[i]) > abs(signs[steepest]):
                steepest = i
        trial[:] = 0.0
        if size > 0:
            trial[steepest] = 1.0
    return estimate


@inner_kernel
def pivot_fully(matrix, rows, columns):
    """Gauss elimination with full pivoting, destroying `matrix` (m, n).

    `rows` (m,) and `columns` (n,) int64 become the order in which pivots were taken; the k-th pivot is
    left at matrix[rows[k], columns[k]].
    """
    count_rows, count_columns = matrix.shape
    for i in range(count_rows):
        rows[i] = i
    for j in range(count_columns):
        columns[j] = j
    first = 0.0
    for k in range(min(count_rows, count_columns)):
        best, row, column = -1.0, k, k
        for i in range(k, count_rows):
            for j in range(k, count_columns):
                if abs(matrix[rows[i], columns[j]]) > best:
                    best, row, column = abs(matrix[rows[i], columns[j]]), i, j
        rows[k], rows[row] = rows[row], rows[k]
        columns[k], columns[column] = columns[column], columns[k]
        if k == 0:
            first = best
        if best <= 1e-14 * first:
            return
        pivot = rows[k]
        for i in range(k + 1, count_rows):
            ratio = matrix[rows[i], columns[k]] / matrix[pivot, columns[k]]
            if ratio != 0.0:
                for j in range(k, count_columns):
                    matrix[rows[i], columns[j]] -= ratio * matrix[pivot, columns[j]]
