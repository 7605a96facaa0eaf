"""Adaptive observer: it simulates the model, corrects the simulated state by a constant gain at each measured frame,
and learns a factor on the actuation torque.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np

from pliant.compiler.choose import tuples, twin
from pliant.equations.laws import POLYNOMIAL
from pliant.estimation import adaptive_observer_loops
from pliant.estimation.contract import EstimatorKind, Setting, State
from pliant.estimation.link_angles import needs_joint_rows
from pliant.estimation.symbols import (
    FRAME_LOST,
    PARTED,
    STEP_FAILED,
    ObserverGains,
    ObserverModel,
    ObserverState,
    Pace,
    make_observer_workspace,
)
from pliant.linear.linearisation import linearise
from pliant.linear.sampled import hold
from pliant.mechanics import mechanics_of
from pliant.mechanics.springs import stiffer_segments, stiffer_springs
from pliant.model import Memory, Model, Valve
from pliant.model.features import HYSTERESIS, IN_SPACE, LAWS, LENGTHENS, SPRINGS, TENDONS, VALVES, WALLS, Consumer
from pliant.options import with_defaults
from pliant.simulation import state

Array = np.ndarray
UNIT = 1e-6  # N m/Pa, slope of a linear law that replaces the chamber's own, whose slope at 0 Pa may be 0


OBSERVER = Consumer(
    "AdaptiveObserver", SPRINGS | LAWS | WALLS | HYSTERESIS,
    dict.fromkeys(VALVES, "pressures are taken as behind the valves"),
    dict.fromkeys(LENGTHENS | IN_SPACE | TENDONS, "use the KalmanFilter (estimator filter)"),
)


class ObserverNoise(TypedDict, total=False):
    """Keyword options of `AdaptiveObserver`: noise levels of the measured frames, of the model, and of the learnt
    torque factor.
    """

    noise: float
    random_walk: float
    jerk: float
    scale_sd: float
    scale_random_walk: float


OBSERVER_NOISE: ObserverNoise = {
    "noise": 2e-3, "random_walk": 0.05, "jerk": 0.5, "scale_sd": 0.2, "scale_random_walk": 0.02,
}


class AdaptiveObserver:
    """State observer that simulates the model and corrects the simulated state by a constant Kalman gain at each
    measured frame.

    The state holds angles, rates and a shift of every joint's rest angle, modelled as a random walk. Creep, friction,
    contact and errors of torque law or stiffness appear as this shift; K times the shift is the torque that the model
    lacks. In addition, one factor on the torques of all chambers is estimated by recursive least squares. The
    sensitivity of the observer's state to this factor obeys the observer's own equation.

    Source: Zhang, IEEE Trans. Autom. Control 47(3), 2002 (adaptive observers)

    Parameters
    ----------
    model : Model
        With its hysteresis and creep, if any. Its valves are ignored: pressures are taken as behind them.
    period : float
        Time between frames, s.
    noise : float
        Standard deviation of the joint angles of one frame, rad; default: 2e-3.
    random_walk : float
        Random walk of the rest angles, rad per square root of a second; default: 0.05.
    jerk : float
        Random walk of the joint rates by model error, rad/s per square root of a second; default: 0.5.
    time_step : float
        Longest integration step, s.
    late : int
        Delay of the shape in frames: pressures are delayed by as many.
    scale_sd, scale_random_walk : float
        Standard deviation of `scale` at the start, and its growth per square root of a second; 0 keeps it at 1.
        Default: 0.2 and 0.02.
    share : float
        Argument of ``frozen(model, share)``, whose rest angles are the reference of the state's `rest_shift`.

    Attributes
    ----------
    model : Model
        The model without its valves.
    missed : int
        Number of lost frames.
    fault : str
        Why model and body no longer agree; empty while they do.
    """

    LARGEST = 0.5  # rad: a larger innovation means that model and body no longer agree

    def __init__(
        self, model: Model, period: float, *, time_step: float = 2e-3, late: int = 0, share: float = 1.0,
        **noise: Unpack[ObserverNoise],
    ) -> None:
        sizes = with_defaults(AdaptiveObserver, noise, OBSERVER_NOISE)
        OBSERVER.check(model)
        self.model, self.period, self._late = without_valves(model), period, late
        parts = max(1, math.ceil(period / time_step - 1e-9))
        design = stationary(self.model, period, sizes["noise"], sizes["random_walk"], sizes["jerk"])
        chain, drive = with_shifts(self.model)
        growth = sizes["scale_random_walk"]**2 * period
        self.gains = ObserverGains(design.gain, design.precision, *hold(chain, drive, period), growth)
        self.pace, self._scale = Pace(parts, period / parts, self.LARGEST), (1.0, sizes["scale_sd"]**2)
        self._covariance, self._rows = in_torques(self.model, design.covariance), np.empty(0)
        remembered = float(share * model.memory.instantaneous)
        self.body = ObserverModel(
            mechanics_of(model).joints, mechanics_of(self.model).body, model.actuation.kernel(), model.memory.law(),
            remembered,
        )
        self.workspace = make_observer_workspace(self.model)
        self._follow = twin(adaptive_observer_loops.follow_of_tuples, *mechanics_of(self.model).sizes)
        self.reset()

    def reset(self) -> None:
        """Set the observer's state to the equilibrium of the model without pressure."""
        model, n = self.model, self.model.n
        q = state.equilibrium(model, 0.0)
        self._x = np.zeros((5, n))
        self._x[0] = mechanics_of(model).coordinates(q)
        angle, rate, bias, innovation, shift = self._x
        self.own = ObserverState(
            angle, rate, bias, innovation, shift, state.relaxed(model, q), np.zeros(3 * n), np.array(self._scale),
            model.actuation.rest_state(0.0),
        )
        self._records = self.own, self.body, self.gains, self.pace, self.workspace
        self._tuples = tuples(self._records)
        self._pressure = np.zeros(model.actuation.count)
        self._latest: float | Array = 0.0
        self._reading: float | Array = 0.0
        self._waiting: deque[float | Array] = deque([0.0] * self._late)
        self._time = -math.inf
        self.fault, self.missed = "", 0

    @property
    def scale(self) -> float:
        """Return the learnt factor on the torque of all chambers, above 1 if the body bends more than the model."""
        return float(self.own.factor[0])

    def inputs(self, values: Array, periods: int = 1) -> tuple[Any, ...]:
        """Return the arguments of the compiled loop for one frame of n measured link angles `values` (n,) [rad]."""
        return (periods, self._pressure, values, *self._records)

    def push_pressure(self, time: float, pressure: float | Array) -> None:
        """Take pressures (C,) [Pa] of C chambers.
        Between two frames the model runs under the mean of the pressures at both.
        """
        del time
        self._latest = self.model.actuation.pressures(pressure)

    def push_frame(self, time: float, rows: Array, values: Array, variance: Array) -> None:
        """Predict the state to the `time` [s] of a frame and correct it by the measured values.
        A lost frame only counts in `missed`.

        `variance` is ignored, since the gain is constant.

        Raises
        ------
        InputError
            When the rows are not those of `LinkAngles`.
        """
        del variance
        if rows is not self._rows:
            self._rows = needs_joint_rows(self.model, rows, "the adaptive observer")
        self._waiting.append(self._latest)
        reading = self._waiting.popleft()
        self._pressure[:], self._reading = 0.5 * (self._reading + reading), reading
        periods = 0
        if math.isfinite(self._time):
            periods = min(max(round((time - self._time) / self.period), 0), 100)
        self._time = time
        measured = np.ascontiguousarray(values, dtype=float)
        outcome = self._follow(periods, self._pressure, measured, self._tuples)
        if outcome == FRAME_LOST:
            self.missed += 1
        elif outcome == STEP_FAILED:
            self.fault = "a step of the observer's model failed: a link turned by more than a radian in it"
        elif outcome == PARTED:
            self.fault = f"a frame differs from the observer's model by more than {self.LARGEST} rad"

    def state(self, time: float) -> State:
        """Return the state at the last frame, for any `time`, as this observer does not predict further."""
        del time
        angle, rate, bias, _, shift = self._x.copy()
        return State(
            self._time, angle, rate, shift, self.body.joints.K * bias, self._covariance, self.scale, self.fault
        )


