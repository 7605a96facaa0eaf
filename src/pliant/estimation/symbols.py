"""Named tuples of arguments for the compiled loops of estimators, and functions that allocate them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.compiler.trace import planar_workspace
from pliant.equations.symbols import (
    ActuationConstants,
    Body,
    ExtensibleBody,
    ExtensibleWorkspace,
    Held,
    Joints,
    MemoryLaw,
    ObservedChain,
    Sight,
    SpatialBody,
    SpatialWorkspace,
    StepSlopes,
    Workspace,
)
from pliant.mechanics import mechanics_of
from pliant.model import Model

FOLLOWED, FRAME_LOST, PARTED, STEP_FAILED = range(4)  # outcome of a frame for the adaptive observer


class ObserverModel(NamedTuple):
    """Constants of the model that the adaptive observer simulates: inertia, springs, chambers, hysteresis."""

    joints: Joints
    body: Body
    chambers: ActuationConstants
    memory: MemoryLaw
    instantaneous: float  # stiffness of the hysteresis before it slips, over K, as far as `frozen` keeps it


class ObserverGains(NamedTuple):
    """Constant gain of the adaptive observer, and the linear model from which it learns a factor on the actuation
    torque.
    """

    gain: np.ndarray  # (3n, n), of angles, rates and rest shifts
    precision: np.ndarray  # (n, n) 1/rad^2, inverse of the innovations' covariance
    F: np.ndarray  # (3n, 3n), transition of a period
    G: np.ndarray  # (3n, C) per N m, of the torque of each chamber over a period
    growth: float  # of the factor's variance in a period


class ObserverState(NamedTuple):
    """State of the adaptive observer, changed in place: angles, rates, shifts of the rest angles, and a factor on the
    torque.
    """

    angle: np.ndarray  # (n,) rad, absolute
    rate: np.ndarray  # (n,) rad/s
    own_shift: np.ndarray  # (n,) rad, estimated shift of the rest angles by model error
    innovation: np.ndarray  # (n,) rad, of the last frame
    rest_shift: np.ndarray  # (n,) rad, total shift of the rest angles of `frozen(model)`
    memory: np.ndarray  # (n, branches)
    sensitivity: np.ndarray  # (3n,) of angles, rates and rest shifts to the factor
    factor: np.ndarray  # (2,) on the torque: its value and its variance
    slow: np.ndarray  # (C, 2) slow states of the chambers, see `equations.chamber.advance`


class Pace(NamedTuple):
    """Number and length of the adaptive observer's time steps between frames, and the limit of its innovations."""

    parts: int  # steps in a period
    h: float  # s, length of one
    largest: float  # rad: a larger innovation means that model and body no longer agree


class ObserverWorkspace(NamedTuple):
    """Scratch arrays for one prediction and correction of the adaptive observer."""

    held: Held
    work: Workspace
    springs: Joints  # joints of a step, with shifted rest angles
    gain: np.ndarray  # (C, n) of the chambers' torques, times the factor
    weight: np.ndarray  # (3n,)
    move: np.ndarray  # (3n,)


class FilterState(NamedTuple):
    """State of the Kalman filter for n links, changed in place: angles, rates, disturbance torques and covariance (N,
    N). N is 2n, or 3n if disturbance torques are estimated.

    With S extensible segments, n + S replaces n.
    """

    angle: np.ndarray  # (n,) rad, absolute
    rate: np.ndarray  # (n,) rad/s
    disturbance: np.ndarray  # (n,) N m, of the joints
    covariance: np.ndarray  # (N, N)
    memory: np.ndarray  # (n, branches)


class FilterModel(NamedTuple):
    """Model constants for the Kalman filter's compiled loops: torque gains of the chambers, inertia, springs,
    hysteresis.
    """

    gain: np.ndarray  # (C, n) factor on the torque of each chamber at each joint; (C, N + R) with tendons
    body: Body | ExtensibleBody | SpatialBody
    joints: Joints
    memory: MemoryLaw
    remembers: bool  # whether the model has hysteresis or creep


