"""State estimation from shape and pressure: an online Kalman filter, an offline smoother, and simpler estimators."""

from __future__ import annotations

from pliant.estimation.adaptive_observer import AdaptiveObserver, frozen
from pliant.estimation.contract import Estimator, EstimatorKind, Frame, Setting, State, estimators
from pliant.estimation.differences import Differences
from pliant.estimation.kalman import KalmanFilter
from pliant.estimation.link_angles import LinkAngles, calibrated
from pliant.estimation.measurement import rows_of
from pliant.estimation.noise import Noise, default_noise
from pliant.estimation.offline import estimate

__all__ = [
    "AdaptiveObserver", "Differences", "Estimator", "EstimatorKind", "Frame", "KalmanFilter", "LinkAngles", "Noise",
    "Setting", "State", "calibrated", "default_noise", "estimate", "estimators", "frozen", "rows_of",
]
