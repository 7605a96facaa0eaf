"""What made a recording: a level whose end was not recorded has one edge, and the fit frees no other."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment, fit
from pliant.model import Station, chain_model
from pliant.simulation import Pulse, simulate

TIMES = np.arange(0.0, 2.0, 0.01)
START, LEVEL = 0.4037, 6e4


@pytest.fixture(scope="module")
def body():
    return chain_model(
        length=0.12, mass=0.05, links=2, stiffness=0.5, damping=3e-3, torque=[6e-7], stations=(Station("tip", 1, 0.06),)
    )


def stepped(body, excitation):
    """A level that comes on and stays on to the end of the recording."""
    seen = simulate(body, Pulse(LEVEL, START), times=TIMES, time_step=5e-4)["station_position"].values
    noise = 2e-5 * np.random.default_rng(1).standard_normal(seen.shape)
    return Experiment("it", TIMES, seen + noise, ("tip",), excitation, None, LEVEL)


def test_a_step_has_one_edge_and_gives_the_body_back(body):
    begun = body.with_(stiffness=0.8, damping=1e-2, torque=[1e-6])
    found = fit([stepped(body, "step")], begun, ["stiffness", "damping", "torque_1"], starts=1)
    assert {p.name for p in found.parameters} == {"stiffness", "damping", "torque_1", "it.start"}
    truth = {"stiffness": 0.5, "damping": 3e-3, "torque_1": 6e-7, "it.start": START}
    for p in found.parameters:
        assert abs(p.value - truth[p.name]) < 5 * p.std, p
    assert "do not show" not in found.status


def test_a_step_needs_its_level(body):
    with pytest.raises(InputError, match="a step needs its nominal level"):
        Experiment("it", TIMES, np.ones((TIMES.size, 1, 2)), ("tip",), "step")


def test_traits_of_a_step_are_those_of_its_plateau(body):
    from pliant.simulation import modes
    from pliant.validation.metrics import response

    exp = stepped(body, "step")
    traits = response(exp, exp.last_station)
    assert traits["frequency_hz"] == pytest.approx(modes(body)[0][0], rel=0.02)
    assert traits["steady_state_mm"] == pytest.approx(1e3 * np.linalg.norm(
        exp.last_station[-5:].mean(axis=0) - exp.last_station[:5].mean(axis=0)), rel=0.01)
    assert traits["overshoot_percent"] > 10
