"""Simple estimates of angles and rates: differences of the shape, and a model that follows it with a constant gain."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from pliant.compiler.choose import twin
from pliant.errors import InputError
from pliant.estimation import adaptive_observer_loops
from pliant.estimation.link_angles import LinkAngles
from pliant.linear.linearisation import linearise
from pliant.linear.sampled import hold
from pliant.model import Memory, Model, Valve
from pliant.simulation import state

Array = np.ndarray


class Estimator(Protocol):
    """What turns measurements into a state. `drive(time, pressure)` and `consistent` are used where they exist."""

    def update(self, time_s: float, measurement: Array) -> tuple[Array, Array]:
        """Absolute link angles and rates (n,) [rad, rad/s] at a measurement's time."""


class Differences:
    """Angles of the chords, rates by differences behind a first-order filter: what needs no model.

    Parameters
    ----------
    chords : LinkAngles
    cutoff : float
        Of the filter, Hz.
    """

    def __init__(self, chords: LinkAngles, cutoff: float = 25.0) -> None:
        if not cutoff > 0:
            raise InputError(f"the filter's cutoff must be positive, in Hz, got {cutoff}")
        self._chords, self._omega = chords, 2 * np.pi * cutoff
        self._time = -math.inf
        self._angle: Array | None = None
        self._rate: Array | None = None

    def update(self, time_s: float, measurement: Array) -> tuple[Array, Array]:
        """Angles of this frame and filtered rates; a frame that is not newer than the last one changes nothing."""
        angle = self._chords(measurement)
        if self._angle is None or self._rate is None:
            self._time, self._angle, self._rate = time_s, angle, np.zeros_like(angle)
        elif time_s > self._time:
            h = time_s - self._time
            keep = math.exp(-self._omega * h)
            self._rate = keep * self._rate + (1 - keep) * (angle - self._angle) / h
            self._time, self._angle = time_s, angle
        return self._angle, self._rate


class AdaptiveObserver:
    """The model run beside the body and corrected by each frame with a constant (stationary Kalman) gain.

    Beside angles and rates it carries a shift of every joint's rest angle, a random walk: creep, friction, contact and
    an error of the torque law or the stiffness end up there; K times the shift is the torque that the model lacks.
    Beside both, one factor on the torque is learnt: the sensitivity of the observer's state to it obeys the observer's
    own equation, and what of an innovation lies along it corrects the factor by recursive least squares.

    Source: Zhang, IEEE Trans. Autom. Control 47(3), 2002 (adaptive observers)

    Parameters
    ----------
    model : Model
        With its memory, if any. Its valve is left out: the pressure behind it is given to `drive`.
    chords : LinkAngles
    period : float
        Of the frames, s.
    noise : float
        Standard deviation of the joint angles of one frame, rad.
    wander : float
        Of the rest angles, rad per square root of a second.
    jerk : float
        Standard deviation of the joint rates that the model misses in a second, rad/s per square root of a second.
    step : float
        Longest step of the model, s.
    late : int
        Frames by which the shape is late: pressures are held back as long.
    doubt : float
        Standard deviation at the start of `scale`; 0 keeps it at 1.
    drift : float
        Of `scale`, per square root of a second.
    share : float
        That of ``frozen(model, share)`` whose rest angles `shift` tells of.

    Attributes
    ----------
    scale : float
        Factor on the torque of the pressure, learnt from the frames: another specimen is softer or pulls harder.
    angle, rate : array (n,)
        Absolute link angles [rad] and rates [rad/s], changed in place.
    shift : array (n,)
        Of the rest angles of `frozen(model, share)`, rad, changed in place: the memory as it is, and what the model
        lacks.
    innovation : array (n,)
        Of the last frame, rad.
    consistent : bool
        False once a joint's innovation exceeds `LOST`: model and body have parted.
    missed : int
        Frames that were lost.
    body : tuple
        The model as `observer_loops.follow` takes it.
    """

    LOST = 0.5  # rad

    def __init__(
        self, model: Model, chords: LinkAngles, period: float, *, noise: float = 2e-3, wander: float = 0.05,
        jerk: float = 0.5, step: float = 2e-3, late: int = 0, doubt: float = 0.2, drift: float = 0.02,
        share: float = 1.0,
    ) -> None:
        self.model, self.period = model.with_(valve=Valve()), period
        self._chords, self._late = chords, late
        parts = max(1, math.ceil(period / step - 1e-9))
        self.gain, sure = stationary_gain(self.model, period, noise, wander, jerk)
        chain, drive = with_shifts(self.model)
        self._gains = (self.gain, sure, *hold(chain, drive, period))
        self._start = (0.0, 1.0, doubt**2, drift**2 * period)
        self._pace = (parts, period / parts, self.LOST)
        joints, law, remembered = self.model.joints(), np.array(model.torque), share * model.memory.instantaneous
        self.body = (
            float(model.base_angle), np.array(model.rest_angle), joints, self.model.body(), law,
            float(model.swell_share), float(model.swell_time), model.memory.law(), float(remembered),
        )
        self._scratch = np.zeros(1 + 16 * model.n + 2 * model.n**2 + law.size)
        self._points, self._parts = np.zeros((chords.size, 2)), chords.parts
        self._follow = twin(adaptive_observer_loops.follow, model.n)
        self.reset()

    def reset(self) -> None:
        """Back to the model's rest without pressure."""
        n = self.model.n
        q = state.equilibrium(self.model, 0.0)
        x = np.zeros((5, n))
        x[0] = state.absolute(self.model, q)
        self.angle, self.rate, _, self.innovation, self.shift = x
        self._state = (x, state.relaxed(self.model, q))
        self._learnt = np.concatenate([self._start, np.zeros(3 * n)])
        self._pressure = self._reading = 0.0
        self._waiting = [0.0] * self._late
        self._time = -math.inf
        self.consistent, self.missed = True, 0

    @property
    def scale(self) -> float:
        """Factor on the torque of the pressure."""
        return float(self._learnt[1])

    def drive(self, time_s: float, pressure: float) -> None:
        """The chamber's pressure [Pa] at the time of the next frame; the mean with the one before moves the model."""
        del time_s
        self._waiting.append(pressure)
        reading = self._waiting.pop(0)
        self._pressure, self._reading = 0.5 * (self._reading + reading), reading

    def inputs(self, periods: int) -> tuple[Any, ...]:
        """Arguments of `observer_loops.follow` for the frame at hand, so many periods after the last one."""
        return (
            self._state, self._learnt, float(self._pressure), self.body, self._gains, self._parts,
            (periods, *self._pace), self._points, self._scratch,
        )

    def update(self, time_s: float, measurement: Array) -> tuple[Array, Array]:
        """Predict up to a frame's time, then correct by it unless it is lost; the arrays returned are the live ones."""
        periods = 0
        if math.isfinite(self._time):
            periods = min(max(round((time_s - self._time) / self.period), 0), 100)
        self._time = time_s
        self._points[:] = measurement
        told = self._follow(*self.inputs(periods))
        self.missed += told & 2 > 0
        if told & 5:
            self.consistent = False
        return self.angle, self.rate