def make(setting: Setting) -> AdaptiveObserver:
    """Return an adaptive observer, created from the arguments in `setting`."""
    return AdaptiveObserver(setting.model, setting.period, late=setting.late)


ESTIMATOR = EstimatorKind("observer", make, consumer=OBSERVER)


def frozen(model: Model, share: float = 1.0) -> Model:
    """Return the model without hysteresis and creep, but with stiffer springs. The added stiffness is `share` times the
    stiffness of hysteresis and creep against a sudden small change of angle, and of the segments against one of strain.
    """
    joints, axial = (1.0 + share * m.instantaneous for m in (model.memory, model.memory.axial))
    segments = stiffer_segments(model, axial)  # branches are straight: the springs bend as before
    return model.with_(**stiffer_springs(model, joints), extensions=segments, memory=Memory())


def without_valves(model: Model) -> Model:
    """Return the model with ideal valves, whose inputs are the pressures in the chambers."""
    return model.with_(chambers=tuple(replace(c, valve=Valve()) for c in model.chambers))


def with_shifts(model: Model) -> tuple[Array, Array]:
    """Return two matrices of the linearised model of n joints and C chambers: the state matrix (3 n, 3 n) of angles,
    rates and rest-angle shifts, and the input matrix (3 n, C) of the chambers' torques.
    """
    unit = tuple(replace(c, law=POLYNOMIAL, torque=np.array([UNIT])) for c in model.chambers)
    linear = linearise(model.with_(chambers=unit), 0.0)
    n, count = model.n, model.actuation.count
    chain = np.zeros((3 * n, 3 * n))
    chain[: 2 * n, : 2 * n] = linear.A
    chain[n : 2 * n, 2 * n :] = -linear.A[n:, :n] @ np.tril(np.ones((n, n)))  # a rest shift pulls as the opposite bend
    drive = np.zeros((3 * n, count))
    drive[: 2 * n] = linear.B / UNIT
    return chain, drive


