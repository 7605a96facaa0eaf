"""Several starts: one that runs into a minimum that was found stops there, one that leads elsewhere goes on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.identification.optimise import solve, solve_all


@pytest.fixture
def two_bowls() -> Any:
    """Minima near -1, with a residual of 0.3 that stays, and near 1, higher; x counts in parameters of size 1."""
    asked: list[float] = []

    def residual(x: np.ndarray) -> np.ndarray:
        asked.append(float(x[0]))
        return np.array([x[0] ** 2 - 1.0, 0.2 * (x[0] + 1.0), 0.3])

    def jacobian(x: np.ndarray) -> np.ndarray:
        return np.array([[2.0 * x[0]], [0.2], [0.0]])

    bounds = (np.array([-9.0]), np.array([9.0]))
    return SimpleNamespace(
        residual=residual, jacobian=jacobian, free=[SimpleNamespace(name="damping")], bounds=bounds, weighting="travel",
        unit=1.0, evaluations=0, asked=asked, model=SimpleNamespace(space=None),
    )


def starts(*values: float) -> list[np.ndarray]:
    return [np.array([v]) for v in values]


@pytest.mark.parametrize("order", [(2.0, -2.0), (-2.0, 2.0)])
def test_the_lower_of_two_minima_wins_whichever_comes_first(two_bowls: Any, order: tuple[float, float]) -> None:
    best = solve_all(two_bowls, starts(*order), "linear", 100, None)
    assert best.x == pytest.approx([-1.0], abs=1e-6)
    assert best.cost == pytest.approx(0.5 * 0.3**2)


def test_a_start_on_its_way_to_a_known_minimum_stops(two_bowls: Any) -> None:
    first = solve(two_bowls, np.array([-2.0]), "linear", 100)
    alone = len(two_bowls.asked)
    solve(two_bowls, np.array([-3.0]), "linear", 100)
    whole = len(two_bowls.asked) - alone
    two_bowls.asked.clear()
    told: list[str] = []
    best = solve_all(two_bowls, starts(-2.0, -3.0), "linear", 100, told.append)
    assert len(two_bowls.asked) < alone + whole
    assert np.array_equal(best.x, first.x)
    assert "cost 0.045" in told[0]
    assert "a minimum found before" in told[1]


@pytest.mark.parametrize("loss", ["linear", "soft_l1"])
def test_an_optimisation_stops_at_its_best_iterate_when_its_time_is_over(
    two_bowls: Any, monkeypatch: pytest.MonkeyPatch, loss: str,
) -> None:
    seconds = iter(range(1000))
    monkeypatch.setattr("pliant.identification.optimise.clock.monotonic", lambda: float(next(seconds)))
    late = solve(two_bowls, np.array([-3.0]), loss, 100, deadline=2.5)
    cost = [0.5 * float(np.sum(np.square(two_bowls.residual(np.array([x]))))) for x in dict.fromkeys(two_bowls.asked)]
    assert late.status == 0
    assert 3 <= len(cost) <= 6  # from the derivatives at the start and at two iterates
    assert late.cost == pytest.approx(min(cost))
    assert late.jac[0] == pytest.approx(2.0 * late.x[0]) or loss == "linear"  # which gives fewer rows
    never = solve(two_bowls, np.array([-3.0]), loss, 100, deadline=-1.0)
    assert never.x == pytest.approx([-3.0])


def test_robust_losses_take_every_start_to_its_end(two_bowls: Any) -> None:
    best = solve_all(two_bowls, starts(2.0, -2.0, -3.0), "soft_l1", 100, None)
    assert best.x == pytest.approx([-1.0], abs=1e-4)


@pytest.mark.parametrize(("names", "quick"), [(("stiffness", "creep_share_1"), True), (("damping", "torque_1"), False)])
def test_a_valley_of_stiffness_and_creep_is_straight_in_logarithms(names: tuple[str, str], quick: bool) -> None:
    """K (1 + s) is seen well, K hardly: from (1, 1) to (0.02, 99); numbers of other names take the bend in steps."""
    asked: list[np.ndarray] = []

    def residual(x: np.ndarray) -> np.ndarray:
        asked.append(x)
        return np.array([x[0] * (1.0 + x[1]) - 2.0, 0.01 * (x[0] - 0.02)])

    def jacobian(x: np.ndarray) -> np.ndarray:
        return np.array([[1.0 + x[1], x[0]], [0.01, 0.0]])

    problem: Any = SimpleNamespace(
        residual=residual, jacobian=jacobian, free=[SimpleNamespace(name=n) for n in names], weighting="travel",
        bounds=(np.array([1e-9, 0.0]), np.array([np.inf, 1e3])), unit=1.0, scale=np.ones(2),
        evaluations=0, model=SimpleNamespace(space=None),
    )
    found = solve(problem, np.ones(2), "linear", 400)
    evaluations = len(asked)
    J = jacobian(found.x)
    assert found.jac.T @ found.jac == pytest.approx(J.T @ J, rel=1e-6)
    assert (evaluations < 25) == quick
    assert (found.x == pytest.approx([0.02, 99.0], rel=1e-3)) or not quick
