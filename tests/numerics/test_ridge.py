"""Ridge regression from sums of products: left-out errors equal explicit refits, lags equal their closed form."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.numerics.ridge import added, lagged, left_out_errors, products, solved, squared_error


def rows(seed: int, count: int = 240) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Regressors with a constant (N, 6), two outputs (N, 2) and the group of each row (N,), of unequal sizes."""
    rng = np.random.default_rng(seed)
    x = np.column_stack([np.ones(count), rng.normal(size=(count, 5)) @ rng.normal(size=(5, 5))])
    y = x @ rng.normal(size=(6, 2)) + rng.normal(size=(count, 2))
    return x, y, np.sort(rng.integers(0, 5, count))


def explicit(x: np.ndarray, y: np.ndarray, ridge: float) -> np.ndarray:
    """The same fit as least squares with rows for the ridge, which know nothing of sums of products."""
    rest = np.sqrt(ridge * len(x)) * np.eye(x.shape[1])[1:]
    return np.linalg.lstsq(np.vstack([x, rest]), np.vstack([y, np.zeros((len(rest), y.shape[1]))]), rcond=None)[0]


@pytest.mark.parametrize("ridge", [0.0, 1e-6, 1e-2, 1.0])
def test_leaving_a_group_out_equals_a_refit_to_the_others(ridge: float) -> None:
    x, y, group = rows(1)
    errors = left_out_errors([products(x[group == g], y[group == g]) for g in range(5)], ridge)
    for g in range(5):
        refit = explicit(x[group != g], y[group != g], ridge)
        expected = np.sum((x[group == g] @ refit - y[group == g]) ** 2)
        assert errors[g] == pytest.approx(expected, rel=1e-10)


def test_sums_of_groups_give_the_fit_to_all_rows() -> None:
    x, y, group = rows(2)
    whole = added([products(x[group == g], y[group == g]) for g in range(5)])
    fitted = solved(whole, 1e-3)
    np.testing.assert_allclose(fitted, explicit(x, y, 1e-3), rtol=1e-10)
    assert squared_error(whole, fitted) == pytest.approx(np.sum((x @ fitted - y) ** 2), rel=1e-10)


def test_the_constant_has_no_ridge() -> None:
    x, y, _ = rows(3)
    x[:, 1:] -= x[:, 1:].mean(axis=0)
    np.testing.assert_allclose(solved(products(x, y), 1e9)[0], y.mean(axis=0), rtol=1e-9)


def test_a_lag_of_a_step_and_of_a_ramp_has_its_closed_form() -> None:
    rng = np.random.default_rng(4)
    time, tau = np.concatenate([[0.0], np.sort(rng.uniform(0.0, 3.0, 3000))]), 0.4
    steps, ramp = np.ones(time.size - 1), np.minimum(time, 1e9)
    start = np.stack([steps, ramp[:-1]], axis=1)
    start[0, 0] = 1.0
    before = np.stack([steps, ramp[1:]], axis=1)
    zero = [[0.0, 0.0]]
    out = lagged(np.concatenate([[-1.0], time]), np.vstack([zero, start]), np.vstack([zero, before]), tau)[1:]
    np.testing.assert_allclose(out[:, 0], 1.0 - np.exp(-time / tau), atol=1e-9)
    np.testing.assert_allclose(out[:, 1], time - tau * (1.0 - np.exp(-time / tau)), atol=1e-9)
