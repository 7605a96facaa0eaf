"""The distance between two models: paths made by hand, and the reference input of the first one."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.exporters.difference import difference, of_tips
from pliant.exporters.features import without
from pliant.model import Chamber, Valve, chain_model
from pliant.simulation import Pulse, equilibrium, simulate
from pliant.simulation.state import typical_pressure


def test_travel_counts_from_the_start_of_the_first_model():
    one = np.array([[1.0, 1.0], [4.0, 5.0], [1.0, 2.0]])  # 5 away at most, ends 1 away from its start
    other = one + np.array([[0.0, 0.0], [0.3, 0.4], [0.0, 1.0]])
    found = of_tips(2e4, one, other)
    assert (found.travel, found.largest, found.rms) == pytest.approx((5.0, 1.0, np.sqrt(1.25 / 3)))
    assert found.to_dict() == {
        "input": "a pulse of 20 kPa from 0.1 s for 1 s, 2 s", "tip_travel_mm": 5000.0,
        "largest_tip_difference_mm": 1000.0, "rms_tip_difference_mm": pytest.approx(1e3 * np.sqrt(1.25 / 3)),
    }


def test_both_move_under_the_first_ones_pulse():
    """Its level is the end of the control range."""
    one = chen2018.model(links=2)
    other = one.with_(stiffness=1.3 * one.stiffness)
    level = 2.0 * typical_pressure(one)
    tips = [tip_under(m, level) for m in (one, other)]
    found = difference(one, other)
    lower = difference(one, other, np.array([0.5 * level]))
    assert found == max((of_tips(level, *tips), lower), key=lambda d: d.largest)
    assert found.largest > 1e-3
    near = difference(one, other, np.array([2e4]))
    assert near.level <= 2e4
    assert near.largest < 0.5 * found.largest


def tip_under(model, level, which=0):
    """The tip's path under a pulse of one input."""
    inputs = [Pulse(level if c == which else 0.0, 0.1, 1.0) for c in range(model.actuation.count)]
    run = simulate(model, inputs, duration=2.0, time_step=1e-3, check=False)
    return run.tip_position.values[:, -1]


def two_chambers(**second):
    chambers = Chamber(torque=(6.7e-7,), name="a"), Chamber(**{"torque": (6.7e-7,), "name": "b"} | second)
    return chain_model(length=0.17, mass=0.069, links=3, stiffness=1.6, damping=8e-3, chambers=chambers)


@pytest.mark.parametrize(("second", "key"), [
    ({"inflation_limit": 3e5}, "inflation"), ({"valve": Valve(opening_time=0.3)}, "opening"),
    ({"valve": Valve(dead_band=3e4)}, "dead_band"), ({"law": "saturating", "torque": (6.7e-7, 1e5)}, "own_law"),
])  # fmt: skip
def test_a_feature_of_the_second_input_alone_is_exercised(second, key):
    """The first input does not show it: no number of 0 mm."""
    one = two_chambers(**second)
    other = without(one, (key,))
    found = difference(one, other)
    assert "kPa in b from" in found.input
    apart = np.linalg.norm(tip_under(one, 2e5, 1) - tip_under(other, 2e5, 1), axis=1).max()
    assert apart > 1e-3
    assert found.largest > 0.99 * apart
    assert tip_under(one, 1e5) == pytest.approx(tip_under(other, 1e5))


def test_a_law_that_saturates_is_driven_to_the_end_of_the_range():
    one = chain_model(length=0.17, mass=0.069, links=3, stiffness=1.6, damping=8e-3, law="saturating",
                      torque=(6.7e-7, 1e5))  # fmt: skip
    level = typical_pressure(one)
    ends = [equilibrium(one, p).sum() for p in (level, 1e7)]
    assert ends[0] == pytest.approx(0.9 * ends[1], rel=0.02)
    other = without(one, ("own_law",))
    found = difference(one, other)
    assert found.largest > np.linalg.norm(tip_under(one, 4e5) - tip_under(other, 4e5), axis=1).max() > 0.03


def test_a_level_beyond_the_law_is_lowered_to_one_that_it_bears():
    one = two_chambers(inflation_limit=1.5e5)
    found = difference(one, without(one, ("inflation",)), np.array([4e5, 4e5]))
    assert 0.6 * 1.5e5 < found.level < 1.5e5


def test_a_slow_feature_has_time_to_show():
    one = chen2018.model(links=2, valve=Valve(settle_share=0.5, settle_time=2.0))
    found = difference(one, without(one, ("settling",)))
    assert found.width == 6.0
    assert "for 6 s, 12 s" in found.input


def test_a_body_that_hardly_bends_is_let_go():
    stiff = chain_model(length=0.17, mass=0.069, links=2, stiffness=1e3, damping=8e-3, torque=(1e-8,))
    assert typical_pressure(stiff) == 0.0
    assert difference(stiff, stiff.with_(damping=1e-2)).level == 0.0


def test_without_a_torque_law_both_are_let_go():
    one = chen2018.model(links=2).with_(torque=[0.0])
    found = difference(one, one.with_(stiffness=1.1 * one.stiffness))
    assert found.level == 0.0
    assert found.input == "release from 0.1 rad at every joint, 2 s"
    assert found.travel > 0
    assert found.largest > 0
