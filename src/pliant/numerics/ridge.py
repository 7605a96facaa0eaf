"""Linear least squares with a ridge, and its errors on left-out groups of rows, from sums of products alone.

Every group of rows is summarised once by its sums of products. A fit without a group then takes the sums of all groups
less those of that group: it is the exact fit to the other rows, with no row touched again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

Array = np.ndarray


class Products(NamedTuple):
    """Sums of products over rows of P regressors and M outputs."""

    gram: Array  # (P, P), X^T X
    cross: Array  # (P, M), X^T Y
    square: float  # sum of the squared outputs
    rows: float  # number of rows


def products(x: Array, y: Array) -> Products:
    """Return the sums of products of regressors `x` (N, P) and outputs `y` (N, M) over N rows."""
    return Products(x.T @ x, x.T @ y, float(np.sum(y * y)), float(len(x)))


def added(groups: Sequence[Products]) -> Products:
    """Return the sums of products of all groups of rows together."""
    return Products(*(sum(parts[1:], parts[0]) for parts in zip(*groups, strict=True)))


def without(whole: Products, group: Products) -> Products:
    """Return the sums of products of all rows but those of a group."""
    return Products(whole.gram - group.gram, whole.cross - group.cross, whole.square - group.square,
                    whole.rows - group.rows)  # fmt: skip


def solved(p: Products, ridge: float) -> Array:
    """Return the coefficients (P, M) that minimise |Y - X B|^2 / N + `ridge` |B|^2 over N rows.

    The first regressor is the constant, which has no ridge.
    """
    penalty = np.full(len(p.gram), ridge * p.rows)
    penalty[0] = 0.0
    return np.asarray(np.linalg.solve(p.gram + np.diag(penalty), p.cross))


def squared_error(p: Products, coefficients: Array) -> float:
    """Return the sum of squared errors of the `coefficients` (P, M) over the rows of `p`."""
    inner = np.sum(coefficients * (p.gram @ coefficients)) - 2.0 * np.sum(coefficients * p.cross)
    return max(p.square + float(inner), 0.0)


def fits_without(groups: Sequence[Products], ridge: float) -> list[Array]:
    """Return for each of K groups of rows the coefficients (P, M) of the fit to all other groups.

    Raises
    ------
    numpy.linalg.LinAlgError
        When the other groups do not determine the coefficients, which a positive `ridge` prevents.
    """
    whole = added(groups)
    return [solved(without(whole, group), ridge) for group in groups]


def left_out_errors(groups: Sequence[Products], ridge: float) -> Array:
    """Return for each of K groups of rows (K,) the sum of squared errors of the fit to all other groups.

    Raises
    ------
    numpy.linalg.LinAlgError
        As `fits_without`.
    """
    fitted = fits_without(groups, ridge)
    return np.array([squared_error(group, coefficients) for group, coefficients in zip(groups, fitted, strict=True)])


def lagged(time: Array, start: Array, end: Array, time_constant: complex) -> Array:
    """Return C inputs (T, C) behind a first-order lag at the times `time` (T,) [s].

    In the interval k between two times each input is the straight line from ``start[k]`` to ``end[k]`` (T - 1, C). The
    lag begins in equilibrium with ``start[0]``. The result is exact for such inputs.
    """
    step = np.diff(time)[:, None]
    decay = np.exp(-step / time_constant)
    slope = (end - start) / np.where(step > 0, step, 1.0) * time_constant
    first = start[:1]
    out = np.concatenate([first, end - slope - decay * (start - slope)])  # y_k+1 = decay y_k + out_k+1
    factor = np.concatenate([np.zeros((1, 1)), decay])
    reach = 1
    while reach < len(out) and factor.any():  # prefix sums of the recursion, doubling their reach
        out[reach:] += factor[reach:] * out[:-reach]
        factor[reach:] = factor[reach:] * factor[:-reach]
        factor[:reach] = 0.0
        reach *= 2
    return out
