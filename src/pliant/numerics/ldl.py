"""Dense LDL^T factorisation of a small symmetric positive definite matrix, in place and without allocation.

Source: Golub and Van Loan, Matrix Computations, 4th ed., Sec. 4.1.
"""

from __future__ import annotations


def ldl_factor(A):
    """Overwrite a symmetric positive definite matrix A (n, n) by its LDL^T factors. Only its lower triangle is read.

    Strictly below the diagonal: L. On the diagonal: 1/D, so that a solve has no division. Above the diagonal: D L^T, so
    that the factorisation has one division a column.
    """
    n = A.shape[0]
    for j in range(n):
        pivot = A[j, j]
        for k in range(j):
            pivot = pivot - A[j, k] * A[k, j]
        pivot = 1.0 / pivot
        A[j, j] = pivot
        for i in range(j + 1, n):
            value = A[i, j]
            for k in range(j):
                value = value - A[i, k] * A[k, j]
            A[j, i] = value
            A[i, j] = value * pivot


def ldl_solve(A, b):
    """Solve A x = b, with A (n, n) already factorised by `ldl_factor`. The solution x overwrites b (n,)."""
    n = A.shape[0]
    for i in range(1, n):
        value = b[i]
        for k in range(i):
            value = value - A[i, k] * b[k]
        b[i] = value
    for i in range(n - 1, -1, -1):
        value = b[i] * A[i, i]
        for k in range(i + 1, n):
            value = value - A[k, i] * b[k]
        b[i] = value


def ldl_solve_by_columns(A, b):
    """Solve A x = b as `ldl_solve` does, but subtract each unknown of the backward pass from all others once it is
    known.

    No sum then waits for another, which takes less time for matrices of ten and more rows. The sums are rounded in
    another order.
    """
    n = A.shape[0]
    for i in range(n):
        for k in range(i):
            b[i] = b[i] - A[i, k] * b[k]
    for i in range(n):
        b[i] = b[i] * A[i, i]
    for k in range(n - 1, -1, -1):
        for i in range(k):
            b[i] = b[i] - A[k, i] * b[k]
