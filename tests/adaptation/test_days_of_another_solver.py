"""Another day made from recordings of a body that shares no code with the model: known shifts of its mounting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.adaptation import adapt_model, parts_of_day, posterior_of
from pliant.identification import Experiment, FitResult, Parameter, fit
from pliant.identification.fit import predict_held_out
from pliant.identification.problem import root_mean_square
from pliant.study import demo_study, load_study
from pliant.study.run import prepare_all

pytestmark = pytest.mark.slow
TILT, SHIFT, DELAY = 0.05, np.array([4e-3, -3e-3]), 0.03  # rad, m, s
FREE = ("stiffness", "damping", "torque_1", "torque_2", "stiffening")


@pytest.fixture(scope="module")
def experiments() -> dict[str, Experiment]:
    return dict(prepare_all(load_study(demo_study()), lambda _line: None).experiments)


@pytest.fixture(scope="module")
def arm(experiments) -> FitResult:
    """The model of the earlier day."""
    model = prepare_all(load_study(demo_study()), lambda _line: None).model
    return fit([experiments["pulse_60"], experiments["pulse_180"]], model,
               [*(Parameter(n) for n in FREE), Parameter("start")], time_step=4e-3, starts=1)


def remounted(exp: Experiment, tilt: float = TILT) -> Experiment:
    """The recording of an arm whose base is turned and moved, by a camera whose clock is late."""
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    return replace(exp, time=exp.time + DELAY, position=exp.position @ turn.T + SHIFT)


def test_known_shifts_of_the_mounting_are_found_and_the_body_is_the_same(experiments, arm):
    posterior = posterior_of(arm, set(experiments))
    day = parts_of_day([remounted(experiments["pulse_119"]), remounted(experiments["step_240"])], 1.5)
    found = adapt_model(arm, posterior, day)
    assert found.verdict == "re-mounted", found.sentence
    moves = {m.name: m for m in found.moves}
    for name, true in (("base_x", SHIFT[0]), ("base_y", SHIFT[1]), ("base_angle", TILT)):
        move = moves[name]
        assert abs(move.after - true) < 3.0 * move.std, (name, move.after, move.std)
    rest = next(e for e in found.errors if e.name.startswith("step_240"))
    known = root_mean_square(predict_held_out(experiments["step_240"], arm)[0]["compared"],
                             experiments["step_240"].compared)
    assert rest.after < max(1.3 * known, 0.02 * rest.travel)
    assert rest.before > 3.0 * rest.after


def test_five_days_in_a_row_narrow_the_body(experiments, arm):
    rng = np.random.default_rng(3)
    posterior, std = posterior_of(arm, set(experiments)), []
    posterior = replace(posterior, body=replace(posterior.body, covariance=25.0 * posterior.body.covariance))
    for k in range(5):
        exp = remounted(experiments["pulse_119"], 0.01 * k)
        exp = replace(exp, position=exp.position + 5e-4 * rng.standard_normal(exp.position.shape))
        found = adapt_model(arm, posterior, parts_of_day([exp], 5.0))
        assert found.verdict in ("same arm", "re-mounted"), found.sentence
        posterior = posterior_of(found.result, set(experiments))
        std.append({p.name: p.std for p in found.result.parameters if p.name in FREE})
    for name in ("stiffness", "damping", "torque_1"):
        assert std[-1][name] < 0.9 * std[0][name], (name, [s[name] for s in std])
