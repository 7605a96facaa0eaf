"""Changes of the body against closed forms of linear Gaussian problems."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pliant.adaptation.change import (
    ODDS,
    OTHERWISE,
    BodyChange,
    body_change,
    odds_of_another,
    shift_and_scatter,
    stepwise,
    why_another,
)
from pliant.adaptation.posterior import Posterior, by_joint
from pliant.errors import InputError
from pliant.identification import Parameter
from pliant.identification.problem import JointPrior
from pliant.model import chain_model

JOINTS = ("stiffness_1", "stiffness_2", "stiffness_3")


def posterior(names: tuple[str, ...] = (*JOINTS, "damping"), std: float = 0.02) -> Posterior:
    model = chain_model(length=0.2, mass=0.1, links=3, stiffness=[1.0, 2.0, 4.0], damping=0.1, torque=[1e-6])
    means = {"stiffness": 2.0, **dict(zip(JOINTS, (1.0, 2.0, 4.0), strict=True)), "damping": 0.1, "torque_1": 1e-6,
             "base_angle": 0.2}  # fmt: skip
    mean = np.array([means[n] for n in names])
    return Posterior(model, tuple(Parameter(n, m) for n, m in zip(names, mean, strict=True)),
                     JointPrior(names, mean, np.diag((std * mean) ** 2)), {}, {})  # fmt: skip


def fitted(known: Posterior, factors: dict[str, float], std: float = 0.03) -> SimpleNamespace:
    """The result of a fit with a free body."""
    names, mean = known.body.names, known.body.mean
    values = {n: m * factors.get(n, 1.0) for n, m in zip(names, mean, strict=True)}
    return SimpleNamespace(values=values,
                           covariance=SimpleNamespace(names=names, total=np.diag((std * mean) ** 2)))  # fmt: skip


def with_one_more(name: str, value: float, std: float) -> Posterior:
    """A posterior with another parameter of the body, whose value may be 0."""
    known = posterior()
    covariance = np.diag(np.r_[np.diag(known.body.covariance), std**2])
    return replace(known, parameters=(*known.parameters, Parameter(name, value)), body=JointPrior(
        (*known.body.names, name), np.r_[known.body.mean, value], covariance))  # fmt: skip


def fitted_to(known: Posterior, values: dict[str, float]) -> SimpleNamespace:
    """The result of a fit with a free body, with values and the covariance of the posterior."""
    return SimpleNamespace(values=known.body.means | values,
                           covariance=SimpleNamespace(names=known.body.names, total=known.body.covariance))  # fmt: skip


def day_move(known: Posterior, day: SimpleNamespace) -> np.ndarray:
    """By how much a fit moved the parameters of the body, in their order."""
    return np.array([day.values[n] - m for n, m in known.body.means.items()])


def test_one_direction_explains_what_it_caused_in_a_generalised_sense(rng):
    root = rng.normal(size=(4, 4))
    covariance = root @ root.T + 0.1 * np.eye(4)
    units = dict(zip("abcd", np.eye(4), strict=True))
    move = 50.0 * units["c"]
    assert stepwise(move, covariance, units, 4.0) == ("c",)
    W = np.linalg.inv(covariance)
    explained = (W @ move)[2] ** 2 / W[2, 2]
    assert explained == pytest.approx(move @ W @ move)
    assert stepwise(move, covariance, units, np.sqrt(explained) + 1e-6) == ()
    assert set(stepwise(move - 40.0 * units["a"], covariance, units, 4.0)) == {"a", "c"}


def test_a_direction_is_dropped_that_others_explain_as_well():
    units = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0]), "both": np.array([1.0, 1.0, 0.1])}
    move = np.array([10.0, 9.0, 0.0])  # "both" explains most, then x and y leave nothing to it
    assert set(stepwise(move, np.eye(3), units, 0.5)) == {"x", "y"}


def test_shift_and_scatter_of_earlier_recordings(rng):
    moves = rng.normal(size=(200, 3)) @ np.diag([1.0, 2.0, 0.5]) + np.array([3.0, 0.0, -1.0])
    shift, scatter = shift_and_scatter(moves)
    np.testing.assert_allclose(shift, [3.0, 0.0, -1.0], atol=0.5)
    np.testing.assert_allclose(scatter, (1 + 1 / 200) * np.cov(moves.T), rtol=1e-9)
    shift, scatter = shift_and_scatter(moves[:1])
    np.testing.assert_allclose(scatter, np.outer(moves[0], moves[0]))


def test_a_body_like_the_earlier_one_is_not_compared():
    known = posterior()

    def never() -> list[object]:
        raise AssertionError("nothing calls for the earlier recordings")

    assert body_change(known, fitted(known, {"damping": 1.02}), never, never) == BodyChange()


@pytest.mark.parametrize("factor", [0.6, 1.4])
def test_the_joint_that_changed_is_named(factor):
    known = posterior()
    day = fitted(known, {"stiffness_2": factor})
    earlier = iter([{"stiffness_3": 1.05}, {"stiffness_3": 1.1}, {"stiffness_3": 1.08}])
    found = body_change(known, day, lambda: [0, 1, 2], lambda _exp: fitted(known, next(earlier)))
    assert (found.names, found.compared) == (("stiffness_2",), 3)
    assert found.another == ""
    (change,) = found.changes
    assert (change.name, change.before, change.unit) == ("stiffness_2", 2.0, "N m/rad")
    assert change.after == pytest.approx(2.0 * factor)
    assert change.deviations == pytest.approx((factor - 1.0) / np.hypot(0.02, 0.03), rel=0.02)
    assert change.sentence.startswith(f"stiffness_2 2 to {2.0 * factor:.4g} N m/rad ({'+' if factor > 1 else '-'}11 sd")


def test_what_earlier_recordings_show_too_is_no_change_of_the_body():
    known = posterior()
    day = fitted(known, {"stiffness_1": 0.8, "damping": 1.3})
    earlier = iter([{"stiffness_1": s, "damping": d} for s, d in ((0.82, 1.25), (0.78, 1.3), (0.81, 1.33))])
    found = body_change(known, day, lambda: [0, 1, 2], lambda _exp: fitted(known, next(earlier)))
    assert found == BodyChange((), compared=3)


def test_a_change_is_counted_from_what_earlier_recordings_show_too():
    known = posterior()
    day = fitted(known, {"stiffness_2": 0.6, "damping": 1.3})
    earlier = iter([{"damping": d} for d in (1.28, 1.3, 1.32)])
    found = body_change(known, day, lambda: [0, 1, 2], lambda _exp: fitted(known, next(earlier)))
    assert [c.name for c in found.changes] == ["stiffness_2"]
    assert found.changes[0].after == pytest.approx(1.2)


def test_without_earlier_recordings_the_verdict_says_so():
    known = posterior()
    found = body_change(known, fitted(known, {"stiffness_2": 0.6}), list, lambda _exp: None)
    assert (found.names, found.compared) == (("stiffness_2",), 0)
    assert "could not be compared" in found.caution

    def still(_exp):
        raise InputError("holds no motion")

    assert body_change(known, fitted(known, {"stiffness_2": 0.6}), lambda: [0], still).compared == 0


def test_all_joints_together_are_one_change_and_most_parameters_another_arm():
    known = posterior()
    day = fitted(known, dict.fromkeys(JOINTS, 1.4))
    found = body_change(known, day, lambda: [0, 1], lambda _exp: fitted(known, {}))
    assert (found.names, found.compared) == (("stiffness",), 2)
    (change,) = found.changes
    assert change.after == pytest.approx(1.4)
    assert change.deviations == pytest.approx(0.4 / (np.hypot(0.02, 0.03) / 3**0.5))  # of three joints
    assert change.sentence == "stiffness of every joint, as a factor, 1 to 1.4 (+19 sd)"
    assert found.another == ""  # one cause, although three parameters changed
    factors = (1.5, 0.7, 1.3, 1.4)
    other = fitted(known, dict(zip(known.body.names, factors, strict=True)))
    for found in (body_change(known, other, lambda: [0, 1], lambda _exp: fitted(known, {})),
                  body_change(known, other, list, lambda _exp: None)):  # fmt: skip
        assert "too many parameters changed for one cause (" in found.another


def test_the_odds_of_another_arm_are_those_of_gaussian_densities(rng):
    known = posterior()
    sizes = known.body.mean
    root = 0.1 * np.diag(sizes) @ rng.normal(size=(4, 4))
    covariance, move = root @ root.T + np.diag((0.05 * sizes) ** 2), sizes * rng.normal(size=4)
    first = np.array([sizes[0], 0.0, 0.0, 0.0])

    def density(spread):
        return multivariate_normal(np.zeros(4), covariance + OTHERWISE**2 * spread).logpdf(move)

    other = density(np.diag(sizes**2))
    assert odds_of_another(move, covariance, [], known) == pytest.approx(other - density(0.0) + np.log(ODDS))
    some = density(np.outer(first, first))
    assert odds_of_another(move, covariance, [first], known) == pytest.approx(other - some + np.log(ODDS))
    still = odds_of_another(np.zeros(4), covariance, [], known)
    assert still < np.log(ODDS)  # parameters that need not differ count against another arm


@pytest.mark.parametrize(("start", "after"), [(0.02, 0.4), (-0.005, 0.15), (0.0, 0.2)])
def test_a_change_of_a_parameter_small_for_its_kind_is_no_other_arm(start, after):
    known = with_one_more("stiffening", start, 0.02)
    day = fitted_to(known, {"stiffening": after})
    found = body_change(known, day, lambda: [0, 1], lambda _exp: fitted_to(known, {}))
    assert (found.names, found.another) == (("stiffening",), "")
    assert found.changes[0].after == pytest.approx(after)
    sizes = np.array([1.0, 2.0, 4.0, 0.1, 0.2])  # 0.2 1/rad: the typical scale of a stiffening
    spread = OTHERWISE**2 * np.diag(sizes**2 * (np.arange(5) == 4))
    doubt = np.diag((0.05 * sizes) ** 2)
    move = day_move(known, day)
    other, some = (multivariate_normal(np.zeros(5), doubt + s).logpdf(move)
                   for s in (OTHERWISE**2 * np.diag(sizes**2), spread))  # fmt: skip
    direction = np.eye(5)[4] * (abs(start) or 1.0)
    assert odds_of_another(move, doubt, [direction], known) == pytest.approx(other - some + np.log(ODDS))


def test_a_parameter_without_a_size_is_left_out_of_the_odds():
    known = with_one_more("torque_2", 0.0, 1e-13)  # at 0, without a typical scale
    day = fitted_to(known, {"torque_2": 3e-12})
    found = body_change(known, day, lambda: [0, 1], lambda _exp: fitted_to(known, {}))
    assert (found.names, found.another) == (("torque_2",), "")
    doubt = np.diag(np.r_[(0.05 * np.array([1.0, 2.0, 4.0, 0.1])) ** 2, 1e-26])
    alone = odds_of_another(np.zeros(4), doubt[:4, :4], [], posterior())
    assert odds_of_another(day_move(known, day), doubt, [np.eye(5)[4]], known) == pytest.approx(alone)


@pytest.mark.parametrize("names", [("stiffness", "damping"), ("stiffness", "damping", "torque_1")])
def test_two_changes_are_no_other_arm_however_few_parameters_its_body_has(names):
    known = posterior(names)
    day = fitted(known, {"stiffness": 1.4, "damping": 1.4})
    found = body_change(known, day, lambda: [0, 1], lambda _exp: fitted(known, {}))
    assert set(found.names) == {"stiffness", "damping"}
    assert found.another == ""


@pytest.mark.parametrize(("deviations", "another"), [(2.0, False), (2.3, False), (2.8, True), (3.7, True)])
def test_what_the_named_changes_leave_is_another_arm_beyond_the_limit_of_naming(deviations, another):
    known = posterior()
    factors = 1.0 + deviations * np.hypot(0.02, 0.03) * np.array([1.0, -1.0, -1.0])
    day = fitted(known, {"stiffness_1": 1.6} | dict(zip(known.body.names[1:], factors, strict=True)))
    found = body_change(known, day, lambda: [0, 1], lambda _exp: fitted(known, {}))
    assert found.names == ("stiffness_1",)
    assert (3.0 * deviations**2 > 4.0**2) == another
    assert ("stiffness_1 and, taken together, the other parameters" in found.another) == another


def test_one_leftover_below_the_limit_of_naming_is_no_other_arm():
    known = posterior(("stiffness", "damping", "torque_1"))
    day = fitted(known, {"stiffness": 1.4, "damping": 1.0 + 3.7 * np.hypot(0.02, 0.03)})
    found = body_change(known, day, lambda: [0, 1], lambda _exp: fitted(known, {}))
    assert (found.names, found.another) == (("stiffness",), "")


def test_a_common_stiffness_is_split_into_those_of_the_joints():
    known = posterior(("stiffness", "damping"), std=0.1)
    split = by_joint(known, 0.02, 6)
    assert split.body.names == (*JOINTS, "damping")
    np.testing.assert_allclose(split.body.mean, [1.0, 2.0, 4.0, 0.1])
    stiffness = np.array([1.0, 2.0, 4.0])
    expected = 0.1**2 * np.outer(stiffness, stiffness) + np.diag((0.02 * stiffness) ** 2)
    np.testing.assert_allclose(split.body.covariance[:3, :3], expected)
    assert [p.name for p in split.parameters] == ["damping", *JOINTS]
    assert by_joint(known, 0.02, 2) is known  # more joints than are judged one by one
    assert by_joint(replace(known, body=known.body.of(["damping"])), 0.02, 6).body.names == ("damping",)


def test_three_changes_are_another_arm_unless_many_other_parameters_stay():
    gains = tuple(f"joint_gain_{k + 1}" for k in range(11))
    three = dict.fromkeys(("stiffness_1", "stiffness_3", "damping"), 1.4)
    known = posterior((*JOINTS, "damping"))
    found = body_change(known, fitted(known, three), lambda: [0, 1], lambda _exp: fitted(known, {}))
    move = known.body.mean * np.array([0.4, 0.0, 0.4, 0.4])
    assert len(found.names) == 3
    assert found.another.startswith("in a fit whose body is free, too many parameters changed for one cause")
    wide = replace(known, parameters=(*known.parameters, *(Parameter(n, 1.0) for n in gains)), body=JointPrior(
        (*known.body.names, *gains), np.r_[known.body.mean, np.ones(11)],
        np.diag(np.r_[np.diag(known.body.covariance), np.full(11, 0.02**2)])))  # fmt: skip
    doubt = np.diag((0.036 * wide.body.mean) ** 2)
    assert why_another(np.r_[move, np.zeros(11)], doubt, tuple(three), wide) == ""
