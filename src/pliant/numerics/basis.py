"""Legendre polynomials on an interval of length, with their integrals and roughness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def legendre_basis(s: NDArray[np.float64], length: float, terms: int) -> NDArray[np.float64]:
    """Return the Legendre polynomials P_0 ... P_{terms-1} of x = 2 s / length - 1 as columns (S, terms)."""
    return np.asarray(np.polynomial.legendre.legvander(2.0 * s / length - 1.0, terms - 1), dtype=np.float64)


def legendre_integrals(s: NDArray[np.float64], length: float, terms: int) -> NDArray[np.float64]:
    """Return the integrals of `legendre_basis` from 0 to `s`, as columns (S, terms).

    int P_j dx = (P_{j+1} - P_{j-1}) / (2 j + 1), which vanishes at x = -1 for j > 0
    """
    values = np.polynomial.legendre.legvander(2.0 * s / length - 1.0, terms)
    integrals = np.empty((s.size, terms))
    integrals[:, 0] = s
    degree = np.arange(1, terms)
    integrals[:, 1:] = (values[:, 2:] - values[:, :-2]) / (2 * degree + 1) * length / 2
    return integrals


def legendre_roughness(length: float, terms: int) -> NDArray[np.float64]:
    """Return the matrix (terms, terms) of int f''(s)^2 ds for f = sum of c_j P_j, by exact quadrature."""
    x, w = np.polynomial.legendre.leggauss(terms)
    second = np.polynomial.legendre.legder(np.eye(terms), 2, axis=0) if terms > 2 else np.zeros((1, terms))
    values = np.polynomial.legendre.legval(x, second).T * (2.0 / length) ** 2
    roughness: NDArray[np.float64] = values.T @ (values * (w * length / 2)[:, None])
    return roughness
