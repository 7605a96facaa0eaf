"""Fits in space begin near the truth, whatever stiffness and gains the given model has."""

from dataclasses import replace

import numpy as np
import pytest
from space_cases import AZIMUTHS, LINKS, STEP, TIME, TRACES, arm

import pliant
from pliant.identification import Experiment, Parameter
from pliant.identification.problem import Problem
from pliant.identification.start_search import beginning, independent_start, linear_torques, searched
from pliant.model import Chamber, Station
from pliant.simulation import Trace

GAINS = [f"{name}.gain_{axis}" for name in AZIMUTHS for axis in "xy"]


@pytest.fixture(scope="module")
def seen():
    """A recording of a chain of twice as many links."""
    time = np.arange(0.0, 1.0, 0.02)
    traces = [Trace(time, 40e3 * (1 + np.sin(2 * np.pi * f * time + f))) for f in (0.7, 1.1, 1.9)]
    places = [Station("mid", 2, 0.05), Station("tip", 5, 0.025)]
    finer = arm(links=2 * LINKS, stiffness=2 * 0.5, damping=2 * 5e-3, stations=places)
    motion = pliant.simulate(finer, traces, times=time, time_step=STEP, check=False)
    shape = motion.station_position.values + np.random.default_rng(1).normal(0, 1e-4, (time.size, 2, 3))
    return Experiment("r", time, shape, ("mid", "tip"), "trace", drives=dict(zip(AZIMUTHS, traces, strict=True)))


def start_from(seen, factor, gain):
    """Start values, of a model whose stiffness is off by a factor and whose gains are all the same."""
    places = [Station("mid", 1, 0.025), Station("tip", 2, 0.05)]
    chambers = [Chamber(torque=(2e-6,), joint_gain=gain, cross_gain=gain, name=name) for name in AZIMUTHS]
    given = arm(stiffness=0.5 * factor, damping=5e-3 * factor, stations=places, chambers=chambers)
    listed = searched([seen], given, ["stiffness", "damping", *GAINS], STEP, "travel")[1]
    return {p.name: p.value for p in listed}


@pytest.mark.slow  # compiles the motion on dual numbers
@pytest.mark.parametrize(("factor", "gain"), [(40.0, 1.0), (0.03, -0.3)])
def test_stiffness_and_gains_start_near_the_truth_from_a_model_that_is_far_off(seen, factor, gain):
    found = start_from(seen, factor, gain)
    assert 0.25 < found["stiffness"] < 1.0
    assert 2.5e-3 < found["damping"] < 1e-2
    for name, a in AZIMUTHS.items():
        x, y = found[f"{name}.gain_x"], found[f"{name}.gain_y"]
        assert np.hypot(x, y) == pytest.approx(found["stiffness"] / 0.5, rel=0.3)
        assert np.cos(np.arctan2(x, -y) - a) > np.cos(0.3)


def test_stated_stiffness_is_not_sought(seen):
    given = arm(stations=[Station("mid", 1, 0.025), Station("tip", 2, 0.05)])
    listed = searched([seen], given, [Parameter("stiffness", 7.0), "damping"], STEP, "travel")[1]
    assert {p.name: p.value for p in listed} == {"stiffness": 7.0, "damping": 5e-3}


def test_the_beginning_of_a_record_is_what_follows_its_first_motion(seen):
    still = replace(seen, time=seen.time + 3.0, drives={n: Trace(TIME, t.pressure) for n, t in TRACES.items()})
    time = np.concatenate([np.arange(0.0, 3.0, 0.02), still.time])
    rest = np.repeat(seen.position[:1], 150, axis=0)
    whole = replace(still, time=time, position=np.concatenate([rest, seen.position]))
    cut = beginning(whole, 0.4)
    moved = np.linalg.norm(whole.last_station - whole.last_station[0], axis=1) > 0.05 * whole.travel
    assert cut.time[-1] == pytest.approx(time[np.argmax(moved)] + 0.4, abs=0.021)
    assert cut.position.shape == (cut.time.size, 2, 3)


def test_torques_are_sought_by_laws_before_gains_and_never_of_tendons():
    listed = [Parameter("red.gain_x"), Parameter("stiffness"), Parameter("green.gain_y", 0.3)]
    assert linear_torques(arm(), listed) == {"red.gain_x"}
    assert linear_torques(arm(), [*listed, Parameter("red.torque_1")]) == {"red.torque_1"}
    cord = pliant.model.Tendon.at_azimuth(0.4, np.ones(LINKS), name="red", lever=8e-3)
    assert linear_torques(arm(chambers=[cord]), listed) == set()


def second_start(seen, listed):
    given = arm(stations=[Station("mid", 1, 0.025), Station("tip", 2, 0.05)])
    model, filled = searched([seen], given, listed, STEP, "travel")
    problem = Problem([seen], model, filled, STEP, "travel")
    x = independent_start(problem, given, listed, STEP, "travel")
    return None if x is None else problem.values(x)


@pytest.mark.slow
def test_a_second_start_forgets_a_stated_stiffness(seen):
    found = second_start(seen, [Parameter("stiffness", 60.0), Parameter("damping", 0.2), Parameter("red.gain_x", -2.0)])
    assert 0.25 < found["stiffness"] < 1.0
    assert found["red.gain_x"] == pytest.approx(np.sin(AZIMUTHS["red"]), rel=0.3)


@pytest.mark.parametrize("first", ["stiffness", Parameter("stiffness", 0.5, free=False), Parameter("mass", 0.1)])
def test_there_is_no_second_start_where_no_stiffness_is_stated_for_a_fit(seen, monkeypatch, first):
    monkeypatch.setattr("pliant.identification.start_search.FACTORS", ())  # one start is as good as many
    assert second_start(seen, [first, Parameter("damping", 5e-3)]) is None
