"""Errors that hold: coverage over many seeds, coloured residuals, priors, joints that lean on their mean, bands."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import (
    Experiment,
    Parameter,
    bootstrap,
    bootstrapped,
    fit,
    predict,
    prediction_band,
    residual_noise,
)
from pliant.identification.prediction_bands import motion_traits, variance_by
from pliant.identification.result import cautions
from pliant.model import Model, Valve

STEP = 2e-3
TRUE = {"stiffness": 0.9, "damping": 6e-3, "gain": 1.0}


@pytest.fixture
def clean(truth: Model, traced: Any) -> tuple[Model, Experiment]:
    """An ideal valve, and a recording made with the very step of the fit: noise is the only error."""
    model = truth.with_(valve=Valve())
    exp = traced(model)
    return model, replace(exp, position=predict(model, exp, {}, STEP)["position"])


def coloured(rng: np.random.Generator, shape: tuple[int, ...], size: float, memory: float) -> np.ndarray:
    """First-order noise of standard deviation `size`, each frame keeping `memory` of the one before."""
    noise = size * rng.standard_normal(shape)
    for k in range(1, shape[0]):
        noise[k] = memory * noise[k - 1] + np.sqrt(1 - memory**2) * noise[k]
    return noise


def scores(model: Model, exp: Experiment, seeds: int, noise: Any, **options: Any) -> np.ndarray:
    """Errors in standard errors (seeds, P)."""
    rows = []
    for seed in range(seeds):
        shaken = replace(exp, position=exp.position + noise(np.random.default_rng(seed), exp.position.shape))
        found = fit([shaken], model, [Parameter(n, v) for n, v in TRUE.items()], time_step=STEP, starts=1, **options)
        rows.append([(p.value - TRUE[p.name]) / p.std for p in found.parameters])
    return np.array(rows)


@pytest.mark.slow
def test_intervals_cover_as_often_as_they_say(clean: tuple[Model, Experiment]) -> None:
    z = scores(*clean, 200, lambda rng, shape: 3e-4 * rng.standard_normal(shape))
    covered = (np.abs(z) < 1.96).mean()
    assert 0.93 <= covered <= 0.97


@pytest.mark.slow
def test_coloured_residuals_widen_the_intervals(clean: tuple[Model, Experiment]) -> None:
    def noise(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return coloured(rng, shape, 3e-4, 0.8)

    z = scores(*clean, 40, noise)
    assert 0.6 < np.sqrt((z**2).mean()) < 1.6
    model, exp = clean
    shaken = replace(exp, position=exp.position + noise(np.random.default_rng(1), exp.position.shape))
    found = fit([shaken], model, ["gain", "damping"], time_step=STEP, starts=1)
    assert found.covariance is not None
    assert found.covariance.correlated > 0.03
    gain = found.covariance.names.index("gain")  # static: slow noise hurts it most
    assert found.covariance.matrix[gain, gain] > 1.5 * found.covariance.white[gain, gain]
    assert any("correlated over" in note for note in found.notes)


@pytest.mark.slow
def test_a_block_bootstrap_agrees_with_the_sandwich(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    shaken = replace(exp, position=exp.position + 3e-4 * np.random.default_rng(2).standard_normal(exp.position.shape))
    found = fit([shaken], model, list(TRUE), time_step=STEP, starts=1)
    names, values = bootstrap([shaken], found, replicates=60, time_step=STEP)
    errors = {p.name: p.std for p in found.parameters}
    for name, column in zip(names, values.T, strict=True):
        assert column.std() == pytest.approx(errors[name], rel=0.35)


@pytest.mark.slow
def test_a_band_holds_the_true_motion_of_a_held_out_record(clean: tuple[Model, Experiment], pulse: Any) -> None:
    model, exp = clean
    other = pulse(model, "held", 1.4e5)
    own = {"held.start": 0.1234, "held.stop": 0.6012}
    real = predict(model, other, own, STEP)["position"]
    held = replace(other, position=real)
    inside = []
    for seed in range(30):
        noise = 3e-4 * np.random.default_rng(seed).standard_normal(exp.position.shape)
        found = fit([replace(exp, position=exp.position + noise)], model, list(TRUE), time_step=STEP, starts=1)
        band = prediction_band(held, found, time_step=STEP)
        wide = band.std > 1e-7  # where the motion does not depend on anything, there is no band
        inside.append(((band.lower <= real) & (real <= band.upper))[wide].mean())
    assert 0.8 < np.mean(inside) <= 1.0


def test_a_prior_holds_what_the_data_leave_open(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    known = Parameter("mass", 0.05, prior=0.047, prior_std=0.001)
    found = fit([exp], model, ["gain", "stiffness", "damping", known], time_step=STEP, starts=1)
    mass = next(p for p in found.parameters if p.name == "mass")
    assert mass.value == pytest.approx(0.047, rel=1e-4)
    assert found.values["stiffness"] == pytest.approx(0.9, rel=1e-3)
    assert mass.rests_on == "prior 0.047 +- 0.001 alone"
    assert next(p for p in found.parameters if p.name == "gain").rests_on == "data"
    assert "rests on" in str(found)


def test_a_prior_and_the_data_share_what_is_known_as_of_normal_errors(clean: tuple[Model, Experiment]) -> None:
    """As one more measurement: precisions add, values are weighted by them. The data alone are fitted for it."""
    model, exp = clean
    noise = 3e-4 * np.random.default_rng(7).standard_normal(exp.position.shape)
    seen = replace(exp, position=exp.position + noise)

    def damping(*more: Parameter) -> Parameter:
        found = fit([seen], model, ["stiffness", *(more or ("damping",))], time_step=STEP, starts=1)
        return next(p for p in found.parameters if p.name == "damping")

    alone = damping()
    mean, sd = alone.value + 2.0 * alone.std, 1.5 * alone.std
    both = damping(Parameter("damping", alone.value, prior=mean, prior_std=sd))
    weight = alone.std**2 / (alone.std**2 + sd**2)
    assert (both.value - alone.value) / (mean - alone.value) == pytest.approx(weight, abs=0.05)
    assert both.narrowed == pytest.approx(alone.std / np.hypot(alone.std, sd), abs=0.05)
    assert both.moved == pytest.approx((both.value - mean) / sd)
    assert both.rests_on.startswith("data and prior")


def test_joints_lean_on_their_mean_as_far_as_told(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    uneven = model.with_(stiffness=[1.0, 0.8, 0.9])
    shaken = predict(uneven, exp, {}, STEP)["position"] + 1e-3 * np.random.default_rng(4).standard_normal(
        exp.position.shape)
    seen = replace(exp, position=shaken)
    spreads = []
    for shrink in (0.0, 0.1, 0.001):
        found = fit([seen], model, [Parameter("stiffness_*", shrink=shrink), "damping"], time_step=STEP, starts=1)
        spreads.append(np.ptp(found.model.stiffness))
    assert spreads[2] < 0.02 < spreads[1] <= spreads[0] + 1e-6


def test_noise_levels_decide_whom_to_believe(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    rng = np.random.default_rng(5)
    position = exp.position + np.array([1e-2, 1e-4])[:, None] * rng.standard_normal(exp.position.shape)
    stds = {}
    for weighting in ("travel", "noise"):
        found = fit([replace(exp, position=position)], model, list(TRUE), time_step=STEP, starts=1, weighting=weighting)
        stds[weighting] = found.parameters[0].std
    assert stds["noise"] < 0.2 * stds["travel"]
    assert found.values["stiffness"] == pytest.approx(0.9, abs=4 * stds["noise"])


def test_an_optimum_that_no_body_has_is_flagged(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    found = fit([exp], model, [Parameter("damping", 0.0, upper=1e-12), "stiffness"], time_step=STEP, starts=1)
    assert any("is zero, which no real body has" in n for n in found.notes)
    found = fit([exp], model, ["stiffness", "damping"], time_step=STEP, starts=1, section_area=5e-5)
    assert any("t/m3" in n for n in found.notes)


def test_a_lag_longer_than_the_pulse_is_flagged(truth: Model, pulse: Any) -> None:
    edges = [Parameter("p.start", 0.12), Parameter("p.stop", 0.6)]
    for lag, flagged in ((0.7, True), (0.3, False)):
        slow = truth.with_(valve=Valve(rise_time=lag))
        notes = cautions(slow, [*edges, Parameter("valve_rise_time", lag)], [pulse(truth)], None)
        assert any("lag of 0.7 s is longer than the pulse of p, 0.48 s" in n for n in notes) == flagged
    assert not cautions(slow.with_(valve=Valve(rise_time=0.7)), edges, [pulse(truth)], None)  # not fitted, not flagged


def test_a_torque_that_bends_the_other_way_is_flagged(truth: Model, traced: Any) -> None:
    notes = cautions(truth.with_(torque=[-1e-7]), [Parameter("torque_1", -1e-7)], [traced(truth)], None)
    assert any("bend opposite ways" in n for n in notes)


def test_standard_errors_come_from_the_bootstrap_where_asked(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    shaken = replace(exp, position=exp.position + coloured(np.random.default_rng(3), exp.position.shape, 3e-4, 0.8))
    found = fit([shaken], model, ["gain", "damping"], time_step=STEP, starts=1)
    again = bootstrapped([shaken], found, replicates=30, time_step=STEP)
    assert again.covariance is not None
    assert again.covariance.source == "block bootstrap"
    for p, q in zip(again.parameters, found.parameters, strict=True):
        assert 0.4 < p.std / q.std < 2.0
        assert p.value == q.value
    with pytest.raises(InputError, match="needs at least 20 replicates, got 3"):
        bootstrapped([shaken], found, replicates=3)
    with pytest.raises(InputError, match="needs the covariance of a fit"):
        bootstrapped([shaken], replace(found, covariance=None), replicates=30)


def test_a_band_with_the_residuals_noise_holds_what_was_measured(clean: tuple[Model, Experiment]) -> None:
    model, exp = clean
    rng = np.random.default_rng(6)
    train, held = (replace(exp, name=n, position=exp.position + 3e-4 * rng.standard_normal(exp.position.shape))
                   for n in ("a", "b"))
    found = fit([train], model, list(TRUE), time_step=STEP, starts=1)
    predicted = predict(found.model, held, found.values, STEP)["position"]
    noise = residual_noise([train], found, held, predicted, time_step=STEP)
    assert noise.shape == held.position.shape
    assert np.sqrt(np.mean(noise**2, axis=0)) == pytest.approx(np.full((2, 2), 3e-4), rel=0.25)
    assert 0.9 < prediction_band(held, found, time_step=STEP, noise=noise).holds(held.position) < 0.99


def test_residuals_that_grow_with_way_and_speed_are_found_as_they_are() -> None:
    time = np.linspace(0.0, 2.0, 400)
    rows = 0.08 * np.stack([np.sin(3 * time) ** 2, 1 - np.cos(2 * time)], axis=1)[:, None]
    traits, law = motion_traits(time, rows, 0.1), np.array([[2.0, 1.0], [3.0, 0.0], [0.5, 4.0]])
    way, speed = (rows[:, 0] - rows[0, 0]) / 0.1, np.gradient(rows[:, 0] / 0.1, time, axis=0)
    np.testing.assert_allclose(traits, np.stack([np.ones(400), (way**2).sum(1), (speed**2).sum(1)], axis=1))
    square = traits @ law
    square[7, 0] = np.nan  # not seen
    np.testing.assert_allclose(variance_by(2.0 * traits, traits, square), 2.0 * traits @ law, rtol=1e-9)
    alone = variance_by(traits, traits, traits[:, 1:2])  # no residual at rest: a tenth of the mean is left
    assert alone.min() == pytest.approx(0.1 * traits[:, 1].mean())


def test_a_step_that_biases_a_parameter_is_named_with_one_that_does_not(truth: Model, traced: Any) -> None:
    exp = traced(truth)
    exp = replace(exp, position=exp.position + 1e-4 * np.random.default_rng(5).normal(size=exp.position.shape))

    def fitted(step: float) -> tuple[Any, list[str]]:
        found = fit([exp], truth, ["stiffness", "damping", "torque_1"], time_step=step, starts=1)
        return found, [note for note in found.notes if "integration step" in note]

    (coarse, [note]), (fine, none) = fitted(5e-3), fitted(5e-4)
    assert none == []
    said = re.fullmatch(r".* 5 ms biases (\w+) by about (.+) standard errors: use a step of (.+) ms or less.", note)
    assert said
    moved = {p.name: abs(p.value - fine.values[p.name]) / p.std for p in coarse.parameters if p.std}
    assert said[1] == max(moved, key=lambda name: moved[name])
    assert float(said[2]) == pytest.approx(moved[said[1]], rel=0.25)
    assert fitted(1e-3 * float(said[3]))[1] == []
