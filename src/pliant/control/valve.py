"""The pressure valve of a test rig, which fills faster than it empties, and its identification from commands and gauge
readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pliant.compiler.choose import twin
from pliant.control import feedback_loops
from pliant.errors import FitError, InputError
from pliant.linear.linearisation import LINEARISE, behind_valve
from pliant.linear.sampled import hold
from pliant.model import Model, Valve
from pliant.model.features import Consumer

Array = np.ndarray
FINE = 5e-4  # s, time step of the valve's equation


@dataclass(frozen=True)
class SupplyValve:
    """A second-order pressure regulator with dead time, and different natural frequencies for filling and emptying.

    Parameters
    ----------
    rise_frequency, fall_frequency : float
        Natural frequencies [Hz] for a command above and below the pressure.
    damping_ratio : float
    dead_time : float
        Dead time [s].
    """

    rise_frequency: float
    fall_frequency: float
    damping_ratio: float
    dead_time: float = 0.0

    def __post_init__(self) -> None:
        rest = min(self.rise_frequency, self.fall_frequency, self.damping_ratio)
        if not (rest > 0 and self.dead_time >= 0 and math.isfinite(rest + self.dead_time)):
            raise InputError(f"a supply valve needs positive frequencies and damping, and a dead time >= 0, got {self}")

    @property
    def mean(self) -> Valve:
        """The valve with a single natural frequency, for linear designs: the geometric mean of the frequencies for
        filling and for emptying.
        """
        return Valve(
            natural_frequency=math.sqrt(self.rise_frequency * self.fall_frequency), damping_ratio=self.damping_ratio,
            dead_time=self.dead_time,
        )

    def march(self, command: Array, h: float, held: Array) -> Array:
        """Return the valve's pressures (K,) [Pa] after each of K steps of `h` [s] under commands (K,) [Pa], without
        dead time.

        `held` (2,) holds the pressure [Pa] and its rate [Pa/s], and is updated in place.
        """
        out, two_pi = np.empty(command.size), 2 * math.pi
        twin(feedback_loops.regulate)(
            command, h, two_pi * self.rise_frequency, two_pi * self.fall_frequency, self.damping_ratio, held, out
        )
        return out


OF_THE_RIG = {"settling": "settle_share", "dead_band": "dead_band", "opening": "opening_time"}
CONTROL = Consumer(
    "a controller", LINEARISE.can - {"settling", "tendon_friction"}, LINEARISE.by_nature,
    {
        key: f"give the rig's valve (`supply`, [valve] in a task file), or set {name} to 0 in the model"
        for key, name in OF_THE_RIG.items()
    } | {
        "inflation": LINEARISE.remedy["inflation"],
        "tendon_friction": "set friction to 0 in the model, so that integral action acts against that of the body",
    },
)


def check_followed(model: Model) -> None:
    """Raise InputError if the model has a feature that controllers do not support, such as a valve with slow settling,
    a dead band or an opening time. The controllers' models do not include them.
    """
    CONTROL.check(model)


def supply_of(valve: Valve) -> SupplyValve | None:
    """Return the second-order valve of a model as a `SupplyValve`, or None if the valve is not of second order."""
    if not valve.natural_frequency:
        return None
    return SupplyValve(valve.natural_frequency, valve.natural_frequency, valve.damping_ratio, valve.dead_time)


@dataclass(frozen=True)
class ValveRun:
    """A recording for `identify_valve`: steps of the commanded pressure and the readings of a pressure gauge.

    Attributes
    ----------
    edge_time, level : array (E,)
        Times [s], and the command [Pa] from each time on; 0 before the first.
    time, pressure : array (T,)
        Times [s], on the clock of the command, and the gauge's readings [Pa].
    """

    edge_time: Array
    level: Array
    time: Array
    pressure: Array


@dataclass(frozen=True)
class ValveFit:
    """Result of `identify_valve`: the valve, its fit error [Pa] and standard errors of its parameters.

    Attributes
    ----------
    valve : SupplyValve
    rmse : float
        Root-mean-square error of the gauge's readings [Pa].
    standard_error : dict of str to float
        Standard errors of the valve's parameters by name, for white residuals. They are too small if the valve is of
        another kind.
    """

    valve: SupplyValve
    rmse: float
    standard_error: dict[str, float]


NAMES = ("rise_frequency", "fall_frequency", "damping_ratio", "dead_time")
LOW, HIGH = (0.2, 0.2, 0.2, 0.0), (100.0, 100.0, 5.0, 0.2)


def identify_valve(runs: Sequence[ValveRun]) -> ValveFit:
    """Fit natural frequencies, damping ratio and dead time of a pressure valve to gauge readings under steps of the
    command.

    Each run is scaled by its highest command. A constant offset of the gauge is removed from each run.

    Parameters
    ----------
    runs : sequence of ValveRun
        Runs with steps up and down.

    Returns
    -------
    ValveFit

    Raises
    ------
    InputError
        When a run has no steps, or readings that are not finite.
    FitError
        When the readings are not those of a second-order valve.

    Examples
    --------
    >>> import numpy as np
    >>> from pliant.control import SupplyValve, ValveRun, identify_valve, valve_response
    >>> time, edges, levels = np.arange(0.0, 1.0, 2e-3), np.array([0.1, 0.6]), np.array([5e4, 1e4])
    >>> seen = valve_response(SupplyValve(9.0, 6.5, 0.75, 0.008), edges, levels, time)
    >>> found = identify_valve([ValveRun(edges, levels, time, seen)]).valve
    >>> round(found.rise_frequency, 2), round(found.fall_frequency, 2), round(found.dead_time, 4)
    (9.0, 6.5, 0.008)
    """
    from scipy.optimize import least_squares

    if not runs:
        raise InputError("identify_valve needs at least one run of commanded steps, got none")
    whole = [_checked(run) for run in runs]

    def residual(x: Array) -> Array:
        return np.concatenate([_misfit(run, x) for run in whole])

    starts = ([f, f, 0.8, 0.01] for f in (3.0, 10.0))
    fits = [least_squares(residual, x, bounds=(LOW, HIGH), x_scale=[1.0, 1.0, 0.1, 1e-3], diff_step=1e-4)
            for x in starts]  # fmt: skip
    best = min(fits, key=lambda made: float(made.cost))
    at_bound = np.isclose(best.x, HIGH) | (np.isclose(best.x, LOW) & (np.arange(4) < 3))
    if not best.success or at_bound.any():
        numbers = ", ".join(f"{name} {value:.3g}" for name, value in zip(NAMES, best.x, strict=True))
        raise FitError(
            f"the readings do not fit a second-order valve ({numbers}): check that command and gauge use one clock"
        )
    count = best.fun.size
    errors = np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)) * 2 * best.cost / max(count - 4, 1))
    squares = sum(float(np.sum((_misfit(run, best.x) * run.level.max()) ** 2)) for run in whole)
    standard_error = dict(zip(NAMES, map(float, errors), strict=True))
    return ValveFit(SupplyValve(*map(float, best.x)), float(np.sqrt(squares / count)), standard_error)


def valve_response(valve: SupplyValve, edge_time: Array, level: Array, time: Array) -> Array:
    """Return a valve's pressures (T,) [Pa] at T times (T,) [s] under steps of the command. It starts without pressure.

    From each of `edge_time` [s] on, the command is the corresponding `level` [Pa].
    """
    ends = np.append(edge_time[1:], max(float(time[-1]), float(edge_time[-1]) + FINE))
    valve_state, clock, pressure = np.zeros(2), [np.array([edge_time[0]])], [np.zeros(1)]
    for first, last, command in zip(edge_time, ends, level, strict=True):
        count = max(1, math.ceil((last - first) / FINE))
        pressure.append(valve.march(np.full(count, float(command)), (last - first) / count, valve_state))
        clock.append(np.linspace(first, last, count + 1)[1:])
    return np.interp(time - valve.dead_time, np.concatenate(clock), np.concatenate(pressure))


def _checked(run: ValveRun) -> ValveRun:
    checked = ValveRun(*(np.asarray(part, dtype=float) for part in (run.edge_time, run.level, run.time, run.pressure)))
    sizes = checked.edge_time.size, checked.level.size, checked.time.size, checked.pressure.size
    if not (sizes[0] == sizes[1] > 0 and sizes[2] == sizes[3] > 0):
        raise InputError(
            "a run for a valve needs as many edges (s) as levels (Pa), and as many readings as times; got "
            f"{sizes[0]} edges, {sizes[1]} levels, {sizes[2]} times, {sizes[3]} readings"
        )
    for name in ("edge_time", "level", "time", "pressure"):
        if not np.isfinite(getattr(checked, name)).all():
            raise InputError(f"{name} of a run for a valve must be finite: remove or correct the other values")
    if not checked.level.max() > 0:
        raise InputError("at least one level of a run for a valve must be > 0 Pa, but none is: command a pressure step")
    if np.any(np.diff(checked.edge_time) <= 0):
        raise InputError("edge_time of a run for a valve must increase: sort the steps of the command by time")
    return checked


def _misfit(run: ValveRun, numbers: Array) -> Array:
    left = run.pressure - valve_response(SupplyValve(*map(float, numbers)), run.edge_time, run.level, run.time)
    return np.asarray((left - left.mean()) / run.level.max())


class ValveObserver:
    """Observer that estimates the pressure behind a valve, and its rate, from commands and a pressure gauge.

    Parameters
    ----------
    valve : Valve
    period : float
        Control period [s].
    noise : float
        Standard deviation of the gauge [Pa].
    trust : float
        Standard deviation of the valve equation's error over one period [Pa].
    late : int
        Number of periods by which the shape is late. The pressure is delayed equally, so that both refer to one time.
    supply : SupplyValve, optional
        The rig's valve; default: the model's.
    """

    def __init__(
        self, valve: Valve, period: float, *, noise: float = 300.0, trust: float = 300.0, late: int = 0,
        supply: SupplyValve | None = None,
    ) -> None:
        from scipy.linalg import solve_discrete_are

        plain = np.zeros((0, 0))
        A, B, names = behind_valve(plain, np.zeros(0), valve)
        self.order = len(names)
        self._late, self._delay = late, round(valve.dead_time / period) + late
        self.reset()
        if not self.order:
            return
        self._A, self._B = hold(A, B, period)
        self._supply = supply if self.order == 2 else None
        if self._supply is not None:
            parts, turn = max(1, round(period / FINE)), 2 * math.pi
            numbers = (
                period / parts, turn * self._supply.rise_frequency, turn * self._supply.fall_frequency,
                float(self._supply.damping_ratio),
            )
            self._workspace, self._follow = np.zeros((2, parts)), twin(feedback_loops.follow_valve)
        Q = trust**2 * np.outer(self._B, self._B) + 1e-6 * np.eye(self.order) * trust**2
        H = np.eye(1, self.order)
        P = solve_discrete_are(self._A.T, H.T, Q * 1e-6, np.array([[noise**2 * 1e-6]]))
        self._gain = np.ascontiguousarray((P @ H.T / (P[0, 0] + noise**2 * 1e-6))[:, 0])
        if self._supply is not None:
            self._numbers = (*numbers, self._gain)

    def reset(self) -> None:
        """Reset the estimated pressure and the commands in transit to zero."""
        self.value = np.zeros(max(self.order, 1))
        self._queue, self._readings = [0.0] * self._delay, [0.0] * self._late

    def update(self, command: float, reading: float) -> Array:
        """Return the estimated valve states [Pa, Pa/s] after a period under `command` [Pa], corrected by the gauge
        `reading` [Pa].
        """
        self._queue.append(command)
        self._readings.append(reading)
        asked, reading_then = self._queue.pop(0), self._readings.pop(0)
        if not self.order:
            self.value[0] = asked
            return self.value
        if self._supply is not None:
            self._follow(float(asked), float(reading_then), self._numbers, self.value, *self._workspace)
            return self.value
        self.value = self._A @ self.value + self._B * asked
        if math.isfinite(reading_then):
            self.value = self.value + self._gain * (reading_then - self.value[0])
        return self.value


def behind_supply(valve: SupplyValve, command: Array, period: float) -> tuple[Array, Array]:
    """Return times [s] and the pressures [Pa] behind a valve under K commands (K,) [Pa] that are held for `period` [s]
    each. The valve's dead time is left out.
    """
    parts = max(1, round(period / FINE))
    pressure = valve.march(np.repeat(command, parts), period / parts, np.zeros(2))
    return np.arange(pressure.size + 1) * (period / parts), np.append(0.0, pressure)


def valve_under(valve: Valve, supply: SupplyValve | None, command: Array, period: float, latency: float) -> Array:
    """Return a valve's pressure [Pa] and, at order 2, its rate [Pa/s] at the start of K periods, as states (K, order).
    They follow the commands (K,) [Pa], delayed by `latency` [s] in addition to the dead time.
    """
    A, B, names = behind_valve(np.zeros((0, 0)), np.zeros(0), valve)
    out = np.zeros((command.size, len(names)))
    if supply is not None:
        time, pressure = behind_supply(supply, command, period)
        times = np.arange(command.size) * period - supply.dead_time - latency
        out[:, 0] = np.interp(times, time, pressure)
        out[:, 1] = np.interp(times, time, np.gradient(pressure, time[1]))
    elif names:
        whole, part = divmod(valve.dead_time + latency, period)
        early, late = hold(A, B, part), hold(A, B, period - part)
        sent = np.concatenate([np.zeros(int(whole) + 1), command])
        x = np.zeros(len(names))
        for k in range(command.size):
            out[k] = x
            x = late[0] @ (early[0] @ x + early[1] * sent[k]) + late[1] * sent[k + 1]
    return out
