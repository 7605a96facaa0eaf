"""Kalman filter as the control loop uses it: tuned to follow fast, with a factor on the actuation torque.

Part of the filter's disturbance torque is in proportion to the torque of the chambers. A controller compensates that
part best as a factor on the torque, which acts on its next command, and the rest as a shift of the rest angles.
"""

from __future__ import annotations

import math
from dataclasses import replace

from pliant.estimation.contract import EstimatorKind, Setting, State
from pliant.estimation.kalman import KalmanFilter
from pliant.estimation.noise import default_noise
from pliant.mechanics import mechanics_of
from pliant.model.features import ALL, IN_SPACE, LENGTHENS, TENDONS, missing

FASTER = 10.0  # times the random walk of `default_noise`; tuned on virtual actuator a and variants of it
OTHER_SHIFT = 0.03  # rad: shift of a joint's rest angle in one frame by other causes than the factor
FACTOR_SD, FACTOR_WALK = 0.2, 0.02  # standard deviation of the factor, and its growth per square root of a second


class LoopFilter(KalmanFilter):
    """Kalman filter that also estimates `State.torque_scale`, by recursive least squares on its own disturbance.

    The disturbance is (scale - 1) times the torque of the chambers plus a remainder.
    `state` returns the remainder as disturbance and rest shift. Only for planar bodies of fixed length with chambers.
    """

    def __init__(self, setting: Setting) -> None:
        noise = default_noise(setting.model)
        noise = replace(noise, random_walk=FASTER * noise.random_walk, motion_growth=0.0)
        super().__init__(setting.model, noise, time=-math.inf)
        self._scale, self._variance, self._newest = 1.0, FACTOR_SD**2, -math.inf

    def state(self, time: float) -> State:
        """Return the estimated state at `time` [s], or at the newest event if that is later."""
        state = super().state(time)
        K = mechanics_of(self.model).joints.K
        push, shift = self._tau / K, state.disturbance / K
        span = state.time - self._newest
        if 0.0 < span < math.inf:
            self._variance = min(self._variance + FACTOR_WALK**2 * span, FACTOR_SD**2)
            gain = self._variance / (OTHER_SHIFT**2 + self._variance * float(push @ push))
            self._scale += gain * float(push @ (shift - (self._scale - 1.0) * push))
            self._variance -= gain * self._variance * float(push @ push)
        self._newest = state.time
        part = (self._scale - 1.0) * push
        return state._replace(
            disturbance=state.disturbance - K * part, torque_scale=self._scale,
            rest_shift=state.rest_shift - part / (1.0 + self.model.memory.instantaneous),
        )


def make(setting: Setting) -> KalmanFilter:
    """Return the filter for a control loop. It starts at the first pressure or frame."""
    if missing(setting.model, ALL - LENGTHENS - IN_SPACE - TENDONS):
        return KalmanFilter(setting.model, time=-math.inf)
    return LoopFilter(setting)


ESTIMATOR = EstimatorKind("filter", make, predicts=True)
