"""Random parameters, drawn from the covariance of the fit from which the model comes."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from pliant.exporters.jax_source.structure import FACTOR, LOWER, MEAN, SLOPES, UPPER, parameters

DRAWN_AGAIN = 1000  # draws of one body, at most; the export checks that one in ten lies within the bounds


def draws(n, key):
    """Return the parameters of n bodies, drawn from the uncertainty of the fit: each array has n rows.

    The fitted values are normally distributed; a draw out of the bounds of the fit is drawn again. To first order, the
    parameters follow the fitted values. `key` is one of `jax.random.key`.
    """

    def within(move):
        return jnp.all((move >= LOWER - MEAN) & (move <= UPPER - MEAN), axis=1)

    def again(now):
        key, move, count = now
        key, subkey = jax.random.split(key)
        fresh = jax.random.normal(subkey, move.shape, move.dtype) @ jnp.asarray(FACTOR.T, move.dtype)
        return key, jnp.where(within(move)[:, None], move, fresh), count + 1

    start = (key, jnp.full((n, MEAN.size), jnp.nan, jnp.result_type(float)), 0)
    _, move, _ = lax.while_loop(lambda now: ~jnp.all(within(now[1])) & (now[2] < DRAWN_AGAIN), again, start)
    return {
        name: jnp.asarray(value, move.dtype) + jnp.tensordot(move, jnp.asarray(SLOPES[name], move.dtype), 1)
        if name in SLOPES else jnp.broadcast_to(jnp.asarray(value, move.dtype), (n, *value.shape))
        for name, value in parameters.items()
    }  # fmt: skip
