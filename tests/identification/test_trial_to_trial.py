"""Bands of new recordings: the reach of the training residuals, and the scatter of parameters from trial to trial."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import t

from pliant.identification import Experiment, FitResult, fit, predict, prediction_band, residual_reach
from pliant.identification.prediction_bands import TRIAL_GAIN, TRIAL_TURN, TrainingResiduals, trial_turn
from pliant.model import Model, Valve

STEP = 2e-3


@pytest.fixture
def clean(truth: Model, traced: Any) -> tuple[Model, Experiment]:
    """A recording without any error, by the very step of the fit."""
    model = truth.with_(valve=Valve())
    exp = traced(model)
    return model, replace(exp, position=predict(model, exp, {}, STEP)["position"])


def fitted(model: Model, *experiments: Experiment) -> FitResult:
    return fit(list(experiments), model, ["stiffness", "damping", "gain"], time_step=STEP, starts=1)


def shaken(exp: Experiment, errors: np.ndarray, name: str = "t") -> Experiment:
    return replace(exp, name=name, position=exp.position + 1e-4 * errors)


@pytest.mark.parametrize(("kind", "expected"), [("normal", 1.96), ("uniform", 0.95 * 3**0.5)])
def test_the_reach_of_residuals_is_their_quantile(clean: tuple[Model, Experiment], kind: str, expected: float) -> None:
    model, exp = clean
    rng = np.random.default_rng(1)
    errors = {"normal": rng.standard_normal, "uniform": lambda n: rng.uniform(-1, 1, n)}[kind](exp.position.shape)
    seen = shaken(exp, errors)
    found = fitted(model, seen)
    assert residual_reach([seen], found) == pytest.approx(expected, rel=0.07)


def test_the_reach_scales_the_noise_alone(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    seen = shaken(exp, np.random.default_rng(2).standard_normal(exp.position.shape))
    found = fitted(model, seen)
    wide, narrow = (prediction_band(exp, found, noise=1e-3, reach=r) for r in (None, 1.5))
    np.testing.assert_allclose(0.5 * (wide.upper - wide.lower), 1.959964 * wide.std)
    parameters = 1.959964 * prediction_band(exp, found).std
    np.testing.assert_allclose(0.5 * (narrow.upper - narrow.lower), np.hypot(parameters, 1.5e-3))
    spread = np.full_like(wide.std, 2e-3)
    np.testing.assert_allclose(narrow.widened(spread).upper - narrow.position,
                               np.hypot(narrow.upper - narrow.position, 1.959964 * spread))  # fmt: skip


def test_fewer_than_three_recordings_leave_the_scatter_of_trials_to_a_stated_gain(
    clean: tuple[Model, Experiment],
) -> None:
    model, exp = clean
    rng = np.random.default_rng(3)
    trials = [shaken(exp, rng.standard_normal(exp.position.shape), n) for n in ("one", "two", "three")]
    for few in (trials[:1], trials[:2]):
        std = prediction_band(exp, fitted(model, *few), training=few).std
        assert (std >= TRIAL_GAIN * np.abs(exp.position - exp.position[:1])).all()
    alike = prediction_band(exp, fitted(model, *trials), training=trials).std
    assert alike.max() < 0.2 * std.max()


def test_two_levels_through_which_a_torque_law_passes_do_not_show_a_gain_of_each(
    clean: tuple[Model, Experiment], traced: Any,
) -> None:
    model, rng = clean[0], np.random.default_rng(7)

    def trial(name: str, level: float, gain: float) -> Experiment:
        exp = traced(model.with_(torque=gain * model.torque), name, level)
        return shaken(exp, rng.standard_normal(exp.position.shape), name)

    train = [trial("low", 6e4, 1.02), trial("high", 1.2e5, 0.98)]
    law = fit(train, model, ["stiffness", "damping", "torque_1", "torque_2"], time_step=STEP, starts=1)
    between = trial("between", 9e4, 0.975)
    assert prediction_band(between, law, training=train, noise=1e-4).holds(between.position) > 0.9
    assert prediction_band(between, law, noise=1e-4).holds(between.position) < 0.85


def test_the_scatter_of_three_recordings_widens_the_band_of_a_fourth(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    rng = np.random.default_rng(4)
    trials = []
    for k, gain in enumerate((0.95, 1.0, 1.05)):
        moved = replace(exp, position=predict(model.with_(torque=gain * model.torque), exp, {}, STEP)["position"])
        trials.append(shaken(moved, rng.standard_normal(exp.position.shape), f"t{k}"))
    found = fitted(model, *trials)
    assert found.covariance is not None
    wide = prediction_band(exp, found, training=trials, noise=1e-4)
    fourth = predict(model.with_(torque=1.04 * model.torque), exp, {}, STEP)["position"]
    assert wide.holds(fourth) > 0.9
    unscattered = replace(found, covariance=found.covariance._replace(between=None))
    mean_only = prediction_band(exp, unscattered, training=trials, noise=1e-4)
    assert wide.std.max() > 1.15 * mean_only.std.max()


@pytest.mark.parametrize("count", [2, 3, 6])
def test_bands_hold_recordings_that_rest_beside_the_model(clean: tuple[Model, Experiment], count: int) -> None:
    """Errors at rest of normal distribution, of which a fit takes the mean: their difference over the standard
    deviation of a few is distributed as Student's t.
    """
    exp = clean[1].thinned(10)
    rng, rows, normal = np.random.default_rng(5), exp.position, 1.959964
    held, before = [], []
    for _ in range(300):
        rests = 1e-3 * rng.standard_normal((count + 1, 1, *rows.shape[1:]))
        rests -= rests[:-1].mean(axis=0)
        train = [replace(exp, name=f"t{k}", position=rows - rest) for k, rest in enumerate(rests[:-1])]
        left = TrainingResiduals(train, [rows] * count, "metre")
        noise = left.noise(exp, rows)
        held.append(np.mean(np.abs(rests[-1]) <= normal * np.hypot(noise, left.rest_spread(exp.stations))))
        before.append(np.mean(np.abs(rests[-1]) <= normal * noise))
    larger = (t.ppf(0.975, 3 * (count - 1)) / normal) ** 2
    reach = normal * np.sqrt((1 - 1 / count + 2 / count * larger) / (1 + 1 / count))
    assert np.mean(held) == pytest.approx(2 * t.cdf(reach, count - 1) - 1, abs=0.03)
    assert np.mean(before) < np.mean(held) - 0.03


def test_noise_of_frames_is_no_scatter_of_rests(clean: tuple[Model, Experiment]) -> None:
    exp = clean[1].thinned(10)
    rng, spreads = np.random.default_rng(6), []
    for _ in range(200):
        noisy = [shaken(exp, rng.standard_normal(exp.position.shape), f"t{k}") for k in range(4)]
        spreads.append(TrainingResiduals(noisy, [exp.position] * 4, "metre").rest_spread(exp.stations) ** 2)
    scattered = [replace(e, position=e.position + 1e-4 * k) for k, e in enumerate(noisy)]
    there = TrainingResiduals(scattered, [exp.position] * 4, "metre").rest_spread(exp.stations) ** 2
    assert np.mean(spreads) < 0.15 * 1e-8  # of the variance of the noise
    assert there.mean() > 0.5 * 1e-8


def test_one_recording_shows_no_scatter_of_rests(clean: tuple[Model, Experiment]) -> None:
    _, exp = clean
    left = TrainingResiduals([exp], [exp.position + 1e-3], "metre")
    np.testing.assert_array_equal(left.rest_spread(exp.stations), 0.0)


@pytest.mark.parametrize("count", [1, 2])
def test_few_recordings_leave_turns_of_the_base_to_a_stated_prior(clean: tuple[Model, Experiment], count: int) -> None:
    """A fit takes the mean of the turns; the residuals of K recordings contain 1 - 1 / K of their variance."""
    exp = clean[1].thinned(10)
    rng, rows = np.random.default_rng(8), exp.position
    square = np.zeros_like(rows)
    for turns in TRIAL_TURN * rng.standard_normal((2000, count + 1)):
        cos, sin = np.cos(turns), np.sin(turns)
        turned = np.einsum("tsj,ijk->ktsi", rows, np.array([[cos, -sin], [sin, cos]]))
        square += (turned[-1] - turned[:-1].mean(axis=0)) ** 2 / 2000
    x, y = np.moveaxis(rows, -1, 0)
    residuals = (1 - 1 / count) * TRIAL_TURN**2 * np.stack([y, x], axis=-1) ** 2
    scale = np.abs(rows).max()
    np.testing.assert_allclose(np.hypot(trial_turn(exp, rows, count), np.sqrt(residuals)), np.sqrt(square), rtol=0.08,
                               atol=1e-4 * scale)  # fmt: skip


def test_turns_of_the_base_count_where_no_recording_shows_them(clean: tuple[Model, Experiment]) -> None:
    _, exp = clean
    assert trial_turn(exp, exp.position, 2).max() > 0
    for seen, count in ((exp, 3), (replace(exp, own_places=True), 2)):
        np.testing.assert_array_equal(trial_turn(seen, exp.position, count), 0.0)
    model, found = clean[0], fitted(clean[0], exp)
    left = TrainingResiduals.of([exp], found)
    half = left.band(exp, found, exp.position, found).upper - predict(model, exp, found.values, STEP)["position"]
    assert (half >= 1.959 * trial_turn(exp, exp.position, 1)).all()
