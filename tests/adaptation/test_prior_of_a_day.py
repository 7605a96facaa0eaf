"""The prior of another day against closed forms of linear Gaussian problems, and what belongs to the mounting."""

from __future__ import annotations

import importlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pliant.adaptation.adapt import common_factor, verdict_of
from pliant.adaptation.change import BodyChange
from pliant.adaptation.day import parts_of_day
from pliant.adaptation.mounting import (
    COMMON,
    COMMON_GAIN,
    MOUNTING,
    common_gain,
    mounting_parameters,
    of_mounting,
    width_of,
)
from pliant.adaptation.posterior import Posterior, of_a_kind, posterior_of
from pliant.adaptation.result import DayError, Move
from pliant.errors import InputError
from pliant.identification import Experiment, FitResult, Parameter
from pliant.identification.names import declarations
from pliant.identification.problem import JointPrior, Problem
from pliant.identification.residuals import correlated_frames
from pliant.identification.uncertainty import Covariance, scatter_between
from pliant.model import Station, Tendon, chain_model
from pliant.simulation import Trace

adapting = importlib.import_module("pliant.adaptation.adapt")


def prior(rng: np.random.Generator, names: tuple[str, ...]) -> JointPrior:
    root = rng.normal(size=(len(names), len(names)))
    return JointPrior(names, rng.normal(size=len(names)), root @ root.T + np.eye(len(names)))


def test_the_rows_of_a_joint_prior_are_its_quadratic_form(rng):
    joint = prior(rng, ("stiffness", "damping", "tip_mass"))
    free = [Parameter(n, 1.0) for n in ("damping", "torque_1", "stiffness", "tip_mass")]
    scale = np.array([0.1, 2.0, 3.0, 0.5])
    A, b = joint.rows(free, scale)
    x = rng.normal(size=4)
    values = dict(zip((p.name for p in free), x * scale, strict=True))
    off = np.array([values[n] for n in joint.names]) - joint.mean
    assert np.sum((A @ x - b) ** 2) == pytest.approx(off @ np.linalg.solve(joint.covariance, off), rel=1e-9)


def test_parameters_that_are_not_free_are_marginalised(rng):
    joint = prior(rng, ("stiffness", "damping", "tip_mass"))
    A, b = joint.rows([Parameter("damping", 1.0)], np.ones(1))
    assert A.shape == (1, 1)
    assert (A[0, 0] ** -2, b[0] / A[0, 0]) == pytest.approx((joint.covariance[1, 1], joint.mean[1]))


@pytest.mark.parametrize(("change", "said"), [
    ({"mean": np.zeros(2)}, "needs a mean"), ({"mean": np.array([np.nan, 0, 0])}, "finite"),
    ({"covariance": np.diag([1.0, 0.0, 1.0])}, "that of damping is not"),
])  # fmt: skip
def test_an_impossible_prior_is_refused(change, said):
    entries = {"mean": np.zeros(3), "covariance": np.eye(3)} | change
    with pytest.raises(InputError, match=said):
        JointPrior(("stiffness", "damping", "tip_mass"), **entries)


def test_scatter_between_recordings_is_found_and_noise_alone_gives_none(rng):
    count, frames, true = 12, 400, 0.3
    J = rng.normal(size=(count, frames, 2))
    inverse = np.linalg.inv(np.einsum("kti,ktj->ij", J, J))

    def scores(spread: float) -> np.ndarray:
        x = spread * rng.normal(size=(count, 2))
        y = np.einsum("kti,ki->kt", J, x) + 0.1 * rng.normal(size=(count, frames))
        mean = inverse @ np.einsum("kti,kt->i", J, y)
        return np.einsum("kti,kt->ki", J, y - J @ mean)

    noise = 0.1**2 * inverse
    found = scatter_between(scores(true), inverse, noise)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), true, rtol=0.5)
    quiet = np.mean([np.diag(scatter_between(scores(0.0), inverse, noise)) for _ in range(20)])
    assert quiet < 0.3 * count * noise[0, 0]
    assert scatter_between(scores(true)[:2], inverse, noise) is None


def test_every_row_of_the_mounting_is_a_parameter():
    assert set(MOUNTING) <= set(declarations())
    assert of_mounting("base_tilt_x")
    assert of_mounting("tip.along")
    assert not of_mounting("stiffness")
    assert not of_mounting("left.torque_1")


