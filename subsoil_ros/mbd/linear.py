"""Dense linear algebra for the small systems of a machine. Arrays float64, C order."""

from .compiled import inner_kernel


@inner_kernel
def copy(target, source):
    """The first entries of `source` (any number more) into all of `target`; both 1-D."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@inner_kernel
def lu_factor(matrix, pivots):
    """LU of a square matrix in place, rows exchanged for the largest pivot; False if singular."""
    size = matrix.shape[0]
    for k in range(size):
        best, chosen = 0.0, k
        for i in range(k, size):
            if abs(matrix[i, k]) > best:
                best, chosen = abs(matrix[i, k]), i
        pivots[k] = chosen
        if best == 0.0:
            return False
        if chosen != k:
            for j in range(size):
                matrix[k, j], matrix[chosen, j] = matrix[chosen, j], matrix[k, j]
        for i in range(k + 1, size):
            ratio = matrix[i, k] / matrix[k, k]
            matrix[i, k] = ratio
            if ratio != 0.0:
                for j in range(k + 1, size):
                    matrix[i, j] -= ratio * matrix[k, j]
    return True


@inner_kernel
def lu_solve(factor, pivots, right):
    """Solve A x = right in place, A given by lu_factor.

    Four rows at a time: their sums do not wait for one another.
    """
    size = factor.shape[0]
    for k in range(size):
        chosen = pivots[k]
        right[k], right[chosen] = right[chosen], right[k]
    whole = size - size % 4
    for i in range(0, whole, 4):
        a, b, c, d = right[i], right[i + 1], right[i + 2], right[i + 3]
        for j in range(i):
            x = right[j]
            a -= factor[i, j] * x
            b -= factor[i + 1, j] * x
            c -= factor[i + 2, j] * x
            d -= factor[i + 3, j] * x
        b -= factor[i + 1, i] * a
        c -= factor[i + 2, i] * a + factor[i + 2, i + 1] * b
        d -= factor[i + 3, i] * a + factor[i + 3, i + 1] * b + factor[i + 3, i + 2] * c
        right[i], right[i + 1], right[i + 2], right[i + 3] = a, b, c, d
    for i in range(whole, size):
        total = right[i]
        for j in range(i):
            total -= factor[i, j] * right[j]
        right[i] = total
    for i in range(size - 1, whole - 1, -1):
        total = right[i]
        for j in range(i + 1, size):
            total -= factor[i, j] * right[j]
        right[i] = total / factor[i, i]
    for i in range(whole - 4, -1, -4):
        a, b, c, d = right[i], right[i + 1], right[i + 2], right[i + 3]
        for j in range(i + 4, size):
            x = right[j]
            a -= factor[i, j] * x
            b -= factor[i + 1, j] * x
            c -= factor[i + 2, j] * x
            d -= factor[i + 3, j] * x
        d /= factor[i + 3, i + 3]
        c = (c - factor[i + 2, i + 3] * d) / factor[i + 2, i + 2]
        b = (b - factor[i + 1, i + 2] * c - factor[i + 1, i + 3] * d) / factor[i + 1, i + 1]
        a = (a - factor[i, i + 1] * b - factor[i, i + 2] * c - factor[i, i + 3] * d) / factor[i, i]
        right[i], right[i + 1], right[i + 2], right[i + 3] = a, b, c, d


@inner_kernel
def lu_solve_columns(factor, pivots, right):
    """Solve A X = right in place for all columns of `right` (size, columns)."""
    size, columns = right.shape
    for k in range(size):
        chosen = pivots[k]
        if chosen != k:
            for c in range(columns):
                right[k, c], right[chosen, c] = right[chosen, c], right[k, c]
    for i in range(size):
        for j in range(i):
            for c in range(columns):
                right[i, c] -= factor[i, j] * right[j, c]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            for c in range(columns):
                right[i, c] -= factor[i, j] * right[j, c]
        for c in range(columns):
            right[i, c] /= factor[i, i]


@inner_kernel
def lu_solve_transposed(factor, pivots, right):
    """Solve A^T x = right in place, A given by lu_factor."""
    size = factor.shape[0]
    for i in range(size):
        right[i] /= factor[i, i]
        for j in range(i + 1, size):
            right[j] -= factor[i, j] * right[i]
    for i in range(size - 1, -1, -1):
        for j in range(i):
            right[j] -= factor[i, j] * right[i]
    for k in range(size - 1, -1, -1):
        chosen = pivots[k]
        right[k], right[chosen] = right[chosen], right[k]


@inner_kernel
def inverse_norm(factor, pivots, trial, signs):
    """Estimate of the 1-norm of A^-1 (Hager's method, two rounds); `trial`, `signs` (size,) are memory.

    Source: Hager (1984), Condition estimates, SIAM J. Sci. Stat. Comput. 5(2).
    """
    size = factor.shape[0]
    estimate = 0.0
    trial[:] = 1.0 / max(size, 1)
    for turn in range(2):
        lu_solve(factor, pivots, trial)
        total = 0.0
        for i in range(size):
            total += abs(trial[i])
            signs[i] = 1.0 if trial[i] >= 0.0 else -1.0
        estimate = max(estimate, total)
        if turn == 1:
            return estimate
        lu_solve_transposed(factor, pivots, signs)
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
