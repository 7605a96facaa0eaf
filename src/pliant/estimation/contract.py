"""Interface of an estimator, which turns pressure samples and measured shapes into estimated states of the body.

All times are in seconds on one clock: that of the control loop, or of the recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from pliant.model import Model
from pliant.model.features import RESTING, Consumer
from pliant.plugins import chosen, offered
from pliant.shapes import Float

Array = np.ndarray


class State(NamedTuple):
    """Estimated state of the body at one time: angles, rates and their uncertainty. Later frames do not change it.

    Attributes
    ----------
    time : float
        Time of the state, s.
    angle, rate : array (n,)
        Absolute link angles [rad] and rates [rad/s]; in space (N,), of the joint coordinates, and N replaces n below.
    rest_shift : array (n,)
        Shift of the joints' rest angles from those of ``frozen(model)``, rad: the effect of creep and hysteresis, and
        of model error. Zeros where the estimator has no model.
    disturbance : array (n,)
        Torque of each joint that the model does not explain, N m; zeros where it is not estimated.
    covariance : array (2 n, 2 n) or (3 n, 3 n)
        Covariance of angles, rates and, where it is estimated, the disturbance.
    torque_scale : float
        Estimated factor on the model's torque.
    fault : str
        Why model and body no longer agree, in one sentence; empty while they do.
    strain, strain_rate : array (S,)
        Strain of each extensible segment, and its rate, 1/s. The covariance then holds strains after the angles, their
        rates after the rates, and their disturbances [N m] after the torques.
    strain_shift : array (S,)
        Shift of each rest strain, by the axial force that the model does not explain.
    """

    time: float
    angle: Float[Array, " N"]
    rate: Float[Array, " N"]
    rest_shift: Float[Array, " N"]
    disturbance: Float[Array, " N"]
    covariance: Float[Array, "K K"]
    torque_scale: float = 1.0
    fault: str = ""
    strain: Float[Array, " S"] = np.zeros(0)
    strain_rate: Float[Array, " S"] = np.zeros(0)
    strain_shift: Float[Array, " S"] = np.zeros(0)

    @property
    def consistent(self) -> bool:
        """Return whether the estimator's model agrees with the measured body, that is, whether `fault` is empty."""
        return not self.fault


class Frame(NamedTuple):
    """Measurement of the shape at one instant, for an estimator: m values, their variances, and m rows that state which
    quantity each value is.
    """

    rows: Float[Array, "m 4"]  # (kind, link, along, across), in space aside: the quantity of each value
    values: Float[Array, " m"]  # m or rad, in the model's base frame; NaN where one is missing
    variance: Float[Array, " m"]  # m^2 or rad^2


Measure = Callable[[Array], Frame]  # points of the body (S, 2) [m] to a frame, such as `LinkAngles.frame`


class Estimator(Protocol):
    """Interface of an estimator, which turns pressure samples and measured frames into states of the body."""

    def push_pressure(self, time: float, pressure: float | Float[Array, " C"]) -> None:
        """Take a pressure sample at `time` [s]: gauge pressures (C,) [Pa] of C chambers, or a
        number for one chamber.
        """

    def push_frame(
        self, time: float, rows: Float[Array, "m 4"], values: Float[Array, " m"], variance: Float[Array, " m"],
    ) -> None:
        """Take a frame of the measured shape at `time` [s]. A lost frame is pushed too, with NaN as values."""

    def state(self, time: float) -> State:
        """Return the estimated state at `time` [s].
        An estimator that does not predict returns the state of the last frame.
        """


class Setting(NamedTuple):
    """Arguments from which any estimator is created: the model, the time between frames, and the frames' delay."""

    model: Model  # with the rest shape of the actual body, and with its hysteresis and creep
    period: float  # s, of the frames
    late: int  # delay of the frames, in periods, against the pressures that arrive with them


ANY_BODY = Consumer("an estimator", RESTING)


@dataclass(frozen=True)
class EstimatorKind:
    """A registered estimator: its name, its constructor, and what it can process.

    Attributes
    ----------
    make : callable
        Function that returns an estimator for a `Setting`.
    predicts : bool
        Whether `state(time)` predicts to that time. Otherwise the state is as old as the last frame, and a control
        design counts that age as dead time.
    consumer : Consumer
        States the features of models that it takes into account, and refuses others.
    """

    name: str
    make: Callable[[Setting], Estimator]
    predicts: bool = False
    consumer: Consumer = ANY_BODY


GROUP = "pliant.estimators"
BUILT_IN = {
    "observer": "pliant.estimation.adaptive_observer:ESTIMATOR",
    "filter": "pliant.estimation.kalman:ESTIMATOR",
    "differences": "pliant.estimation.differences:ESTIMATOR",
}


def estimators() -> dict[str, EstimatorKind]:
    """Return all known estimators by name, each with its constructor and properties."""
    return offered(GROUP, BUILT_IN, EstimatorKind)


def estimator_kind(name: str) -> EstimatorKind:
    """Return the registered estimator called `name`; raise InputError with the known names if there is none."""
    return chosen(GROUP, BUILT_IN, EstimatorKind, name)
