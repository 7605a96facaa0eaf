"""A fit that contains a smaller one starts from its optimum too, and ends no higher; if it does, its status says so."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.identification import Experiment, FitResult, Parameter, fit
from pliant.identification.fit import below_nested
from pliant.identification.initial_guess import prepare
from pliant.identification.nested import contains, excess_phrase, parents, warm_start
from pliant.identification.problem import Problem
from pliant.model import Memory, Model

STEP = 1e-3
SMALL = ("stiffness", "damping")
MORE = (*SMALL, "creep_share_1", "creep_time_1", "torque_2", "tip.along", "latency")


def listed(*entries: str | Parameter) -> list[Parameter]:
    return [Parameter(e) if isinstance(e, str) else e for e in entries]


@pytest.fixture(scope="module")
def creeping(truth: Model, traced: Any) -> Experiment:
    exp: Experiment = traced(truth.with_(memory=Memory((0.4,), (0.1,))))
    return exp


@pytest.fixture(scope="module")
def small(creeping: Experiment, truth: Model) -> FitResult:
    return fit([creeping], truth, SMALL, time_step=STEP, starts=1)


FIXED = Parameter("torque_1", 6e-7, free=False)


@pytest.mark.parametrize(("larger", "smaller", "yes"), [
    ((*SMALL, "gain"), SMALL, True),
    (SMALL, (*SMALL, "gain"), False),
    (SMALL, SMALL, False),
    (("stiffness_1", "stiffness_2", "damping"), SMALL, True),
    (("stiffness_*", "damping"), SMALL, True),
    (SMALL, ("stiffness_*", "damping"), False),
    ((*SMALL, "gain", FIXED), (*SMALL, FIXED), True),
    ((*SMALL, "gain", "torque_1"), (*SMALL, FIXED), True),
    ((*SMALL, "gain", FIXED.with_(value=5e-7)), (*SMALL, FIXED), False),
    ((*SMALL, "gain"), (*SMALL, FIXED), False),
    ((*SMALL, "gain", FIXED), SMALL, True),
])  # fmt: skip
def test_one_fit_contains_another(larger: Any, smaller: Any, yes: bool) -> None:
    assert contains(listed(*larger), listed(*smaller)) == yes


def test_the_parents_are_the_largest_fits_inside_with_the_same_recordings() -> None:
    fits = {"all": listed(*MORE), "some": listed(*SMALL, "torque_2"), "few": listed(*SMALL), "other": listed(*SMALL)}
    found = parents(fits, lambda one, other: "other" not in (one, other))
    assert found == {"all": ("some",), "some": ("few",), "few": (), "other": ()}


def test_the_optimum_of_the_smaller_fit_is_a_start_of_the_same_cost(
    creeping: Experiment, truth: Model, small: FitResult
) -> None:
    """Each added term at the value at which it has no effect, or at its start value where that costs less."""
    bad = [Parameter("creep_share_1", 30.0), Parameter("creep_time_1", 9.0)]
    model, filled = prepare([creeping], truth, [*listed(*SMALL, "tip.along", "mass"), *bad])
    problem = Problem([creeping], model, filled, STEP, "travel")
    x = warm_start(problem, small)
    assert x is not None
    alone = Problem([creeping], small.model, list(small.parameters), STEP, "travel")
    assert problem.cost(x) == pytest.approx(alone.cost(alone.start), rel=1e-9)
    assert problem.cost(problem.start) > 1.5 * problem.cost(x)
    further = prepare([creeping], truth, listed(*MORE))[1]
    other = Problem([creeping], model, further, STEP, "travel")
    x = warm_start(other, small)
    assert x is not None
    assert other.cost(x) < (1.0 + 1e-9) * alone.cost(alone.start)


def test_a_bad_start_ends_above_the_smaller_fit_unless_it_knows_it(
    creeping: Experiment, truth: Model, small: FitResult
) -> None:
    far = [*SMALL, Parameter("creep_share_1", 30.0), Parameter("creep_time_1", 9.0)]
    options: dict[str, Any] = {"time_step": STEP, "starts": 1, "max_evaluations": 2}
    alone = fit([creeping], truth, far, **options)
    lines: list[str] = []
    warm = fit([creeping], truth, far, nested={"small": small}, progress=lines.append, **options)
    assert alone.rmse["t"] > small.rmse["t"]
    assert warm.rmse["t"] < (1.0 + 1e-9) * small.rmse["t"]
    assert [line[:12] for line in lines] == ["start 1 of 2", "start 2 of 2"]


def test_an_end_above_the_start_from_a_smaller_fit_is_searched_again_and_measured() -> None:
    calls = []

    def residual(x: np.ndarray) -> np.ndarray:
        calls.append(x)
        return np.array([x[0] - 1.0, 2.0])

    problem: Any = SimpleNamespace(
        residual=residual, jacobian=lambda _x: np.array([[1.0], [0.0]]), free=[SimpleNamespace(name="damping")],
        bounds=(np.array([-9.0]), np.array([9.0])), weighting="travel", unit=1.0, model=SimpleNamespace(space=None),
    )
    end: Any = SimpleNamespace(cost=9.0, x=np.array([4.0]))
    best, excess = below_nested(problem, end, {"near": np.array([1.5]), "unknown": None}, "linear", 50)
    assert best.cost == pytest.approx(2.0)
    assert set(excess) == {"near"}
    assert excess["near"] < 0.0
    assert len(calls) > 2
    kept, excess = below_nested(problem, end, {"near": np.array([1.5])}, "linear", 1)
    assert kept.cost <= 2.125
    assert excess_phrase(excess) == ""


def test_a_fit_that_stays_above_a_smaller_one_is_no_success(
    creeping: Experiment, truth: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    import importlib

    module = importlib.import_module("pliant.identification.fit")
    monkeypatch.setattr(module, "below_nested", lambda _problem, best, *_others: (best, {"small": 0.55, "tiny": 1e-6}))
    found = fit([creeping], truth, SMALL, time_step=STEP, starts=1)
    assert not found.converged
    assert found.status.startswith("The fit did not converge: its cost is 55 % above that of the fit small, which")
    assert "tiny" not in found.status


def test_a_prior_keeps_its_mean_when_a_search_moves_the_start() -> None:
    """The mean is the first start value: each later start would otherwise draw the prior along."""
    p = Parameter("mass", 0.3, prior_std=0.2)
    assert p.prior == 0.3
    assert p.with_(value=0.1).prior == 0.3
    assert Parameter("mass", prior_std=0.2).with_(value=0.1).prior == 0.1
    assert Parameter("mass", 0.3).prior is None