def test_the_mounting_of_a_planar_arm_has_its_values_and_wide_priors():
    model = chain_model(length=0.2, mass=0.1, links=2, stiffness=1.0, damping=0.1, torque=[1e-6], base_angle=0.03,
                        tip_mass=0.01, rest_angle=[0.1, -0.2], stations=(Station("tip", 1, 0.1),))  # fmt: skip
    time = np.arange(20) / 10
    position = np.stack([np.sin(time), 0.1 + 0 * time], axis=1)[:, None]
    exp = Experiment("day", time, position, ("tip",), "trace", Trace(time, 1e4 * time))
    listed = {p.name: p for p in mounting_parameters(model, [exp], {"base_x": 2e-3})}
    assert {n: p.value for n, p in listed.items()} == pytest.approx({
        "tip_mass": 0.01, "start": 0.0, "rest_angle_1": 0.1, "rest_angle_2": -0.2, "base_x": 2e-3, "base_y": 0.0,
        "base_angle": 0.03, "tip.along": 0.1, "tip.across": 0.0,
    })  # fmt: skip
    assert listed["base_x"].prior_std == pytest.approx(0.1 * 0.2)
    assert listed["tip_mass"].prior_std == pytest.approx(0.1 * 0.1)
    assert all(p.free and p.prior == p.value for p in listed.values())


def test_a_pretension_is_as_wide_as_the_largest_one():
    tendon = Tendon(driven_by="displacement", lever=0.01, line_stiffness=1e3, pretension=8.0, joint_gain=[1.0],
                    cross_gain=[0.0], name="m")  # fmt: skip
    model = chain_model(length=0.2, mass=0.1, links=1, stiffness=1.0, damping=0.1, space=True, chambers=(tendon,))
    assert width_of("m.pretension", model) == pytest.approx(0.3 * 8.0)


def test_a_factor_on_inputs_is_a_power_of_it_on_a_torque_law():
    values = {"stiffness": 2.0, "torque_1": 3.0, "torque_2": 5.0, "gain": 7.0}
    np.testing.assert_allclose(common_gain(tuple(values), values), [0.0, 3.0, 10.0, 0.0])
    values = {"a.gain_x": 2.0, "a.axial_gain": 3.0, "b.torque_1": 4.0, "b.gain_y": 5.0}
    np.testing.assert_allclose(common_gain(tuple(values), values), [2.0, 3.0, 4.0, 0.0])


def result(values: dict[str, float], std: float = 0.01) -> FitResult:
    model = chain_model(length=0.2, mass=0.1, links=2, stiffness=values["stiffness"], damping=0.1, torque=[1e-6])
    listed = tuple(Parameter(n, v, std=std) for n, v in values.items())
    spread = Covariance(tuple(values), std**2 * np.eye(len(values)), np.eye(len(values)), np.zeros(len(values), bool),
                        0.0, 100.0)  # fmt: skip
    return FitResult(model, listed, "", {"old": 1e-3}, 1, 0.0, True, spread)


def test_what_belongs_to_recordings_and_mounting_is_left_out_of_the_body():
    found = posterior_of(result({"stiffness": 1.0, "base_angle": 0.1, "old.base_x": 0.01}), {"old"})
    assert found.body.names == ("stiffness",)
    assert found.values == {"base_angle": 0.1}
    assert np.sqrt(found.body.covariance[0, 0]) == pytest.approx(np.hypot(0.01, 0.02))  # doubt and day to day
    with pytest.raises(InputError, match="no free parameter of the body"):
        posterior_of(result({"stiffness": 1.0}).__class__(**{
            **vars(result({"stiffness": 1.0})), "parameters": (Parameter("stiffness", 1.0, free=False),)}), set())


def test_the_common_factor_is_the_posterior_mean_of_a_linear_problem():
    joint = JointPrior(("a.torque_1", "b.torque_1"), np.array([2.0, 4.0]), np.diag([0.01, 0.04]))
    posterior = Posterior(None, (), joint, {}, {})
    log_factor = 0.05
    moved = SimpleNamespace(values={"a.torque_1": 2.0 * (1 + log_factor), "b.torque_1": 4.0 * (1 + log_factor)})
    information = 2.0**2 / 0.01 + 4.0**2 / 0.04
    expected = log_factor * information / (information + COMMON_GAIN**-2)
    assert common_factor(posterior, moved) == pytest.approx(expected)


def test_several_robots_tell_the_spread_of_their_kind():
    robots = [posterior_of(result({"stiffness": k, "damping": 0.1}), set()) for k in (0.8, 1.0, 1.2)]
    kind = of_a_kind(robots, 0.5)
    assert kind.body.means["stiffness"] == pytest.approx(1.0)
    spread = np.sqrt(0.04 * (1 + 1 / 3) + np.mean([0.01**2 + (0.02 * k) ** 2 for k in (0.8, 1.0, 1.2)]))
    assert kind.body.std["stiffness"] == pytest.approx(spread)
    one = of_a_kind(robots[:1], 0.5)
    assert one.body.std["stiffness"] == pytest.approx(np.sqrt((0.5 * 0.8) ** 2 + 0.01**2 + 0.016**2))


