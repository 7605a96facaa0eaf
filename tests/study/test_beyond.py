"""What a forecast extrapolates: inputs beyond their range, inputs never driven together, and loads."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import invoke
from small_study import changed, write_study

from pliant.identification import Experiment, FitResult, Parameter
from pliant.model import Chamber, Station, chain_model
from pliant.simulation import Trace
from pliant.study.forecast import extrapolations
from pliant.validation.store import load_outcome

TIME = np.arange(0.0, 1.4, 0.01)
SEEN = np.stack([np.sin(TIME), 1.0 + 0.0 * TIME], axis=-1)[:, None]
KNOTS = np.array([0.0, 0.1, 0.6, 0.7])


def fitted() -> FitResult:
    """A body with two chambers and a payload of 20 g that was fitted."""
    chambers = tuple(Chamber(torque=[1e-6], joint_gain=[1.0, 0.0], name=n) for n in ("left", "right"))
    model = chain_model(length=0.2, mass=0.1, links=2, stiffness=1.0, damping=0.1, chambers=chambers, tip_mass=0.02,
                        stations=(Station("tip", 1, 0.1),))  # fmt: skip
    return FitResult(model, (Parameter("tip_mass", 0.02),), "", {"r": 1e-3}, 1, 0.0, converged=True)


def driven(left: float, right: float, late: float = 0.0, **known: float) -> Experiment:
    """A recording in which each chamber rises to a pressure [kPa]; the right one `late` by some seconds."""
    grid = np.linspace(0.0, 2.0, 201)
    traces = {name: Trace(grid, 1e3 * np.interp(grid - start, KNOTS, [1.0, level, level, 1.0]))
              for name, level, start in (("left", left, 0.0), ("right", right, late))}  # fmt: skip
    return Experiment("r", TIME, SEEN, ("tip",), "trace", drives=traces, known=known)


ALONE = [driven(50.0, 1.0), driven(1.0, 40.0)]


@pytest.mark.parametrize(("case", "training", "known", "phrases"), [
    (driven(50.0, 1.0), ALONE, {}, []),
    (driven(80.0, 1.0), ALONE, {}, ["left at 80 kPa (in training at most 50 kPa)"]),
    (driven(-9.0, 1.0), ALONE, {}, ["left at -9 kPa (in training at least 0 kPa)"]),
    (driven(40.0, 30.0), ALONE, {}, ["left together with right, which no training recording drives together"]),
    (driven(40.0, 30.0), [*ALONE, driven(25.0, 20.0)], {}, []),
    (driven(40.0, 30.0), [driven(50.0, 40.0, late=0.65)], {},  # one after the other
     ["left together with right, which no training recording drives together"]),
    (driven(5.0, 5.0), ALONE, {}, []),
    (driven(50.0, 1.0), ALONE, {"tip_mass": 0.05}, ["tip_mass 0.05 kg (in training 0.02 kg)"]),
    (driven(50.0, 1.0), [driven(50.0, 1.0, tip_mass=0.0), driven(1.0, 40.0, tip_mass=0.06)], {"tip_mass": 0.05}, []),
])  # fmt: skip
def test_what_lies_beyond_training_is_named(case, training, known, phrases):
    assert list(extrapolations(case, fitted(), training, known)) == phrases


def test_an_input_that_was_never_driven_is_named():
    lone = [Experiment("r", TIME, SEEN, ("tip",), "trace", drives={"left": Trace(KNOTS, np.array([0.0, 1e3, 1e3, 0]))})]
    assert extrapolations(driven(1.0, 30.0), fitted(), lone, {}) == ("right, which no training recording drives",)


@pytest.mark.slow
def test_the_run_says_what_a_forecast_extrapolates(tmp_path):
    content = changed("forecasts", value={
        "more": {"like": "high", "pressures": {"chamber": 150.0}, "pressure_unit": "kPa", "known": {"tip_mass": 0.01}},
        "less": {"like": "high", "pressures": {"chamber": 100.0}, "pressure_unit": "kPa"}})
    done = invoke("run", write_study(tmp_path, content), "-o", tmp_path / "out", "--quiet")
    assert done.exit_code == 0, done.output
    said = "the input at 150 kPa (in training at most 120 kPa); tip_mass 0.01 kg (in training 0 kg)"
    assert f"Forecast, more: it extrapolates {said}." in " ".join(done.output.split())
    assert done.output.count("it extrapolates") == 1
    found = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))["forecasts"]
    assert found["more"]["extrapolates"] == said.split("; ")
    assert said in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    restored = {f.name: f.extrapolates for f in load_outcome(tmp_path / "out").forecasts}
    assert restored == {"more": tuple(said.split("; ")), "less": ()}