def frozen(model: Model, share: float = 1.0) -> Model:
    """The model without its memory, stiffer by a share of what the memory holds before anything creeps or slips."""
    stiffer = 1.0 + share * model.memory.instantaneous  # branches are straight: the springs bend as before
    return model.with_(
        stiffness=model.stiffness * stiffer, stiffening=model.stiffening / stiffer, memory=Memory()
    )


def with_shifts(model: Model) -> tuple[Array, Array]:
    """State matrix (3 n, 3 n) of angles, rates and rest shifts at rest, and what a common torque [N m] does (3 n,)."""
    linear = linearise(model, 0.0)
    n = model.n
    chain = np.zeros((3 * n, 3 * n))
    chain[: 2 * n, : 2 * n] = linear.A
    chain[n : 2 * n, 2 * n :] = -linear.A[n:, :n] @ np.tril(np.ones((n, n)))  # a rest shift pulls as the opposite bend
    drive = np.zeros(3 * n)
    drive[: 2 * n] = linear.B / float(model.torque[0])
    return chain, drive


def stationary_gain(
    model: Model, period: float, noise: float, wander: float, jerk: float
) -> tuple[Array, Array]:
    """Kalman gain (3 n, n) from absolute link angles to angles, rates and rest shifts of the joints, at rest.

    Second, the inverse (n, n) of the covariance of its innovations, 1/rad^2.
    """
    from scipy.linalg import solve_discrete_are

    n = model.n
    sums = np.tril(np.ones((n, n)))
    chain, drive = with_shifts(model)
    F = hold(chain, drive, period)[0]
    Q = np.zeros_like(F)
    Q[:n, :n] = (1e-2 * noise) ** 2 * np.eye(n)
    Q[n : 2 * n, n : 2 * n] = jerk**2 * period * sums @ sums.T
    Q[2 * n :, 2 * n :] = wander**2 * period * np.eye(n)
    R = noise**2 * sums @ sums.T
    H = np.eye(n, 3 * n)
    P = solve_discrete_are(F.T, H.T, Q, R)
    sure = np.linalg.inv(H @ P @ H.T + R)
    return np.asarray(P @ H.T @ sure), sure
