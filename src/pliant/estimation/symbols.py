"""What the compiled loops of estimation call their parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from pliant.equations.symbols import Body, Held, Joints, Memory, Workspace

if TYPE_CHECKING:
    import numpy as np

FOLLOWED, FRAME_LOST, PARTED, STEP_FAILED = range(4)  # what became of a frame of the adaptive observer


class ObserverModel(NamedTuple):
    """The model that the adaptive observer runs."""

    base_angle: float  # rad
    rest_angle: np.ndarray  # (n,) rad
    joints: Joints
    body: Body
    law: np.ndarray  # of the torque
    swell_share: float
    swell_time: float  # s
    memory: Memory
    instantaneous: float  # stiffness of the memory before it gives way, in parts of K, as far as `frozen` keeps it


class ObserverGains(NamedTuple):
    """Constant gain of the adaptive observer, and the linear model that its factor on the torque is learnt by."""

    gain: np.ndarray  # (3n, n), of angles, rates and rest shifts
    precision: np.ndarray  # (n, n) 1/rad^2, inverse of the innovations' covariance
    F: np.ndarray  # (3n, 3n), transition of a period
    G: np.ndarray  # (3n,) per N m, of the torque over a period
    growth: float  # of the factor's variance in a period


class ObserverState(NamedTuple):
    """State of the adaptive observer, changed in place."""

    angle: np.ndarray  # (n,) rad, absolute
    rate: np.ndarray  # (n,) rad/s
    own_shift: np.ndarray  # (n,) rad, of the rest angles: what the model lacks
    innovation: np.ndarray  # (n,) rad, of the last frame
    rest_shift: np.ndarray  # (n,) rad, of the rest angles of the model without memory
    memory: np.ndarray  # (n, branches)
    sensitivity: np.ndarray  # (3n,) of angles, rates and rest shifts to the factor
    factor: np.ndarray  # (2,) on the torque: its value and its variance
    slow_pressure: np.ndarray  # (1,) Pa


class Pace(NamedTuple):
    """Steps of the adaptive observer."""

    parts: int  # steps in a period
    h: float  # s, length of one
    largest: float  # rad: a larger innovation means that model and body have parted


class ObserverWorkspace(NamedTuple):
    """Arrays that a frame of the adaptive observer works in."""

    held: Held
    work: Workspace
    springs: Joints  # those that a step sees, their rest moved by the shift
    law: np.ndarray  # of the torque, times the factor
    weight: np.ndarray  # (3n,)
    move: np.ndarray  # (3n,)
