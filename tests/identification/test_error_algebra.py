"""What follows from a covariance, a spectrum of singular values, a pair of errors: on numbers made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.identification import Parameter, uncertainty
from pliant.identification.clusters import Clusters
from pliant.identification.identifiability import combinations
from pliant.identification.problem import scattered
from pliant.identification.uncertainty import HIDDEN, Covariance, covariance


def test_fixing_one_parameter_leaves_the_conditional_error_of_the_other() -> None:
    """Of two normal errors with correlation rho, knowing one narrows the other to sqrt(1 - rho^2) of itself."""
    std, rho = np.array([0.8, 0.6]), 0.95
    relative = np.outer(std, std) * np.array([[1.0, rho], [rho, 1.0]])
    values = np.array([2.0, 3.0])
    free = [Parameter("stiffness", 2.0), Parameter("gain", 3.0)]
    problem: Any = SimpleNamespace(free=free, scale=values)
    found = Covariance(
        ("stiffness", "gain"), relative * np.outer(values, values), np.eye(2), np.zeros(2, bool), 0.0, 100.0
    )
    (sentence,) = combinations(problem, np.ones(2), found)
    alone = std[1] * np.sqrt(1 - rho**2)
    assert f"other errors would fall: gain from 60 to {100 * alone:.0f} %" in sentence
    assert "stiffness is weakly determined (standard error 80 %)" in sentence
    assert f"gain {10 * rho * std[1] / std[0]:.1f} % higher" in sentence


@pytest.mark.parametrize(("least", "hidden"), [(1.2e-6, True), (1.6e-6, False), (1e-3, False)])
def test_a_direction_is_hidden_by_its_share_of_the_largest_singular_value(
    monkeypatch: pytest.MonkeyPatch, least: float, hidden: bool,
) -> None:
    """Two columns of length 1 at a small angle: singular values sqrt(2) and `least`; HIDDEN of the first decides."""
    a = np.arcsin(least / np.sqrt(2.0))
    J = np.zeros((50, 2))
    J[0], J[1] = np.cos(a), (np.sin(a), -np.sin(a))
    np.testing.assert_allclose(np.linalg.svd(J, compute_uv=False), [np.sqrt(2.0) * np.cos(a), least], rtol=1e-9)
    assert 1.2e-6 < HIDDEN * np.sqrt(2.0) < 1.6e-6
    monkeypatch.setattr(uncertainty, "correlated_frames", lambda _o, _r: 1.0)
    monkeypatch.setattr(uncertainty, "clusters_of", lambda *_: Clusters((), ""))  # of noise alone
    monkeypatch.setattr(uncertainty, "error_of_form", lambda _parts, inverse: 0.0 * inverse)
    residual = np.random.default_rng(0).standard_normal(50)
    observed: Any = SimpleNamespace(exp=SimpleNamespace(time=np.arange(50.0)))
    problem: Any = SimpleNamespace(
        free=[Parameter("stiffness", 1.0), Parameter("gain", 1.0)], scale=np.ones(2), size=1.0, least_error=0.0,
        known=(np.zeros((0, 2)), np.zeros(0)), observed=[observed], parted=lambda rows: [(observed, rows)],
        data_jacobian=lambda _x: J, data_residual=lambda _x: residual,
    )
    found = covariance(problem, np.ones(2))
    assert found.hidden.tolist() == [hidden, hidden]
    if not hidden:
        expected = np.mean(residual**2) * 50 / 48 * np.linalg.inv(J.T @ J)
        np.testing.assert_allclose(found.matrix, expected, rtol=1e-3)


def test_a_scattered_start_lies_on_both_sides_and_leaves_edges() -> None:
    free = [Parameter("stiffness", 2.0), Parameter("gain", -1.0, lower=-5.0), Parameter("p.start", 0.1)]
    x, rng = np.array([2.0, -1.0, 0.1]), np.random.default_rng(4)
    bounds = np.array([0.0, -5.0, 0.0]), np.array([2.4, 5.0, 1.0])
    moved = np.array([scattered(free, x, bounds, rng) for _ in range(400)]) / x - 1.0
    assert (moved[:, 2] == 0.0).all()
    for column, highest in ((0, 0.2), (1, 0.3)):
        assert -0.3 <= moved[:, column].min() < -0.28
        assert highest - 0.02 < moved[:, column].max() <= highest + 1e-12
        assert 0.4 < (moved[:, column] < 0).mean() < 0.6