def test_the_gains_of_an_input_in_space_turn_as_one_vector():
    gains = {"stiffness": 1.0, "a.gain_x": 0.03, "a.gain_y": -0.4, "b.gain_x": 0.2}
    kind = of_a_kind([posterior_of(result(gains), set())], 0.1)
    spread = np.hypot(0.03, 0.4) * 0.1
    for name, size in (("a.gain_x", spread), ("a.gain_y", spread), ("b.gain_x", 0.1 * 0.2), ("stiffness", 0.1)):
        doubt = 0.01**2 + (0.02 * gains[name]) ** 2
        assert kind.body.std[name] == pytest.approx(np.sqrt(size**2 + doubt)), name


def test_scatter_between_the_recordings_of_a_robot_is_no_difference_between_robots():
    found = result({"stiffness": 1.0, "damping": 0.1})
    scattered = found.covariance._replace(between=np.diag([0.25, 0.01]))
    other = posterior_of(replace(found, covariance=scattered), set())
    assert other.body.std["stiffness"] == pytest.approx(np.sqrt(0.01**2 + 0.02**2 + 0.25))  # on another day
    kind = of_a_kind([other], 0.1)
    assert kind.body.std["stiffness"] == pytest.approx(np.sqrt(0.01**2 + 0.02**2 + 0.1**2))


def test_robots_whose_studies_list_parameters_in_another_order():
    first = posterior_of(result({"stiffness": 1.0, "damping": 0.1}), set())
    turned = result({"damping": 0.1, "stiffness": 1.0})
    turned = posterior_of(replace(turned, covariance=turned.covariance._replace(matrix=np.diag([4.0, 9.0]))), set())
    assert turned.body.names == ("damping", "stiffness")
    kind = of_a_kind([first, turned], 0.1)
    spread = np.array([0.1 * 1.0, 0.1 * 0.1]) ** 2
    np.testing.assert_allclose(np.diag(kind.body.covariance) - spread,
                               [(0.01**2 + 9.0) / 2 + 0.02**2, (0.01**2 + 4.0) / 2 + 0.002**2])  # fmt: skip


def moving(seconds: float, **options: object) -> Experiment:
    time = np.arange(0.0, seconds, 0.05)
    position = 0.1 * np.stack([np.sin(time), np.cos(time)], axis=1)[:, None]
    return Experiment("day", time, position, ("tip",), "trace", Trace(time, 1e4 * np.sin(time)), **options)


def test_a_day_is_cut_where_the_seconds_end():
    parts = parts_of_day([moving(30.0), replace(moving(10.0), name="later")], 12.0)
    assert [e.name for e in parts.fitted] == ["day"]
    assert [e.name for e in parts.judged] == ["day_rest", "later"]
    fitted, rest = parts.fitted[0], parts.judged[0]
    seen = np.isfinite(rest.compared).all(axis=(1, 2))
    assert fitted.time[-1] == pytest.approx(12.0)
    assert rest.time[seen][0] == pytest.approx(12.05)
    assert seen.sum() + fitted.time.size == moving(30.0).time.size
    assert rest.time[0] == 0.0  # simulated from the beginning


def test_seconds_within_the_warm_up_are_refused():
    with pytest.raises(InputError, match="after the warm-up of 4 s, and a fit needs"):
        parts_of_day([moving(30.0, warm_up=4.0)], 4.2)


def problem_of(seconds: float) -> Problem:
    """A problem of one free stiffness with a prior, and one recording at 20 Hz."""
    model = chain_model(length=0.2, mass=0.1, links=1, stiffness=1.0, damping=0.1, torque=[1e-6],
                        stations=(Station("tip", 0, 0.1),))  # fmt: skip
    return Problem([moving(seconds)], model, [Parameter("stiffness", 1.0, prior=1.0, prior_std=0.1)], 5e-3, "travel")


def test_a_recording_shows_an_error_of_the_model_once_in_its_correlation_time():
    problem = problem_of(20.0)
    problem.expect_error(0.03, 2.0)
    frames = 2.0 / 0.05
    assert problem.size == pytest.approx(0.03 * np.sqrt(frames))
    white = 1e-4 * np.random.default_rng(0).standard_normal(problem.ends[-1])
    (observed,) = problem.observed
    assert problem.frames_of_error(observed, white) == pytest.approx(frames)  # closer than the model deserves
    assert problem.frames_of_error(observed, 1e3 * white) == correlated_frames(observed, white)
    problem.expect_error(0.03, 1e6)
    assert problem.size == pytest.approx(0.03 * np.sqrt(0.5 * moving(20.0).time.size))  # at least twice