class Stationary(NamedTuple):
    """Stationary Kalman filter of angles, rates and rest-angle shifts, for the model linearised at rest."""

    gain: Array  # (3n, n), from absolute link angles
    precision: Array  # (n, n) 1/rad^2, inverse of the innovations' covariance
    covariance: Array  # (3n, 3n), after a frame


def stationary(model: Model, period: float, noise: float, random_walk: float, jerk: float) -> Stationary:
    """Return the stationary Kalman filter for frames every `period` [s]. The noise levels are those of the measured
    joint angles (`noise`), the rest angles (`random_walk`) and the joint rates (`jerk`).
    """
    from scipy.linalg import solve_discrete_are

    n = model.n
    sums = np.tril(np.ones((n, n)))
    chain, drive = with_shifts(model)
    F = hold(chain, drive, period)[0]
    Q = np.zeros_like(F)
    Q[:n, :n] = (1e-2 * noise) ** 2 * np.eye(n)
    Q[n : 2 * n, n : 2 * n] = jerk**2 * period * sums @ sums.T
    Q[2 * n :, 2 * n :] = random_walk**2 * period * np.eye(n)
    R = noise**2 * sums @ sums.T
    H = np.eye(n, 3 * n)
    P = solve_discrete_are(F.T, H.T, Q, R)
    precision = np.linalg.inv(H @ P @ H.T + R)
    gain = np.asarray(P @ H.T @ precision)
    return Stationary(gain, precision, P - gain @ H @ P)


def in_torques(model: Model, covariance: Array) -> Array:
    """Convert the covariance (3 n, 3 n) of the angles, rates and rest-angle shifts of n joints to that of angles, rates
    and torques. The torque of a joint is its stiffness times its rest-angle shift.
    """
    size = np.concatenate([np.ones(2 * model.n), model.stiffness])
    scaled = size[:, None] * covariance * size
    scaled.flags.writeable = False
    return np.asarray(scaled)