class FilterNoise(NamedTuple):
    """Spectral densities of the Kalman filter's process noise: of the joints' torques, the chambers' torques, and the
    random walk of the disturbance torques.
    """

    own: np.ndarray  # (n,) (N m)^2 s, of the torque of each joint
    common: np.ndarray  # (C,) (N m)^2 s, of the torque of each chamber, from the noise of its pressure
    random_walk: np.ndarray  # (n,) (N m)^2/s, of the disturbance's rate
    motion_growth: float  # s^2/rad^2: growth of random_walk with the mean square of the joint rates
    recent: np.ndarray  # (1,) rad^2/s^2, recent mean square of the joint rates


class Prediction(NamedTuple):
    """Number and length of the Kalman filter's time steps until the next frame, with mean torque and process noise."""

    steps: int
    h: float  # s, length of a step
    torque: np.ndarray  # (n,) N m, its mean
    noise: FilterNoise


class FilterFrame(NamedTuple):
    """Measurement that corrects the Kalman filter: one frame of m values, or all T frames (T, m) of a recording."""

    base_angle: float  # rad
    chain: ObservedChain | SpatialBody
    wide: int  # columns of `rows` before the constants of their kinds: 4, in space 5
    rows: np.ndarray  # (m, wide + constants), see `equations.observation.observe_rows`
    values: np.ndarray  # (m,) m or rad, NaN where one is missing
    variance: np.ndarray  # (m,)
    innovation: np.ndarray  # (m,) output: the whitened innovations


class FilterWorkspace(NamedTuple):
    """Scratch arrays for one prediction or correction of the Kalman filter."""

    work: Workspace | ExtensibleWorkspace | SpatialWorkspace
    held: Held
    J: np.ndarray  # (3n, 2n), followed by rows of tendons
    slopes: StepSlopes  # J, and the arrays from which it is computed
    W: np.ndarray  # (N, N)
    phi: np.ndarray  # (n,)
    w: np.ndarray  # (n,)
    G: np.ndarray  # (2n,)
    gain: np.ndarray  # (N,)
    change: np.ndarray  # (N,)
    seen: np.ndarray  # (m,)
    H: np.ndarray  # (m, n)
    sight: Sight  # scratch of `equations.observation.observe_rows`


class FilterOutput(NamedTuple):
    """Output of the Kalman filter for each of T frames: prediction, estimate, covariances and innovations."""

    predicted: np.ndarray  # (T, N)
    predicted_covariance: np.ndarray  # (T, N, N)
    estimate: np.ndarray  # (T, N)
    covariance: np.ndarray  # (T, N, N)
    transition: np.ndarray  # (T, N, N), from the estimate of the frame before
    innovation: np.ndarray  # (T, m), whitened; not a number where a row was missing
    score: np.ndarray  # (T, 4): rows used, normalised innovation squared, log determinant of its covariance, motion


def make_workspace(model: Model, states: int, rows: int) -> FilterWorkspace:
    """Return the Kalman filter's scratch arrays for a model, a number of states, and a number of measured values."""
    n, chain = model.size, mechanics_of(model)
    slopes = chain.slopes()
    shapes = [(states, states), (n,), (n,), (2 * n,), (states,), (states,), (rows,), (rows, n)]
    scratch: list[Any] = [*map(np.zeros, shapes), chain.sight()]
    return FilterWorkspace(chain.workspace(), chain.held(), slopes.J, slopes, *scratch)


def make_observer_workspace(model: Model) -> ObserverWorkspace:
    """Return the scratch arrays of the adaptive observer for a model."""
    n, springs = model.n, mechanics_of(model).joints._replace(theta0=np.zeros(model.n))
    return ObserverWorkspace(
        mechanics_of(model).held(), planar_workspace(n), springs, np.zeros_like(model.actuation.gain), np.zeros(3 * n),
        np.zeros(3 * n),
    )


def make_output(frames: int, states: int, rows: int) -> FilterOutput:
    """Return zeroed output arrays of the Kalman filter for a number of frames, states and measured values."""
    N = states
    shapes = [(N,), (N, N), (N,), (N, N), (N, N), (rows,), (4,)]
    return FilterOutput(*(np.zeros((frames, *shape)) for shape in shapes))
