"""Pressure inputs as functions of time, commanded or measured. Gauge pressure in Pa, time in s.

Every input is a callable of time with the attributes `jumps` (times of jumps) and `breakpoints` (times of jumps and
kinks), so that a simulation can integrate exactly across these times.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from pliant.errors import InputError
from pliant.numerics.ringdown import peak
from pliant.shapes import Float

Array = np.ndarray


class Input(Protocol):
    """Interface of a pressure input for `simulate`: pressure [Pa] as a function of time, with its jumps and kinks."""

    @property
    def jumps(self) -> Float[Array, " J"]:
        """Times [s] at which the pressure jumps."""

    @property
    def breakpoints(self) -> Float[Array, " B"]:
        """Times [s] at which the pressure jumps or has a kink."""

    def __call__(self, t: Any) -> Array:
        """Return the gauge pressure [Pa] at the times `t` [s]."""


def _check(what: str, **values: float) -> None:
    for name, value in values.items():
        if not np.isfinite(value):
            raise InputError(f"{what}: {name} must be finite, got {value}")


@dataclass(frozen=True)
class Pulse:
    """A rectangular pulse: `level` [Pa] from `start` [s] for `width` [s], zero elsewhere. Without a width it does not
    end, like a `Step`.

    Raises
    ------
    InputError
        When a number is not finite, or the width not positive.

    Examples
    --------
    >>> import pliant
    >>> pulse = pliant.Pulse(level=50e3, start=0.1, width=1.0)  # Pa, s, s
    >>> [float(pulse(t)) for t in (0.0, 0.5, 2.0)]
    [0.0, 50000.0, 0.0]
    """

    level: float
    start: float = 0.0
    width: float = np.inf

    def __post_init__(self) -> None:
        _check(type(self).__name__.lower(), level=self.level, start=self.start)
        if not self.width > 0:
            raise InputError(f"pulse width must be positive, got {self.width}")

    @property
    def jumps(self) -> Array:
        edges = np.array([self.start, self.start + self.width])
        return edges[np.isfinite(edges)]

    @property
    def breakpoints(self) -> Array:
        return self.jumps

    def __call__(self, t: Any) -> Array:
        if isinstance(t, float):
            return np.array(self.level if self.start <= t < self.start + self.width else 0.0, dtype=float)
        t = np.asarray(t, dtype=float)
        return np.where((t >= self.start) & (t < self.start + self.width), self.level, 0.0)


@dataclass(frozen=True)
class Step(Pulse):
    """A step from zero to `level` [Pa] at `start` [s]: a `Pulse` that does not end.

    Raises
    ------
    InputError
        When a number is not finite.

    Examples
    --------
    >>> import pliant
    >>> rise = pliant.Step(level=50e3, start=0.1)  # Pa, s
    >>> [float(rise(t)) for t in (0.0, 0.1, 60.0)]
    [0.0, 50000.0, 50000.0]
    """

    width: float = field(default=np.inf, init=False, repr=False)


@dataclass(frozen=True, eq=False)
class Trace:
    """A piecewise linear pressure through given points, such as a measured time series.

    It is constant before the first and after the last point. Two points at the same time make a jump.

    Parameters
    ----------
    time : (P,) array, s
        Times, not decreasing.
    pressure : (P,) array, Pa gauge

    Raises
    ------
    InputError
        When the arrays differ in length, are empty or not finite, or the times decrease.

    Examples
    --------
    >>> from pliant.simulation import Trace
    >>> float(Trace([0.0, 1.0], [0.0, 40e3])(0.25))
    10000.0
    """

    time: Float[Array, " P"]
    pressure: Float[Array, " P"]
    jumps: Float[Array, " J"] = field(init=False)
    breakpoints: Float[Array, " B"] = field(init=False)

    def __post_init__(self) -> None:
        t = np.array(self.time, dtype=float)
        p = np.array(self.pressure, dtype=float)
        if t.ndim != 1 or t.shape != p.shape or t.size == 0:
            raise InputError(f"a pressure trace needs as many times as pressures, got {t.shape} and {p.shape}")
        if not (np.isfinite(t).all() and np.isfinite(p).all()):
            bad = int((~(np.isfinite(t) & np.isfinite(p))).sum())
            raise InputError(f"a pressure trace must be finite: {bad} of {t.size} samples are not; repair them first")
        if np.any(np.diff(t) < 0):
            raise InputError("the times of a pressure trace must not decrease: sort its samples by time")
        same = np.diff(t) == 0
        for name, value in (("time", t), ("pressure", p), ("breakpoints", np.unique(t)), ("jumps", t[1:][same])):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __call__(self, t: Any) -> Array:
        if isinstance(t, float):  # fast path: solvers call it a hundred thousand times
            return np.array(self._at(t))
        t = np.asarray(t, dtype=float)
        after = np.maximum(1, np.minimum(np.searchsorted(self.time, t, side="right"), self.time.size - 1))
        if self.time.size == 1:
            return np.full(t.shape, self.pressure[0])
        t0, t1 = self.time[after - 1], self.time[after]
        p0, p1 = self.pressure[after - 1], self.pressure[after]
        share = np.maximum(0.0, np.minimum((t - t0) / np.where(t1 > t0, t1 - t0, 1.0), 1.0))
        return np.where(t >= self.time[-1], self.pressure[-1], p0 + share * (p1 - p0))

    @property
    def peak(self) -> float:
        """The pressure [Pa] farthest from 0, with its sign (negative for a vacuum)."""
        return peak(self.pressure)

    def _at(self, t: float) -> float:
        """Return the pressure [Pa] at one time [s], by the same arithmetic as `__call__`."""
        if self.time.size == 1 or t >= self.time[-1]:
            return float(self.pressure[-1])
        after = max(1, min(int(self.time.searchsorted(t, side="right")), self.time.size - 1))  # NaN stays NaN
        t0, t1 = self.time[after - 1 : after + 1].tolist()
        p0, p1 = self.pressure[after - 1 : after + 1].tolist()
        share = (t - t0) / (t1 - t0 if t1 > t0 else 1.0)
        return float(p0 + (0.0 if share < 0.0 else min(share, 1.0)) * (p1 - p0))


def ramp(level: float, start: float, duration: float) -> Trace:
    """Return a linear rise from 0 to `level` [Pa] that begins at `start` [s] and lasts `duration` [s], then constant.

    Raises
    ------
    InputError
        When the duration is not a positive time.

    Examples
    --------
    >>> from pliant.simulation import inputs
    >>> float(inputs.ramp(50e3, start=0.0, duration=1.0)(0.5))
    25000.0
    """
    if not (np.isfinite(duration) and duration > 0):
        raise InputError(f"ramp duration must be a positive time in seconds, got {duration}")
    return Trace(np.array([start, start + duration]), np.array([0.0, level]))


def triangle(level: float, period: float, cycles: int, start: float = 0.0) -> Trace:
    """Return `cycles` triangles between 0 and `level` [Pa] with a `period` [s], beginning at `start` [s].

    Raises
    ------
    InputError
        When the period is not positive, or `cycles` is below 1.

    Examples
    --------
    >>> from pliant.simulation import inputs
    >>> rising = inputs.triangle(40e3, period=2.0, cycles=1)
    >>> float(rising(0.5))
    20000.0
    """
    if not (np.isfinite(period) and period > 0 and cycles >= 1):
        raise InputError(f"a triangle needs a positive period (s) and at least one cycle, got {period} and {cycles}")
    corners = np.arange(2 * cycles + 1)
    return Trace(start + 0.5 * period * corners, level * (corners % 2))


@dataclass(frozen=True)
class Chirp:
    """A sine sweep: `offset` + `amplitude` sin(phase), with a frequency from `f0` to `f1` [Hz] in `duration` [s].

    The frequency changes linearly with time. Amplitude and offset are in Pa. The pressure is zero before `start` [s]
    and after the sweep.

    Raises
    ------
    InputError
        When a number is not finite, or the duration not positive.

    Examples
    --------
    >>> from pliant.simulation import Chirp
    >>> chirp = Chirp(amplitude=10e3, offset=20e3, f0=0.5, f1=4.0, duration=5.0)
    >>> bool(10e3 <= chirp(1.0) <= 30e3)
    True
    """

    amplitude: float
    offset: float
    f0: float
    f1: float
    duration: float
    start: float = 0.0

    def __post_init__(self) -> None:
        _check("chirp", amplitude=self.amplitude, offset=self.offset, f0=self.f0, f1=self.f1, start=self.start)
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise InputError(f"chirp duration must be a positive time in seconds, got {self.duration}")

    @property
    def jumps(self) -> Array:
        return np.array([self.start, self.start + self.duration])

    @property
    def breakpoints(self) -> Array:
        return self.jumps

    def __call__(self, t: Any) -> Array:
        s = np.asarray(t, dtype=float) - self.start
        phase = 2 * np.pi * (self.f0 * s + 0.5 * (self.f1 - self.f0) / self.duration * s**2)
        return np.where((s >= 0) & (s < self.duration), self.offset + self.amplitude * np.sin(phase), 0.0)
