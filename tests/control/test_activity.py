"""Settling and the command's activity, on runs written down by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.control.rehearsal import STILL_S, command_activity, settling_time, settling_times

TIME = np.arange(0.0, 2.0, 0.01)


def test_settling_of_an_exponential_is_four_time_constants():
    tip = 0.025 * (1.0 - np.exp(-TIME / 0.1))
    assert settling_time(TIME, tip, 0.025, 0.025) == pytest.approx(0.1 * np.log(50.0), abs=0.01)


def test_a_tip_that_leaves_again_or_comes_in_at_the_end_has_not_settled():
    tip = np.full(TIME.size, 0.025)
    assert settling_time(TIME, tip, 0.025, 0.025) == 0.0
    tip[-1] = 0.0256
    assert settling_time(TIME, tip, 0.025, 0.025) is None
    slow = 0.025 * np.minimum(TIME / 1.7, 1.0)  # inside at 1.67 s: less than a fifth of the run is left
    assert settling_time(TIME, slow, 0.025, 0.025) is None
    assert settling_time(TIME, np.full(TIME.size, np.nan), 0.025, 0.025) is None


def test_every_set_point_is_judged_until_the_next_one():
    tip = np.where(TIME < 1.0, 0.02, np.where(TIME < 1.25, 0.02, 0.01))
    assert settling_times(TIME, tip, [(0.0, 0.02), (1.0, 0.01)]) == [0.0, pytest.approx(0.25, abs=0.01)]
    assert settling_times(TIME, tip, [(0.0, 0.02), (0.5, 0.02), (1.0, 0.0101)])[0] == 0.0
    assert settling_times(TIME, tip, []) == []


def test_activity_tells_rest_from_motion():
    wanted = np.where(TIME < 1.0, 0.02, 0.01)
    wave = 1e3 * (-1.0) ** np.arange(TIME.size)
    moving = (TIME < STILL_S) | ((TIME >= 1.0) & (TIME < 1.0 + STILL_S))
    level = np.where(TIME < 1.0, 60e3, 30e3)  # another mean at each rest is no activity
    found = command_activity(TIME, wanted, level + np.where(moving, 3.0, 1.0) * wave)
    assert found["command_change_rest"] == pytest.approx(2e3, rel=1e-6)
    assert found["command_sd_rest"] == pytest.approx(1e3, rel=1e-2)
    assert found["command_change_motion"] == pytest.approx(6e3, rel=0.15)
    path = command_activity(TIME, np.sin(TIME), level)
    assert np.isnan(path["command_sd_rest"])
    assert np.isnan(path["command_change_rest"])
