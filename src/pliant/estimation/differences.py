"""The simplest estimator, without a model: measured angles, and rates from low-pass filtered differences."""

from __future__ import annotations

import math

import numpy as np

from pliant.errors import InputError
from pliant.estimation.contract import EstimatorKind, Setting, State
from pliant.estimation.link_angles import needs_joint_rows
from pliant.model import Model
from pliant.model.features import IN_SPACE, LENGTHENS, RESTING, Consumer

Array = np.ndarray
DIFFERENCES = Consumer(
    "Differences", RESTING - IN_SPACE - LENGTHENS,
    remedy=dict.fromkeys(IN_SPACE | LENGTHENS, "use the KalmanFilter (estimator filter)"),
)


class Differences:
    """Estimator without a model: link angles of the last frame, and rates from differences with a first-order filter.

    Its covariance comes from the noise of the frames; the lag of the rates is not included.

    Parameters
    ----------
    model : Model
        Only its number of links, rest angles and base angle are used.
    cutoff : float
        Cutoff frequency of the filter, Hz.

    Raises
    ------
    InputError
        When the cutoff is not positive.
    """

    def __init__(self, model: Model, cutoff: float = 25.0) -> None:
        if not (math.isfinite(cutoff) and cutoff > 0):
            raise InputError(f"the filter's cutoff must be positive, in Hz, got {cutoff}")
        self._model, self._omega = model, 2 * np.pi * cutoff
        self._rows: Array | None = None
        self._still = np.zeros(model.n)
        self._time, self._keep, self._gain = -math.inf, 1.0, self._omega
        self._angle, self._rate = np.array(model.rest_angle, dtype=float).cumsum() + model.base_angle, np.zeros(model.n)
        self._variance = np.full(model.n, math.pi**2)  # rad^2, before the first frame

    def push_pressure(self, time: float, pressure: float | Array) -> None:
        """Ignore the pressure, which this estimator does not use."""
        del time, pressure

    def push_frame(self, time: float, rows: Array, values: Array, variance: Array) -> None:
        """Take the measured angle of every link [rad]. A lost frame, or one not newer than the last, is ignored.

        Raises
        ------
        InputError
            When the rows are not those of `LinkAngles`.
        """
        if rows is not self._rows:
            self._rows = needs_joint_rows(self._model, rows, "an estimator of differences")
        if not (time > self._time and np.isfinite(values).all()):
            return
        angle, h = np.cumsum(values), time - self._time
        if math.isfinite(h):
            keep = math.exp(-self._omega * h)
            self._rate = keep * self._rate + (1 - keep) * (angle - self._angle) / h
            self._keep, self._gain = keep, (1 - keep) / h
        self._time, self._angle, self._variance = time, angle, variance

    def state(self, time: float) -> State:
        """Return the state at the last frame, for any `time`, as this estimator does not predict."""
        del time
        return State(
            self._time, self._angle.copy(), self._rate.copy(), self._still.copy(), self._still.copy(),
            self._covariance(),
        )

    def _covariance(self) -> Array:
        """Return the covariance of angles and rates, from independent errors of the angles between links.

        The rate r_k = a r_{k-1} + g (e_k - e_{k-1}), with g = (1 - a) / h, has the variance 2 g^2 / (1 + a) of that of
        e, and the covariance g of it with e_k.
        """
        n, g = self._model.n, self._gain
        covariance = np.tril(np.ones((n, n))) * self._variance
        covariance = covariance @ np.tril(np.ones((n, n))).T
        out = np.empty((2 * n, 2 * n))
        out[:n, :n], out[:n, n:], out[n:, :n] = covariance, g * covariance, g * covariance
        out[n:, n:] = 2.0 * g * g / (1.0 + self._keep) * covariance
        return out


def make(setting: Setting) -> Differences:
    """Return an estimator by differences, created from the arguments in `setting`."""
    return Differences(setting.model)


ESTIMATOR = EstimatorKind("differences", make, consumer=DIFFERENCES)
