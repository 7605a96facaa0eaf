"""States of a valve: simulated from a time series of commands, or estimated from commands and a pressure gauge."""

from __future__ import annotations

import math

import numpy as np

from pliant.compiler.choose import twin
from pliant.control import feedback_loops
from pliant.control.valve import FINE, SupplyValve
from pliant.linear.linearisation import behind_valve
from pliant.linear.sampled import hold
from pliant.model import Valve

Array = np.ndarray


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
        asked, seen = self._queue.pop(0), self._readings.pop(0)
        if not self.order:
            self.value[0] = asked
            return self.value
        if self._supply is not None:
            self._follow(float(asked), float(seen), self._numbers, self.value, *self._workspace)
            return self.value
        self.value = self._A @ self.value + self._B * asked
        if math.isfinite(seen):
            self.value = self.value + self._gain * (seen - self.value[0])
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
        at = np.arange(command.size) * period - supply.dead_time - latency
        out[:, 0] = np.interp(at, time, pressure)
        out[:, 1] = np.interp(at, time, np.gradient(pressure, time[1]))
    elif names:
        whole, part = divmod(valve.dead_time + latency, period)
        early, late = hold(A, B, part), hold(A, B, period - part)
        sent = np.concatenate([np.zeros(int(whole) + 1), command])
        x = np.zeros(len(names))
        for k in range(command.size):
            out[k] = x
            x = late[0] @ (early[0] @ x + early[1] * sent[k]) + late[1] * sent[k + 1]
    return out