def test_an_overfitted_day_is_fitted_again_with_priors_that_weigh_more(monkeypatch):
    day = parts_of_day([moving(30.0)], 12.0)
    old = result({"stiffness": 1.0})
    old = replace(old, rmse={"old": 4e-3}, covariance=old.covariance._replace(correlated=3.0))
    asked = []

    def fitted(error: float) -> list[float]:
        asked.clear()

        def fitted_day(_posterior, _day, _prior, options):
            asked.append(options.get("error_time", 0.0))
            return replace(old, rmse={"day": error})

        monkeypatch.setattr(adapting, "fitted_day", fitted_day)
        monkeypatch.setattr(adapting, "judged", lambda *_a, **_k: None)
        monkeypatch.setattr(adapting, "check_day", lambda *_: None)
        monkeypatch.setattr(adapting, "strained", lambda _moves: True)
        monkeypatch.setattr(adapting, "body_change", lambda *_: BodyChange())
        adapting.adapt_model(old, posterior_of(old, {"old"}), day)
        return list(asked)

    free_body = [0.0]  # by which a change is judged
    assert fitted(1e-3) == [0.0, 3.0, *free_body]  # overfitted, then nothing demands another body
    assert fitted(3e-3) == [0.0, *free_body]
    assert fitted(9e-3) == [0.0, 0.0, *free_body]  # all parameters of the body are released


@pytest.mark.parametrize(("factor", "named"), [(0.85, True), (1.2, True), (1.02, False)])
def test_a_common_gain_may_be_a_change_of_stiffness_and_the_verdict_says_so(factor, named):
    rows = (Move(COMMON, "mounting", "1", 1.0, factor, None, COMMON_GAIN, None, None),)
    errors = (DayError("day", "fitted", 9e-3, 1e-3, 0.1),)
    verdict, sentence = verdict_of(result({"stiffness": 1.0}), rows, errors, "base_angle", BodyChange())
    assert verdict == "re-mounted"
    assert ("may be the inverse factor on all stiffnesses" in sentence) == named
    assert (f"The factor {factor:.3g}" in sentence) == named


def test_errors_that_the_earlier_mounting_cannot_make_are_a_new_one_although_no_parameter_stands_out():
    day = result({"stiffness": 1.0})
    rows = [Move(n, "mounting", "m", 0.0, -0.03, None, 0.03, 0.029, None) for n in ("base_y", "tip.along")]
    expected = np.hypot(6e-3, 0.02 * 0.15)
    for before, much in ((1.4 * expected, False), (1.6 * expected, True), (39e-3, True)):
        errors = [DayError("day", "fitted", before, 7e-3, 0.15)]
        assert adapting.surprising(errors, 6e-3) == much
        phrase = adapting.mounting_moved(rows, surprising=much)
        assert ("base_y" in phrase) == much
        assert verdict_of(day, rows, errors, phrase, BodyChange())[0] == ("re-mounted" if much else "same arm")


@pytest.mark.parametrize("form", [0.0, 1.5])
def test_a_mounting_that_moves_farther_than_its_priors_and_errors_of_form_allow_is_none(form):
    names, std = tuple(f"base_{axis}" for axis in "xyz"), 0.03
    spread = SimpleNamespace(names=names, form=form * std**2 * np.eye(3) if form else None)
    day = SimpleNamespace(covariance=spread)
    limit = np.sqrt((1.0 + form) * (3.0 + 8.0 * 6.0**0.5) / 3.0)  # of each of three moves
    for away in (0.99, -0.99, 1.01, -1.01):
        rows = [Move(n, "mounting", "m", 0.0, std * limit * away, None, std, 0.01, None) for n in names]
        assert adapting.no_mounting(rows, day) == ("base_x, base_y and base_z" if abs(away) > 1.0 else "")
    assert adapting.no_mounting([], day) == ""


def test_another_gripper_and_another_clock_are_no_other_arm():
    names, std = ("tip_mass", "start", "pretension", "base_x", "rest_angle_1"), 0.01
    day = SimpleNamespace(covariance=SimpleNamespace(names=names, form=None))
    for far, impossible in (("tip_mass", ""), ("start", ""), ("pretension", ""), ("base_x", "base_x and rest_angle_1")):
        rows = [Move(n, "mounting", "", 0.0, 10.0 * std * (n == far), None, std, 1e-3, None) for n in names]
        assert adapting.no_mounting(rows, day) == impossible


