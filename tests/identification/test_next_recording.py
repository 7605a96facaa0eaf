"""What to record next: the proposal shows what was hidden, within the limits of the pressure."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment, FitResult, design, fit
from pliant.identification.design import Candidate
from pliant.model import Model
from pliant.simulation import Pulse

STEP = 2e-3


def fitted(truth: Model, exp: Experiment, *names: str) -> tuple[FitResult, list[Experiment]]:
    noise = 3e-4 * np.random.default_rng(1).standard_normal(exp.position.shape)
    seen = replace(exp, position=exp.position + noise)
    return fit([seen], truth, list(names), time_step=STEP, starts=1), [seen]


def test_a_second_level_is_proposed_for_a_law_of_two_terms(truth: Model, traced: Any) -> None:
    result, exps = fitted(truth, traced(truth), "stiffness", "damping", "torque_1", "valve_rise_time")
    found = design(result, exps, highest=1.5e5, time_step=STEP)
    assert found.proposals[0].weakest < found.now.weakest
    assert found.proposals[0].weakest <= found.proposals[-1].weakest
    assert all(np.isfinite(list(p.std.values())).all() for p in found.proposals)
    assert any("chirp" in p.words for p in found.proposals)
    assert found.to_dict()["now"]["weakest"] == found.now.weakest


def test_the_expected_error_is_that_of_a_fit_with_the_recording(truth: Model, traced: Any) -> None:
    exp = traced(truth)
    result, exps = fitted(truth, exp, "stiffness", "damping")
    same = Candidate("again", exp.pressure, 1.0, 1e5)
    found = design(result, exps, time_step=STEP, candidates=[same])
    for name, std in found.proposals[0].std.items():
        assert std == pytest.approx(found.now.std[name] / np.sqrt(2), rel=0.1)


def test_pulses_of_unknown_edges_get_pulses_alone(truth: Model, pulse: Any) -> None:
    result, exps = fitted(truth, pulse(truth), "stiffness", "damping")
    found = design(result, exps, time_step=STEP, criterion="D")
    assert not any("chirp" in p.words for p in found.proposals)
    volumes = [p.volume for p in found.proposals]
    assert volumes == sorted(volumes)


def test_limits_and_criteria_are_kept(truth: Model, traced: Any) -> None:
    result, exps = fitted(truth, traced(truth), "stiffness", "damping")
    strong = Candidate("too much", Pulse(1e5, 0.1, 0.5), 1, 1e5)
    with pytest.raises(InputError, match=r"candidate 'too much' reaches .* exceed the highest pressure"):
        design(result, exps, highest=5e4, time_step=STEP, candidates=[strong])
    with pytest.raises(InputError, match="unknown criterion"):
        design(result, exps, criterion="A")
