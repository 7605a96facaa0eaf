"""LDL^T in place: against NumPy, on complex numbers, on symbols, and nothing but the lower triangle is read."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.numerics.ldl import ldl_factor, ldl_solve, ldl_solve_by_columns

SOLVES = (ldl_solve, ldl_solve_by_columns)


def positive_definite(rng, n):
    X = rng.normal(size=(n, n))
    return X @ X.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("solve", SOLVES)
@pytest.mark.parametrize("n", range(1, 9))
def test_solves_as_numpy_does(rng, n, solve):
    A, b = positive_definite(rng, n), rng.normal(size=n)
    factors, x = np.tril(A), b.copy()
    factors[np.triu_indices(n, 1)] = np.nan  # must not be read
    ldl_factor(factors)
    solve(factors, x)
    assert x == pytest.approx(np.linalg.solve(A, b), rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("n", range(1, 9))
def test_factors_are_what_they_say(rng, n):
    A = positive_definite(rng, n)
    factors = A.copy()
    ldl_factor(factors)
    L, D = np.tril(factors, -1) + np.eye(n), np.diag(1 / np.diag(factors))
    assert pytest.approx(A, abs=1e-12) == L @ D @ L.T
    assert np.triu(factors, 1) == pytest.approx(np.triu(D @ L.T, 1), abs=1e-12)


def test_one_factorisation_serves_many_right_hand_sides(rng):
    A, B = positive_definite(rng, 5), rng.normal(size=(3, 5))
    factors, X = A.copy(), B.copy()
    ldl_factor(factors)
    kept = factors.copy()
    for row in X:
        ldl_solve(factors, row)
    assert pytest.approx(B, abs=1e-10) == X @ A
    assert np.array_equal(factors, kept)


@pytest.mark.parametrize("solve", SOLVES)
def test_complex_step_differentiates_the_solution(rng, solve):
    A, dA, b = positive_definite(rng, 4), positive_definite(rng, 4), rng.normal(size=4)
    factors, x = A + 1e-30j * dA, b.astype(complex)
    ldl_factor(factors)
    solve(factors, x)
    expected = -np.linalg.solve(A, dA @ np.linalg.solve(A, b))
    assert x.imag / 1e-30 == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("solve", SOLVES)
def test_runs_on_symbols(solve):
    import sympy as sp

    a, b, c, x, y = sp.symbols("a b c x y")
    factors, solution = np.array([[a, b], [b, c]], object), np.array([x, y], object)
    ldl_factor(factors)
    solve(factors, solution)
    expected = sp.Matrix([[a, b], [b, c]]).LUsolve(sp.Matrix([x, y]))
    assert all(sp.simplify(s - e) == 0 for s, e in zip(solution, expected, strict=True))
