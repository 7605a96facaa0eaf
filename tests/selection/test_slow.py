"""Bodies that follow their inputs slowly: which recordings show one, and the first model from settled shapes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from pliant.identification import Experiment, Parameter
from pliant.model import Chamber, Extension, Memory, Model, Station, chain_model
from pliant.selection import select_model, terms_for
from pliant.selection.slow import time_constant
from pliant.simulation import Trace, simulate

TIMES = np.arange(0.0, 60.0, 0.05)
NOISE = 2e-5  # m


def commands(rng: np.random.Generator) -> Trace:
    """Random levels, one each 2 s."""
    levels = np.repeat(rng.uniform(1e4, 6e4, 30), 2)
    edges = np.arange(0.0, 60.0, 2.0)
    return Trace(np.stack([edges, edges + 1.95], axis=1).ravel(), levels)


def following(system: signal.lti, rng: np.random.Generator, noise: float = NOISE) -> Experiment:
    """A point that follows its input as a linear system does, solved by another library."""
    trace = commands(rng)
    fine = np.arange(0.0, 60.0, 0.005)
    now = trace(fine)
    moved = np.interp(TIMES, fine, signal.lsim(system, now - now[0], fine)[1]) * 1e-6
    path = np.zeros((TIMES.size, 1, 3))
    path[:, 0] = moved[:, None] * [1.0, 0.3, 0.1] + noise * rng.normal(size=(TIMES.size, 3))
    return Experiment("one", TIMES, path, ("tip",), "trace", drives={"left": trace})


@pytest.mark.parametrize("constant", [0.15, 0.6, 2.0])
def test_the_time_constant_is_that_of_a_lag_solved_by_another_library(rng, constant):
    exp = following(signal.lti([1.0], [constant, 1.0]), rng)
    assert time_constant([exp], ["left"]) == pytest.approx(constant, rel=0.2)  # the grid's values are 1.5 times apart


def test_a_body_that_rings_has_no_time_constant(rng):
    exp = following(signal.lti([1.0], [1 / 9.0**2, 2 * 0.1 / 9.0, 1.0]), rng)
    assert time_constant([exp], ["left"]) is None


def test_a_body_without_lag_or_without_relation_to_its_input_has_none(rng):
    assert time_constant([following(signal.lti([1.0], [1e-3, 1.0]), rng)], ["left"]) is None
    assert time_constant([following(signal.lti([1.0], [0.6, 1.0]), rng, noise=0.1)], ["left"]) is None


def arm(**changes) -> Model:
    chambers = [Chamber(torque=[1e-6], joint_gain=np.ones(2), name="left", axial_gain=400.0),
                Chamber(torque=[1e-6], joint_gain=np.zeros(2), cross_gain=np.ones(2), name="right", axial_gain=160.0)]
    return chain_model(length=0.3, mass=0.3, links=2, stiffness=6.0, damping=4.0, space=True, torque=[1e-6],
                       gravity=(0.0, 0.0, 9.81), stations=(Station("tip", 1, 0.1, 0.005, 0.01),)).with_(
        chambers=tuple(chambers), extensions=(Extension(1000.0, 500.0),)).with_(**changes)  # fmt: skip


@pytest.mark.slow
def test_settled_shapes_lead_to_the_model_of_a_slow_body_whose_length_changes(rng):
    """Its stiffness is stated by neither: gains and damping agree relative to it."""
    train = []
    for name in ("one", "two"):
        drives = {"left": commands(rng), "right": commands(rng)}
        path = simulate(arm(), [*drives.values()], times=TIMES, time_step=0.01)["station_position"].values
        train.append(Experiment(name, TIMES, path + NOISE * rng.normal(size=path.shape), ("tip",), "trace",
                                drives=drives))  # fmt: skip
    given = arm(extensions=(), stations=(), stiffness=1.0, damping=1e-3)
    given = given.with_(chambers=tuple(Chamber(torque=[1e-6], joint_gain=np.ones(2), name=c.name)
                                       for c in given.chambers))  # fmt: skip
    told: list[str] = []
    found = select_model(train, given, common=["tip.along", "tip.across", "tip.aside"], progress=told.append,
                         terms=terms_for(given, train, only=["lengthening"]))  # fmt: skip
    assert "without ringing" in told[0]
    assert found.terms == ("lengthening",)
    values, ratio = found.result.values, found.result.values["stiffness"] / 6.0
    assert values["damping"] == pytest.approx(4.0 * ratio, rel=0.1)
    assert values["left.gain_x"] == pytest.approx(ratio, rel=0.1)
    assert values["right.gain_y"] == pytest.approx(ratio, rel=0.1)
    assert abs(values["left.gain_y"]) < 0.05 * ratio
    assert max(found.result.rmse.values()) < 5 * NOISE
    stiffness = next(p for p in found.result.parameters if p.name == "stiffness")
    assert not stiffness.free
    assert "held" in stiffness.source


@pytest.mark.slow
def test_creep_of_a_wall_is_found_in_bend_and_length_at_once(rng):
    """The hidden body creeps in both, with the same time; each alone leaves half of the drift."""
    creeping = Memory(creep_share=(0.6,), creep_time=(9.0,), axial_creep_share=(0.6,), axial_creep_time=(9.0,))
    train = []
    for name in ("one", "two", "three"):
        drives = {"left": commands(rng), "right": commands(rng)}
        path = simulate(arm(memory=creeping), [*drives.values()], times=TIMES, time_step=0.01)
        path = path["station_position"].values
        train.append(Experiment(name, TIMES, path + NOISE * rng.normal(size=path.shape), ("tip",), "trace",
                                drives=drives))  # fmt: skip
    given = arm(stations=(), stiffness=1.0)
    kinds = ["creep", "axial_creep", "wall_creep", "settle"]
    common = [Parameter("tip.along", 0.1, free=False), "tip.across", "tip.aside"]
    search = select_model(train, given, common=common, terms=terms_for(given, train, only=kinds))
    assert search.terms == ("wall_creep",)
    assert search.steps[-1].left_out_percent < 0.15 * search.steps[0].left_out_percent
    for axis in ("", "axial_"):
        assert search.result.values[f"{axis}creep_share_1"] == pytest.approx(0.6, rel=0.05)
        assert search.result.values[f"{axis}creep_time_1"] == pytest.approx(9.0, rel=0.05)


@pytest.mark.slow
def test_an_input_that_hardly_moves_rests_on_a_prior(rng):
    small = commands(rng)
    drives = {"left": commands(rng), "right": Trace(small.time, 2e4 + 0.02 * small.pressure)}
    path = simulate(arm(), [*drives.values()], times=TIMES, time_step=0.01)["station_position"].values
    exp = Experiment("one", TIMES, path + NOISE * rng.normal(size=path.shape), ("tip",), "trace", drives=drives)
    common = [Parameter("tip.along", 0.1, free=False)]
    search = select_model([exp], arm(stations=(), stiffness=1.0), common=common, terms=[])
    right = next(p for p in search.result.parameters if p.name == "right.gain_y")
    assert right.prior == 0.0
    assert "left" in right.source
    values = search.result.values
    axial = next(p for p in search.result.parameters if p.name == "right.axial_gain")
    assert axial.prior == pytest.approx(values["left.axial_gain"], rel=0.2)  # the only one that is shown
    assert axial.prior_std == pytest.approx(0.1 * axial.prior, rel=0.2)  # it moves by a tenth of what would show it


@pytest.mark.slow
def test_a_stated_damping_is_not_replaced_by_that_of_the_time_constant(rng):
    drives = {"left": commands(rng), "right": commands(rng)}
    path = simulate(arm(), [*drives.values()], times=TIMES, time_step=0.01)["station_position"].values
    exp = Experiment("one", TIMES, path + NOISE * rng.normal(size=path.shape), ("tip",), "trace", drives=drives)
    stated = Parameter("damping", 1.5, free=False)
    found = select_model([exp], arm(stations=(), stiffness=1.0), common=["tip.along", stated], terms=[])
    assert found.result.values["damping"] == 1.5
