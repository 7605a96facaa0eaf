"""What a flex sensor and an IMU show of the virtual actuator, against its truth and SciPy's first-order system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from pliant.errors import InputError
from pliant.testbed.fibre import body_angle
from pliant.testbed.laboratory import FLEX, IMU, AngleSensor, Laboratory, observe_angle, run_rod
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import scenario

pytestmark = pytest.mark.slow  # kernels of their own are compiled first


@pytest.fixture(scope="module")
def motion():
    return run_rod(scenario("pulse_119_100ms"), actuator("a"), Laboratory())


def seen(motion, sensor, at):
    return observe_angle(motion, actuator("a"), sensor, at, np.random.default_rng(1), np.random.default_rng(2))


def test_an_ideal_sensor_shows_the_bodys_angle_and_a_late_one_its_lag(motion):
    at = np.arange(0.0, 2.0, 0.05)
    ideal = replace(IMU, lag=0.0, step=0.0, noise=0.0, drift=0.0, zero=0.0)
    true = body_angle(motion, actuator("a"), at)[1][:, -1]
    np.testing.assert_allclose(seen(motion, ideal, at), true, atol=2e-3)
    fine = np.arange(0.0, 2.0, 1e-3)
    bent = body_angle(motion, actuator("a"), fine)[1][:, -1]
    late = bent[0] + lsim(([1.0], [0.1, 1.0]), bent - bent[0], fine)[1]
    np.testing.assert_allclose(seen(motion, replace(ideal, lag=0.1), at), np.interp(at, fine, late), atol=5e-4)
    assert np.ptp(true) > 0.5


def test_a_flex_sensor_counts_in_steps_and_an_imu_drifts(motion):
    at = np.arange(0.0, 2.0, 1 / FLEX.rate)
    counts = np.degrees(seen(motion, FLEX, at)) / 0.8
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    still = replace(IMU, noise=0.0, lag=0.0)
    wander = seen(motion, still, at) - seen(motion, replace(still, drift=0.0), at)
    assert 0 < np.abs(wander).max() < np.deg2rad(0.5)


def test_settings_that_no_sensor_has_are_refused():
    for wrong in ({"place": 0.0}, {"rate": 0.0}, {"lag": -1.0}):
        with pytest.raises(InputError):
            AngleSensor(**wrong)
