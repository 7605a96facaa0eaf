"""The interface of an estimator: pressures and frames of the shape go in, states come out.

All times are in seconds on one clock, that of whoever pushes: the loop, or a recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from pliant.model import Model

Array = np.ndarray


class State(NamedTuple):
    """The estimated state of the body at one time; its arrays are copies.

    Attributes
    ----------
    time : float
        s, of which it tells.
    angle, rate : array (n,)
        Absolute link angles [rad] and rates [rad/s]; in space (N,), of the joint coordinates, and N stands for n.
    rest_shift : array (n,)
        Of the joints' rest angles against those of ``frozen(model)``, rad: the memory as it is, and what the model
        lacks; zeros where the estimator has no model.
    disturbance : array (n,)
        Torque of each joint that the model does not explain, N m; zeros where it is not estimated.
    covariance : array (2 n, 2 n) or (3 n, 3 n)
        Of angles, rates and, where it is estimated, the disturbance.
    torque_scale : float
        The body turns as the model would under so many times the torque.
    fault : str
        Why model and body no longer agree, in one sentence; empty while they do.
    strain, strain_rate : array (S,)
        Of the segments that lengthen, and per second; the covariance then holds them behind the angles, and behind the
        rates, and what disturbs them [N m] behind the torques.
    strain_shift : array (S,)
        Of the strains at rest, by the axial force that the model does not explain.
    """

    time: float
    angle: Array
    rate: Array
    rest_shift: Array
    disturbance: Array
    covariance: Array
    torque_scale: float = 1.0
    fault: str = ""
    strain: Array = np.zeros(0)
    strain_rate: Array = np.zeros(0)
    strain_shift: Array = np.zeros(0)

    @property
    def consistent(self) -> bool:
        """Whether model and body agree."""
        return not self.fault


class Frame(NamedTuple):
    """One frame of the shape as an estimator takes it."""

    rows: Array  # (m, 4) of (kind, link, along, across), in space aside: what each value sees, as of `rows_of`
    values: Array  # (m,) m or rad, in the model's base frame; NaN where one is lost
    variance: Array  # (m,)


Measure = Callable[[Array], Frame]  # points of the body (S, 2), m, to what an estimator takes: see `LinkAngles.frame`


class Estimator(Protocol):
    """An object that turns pressures and frames into states."""

    def push_pressure(self, time: float, pressure: float | Array) -> None:
        """Take a sample of a `time` [s]: gauge pressures (C,) [Pa]; a number is enough for one."""

    def push_frame(self, time: float, rows: Array, values: Array, variance: Array) -> None:
        """Take a frame of a `time` [s]; see `Frame`. A lost one is pushed too, its values NaN."""

    def state(self, time: float) -> State:
        """Return the state at `time` [s]; that of the last frame where an estimator does not predict."""


class Setting(NamedTuple):
    """The setting from which an estimator is made."""

    model: Model  # with the rest shape of the body at hand, and its memory
    period: float  # s, of the frames
    late: int  # periods by which the stamp of a frame lies before the pressures that arrive with it


@dataclass(frozen=True)
class EstimatorKind:
    """An entry of the list of estimators.

    Attributes
    ----------
    make : callable
        Estimator of a Setting.
    predicts : bool
        Whether its state is that of the time asked for. Otherwise it is as old as the last frame, and a control design
        counts that as dead time.
    fixed_length : bool
        Whether it follows bodies of fixed length in a plane alone.
    """

    name: str
    make: Callable[[Setting], Estimator]
    predicts: bool = False
    fixed_length: bool = False
