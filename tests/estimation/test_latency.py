"""A frame that is stamped late says where the body was a latency ago."""

from __future__ import annotations

import numpy as np

from pliant.estimation import KalmanFilter, Noise, rows_of
from pliant.model import chain_model
from pliant.simulation import Trace, simulate

LATENCY, STEP, FRAME = 0.012, 1e-3, 0.01  # s
NOISE = Noise(position=1e-6, torque=1e-5, initial_angle=1e-3, initial_rate=1e-3)


def test_a_latency_that_is_given_cancels_late_stamps():
    """The same frames, stamped late and announced so: the same state. Stamped late and not announced: another one."""
    model = chain_model(length=0.15, mass=0.06, links=3, stiffness=1.2, damping=6e-3, torque=[1.2e-6])
    times = FRAME * np.arange(30)
    motion = simulate(model, Trace([0.0, 0.1], [0.0, 1e5]), times=times, time_step=STEP)
    tips = motion.tip_position.values
    rows, variance = rows_of(model, model.points), np.full(2 * len(model.points), NOISE.position**2)
    points = tips[:, [s.link for s in model.points]].reshape(len(times), -1)

    def rates(latency, stamped):
        filter_ = KalmanFilter(model, NOISE, latency=latency, time_step=STEP)
        for k, time in enumerate(times):
            filter_.push_pressure(time, 1e5 * min(time / 0.1, 1.0))
            if k >= 2:
                filter_.push_frame(times[k - 2] + stamped, rows, points[k - 2], variance)
        filter_.advance(times[-1])
        return filter_.rate

    given, straight, ignored = rates(LATENCY, LATENCY), rates(0.0, 0.0), rates(0.0, LATENCY)
    np.testing.assert_allclose(given, straight, rtol=1e-9)
    assert np.abs(ignored - straight).max() > 0.03 * np.abs(straight).max()
