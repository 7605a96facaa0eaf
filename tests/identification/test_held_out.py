"""A held-out recording is predicted with everything frozen but what no other recording can know: its edges."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.identification import Parameter, fit, predict, predict_held_out
from pliant.model import Model

STEP = 1e-3


@pytest.mark.parametrize("names", [("stiffness", "damping", "gain"), ("stiffness", "torque_1", "tip.across")])
def test_only_the_edges_of_a_held_out_pulse_move(truth: Model, pulse: Any, names: tuple[str, ...]) -> None:
    trained = fit([pulse(truth)], truth.with_(stiffness=1.2), names, step=STEP, starts=1)
    other = pulse(truth, "new", 1.6e5, start=0.2011, stop=0.7503)
    told, own = predict_held_out(other, trained, step=STEP)
    assert {p.name for p in own.parameters if p.free} == {"new.start", "new.stop"}
    frozen = {n: v for n, v in own.values.items() if not n.startswith("new.")}
    assert frozen == trained.values
    assert own.values["new.start"] == pytest.approx(0.2011, abs=2e-4)
    assert own.values["new.stop"] == pytest.approx(0.7503, abs=2e-4)
    assert np.abs(told["position"] - other.position).max() < 1e-4
    again = predict(own.model, other, own.values, STEP)["position"]  # model and values together: nothing counts twice
    np.testing.assert_allclose(again, told["position"], atol=1e-12)


def test_a_wrong_model_stays_wrong_on_held_out_data(truth: Model, pulse: Any) -> None:
    trained = fit([pulse(truth)], truth, ["stiffness", "damping"], step=STEP, starts=1)
    softer = pulse(truth.with_(stiffness=0.7), "new")
    _, own = predict_held_out(softer, trained, step=STEP)
    assert own.rmse["new"] > 1e-3
    assert own.values["stiffness"] == trained.values["stiffness"]


def test_nothing_is_fitted_to_a_held_out_trace(truth: Model, traced: Any) -> None:
    trained = fit([traced(truth)], truth.with_(stiffness=1.2), ["stiffness", "gain"], step=STEP, starts=1)
    other = traced(truth, "new", 6e4)
    told, own = predict_held_out(other, trained, step=STEP)
    assert own.evaluations == 1
    assert not any(p.free for p in own.parameters)
    assert own.rmse["new"] < 1e-5
    assert "nothing was fitted" in own.status
    assert told["position"].shape == other.position.shape


def test_what_belonged_to_a_training_record_stays_there(truth: Model, released: Any) -> None:
    hanging = truth.with_(gravity=[5.0, 0.0])
    trained = fit([released(hanging, "first", turn=-0.03)], hanging, ["stiffness", Parameter("first.base_turn")],
                  step=STEP, starts=1)
    assert trained.values["first.base_turn"] == pytest.approx(-0.03, rel=1e-2)
    assert trained.model.base_angle == 0
    _, own = predict_held_out(released(hanging, "second", release=0.3), trained, step=STEP)
    assert own.rmse["second"] < 1e-4
    assert own.values["second.release"] == pytest.approx(0.3, abs=1e-3)


def test_a_held_out_load_is_known_not_fitted(truth: Model, released: Any) -> None:
    hanging = truth.with_(gravity=[5.0, 0.0])
    trained = fit([released(hanging, "alone", known={"tip_mass": 0.0})], hanging, ["stiffness", "damping"], step=STEP,
                  starts=1)
    loaded = released(hanging, "loaded", known={"tip_mass": 0.03})
    right = predict_held_out(loaded, trained, step=STEP)[1].rmse["loaded"]
    wrong = predict_held_out(replace(loaded, known={"tip_mass": 0.0}), trained, step=STEP)[1].rmse["loaded"]
    assert right < 1e-5
    assert wrong > 1e-3
