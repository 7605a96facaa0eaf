"""Extended Kalman filter for use during an experiment.
Frames that arrive late are applied at the time they were taken.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import chamber
from pliant.equations.memory import memory_angle
from pliant.errors import InputError, SimulationError
from pliant.estimation import kalman_loops
from pliant.estimation.contract import EstimatorKind, Setting, State
from pliant.estimation.measurement import IN_METRES, check_frame, flips
from pliant.estimation.noise import Noise, default_noise
from pliant.estimation.offline import chain_of, frame_of, with_gravity
from pliant.estimation.symbols import FilterNoise, FilterState, FilterWorkspace, Prediction, make_workspace
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.features import RESTING, VALVES, Consumer
from pliant.shapes import Float
from pliant.simulation import BaseMotion, state
from pliant.simulation.base_motion import BaseSteps, base_fields

Array = np.ndarray
LARGEST = 0.5  # rad, or lengths of the body: a larger innovation means that model and body no longer agree


class FilterEvent(NamedTuple):
    """A pressure sample or a measured frame, with its time, as the filter received it."""

    time: float  # s
    pressure: Array | None  # (C,) Pa, held from here on; None for a frame
    rows: Array | None
    value: Array | None
    variance: Array | None


class FilterSnapshot(NamedTuple):
    """Saved state of the filter before an event: angles, rates, disturbance, covariance and
    hysteresis as one vector.
    """

    time: float
    pressure: Array  # (C,) Pa
    slow: Array  # (C, 2) states of the chambers
    state: Array


@dataclass
class Counts:
    """Numbers of measured frames that were used, had no values, came late or came too late, and of orientations ignored
    because a marker appeared flipped.
    """

    used: int = 0
    skipped: int = 0  # without any value
    late: int = 0  # inserted at their time, with later events applied again
    too_late: int = 0  # older than the buffer: ignored
    flipped: int = 0  # orientations more than 90 degrees from the model's, as of flipped markers: ignored
    last_ratio: float = field(default=math.nan)  # normalised innovation squared of the last frame, over its rows


FILTER = Consumer(
    "KalmanFilter", RESTING - VALVES, dict.fromkeys(VALVES, "pressures are taken as behind the valves"),
    {"base_motion": "state the motion of its base: KalmanFilter(model, base=BaseMotion(...)), or set moving_base to "
                    "false for a body whose base rests"},
)


class KalmanFilter:
    """Extended Kalman filter for use during an experiment: it takes pressures and measured frames as they arrive.

    Parameters
    ----------
    model : Model
        Its valves are ignored: pressures are taken as behind them.
    noise : Noise, optional
        Default: `default_noise(model)`.
    time_step : float
        Longest integration step of a prediction, s.
    latency : float
        Delay of a frame's time stamp after the shape that it shows, s.
    buffer : float
        Time for which events are kept, so that late frames can be inserted at their time, s.
    pressure : float, array (C,) for several chambers
        Initial pressure, at which the chain starts in equilibrium, Pa.
    time : float
        Initial time, s; minus infinity: that of the first event.
    base : BaseMotion, optional
        Prescribed motion of the base, on the clock of the filter. The state, and positions and angles of frames, are
        relative to the moved base. By default the base rests.

    Attributes
    ----------
    pressure : array (C,)
        Current pressure, Pa.
    angle, rate, disturbance : array (n,)
        Absolute link angles [rad] and rates [rad/s], disturbance torques of the joints [N m]; in space (N,), of the
        joint coordinates.
    strain, strain_rate : array (S,)
        Strain of each extensible segment, and its rate, 1/s.
    covariance : array (N, N)
        Covariance of the state.
    counts : Counts
        How many frames were used, skipped or late.
    fault : str
        Why model and body no longer agree; empty while they do.

    Examples
    --------
    On recordings of your own::

        import numpy as np, pliant
        from pliant.estimation import KalmanFilter, rows_of
        model = pliant.load_model("results/arm/model.json")
        tip = rows_of(model, model.points[-1:])                    # x and y of the last station
        filter = KalmanFilter(model, latency=0.004)
        filter.push_pressure(0.010, 30e3)                          # s, Pa
        filter.push_frame(0.014, tip, np.array([-0.002, 0.169]), np.full(2, 1e-7))
        filter.advance(0.020)
        filter.rate, filter.covariance                             # now
    """

    def __init__(
        self, model: Model, noise: Noise | None = None, *, time_step: float = 5e-3, latency: float = 0.0,
        buffer: float = 0.2, pressure: float | Float[Array, " C"] = 0.0, time: float = 0.0,
        base: BaseMotion | None = None,
    ) -> None:
        if not time_step > 0:
            raise InputError(f"time_step must be > 0 s, got {time_step}")
        if not (latency >= 0 and buffer >= 0):
            raise InputError(f"latency and buffer must be >= 0 s, got latency = {latency} and buffer = {buffer}")
        model = model if base is None else model.with_(moving_base=False)
        FILTER.check(model)
        self._base = None if base is None else BaseSteps(model, base)
        model = model if self._base is None else self._base.model
        self.model, self.noise = model, noise or default_noise(model)
        self.time_step, self.latency, self.buffer = time_step, latency, buffer
        self.counts, self.fault = Counts(), ""
        self._mechanics = mechanics_of(model) if self._base is None else self._base.chain
        self._chain = chain_of(model)._replace(body=self._mechanics.body, joints=self._mechanics.joints)
        self._workspaces: dict[int, FilterWorkspace] = {}
        sizes = mechanics_of(model).sizes
        self._predict, self._update = twin(kalman_loops.predict_span, *sizes), twin(kalman_loops.update, *sizes)
        q, size, n = self._rest(pressure, float(time)), model.size, model.size - len(model.extensions)
        self.time, self.pressure = float(time), model.actuation.pressures(pressure)
        self._actuation, self._torques = model.actuation.kernel(), twin(chamber.held_torques)
        self._tau = np.zeros(model.actuation.columns.shape[1])
        self._slow = model.actuation.rest_state(pressure)
        start, memory = self.noise.initial(model), state.relaxed(model, q)
        N = start.shape[0]
        x = mechanics_of(model).coordinates(q)
        self._state = np.concatenate([x, np.zeros(2 * size), start.ravel(), memory.ravel(), [0.0]])
        self.covariance = self._state[3 * size : 3 * size + N * N].reshape(N, N)
        self.memory = self._state[3 * size + N * N : -1].reshape(memory.shape)
        x, v, d = self._state[: 3 * size].reshape(3, size)
        self.angle, self.rate, self.disturbance, self.strain, self.strain_rate = x[:n], v[:n], d[:n], x[n:], v[n:]
        self._own = FilterState(x, v, d, self.covariance, self.memory)
        self._densities = FilterNoise(*self.noise.densities(model), self._state[-1:])
        self.innovation = np.empty(0)
        self._events: deque[tuple[FilterSnapshot, FilterEvent]] = deque()

    def _rest(self, pressure: float | Array, time: float) -> Array:
        if self._base is None:
            return state.equilibrium(self.model, pressure)
        return self._base.rest(pressure, time if math.isfinite(time) else float(self._base.motion.time[0]))

    def push_pressure(self, time: float, pressure: float | Float[Array, " C"]) -> None:
        """Take pressures (C,) [Pa] of C chambers at `time` [s]. They count as constant until the next sample.

        Raises
        ------
        InputError
            When it is not finite, or does not have one value for each chamber.
        """
        levels = self.model.actuation.pressures(pressure)
        if not (np.isfinite(levels).all() and math.isfinite(time)):
            raise InputError(f"a pressure sample must be finite, got {pressure} Pa at {time} s: leave this sample out")
        self._take(FilterEvent(float(time), levels, None, None, None))

    def push_frame(
        self, time: float, rows: Float[Array, "m 4"], values: Float[Array, " m"], variance: Float[Array, " m"],
    ) -> None:
        """Take a frame of m measured values at `time` [s], with their variances. Each row of `rows` (m, 4) states what
        one value is: kind of quantity, link, and distances along and across the link [m].

        Positions and angles are in the model's base frame; NaN values are skipped. In space, rows are (m, 5), and an
        orientation is a rotation vector in three rows. One that differs from the model's by more than 90 degrees is
        ignored and counted.

        Raises
        ------
        InputError
            When the shapes do not agree, the time is not finite, a row has an unknown kind or link, or an orientation
            is not three rows of one link.
        """
        rows, values, variance = (np.ascontiguousarray(a, dtype=float) for a in (rows, values, variance))
        check_frame(self.model, rows, values, variance)
        if not math.isfinite(time):
            raise InputError(f"a frame must have a finite time, got {time} s: leave this frame out")
        if not np.isfinite(values).any():
            self.counts.skipped += 1
            return
        self._take(FilterEvent(float(time) - self.latency, None, rows, values, variance))

    def state(self, time: float) -> State:
        """Return the estimated state at `time` [s], or at the newest event if that is later."""
        self.advance(time)
        model, K, n = self.model, self._chain.joints.K, self.angle.size
        angle, rate, disturbance = self.angle.copy(), self.rate.copy(), self.disturbance.copy()
        memory, shift, strain_shift = model.memory, disturbance / K[:n], self._own.disturbance[n:] / K[n:]
        shift = self._remembered(memory, 0, mechanics_of(model).joint_coordinates(self._own.angle)[:n], shift)
        return State(
            self.time, angle, rate, shift, disturbance, self.covariance.copy(), fault=self.fault,
            strain=self.strain.copy(), strain_rate=self.strain_rate.copy(),
            strain_shift=self._remembered(memory.axial, n, self.strain, strain_shift),
        )

    def _remembered(self, memory: Any, first: int, q: Array, shift: Array) -> Array:
        """Return the shifts of rest that have the same effect as model error and hysteresis, of the coordinates q from
        index `first` on. `shift` are those by model error alone.
        """
        if not memory:
            return shift
        left, law = memory.instantaneous, memory.law()
        r = memory_angle(slice(first, first + q.size), q, self.memory, law)
        return np.asarray((shift + left * q - r) / (1.0 + left))

    def advance(self, time: float) -> None:
        """Predict the state to `time` [s] under the current pressure. An earlier time changes nothing."""
        span = time - self.time
        if not span > 1e-12 or math.isinf(span):
            return
        count = math.ceil(span / self.time_step * (1 - 1e-9))
        moves = self._moves(count, span / count)
        self._torques(span, self.pressure, self._actuation, self._slow, self._tau)
        if self._base is None:
            prediction = Prediction(count, span / count, self._tau, self._densities)
            failed = self._predict(self._own, self._chain, prediction, self._arrays(1))
        else:
            failed = self._carried(self._base, moves, span / count)
        if failed < 0:
            raise SimulationError(
                f"the prediction to {time:.6g} s fails: the step {span / count:.3g} s is too long; use a shorter step"
            )
        self.time = float(time)

    def _moves(self, count: int, h: float) -> list[tuple[Array, Any]]:
        """Return the motion of the base in each of `count` steps of h [s], and the constants of a body on which the
        acceleration of the base acts as gravity does; [] for a base at rest.
        """
        if self._base is None:
            return []
        rows, fields = base_fields(self._base.chain, self._base.motion, self.time + h * np.arange(count + 1))
        return [(row, with_gravity(self._chain, pull)) for row, pull in zip(rows, fields, strict=True)]

    def _carried(self, base: BaseSteps, moves: list[tuple[Array, Any]], h: float) -> int:
        """Predict over steps of h [s] on the moving base. Return -1 if a step failed, else 0."""
        prediction, arrays = Prediction(1, h, self._tau, self._densities), self._arrays(1)
        for row, chain in moves:
            predict = partial(self._predict, self._own, chain, prediction, arrays)
            if base.advance(predict, row, self._own.angle, self._own.rate) < 0:
                return -1
        return 0

    def _arrays(self, rows: int) -> FilterWorkspace:
        if rows not in self._workspaces:
            arrays = make_workspace(self.model, self.covariance.shape[0], rows)
            self._workspaces[rows] = arrays._replace(held=self._mechanics.held())
        return self._workspaces[rows]

    def _take(self, event: FilterEvent) -> None:
        if math.isinf(self.time):
            self.time = event.time
        if event.time >= self.time - 1e-12:
            self._apply(event)
        elif self._events and event.time >= self._events[0][0].time:
            self._replay(event)
        else:
            self.counts.too_late += event.value is not None
            return
        while self._events and self._events[0][0].time < self.time - self.buffer:
            self._events.popleft()

    def _replay(self, event: FilterEvent) -> None:
        """Go back to before the event, apply it, and apply again all later events."""
        now, again = self.time, []
        while self._events and self._events[-1][1].time > event.time:
            undone, later = self._events.pop()
            again.append(later)
            self._restore(undone)
            self.counts.used -= later.value is not None
        self.counts.late += event.value is not None
        if event.time < self.time:
            undone, earlier = self._events.pop()
            self._restore(undone)
            self.counts.used -= earlier.value is not None
            again.append(earlier)
        for e in sorted([event, *again], key=lambda e: e.time):
            self._apply(e)
        self.advance(now)

    def _apply(self, event: FilterEvent) -> None:
        before = FilterSnapshot(self.time, self.pressure, self._slow.copy(), self._state.copy())
        self.advance(event.time)  # raises before the event is kept
        self._events.append((before, event))
        if event.pressure is not None:
            self.pressure = event.pressure
        if event.rows is None or event.value is None or event.variance is None:
            return
        workspace = self._arrays(event.value.size)
        frame = frame_of(self.model, event.rows, event.value, event.variance)
        self.innovation = frame.innovation
        used, square, _ = self._update(self._own, self._chain, frame, workspace)
        self.counts.used += 1
        self.counts.flipped += flips(event.rows, event.value, workspace.seen)
        self.counts.last_ratio = square / used if used else math.nan
        off = np.abs(event.value - workspace.seen)
        lengths = IN_METRES[event.rows[:, 0].astype(int)]
        if used and np.nanmax(off / np.where(lengths, self.model.length, 1.0)) > LARGEST:
            self.fault = f"a frame differs from the filter's model by more than {LARGEST} rad or {LARGEST} body lengths"

    def _restore(self, kept: FilterSnapshot) -> None:
        self.time, self.pressure = kept.time, kept.pressure
        self._slow[:] = kept.slow
        self._state[:] = kept.state


def make(setting: Setting) -> KalmanFilter:
    """Return a Kalman filter, created from the arguments in `setting`. It starts at the first pressure or frame."""
    return KalmanFilter(setting.model, time=-math.inf)


ESTIMATOR = EstimatorKind("filter", make, predicts=True, consumer=FILTER)
