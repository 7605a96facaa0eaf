"""Linear equations, and the derivative of a solution of nonlinear equations."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

UNROLLED = 24  # coordinates up to which the factors are written out


def factors(A):
    """Return the factors L D L^T of a symmetric matrix A (N, N) without pivoting, as a list of N columns.

    Column k holds L below the diagonal; its first entry is 1 / D. Larger matrices: the factors of `jax.scipy`.
    """
    if A.shape[0] > UNROLLED:
        return jax.scipy.linalg.lu_factor(A)
    columns = []
    for _ in range(A.shape[0]):
        one = 1.0 / A[0, 0]
        below = A[1:, 0] * one
        columns.append((one, below))
        A = A[1:, 1:] - below[:, None] * A[0, 1:]
    return columns


def solved(columns, b):
    """Return x of A x = b (N,) for the `factors` of A."""
    if not isinstance(columns, list):
        return jax.scipy.linalg.lu_solve(columns, b)
    forward = []
    for _, below in columns:
        forward.append(b[0])
        b = b[1:] - below * b[0]
    x = b
    for (one, below), value in zip(reversed(columns), reversed(forward), strict=True):
        x = jnp.concatenate([(value * one - below @ x)[None], x])
    return x


def rooted(residual, guess, search):
    """Return the solution x of residual(x) = 0 that ``search(residual, guess)`` finds, with exact derivatives.

    The derivatives are those of the implicit function theorem; the search is not differentiated.
    """

    def tangent(linear, y):
        return jnp.linalg.solve(jax.jacfwd(linear)(jnp.zeros_like(y)), y)

    return lax.custom_root(residual, lax.stop_gradient(guess), search, tangent)


def cross(a, b):
    """Return the cross products of vectors (..., 3)."""
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    y = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    z = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return jnp.stack([x, y, z], axis=-1)


def beyond(values):
    """Return the sums of values (n, ...) from each row to the last one."""
    return jnp.cumsum(values[::-1], axis=0)[::-1]