def test_odds_that_favour_another_arm_are_its_verdict():
    day, errors = result({"stiffness": 1.0}), (DayError("day", "fitted", 9e-3, 1e-3, 0.1),)
    for another, expected in (("most of its parameters changed", "another arm"), ("", "re-mounted")):
        verdict, sentence = verdict_of(day, (), errors, "base_angle", BodyChange((), another, 3))
        assert verdict == expected
        assert ("Another arm: most of its parameters changed. Identify it anew" in sentence) == bool(another)


def test_a_mounting_that_moved_without_a_smaller_error_is_told_as_it_was_computed():
    day = result({"stiffness": 1.0})
    clear, vague = ([Move("base_x", "mounting", "m", 0.0, 0.01, None, 0.017, std, None)] for std in (0.001, 0.016))
    for rows, phrase, expected in (
        (clear, "base_x", "hardly mounted anew: base_x moved, which does not make the errors 13 % smaller"),
        (vague, "the mounting as a whole", "its errors are larger than expected: no other mounting makes them 13 %"),
        (vague, "", "in the same mounting: no parameter moved beyond its doubt"),
    ):
        for after, better in ((4.5e-3, False), (4.0e-3, bool(phrase))):
            errors = (DayError("day", "fitted", 5e-3, after, 0.1),)
            verdict, sentence = verdict_of(day, rows, errors, phrase, BodyChange())
            assert verdict == ("re-mounted" if better else "same arm")
            assert (expected in sentence) == (not better)


@pytest.mark.parametrize("mounting", ["", "base_angle"])
def test_a_refuted_change_is_told_and_the_evidence_for_another_arm_stays(mounting):
    day, errors = result({"stiffness": 1.0}), (DayError("day", "fitted", 9e-3, 1e-3, 0.1),)
    _, sentence = verdict_of(day, (), errors, mounting, BodyChange(compared=3, refuted=("damping",)))
    assert "that damping changed, as a fit whose body is free shows, the rest of the day refutes" in sentence
    assert "no parameter" not in sentence
    change = BodyChange(another="most of its parameters changed", compared=3, refuted=("damping",))
    assert verdict_of(day, (), errors, mounting, change)[0] == "another arm"


def test_a_day_at_the_highest_level_is_compared_with_the_worst_earlier_recording(monkeypatch):
    old = replace(result({"stiffness": 1.0}), rmse={"20": 0.5e-3, "40": 1e-3, "60": 2e-3, "80": 4e-3})
    day = parts_of_day([moving(9.0)], 9.0)
    after = replace(old, rmse={e.name: 3e-3 for e in day.fitted})
    monkeypatch.setattr(adapting, "all_moves", lambda *_: ())
    monkeypatch.setattr(adapting, "error_of", lambda *_: 4e-3)
    asked = []
    monkeypatch.setattr(adapting, "surprising", lambda errors, largest: bool(asked.append(largest)))
    adapting.judged(old, posterior_of(old, {"20"}), day, after, BodyChange(), {"usual": 1.5e-3, "kind": False})
    assert asked == [4e-3]


def test_one_bad_recording_of_a_day_is_no_new_mounting():
    errors = [DayError(f"r{k}", "judged", before, 1e-3, 0.1) for k, before in enumerate((7e-3, 2e-3, 2e-3))]
    assert adapting.surprising(errors[:1], 2e-3)
    assert not adapting.surprising(errors, 2e-3)


@pytest.mark.parametrize(("usual", "refuted"), [(2e-3, False), (5e-4, True)])
def test_a_change_is_refuted_by_an_error_above_the_usual_one_alone(monkeypatch, usual, refuted):
    old = result({"stiffness": 1.0})
    known, other = posterior_of(old, {"old"}), replace(old, rmse={"other": 1.0})
    monkeypatch.setattr(adapting, "fitted_day", lambda *_: other)
    monkeypatch.setattr(adapting, "body_change", lambda *_: BodyChange(("stiffness",), "too much", 3))
    monkeypatch.setattr(adapting, "error_of_rest", lambda fitted, _day: 1.2e-3 if fitted is other else 1e-3)
    how = {"progress": None, "earlier": list, "usual": usual}
    change, _, fitted = adapting.with_change(old, known, parts_of_day([moving(9.0)], 9.0), (old, {}), how, lambda _: {})
    assert (change.names == ()) == refuted
    assert (fitted is old) == refuted
    assert change.refuted == (("stiffness",) if refuted else ())
    assert (change.another, change.compared) == ("too much", 3)
