"""Doubt beyond noise: scatter between recordings and blocks, and errors of the model's form in coherent residuals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.identification import Experiment, fit, predict
from pliant.identification.clusters import UNSEEN, Clusters, at_least, clusters_of, coherence, error_of_form, given
from pliant.identification.problem import Problem
from pliant.identification.residuals import Observations
from pliant.model import Model, Valve

STEP = 2e-3
FREE = ["stiffness", "damping", "gain"]


@pytest.fixture
def clean(truth: Model, traced: Any) -> tuple[Model, Experiment]:
    """A recording without any error, by the very step of the fit."""
    model = truth.with_(valve=Valve())
    exp = traced(model)
    return model, replace(exp, position=predict(model, exp, {}, STEP)["position"])


def noisy(exp: Experiment, seed: int, size: float = 3e-4) -> Experiment:
    return replace(exp, position=exp.position + size * np.random.default_rng(seed).normal(size=exp.position.shape))


def turned(exp: Experiment, angle: float) -> Experiment:
    """The recording of a body whose base is turned."""
    c, s = np.cos(angle), np.sin(angle)
    return replace(exp, position=exp.position @ np.array([[c, s], [-s, c]]))


def test_the_sandwich_of_means_is_the_sample_variance_over_their_number() -> None:
    rng = np.random.default_rng(1)
    count, each = 5, 40
    means = rng.normal(size=count)
    residual = np.repeat(means, each) - means.mean()
    rows = tuple(np.split(np.arange(count * each), count))
    inverse = np.array([[1 / residual.size]])
    found = Clusters(rows, "5 recordings").sandwich(np.ones((count * each, 1)), residual, inverse)
    assert found is not None
    assert found[0, 0] == pytest.approx(means.var(ddof=1) / count)
    assert Clusters(rows[:1], "").sandwich(np.ones((each, 1)), residual, np.eye(1)) is None


def test_the_larger_of_two_covariances_is_below_neither(rng: np.random.Generator) -> None:
    roots = rng.normal(size=(2, 3, 3))
    noise, scatter = (r @ r.T + 0.01 * np.eye(3) for r in roots)
    both = at_least(noise, scatter)
    for part in (noise, scatter):
        assert np.linalg.eigvalsh(both - part).min() > -1e-9
    np.testing.assert_allclose(at_least(noise, 0.5 * noise), noise, rtol=1e-9)
    np.testing.assert_allclose(at_least(noise, 3.0 * noise), 3.0 * noise, rtol=1e-9)


def test_residuals_of_noise_are_not_coherent_and_those_of_a_turned_base_are(clean: tuple[Model, Experiment]) -> None:
    _, exp = clean
    rows = np.concatenate([exp.position, 0 * exp.position[..., :1]], axis=2)
    for seen, low, high in ((noisy(exp, 2), 0.0, 0.02), (noisy(turned(exp, 0.03), 2), 0.3, 1.0)):
        observed = Observations(seen, "travel")
        assert low <= coherence(observed, observed.residual(rows)) <= high
    single = replace(exp, position=np.full_like(exp.position[:, -1:], np.nan), stations=exp.stations[-1:],
                     angle=np.sin(exp.time)[:, None], angle_reference="base")  # fmt: skip
    assert coherence(Observations(single, "travel"), np.ones(exp.time.size)) == UNSEEN


def test_an_error_common_to_all_recordings_does_not_average_out(rng: np.random.Generator, clean: Any) -> None:
    observed = Observations(noisy(clean[1], 3, 1e-9), "travel")
    J = rng.normal(size=(observed.count, 2))
    residual = np.repeat(np.sin(np.arange(observed.count / 4)), 4)
    part = (observed, residual, J)
    one = error_of_form([part], np.linalg.inv(J.T @ J))
    three = error_of_form([part] * 3, np.linalg.inv(3 * J.T @ J))
    np.testing.assert_allclose(three, one, rtol=1e-9)


def test_a_prior_is_never_left_with_less_certainty_than_it_states(rng: np.random.Generator) -> None:
    root = rng.normal(size=(3, 3))
    form, std = 1e4 * root @ root.T, np.array([0.5, 2.0])
    held = given(form, np.diag(1.0 / std) @ np.eye(3)[:2])
    assert (np.sqrt(np.diag(held))[:2] <= std).all()
    np.testing.assert_allclose(given(form, np.zeros((0, 3))), form)
    np.testing.assert_allclose(given(np.array([[4.0]]), np.array([[1.0]])), [[0.8]])  # 1 / (1/4 + 1)


def test_doubt_holds_the_truth_where_the_model_lacks_something_and_adds_nothing_to_noise(clean: Any) -> None:
    model, exp = clean
    true = {"stiffness": 0.9, "damping": 6e-3, "gain": 1.0}

    def off(seen: Experiment) -> tuple[np.ndarray, np.ndarray, Any]:
        found = fit([seen], model, FREE, time_step=STEP, starts=1)
        away = np.array([abs(found.values[n] - true[n]) for n in FREE])
        spread = found.covariance
        return away / np.array(spread.std), away / np.array([p.std for p in found.parameters if p.free]), found

    alone, whole, found = off(noisy(turned(exp, 0.03), 4))
    assert alone.max() > 2.5  # noise says that the truth is excluded
    assert whole.max() < 2.0
    assert any("errors of the model's form" in note for note in found.notes)
    alone, whole, found = off(noisy(exp, 5))
    np.testing.assert_allclose(whole, alone, rtol=0.05)


def test_one_long_recording_is_divided_into_blocks_and_several_are_not(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    found = fit([noisy(exp, 6)], model, FREE, time_step=STEP, starts=1)

    def parts(*experiments: Experiment) -> Clusters:
        problem = Problem(list(experiments), found.model, list(found.parameters), STEP, "travel")
        return clusters_of(problem, problem.start, problem.data_residual(problem.start))

    assert parts(noisy(exp, 6), noisy(replace(exp, name="b"), 7)).words == "2 recordings"
    assert parts(noisy(exp, 6)).words == ""  # shorter than four blocks
    repeats = 40
    time = np.concatenate([exp.time + k * (np.ptp(exp.time) + 0.01) for k in range(repeats)])
    rng = np.random.default_rng(8)
    long = replace(exp, time=time, position=np.tile(exp.position, (repeats, 1, 1)) + 3e-4 * rng.normal(
        size=(time.size, *exp.position.shape[1:])))  # fmt: skip
    blocks = parts(long)
    assert "blocks of" in blocks.words
    assert len(blocks.rows) >= 4
    assert np.array_equal(np.sort(np.concatenate(blocks.rows)), np.arange(Observations(long, "travel").count))
