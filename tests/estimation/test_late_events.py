"""Late frames of the filter: put where they belong, also behind what was predicted and asked for in between."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.estimation import KalmanFilter, Noise
from pliant.estimation.measurement import rows_of
from pliant.model import chain_model

ARM = chain_model(length=0.3, mass=0.05, links=3, stiffness=[1.0, 1.5, 2.0], damping=0.01, torque=[1e-6])
TIP = rows_of(ARM, ARM.points[-1:])


@pytest.mark.parametrize("late", [False, True])
def test_a_late_frame_goes_back_behind_a_state_that_was_asked_for(late):
    """The pressure at 60 ms finds the filter at 50 ms; a frame of 30 ms lies before both."""
    live = KalmanFilter(ARM, Noise(random_walk=0.1), time_step=1e-3, buffer=1.0)
    straight = KalmanFilter(ARM, Noise(random_walk=0.1), time_step=1e-3, buffer=1.0)
    frames = {0.01: np.array([-2e-3, 0.3]), 0.03: np.array([-5e-3, 0.299])}
    first = ("frame", 0.03) if late else ("pressure", 0.03)
    for filtered, order in ((straight, (first, ("pressure", 0.06))), (live, (None, ("pressure", 0.06), first))):
        filtered.push_pressure(0.0, 2e4)
        filtered.push_frame(0.01, TIP, frames[0.01], np.full(2, 1e-6))
        for event in order:
            if event is None:
                assert filtered.state(0.05).time == 0.05
            elif event[0] == "frame":
                filtered.push_frame(event[1], TIP, frames[event[1]], np.full(2, 1e-6))
            else:
                filtered.push_pressure(event[1], 1e6 * event[1])
        filtered.advance(0.08)
        assert filtered.counts.used == 1 + late
        assert filtered.counts.too_late == 0
        assert filtered.pressure.tolist() == [6e4]
    assert (straight.counts.late, live.counts.late) == (0, late)
    np.testing.assert_allclose(live.angle, straight.angle, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(live.rate, straight.rate, rtol=1e-2, atol=1e-4)
    np.testing.assert_allclose(live.covariance, straight.covariance, rtol=1e-2, atol=1e-8)
