"""The distance between two models: paths made by hand, and the reference input of the first one."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.exporters.difference import difference, of_tips
from pliant.simulation import Pulse, simulate
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
    one = chen2018.model(links=2)
    other = one.with_(stiffness=1.3 * one.stiffness)
    level = typical_pressure(one)
    tips = [
        simulate(m, Pulse(level, 0.1, 1.0), duration=2.0, time_step=1e-3).tip_position.values[:, -1]
        for m in (one, other)
    ]
    found = difference(one, other)
    assert found == of_tips(level, *tips)
    assert found.largest > 1e-3


def test_without_a_torque_law_both_are_let_go():
    one = chen2018.model(links=2).with_(torque=[0.0])
    found = difference(one, one.with_(stiffness=1.1 * one.stiffness))
    assert found.level == 0.0
    assert found.input == "release from 0.1 rad at every joint, 2 s"
    assert found.travel > 0
    assert found.largest > 0
