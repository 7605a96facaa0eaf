"""Linear equations, and the derivative of a solution of nonlinear equations."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax


def solver(A):
    """Return a function that solves A x = b (N,) for a symmetric matrix A (N, N), which is factored once.

    The factors are not differentiated: the derivatives of x are those of the equations.
    """
    columns = jax.scipy.linalg.lu_factor(lax.stop_gradient(A))

    def solve(b):
        def by_factors(_, b):
            return jax.scipy.linalg.lu_solve(columns, b)

        return lax.custom_linear_solve(lambda x: A @ x, b, by_factors, symmetric=True)

    return solve


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
