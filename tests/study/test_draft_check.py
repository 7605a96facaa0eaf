"""The trial of a draft begins its search as a run does, also for a body that follows its inputs slowly."""

from __future__ import annotations

import time as clock
from dataclasses import replace

import numpy as np
import pytest

from pliant.identification import Experiment
from pliant.model import Model, Station, chain_model
from pliant.selection import terms_for
from pliant.simulation import Trace, simulate
from pliant.study.draft_check import search_seconds, seconds_of, shortened, start_of_search
from pliant.study.schema import SelectionEntry, Study

TIMES = np.arange(0.0, 40.0, 0.05)
STUDY = {"name": "slow", "actuator": {"length": 0.12, "mass": 0.05, "links": 2}, "time_step": 1e-2,
         "recordings": {"one": {"file": "one.csv"}}, "model_selection": {"train": ["one"]}}  # fmt: skip


def slow_arm(**changes) -> Model:
    return chain_model(length=0.12, mass=0.05, links=2, stiffness=1.0, damping=0.6, torque=[1e-6],
                       stations=(Station("tip", 1, 0.06),)).with_(**changes)  # fmt: skip


def recorded(rng: np.random.Generator) -> Experiment:
    edges = np.arange(0.0, 40.0, 2.0)
    trace = Trace(np.stack([edges, edges + 1.95], axis=1).ravel(), np.repeat(rng.uniform(1e4, 6e4, 20), 2))
    place = simulate(slow_arm(), trace, times=TIMES, time_step=0.01)["station_position"].values
    return Experiment("one", TIMES, place + 2e-5 * rng.normal(size=place.shape), ("tip",), "trace", trace)


@pytest.mark.parametrize("slow", [True, False])
def test_the_trial_begins_as_the_search_does(rng, slow):
    """Of a slow body the stiffness is held and the damping follows from the time constant of the whole recording."""
    exp = recorded(rng)
    exp = exp if slow else exp.of_frames(slice(0, 60))  # too short to show a time constant
    short, part = shortened(exp)
    study = Study.model_validate(STUDY)
    model = slow_arm(damping=1e-3, chambers=(replace(slow_arm().chambers[0], torque=np.zeros(1)),), stations=())
    entry = study.model_selection or SelectionEntry(train=["one"])
    problem, x = start_of_search(study, entry, [exp], [short], model, whole=False)
    assert [e.time.size for e in problem.experiments] == [short.time.size]
    stiffness = next(p for p in problem.parameters if p.name == "stiffness")
    assert stiffness.free is not slow
    assert np.isfinite(problem.residual(x)).all()
    if slow:
        assert part < 0.5
        assert "held" in stiffness.source
        values = problem.values(x)
        assert values["damping"] / values["stiffness"] == pytest.approx(0.6, rel=0.3)


def test_what_is_compiled_in_the_first_call_is_not_in_the_forecast():
    calls: list[int] = []

    def action(k: int) -> None:
        calls.append(k)
        clock.sleep(0.2 if k == 0 else 0.01)

    assert 0.01 <= seconds_of(action) < 0.2
    assert calls == [0, 1]


def test_a_forecast_grows_with_the_terms_that_may_join(rng):
    """Every term is screened in each step of a search, whatever the derivatives of the first model take."""
    exp = recorded(rng).of_frames(slice(0, 60))
    model = slow_arm(chambers=(replace(slow_arm().chambers[0], torque=np.zeros(1)),), stations=())
    entry = SelectionEntry(train=["one"])
    problem, x = start_of_search(Study.model_validate(STUDY), entry, [exp], [exp], model, whole=False)
    few, every = (search_seconds(entry, terms_for(model, [exp], only=only), problem, x) for only in (["base"], []))
    assert 0.0 < few < every
