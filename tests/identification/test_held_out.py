"""A held-out recording is predicted with everything frozen but what no other recording can know: its edges."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.identification import Parameter, fit, predict, predict_held_out
from pliant.identification.edges import edges
from pliant.model import Model
from pliant.simulation import modes

STEP = 1e-3
fitting = sys.modules["pliant.identification.fit"]  # the module: the package has a function of that name


@pytest.mark.parametrize("names", [("stiffness", "damping", "gain"), ("stiffness", "torque_1", "tip.across")])
def test_only_the_edges_of_a_held_out_pulse_move(truth: Model, pulse: Any, names: tuple[str, ...]) -> None:
    trained = fit([pulse(truth)], truth.with_(stiffness=1.2), names, time_step=STEP, starts=1)
    other = pulse(truth, "new", 1.6e5, start=0.2011, stop=0.7503)
    told, own = predict_held_out(other, trained, time_step=STEP)
    assert {p.name for p in own.parameters if p.free} == {"new.start", "new.stop"}
    frozen = {n: v for n, v in own.values.items() if not n.startswith("new.")}
    assert frozen == trained.values
    assert own.values["new.start"] == pytest.approx(0.2011, abs=2e-4)
    assert own.values["new.stop"] == pytest.approx(0.7503, abs=2e-4)
    assert np.abs(told["position"] - other.position).max() < 1e-4
    again = predict(own.model, other, own.values, STEP)["position"]  # model and values together: nothing counts twice
    np.testing.assert_allclose(again, told["position"], atol=1e-12)


@pytest.mark.parametrize("periods", [-1.5, -1.0, 0.5, 1.0, 1.5])
def test_a_first_guess_a_period_off_still_ends_at_the_right_edge(
    truth: Model, pulse: Any, periods: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where frames are missing around the start: the error of a ringing body has a minimum at each period."""
    ringing = truth.with_(damping=0.15 * truth.damping)
    trained = fit([pulse(ringing)], ringing.with_(stiffness=1.2), ["stiffness", "damping"], time_step=STEP, starts=1)
    other = pulse(ringing, "new", 1.6e5, start=0.2511, stop=0.7503)
    off = periods / modes(trained.model)[0][0]
    found = edges(other)
    monkeypatch.setattr(fitting, "edges", lambda _exp: found | {"start": found["start"] + off})
    _, own = predict_held_out(other, trained, time_step=STEP)
    assert own.values["new.start"] == pytest.approx(0.2511, abs=2e-4)
    assert own.rmse["new"] < 1e-4


def test_edges_are_found_in_noise(truth: Model, pulse: Any) -> None:
    """Noise of one thirtieth of the travel: a threshold of 3 % sees it long before the pulse."""
    clean = pulse(truth, start=0.3011, stop=0.7003)
    starts, stops = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        noisy = clean.position + clean.travel / 30.0 * rng.standard_normal(clean.position.shape)
        found = edges(replace(clean, position=noisy))
        starts.append(found["start"] - 0.3011)
        stops.append(found["stop"] - 0.7003)
    assert np.abs(starts).max() < 0.03
    assert np.abs(stops).max() < 0.05


def test_a_wrong_model_stays_wrong_on_held_out_data(truth: Model, pulse: Any) -> None:
    trained = fit([pulse(truth)], truth, ["stiffness", "damping"], time_step=STEP, starts=1)
    softer = pulse(truth.with_(stiffness=0.7), "new")
    _, own = predict_held_out(softer, trained, time_step=STEP)
    assert own.rmse["new"] > 1e-3
    assert own.values["stiffness"] == trained.values["stiffness"]


def test_nothing_is_fitted_to_a_held_out_trace(truth: Model, traced: Any) -> None:
    trained = fit([traced(truth)], truth.with_(stiffness=1.2), ["stiffness", "gain"], time_step=STEP, starts=1)
    other = traced(truth, "new", 6e4)
    told, own = predict_held_out(other, trained, time_step=STEP)
    assert own.evaluations == 1
    assert not any(p.free for p in own.parameters)
    assert own.rmse["new"] < 1e-5
    assert "nothing was fitted" in own.status
    assert told["position"].shape == other.position.shape


def test_what_belonged_to_a_training_record_stays_there(truth: Model, released: Any) -> None:
    hanging = truth.with_(gravity=[5.0, 0.0])
    trained = fit([released(hanging, "first", turn=-0.03)], hanging, ["stiffness", Parameter("first.base_turn")],
                  time_step=STEP, starts=1)
    assert trained.values["first.base_turn"] == pytest.approx(-0.03, rel=1e-2)
    assert trained.model.base_angle == 0
    _, own = predict_held_out(released(hanging, "second", release=0.3), trained, time_step=STEP)
    assert own.rmse["second"] < 1e-4
    assert own.values["second.release"] == pytest.approx(0.3, abs=1e-3)


def test_a_held_out_load_is_known_not_fitted(truth: Model, released: Any) -> None:
    hanging = truth.with_(gravity=[5.0, 0.0])
    trained = fit([released(hanging, "alone", known={"tip_mass": 0.0})], hanging, ["stiffness", "damping"],
                  time_step=STEP, starts=1)
    loaded = released(hanging, "loaded", known={"tip_mass": 0.03})
    right = predict_held_out(loaded, trained, time_step=STEP)[1].rmse["loaded"]
    wrong = predict_held_out(replace(loaded, known={"tip_mass": 0.0}), trained, time_step=STEP)[1].rmse["loaded"]
    assert right < 1e-5
    assert wrong > 1e-3


def test_a_held_out_release_takes_the_mean_release_time(truth: Model, released: Any) -> None:
    hanging = truth.with_(gravity=[5.0, 0.0])
    slow = [Parameter(f"{name}.release_time", 0.03) for name in ("first", "second")]
    trained = fit([released(hanging, "first"), released(hanging, "second")], hanging, ["stiffness", *slow],
                  time_step=STEP, starts=1)  # fmt: skip
    mean = np.mean([trained.values["first.release_time"], trained.values["second.release_time"]])
    _, own = predict_held_out(released(hanging, "third", release=0.3), trained, time_step=STEP)
    taken = next(p for p in own.parameters if p.name == "third.release_time")
    assert not taken.free
    assert taken.value == pytest.approx(mean)
    assert "mean of 2 training records" in taken.source
