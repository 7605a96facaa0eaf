"""The default time step of fits: from the modes of the starting model, at most 2 ms, and the same for predictions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.identification import Experiment, fit, identifiability, predict, predict_held_out
from pliant.identification.prediction import LONGEST, LONGEST_OVER_DAMPED, LONGEST_SLOW, fit_step
from pliant.model import Model, Station
from pliant.selection import select_model
from pliant.simulation import Trace
from pliant.simulation.time_step import longest_step, rings

STIFF = {"stiffness": 60.0, "damping": 1e-2}


def test_a_slow_body_is_fitted_with_two_milliseconds_as_if_they_were_given(truth: Model, traced: Any) -> None:
    seen, start = [traced(truth)], truth.with_(stiffness=1.2)
    chosen, given = (fit(seen, start, ["stiffness"], starts=1, **more) for more in ({}, {"time_step": 2e-3}))
    assert chosen.time_step == given.time_step == LONGEST == 2e-3
    assert chosen.values == given.values
    assert chosen.rmse == given.rmse


def test_the_step_follows_the_values_at_the_start(truth: Model) -> None:
    stiff = truth.with_(**STIFF)
    assert fit_step(truth, {**STIFF, "t.start": 0.1}) == fit_step(stiff, {}) <= longest_step(stiff) < LONGEST
    assert fit_step(stiff, {"stiffness": 0.9, "damping": 6e-3}) == LONGEST


@pytest.mark.parametrize("factor", [1.0, 3.0, 30.0])
def test_an_over_damped_body_takes_longer_steps_that_are_as_accurate(truth: Model, factor: float) -> None:
    times = np.arange(0.0, 1.5, 0.02)
    pushed = Experiment("o", times, np.random.default_rng(0).normal(size=(times.size, 1, 2)), ("tip",), "trace",
                        Trace(times, 8e4 * (times > 0.1)))  # fmt: skip
    body = truth.with_(stations=(Station("tip", truth.n - 1, float(truth.link_length[-1])),))
    at = next(d for d in np.geomspace(1e-3, 10.0, 200) if not rings(body.with_(damping=d)))
    assert fit_step(body.with_(damping=0.8 * at), {}) <= LONGEST
    over = body.with_(damping=factor * at)
    step = fit_step(over, {})
    assert LONGEST < step <= LONGEST_OVER_DAMPED
    coarse, fine = (predict(over, pushed, {}, h)["position"] for h in (step, 2e-4))
    assert np.abs(coarse - fine).max() < 3e-3 * body.length


def test_a_slow_recording_of_an_over_damped_body_takes_longer_steps(truth: Model) -> None:
    """A quarter of the time between frames, up to 50 ms; a recording at 100 Hz stays at 10 ms."""
    body = truth.with_(stations=(Station("tip", truth.n - 1, float(truth.link_length[-1])),))
    over = body.with_(damping=30.0 * next(d for d in np.geomspace(1e-3, 10.0, 200) if not rings(body.with_(damping=d))))

    def pushed(spacing: float) -> Experiment:
        times = np.arange(0.0, 9.0, spacing)
        moving = np.random.default_rng(0).normal(size=(times.size, 1, 2))
        return Experiment("o", times, moving, ("tip",), "trace", Trace(times, 8e4 * np.sin(0.7 * times) ** 2))

    slow = pushed(0.2)
    step = fit_step(over, {}, [slow])
    assert LONGEST_OVER_DAMPED < step <= LONGEST_SLOW
    assert fit_step(over, {}, [slow, pushed(0.01)]) == fit_step(over, {}) <= LONGEST_OVER_DAMPED
    coarse, fine = (predict(over, slow, {}, h)["position"] for h in (step, 5e-3))
    assert np.abs(coarse - fine).max() < 1e-3 * body.length


@pytest.mark.slow
def test_predictions_and_stages_take_the_step_of_the_fit(truth: Model, traced: Any) -> None:
    stiff = truth.with_(**STIFF)
    seen, held = traced(stiff, times=np.arange(0.0, 0.6, 0.01)), traced(stiff, "h", 6e4, np.arange(0.0, 0.6, 0.01))
    start = stiff.with_(stiffness=40.0)
    fitted = fit([seen], start, ["stiffness"], starts=1)
    assert fitted.time_step == fit_step(start, {}) < LONGEST
    assert fitted.values["stiffness"] == pytest.approx(60.0, rel=1e-3)
    told, own = predict_held_out(held, fitted)
    assert own.time_step == fitted.time_step
    at_its_step = predict(fitted.model, held, fitted.values, fitted.time_step)
    np.testing.assert_array_equal(told["position"], at_its_step["position"])
    chosen = select_model([seen], start, terms=[]).result
    steps = (chosen.time_step, 0.5 * chosen.time_step)
    coarse, fine = (predict(chosen.model, seen, chosen.values, step)["position"] for step in steps)
    assert np.abs(coarse - fine).max() < 1e-3 * seen.travel
    assert identifiability([seen], start, ["stiffness"]).identifiable
