"""Inner formulas of the estimators against their matrix form, written out with NumPy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pliant.estimation.adaptive_observer_loops import correct_all
from pliant.estimation.kalman_loops import add_noise


def test_noise_of_torques_that_joints_share_is_one_random_number_for_all(rng):
    n, N, h, walk = 3, 8, 2e-3, np.array([0.2, 0.5])
    J = rng.normal(size=(3 * n, 2 * n))
    own, common, gain = rng.uniform(0.1, 1.0, n), np.array([0.7, 0.0]), rng.normal(size=(2, n))
    P = np.zeros((N, N))
    add_noise(P, n, h, gain, (own, common, walk, 3.0, np.array([4.0])), J, np.empty(2 * n))
    rates = J[2 * n :].T  # (2n, n): what a torque at each joint does to the state
    expected = rates @ np.diag(own / h) @ rates.T + common[0] / h * np.outer(rates @ gain[0], rates @ gain[0])
    np.testing.assert_allclose(P[: 2 * n, : 2 * n], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(P[2 * n :, 2 * n :], np.diag(walk) * (1.0 + 3.0 * 4.0) * h, rtol=1e-12)


def test_the_factor_is_corrected_by_recursive_least_squares(rng):
    n = 3
    gain, root = rng.normal(size=(3 * n, n)), rng.normal(size=(n, n))
    precision, innovation, by = root @ root.T, rng.normal(size=n), rng.normal(size=3 * n)
    start = {name: rng.normal(size=n) for name in ("angle", "rate", "own_shift")}
    p = 0.3
    state = SimpleNamespace(innovation=innovation.copy(), sensitivity=by.copy(), factor=np.array([1.1, p]),
                            **{k: v.copy() for k, v in start.items()})  # fmt: skip
    correct_all(state, SimpleNamespace(gain=gain, precision=precision), np.empty(3 * n), np.empty(3 * n))
    seen = by[:n]
    step = p * seen @ precision @ innovation / (1.0 + p * seen @ precision @ seen)
    assert state.factor[0] == pytest.approx(1.1 + step, rel=1e-12)
    assert state.factor[1] == pytest.approx(p / (1.0 + p * seen @ precision @ seen), rel=1e-12)
    left = by - gain @ seen
    np.testing.assert_allclose(state.sensitivity, left, rtol=1e-12, atol=1e-13)
    moved = gain @ innovation + left * step
    found = np.concatenate([state.angle, state.rate, state.own_shift]) - np.concatenate(list(start.values()))
    np.testing.assert_allclose(found, moved, rtol=1e-10, atol=1e-13)
