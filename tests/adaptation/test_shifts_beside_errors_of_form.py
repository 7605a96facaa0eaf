"""Known shifts of every mounting parameter of arms that the model cannot express, and their standard errors."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from virtual_days import NAMES, Arm, blank, identified, recorded

from pliant.adaptation import adapt_model, parts_of_day, posterior_of
from pliant.adaptation.adapt import mounting_of_earlier, with_error_of_form
from pliant.adaptation.mounting import mounting_parameters
from pliant.errors import InputError
from pliant.identification import FitResult, Parameter
from pliant.identification.uncertainty import Covariance


def fitted(moves: dict[str, float], std: float = 0.1) -> FitResult:
    """A fit of a day with independent errors of its parameters, and wide priors."""
    names, unit = tuple(moves), np.eye(len(moves))
    listed = tuple(Parameter(n, m, prior=0.0, prior_std=1.0, std=std) for n, m in moves.items())
    spread = Covariance(names, std**2 * unit, std**2 * unit, np.zeros(len(names), bool), 0.0, 100.0)
    return FitResult(None, listed, "", {"day": 1e-3}, 1, 0.0, True, spread)


def test_moves_of_the_mounting_in_earlier_recordings_are_a_part_of_its_standard_errors():
    earlier = iter([{"base_x": 0.3, "stiffness": 9.0, "tip_mass": 0.0}, {"base_x": 0.1, "stiffness": 9.0,
                                                                         "tip_mass": 8.0}])  # fmt: skip
    moves = mounting_of_earlier(lambda: [0, 1], lambda _exp: fitted(next(earlier)))
    assert moves == [{"base_x": 0.3, "tip_mass": 0.0}, {"base_x": 0.1, "tip_mass": 8.0}]
    found = with_error_of_form(fitted({"base_x": 0.5, "stiffness": 1.0, "tip_mass": 0.0}), moves)
    std = {p.name: p.std for p in found.parameters}
    assert std["base_x"] == pytest.approx(np.sqrt(0.1**2 + 1.5 * (0.3**2 + 0.1**2) / 2))
    assert std["stiffness"] == pytest.approx(0.1)
    assert std["tip_mass"] == pytest.approx(1.0)  # no less certain than its prior
    np.testing.assert_allclose(found.covariance.matrix, 0.1**2 * np.eye(3))  # of predictions by the same model
    assert np.linalg.eigvalsh(found.covariance.form).min() > -1e-12


def test_without_earlier_recordings_standard_errors_stay():
    def still(_exp: object) -> FitResult:
        raise InputError("holds no motion")

    assert mounting_of_earlier(lambda: [0], still) == []
    day = fitted({"base_x": 0.5})
    assert with_error_of_form(day, []) is day
    lost = SimpleNamespace(covariance=None)
    assert with_error_of_form(lost, [{"base_x": 1.0}]) is lost


def shifted(arm: Arm, seed: int) -> tuple[object, dict[str, float]]:
    """A recording of an arm of six joints on another day, and the true mounting of a model with three."""
    rng = np.random.default_rng([seed, 6])
    arm = replace(arm, stiffness=arm.stiffness * (1 + 0.02 * rng.standard_normal(3)))
    fine, coarse = arm.model(6, gain=float(np.exp(0.05 * rng.standard_normal()))), arm.model(3)
    exp, true = blank("day", 14.0, arm.space, rng), {}
    for p in mounting_parameters(coarse, [exp], {}):
        while not p.lower <= (value := rng.normal(p.prior, p.prior_std)) <= p.upper:
            pass
        true[p.name] = value
    values = {n: v for n, v in true.items() if not n.startswith("rest_")}
    for k in range(6):
        values[f"rest_angle_{k + 1}"] = true[f"rest_angle_{k // 2 + 1}"] / 2
    for name in NAMES:  # from the last joint of six, not of three
        values[f"{name}.along"] -= arm.length / 12
    return recorded(exp, fine, values, rng), true


def errors(count: int, days: int) -> np.ndarray:
    """Errors of the mounting's parameters on days of some arms, in standard errors."""
    rows = []
    for seed in range(count):
        arm = replace(Arm.drawn(seed, space=False), midsegment=True)
        old, exps = identified(arm, seed)
        posterior = posterior_of(old, {e.name for e in exps})
        for k in range(days):
            exp, true = shifted(arm, 100 * seed + k)
            result = adapt_model(old, posterior, parts_of_day([exp], 10.0), earlier=partial(list, exps)).result
            rows += [(p.value - true[p.name]) / p.std for p in result.parameters if p.name in true and p.free and p.std]
    return np.array(rows)


@pytest.mark.slow
def test_shifts_lie_within_two_standard_errors_although_the_model_lacks_something():
    z = errors(4, 2)
    assert z.size == 4 * 2 * 14
    assert 0.86 <= np.mean(np.abs(z) <= 2.0) <= 0.99
