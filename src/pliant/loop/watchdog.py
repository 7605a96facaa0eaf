"""The watchdog: what makes the loop vent (p = 0), and stay vented until somebody resets it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.estimation.contract import State
from pliant.units import KIND_OF, shown_in

Array = np.ndarray


@dataclass(frozen=True)
class Bounds:
    """Limits within which the loop counts as healthy.

    Parameters
    ----------
    shape_age, pressure_age : float
        s; an older last whole reading vents.
    highest_pressure : float
        Pa, of the reading (leave a margin for noise and overshoot) and of the command.
    lowest_pressure : float
        Pa, of the reading: below, the sensor is broken.
    largest_angle : float
        rad, of the last link against its rest.
    largest_rate : float
        rad/s, of any link.
    clock_skew : float
        s by which a reading's time may lie ahead of the loop's clock; beyond, it is not used, and so goes stale.
    shape_repeats, pressure_repeats : int
        Readings in a row that may equal each other in every number: one more is a sensor that is frozen. 0: any number,
        for sensors coarser than their noise.
    controller_faults : int
        Periods in a row in which the controller may have no command of its own, and goes on with an earlier plan: one
        more vents.
    unit : str
        SI unit of the inputs: that of `highest_pressure` and `lowest_pressure`, of tendons "N", "m" or "rad".
    """

    highest_pressure: float
    shape_age: float = 0.03
    pressure_age: float = 0.03
    lowest_pressure: float = -2e4
    largest_angle: float = 3.0
    largest_rate: float = 100.0
    clock_skew: float = 5e-3
    shape_repeats: int = 25
    pressure_repeats: int = 250
    controller_faults: int = 25
    unit: str = "Pa"

    def __post_init__(self) -> None:
        for name in ("highest_pressure", "shape_age", "pressure_age", "largest_angle", "largest_rate"):
            if not getattr(self, name) > 0:
                raise InputError(f"watchdog bound {name} must be positive, got {getattr(self, name)}")
        for name in ("clock_skew", "shape_repeats", "pressure_repeats", "controller_faults"):
            if not getattr(self, name) >= 0:
                raise InputError(f"watchdog bound {name} must not be negative, got {getattr(self, name)}")
        if self.unit not in KIND_OF:
            raise InputError(f"watchdog bound unit is one of {', '.join(KIND_OF)}, got {self.unit!r}")


class Watchdog:
    """Checks every period; the first fault is kept and the command is 0 from then on.

    Attributes
    ----------
    fault : str
        Why it vents, in one sentence; empty while it does not.
    fault_time : int
        ns
    controller_fault : str
        What the controller said of the first period in which it had no command of its own; empty while there was none.
    controller_fault_time : int
        ns
    controller_faults : int
        How many such periods there were.
    """

    def __init__(self, bounds: Bounds, rest_angle: float = 0.0) -> None:
        self.bounds, self._rest = bounds, rest_angle
        self.reset()

    def reset(self) -> None:
        """Forget the faults."""
        self.fault, self.fault_time = "", 0
        self.controller_fault, self.controller_fault_time, self.controller_faults, self._in_a_row = "", 0, 0, 0

    @property
    def summary(self) -> tuple[str, int]:
        """Return in a sentence what failed and since when [ns]: why the loop vented, or the controller's faults."""
        if self.fault or not self.controller_faults:
            return self.fault, self.fault_time
        periods = "period" if self.controller_faults == 1 else "periods"
        return f"in {self.controller_faults} {periods} {self.controller_fault}", self.controller_fault_time

    def trip(self, sentence: str, now: int) -> None:
        """Vent from now on; the first reason stays."""
        if not self.fault:
            self.fault, self.fault_time = sentence, now

    def readings(self, now: int, shape_time: int, pressure_time: int, pressure: Array) -> None:
        """Look at the age of the newest whole readings [ns] and at the pressure of every chamber [Pa]."""
        b = self.bounds
        kind = KIND_OF[b.unit]
        for what, seen, limit in (("shape", shape_time, b.shape_age), (kind, pressure_time, b.pressure_age)):
            age = (now - seen) * 1e-9
            if age > limit:
                self.trip(f"stale {what}: the last whole one is {age * 1e3:.1f} ms old, {limit * 1e3:.1f} allowed", now)
        self.pressure(now, pressure)

    def frozen(self, now: int, shape_repeats: int, pressure_repeats: int) -> None:
        """Look at how many readings in a row were equal."""
        b = self.bounds
        for what, count, most in (
            ("shape", shape_repeats, b.shape_repeats), (KIND_OF[b.unit], pressure_repeats, b.pressure_repeats),
        ):
            if 0 < most < count:
                self.trip(f"frozen {what}: {count} readings in a row equal the one before, {most} allowed", now)

    def pressure(self, now: int, pressure: Array) -> None:
        """Look at the pressure of every chamber [Pa]."""
        b = self.bounds
        for p in pressure.tolist():
            if not math.isfinite(p):
                self.trip(f"the {KIND_OF[b.unit]} reading is {p}", now)
            elif not b.lowest_pressure <= p <= b.highest_pressure:
                factor, unit = shown_in(b.unit)
                self.trip(f"the {KIND_OF[b.unit]} of {factor * p:.1f} {unit} is outside "
                          f"{factor * b.lowest_pressure:.1f} ... {factor * b.highest_pressure:.1f} {unit}", now)

    def estimate(self, now: int, state: State) -> None:
        """Look at the estimated state and at what the estimator says of itself."""
        angle, rate = state.angle, state.rate
        if not (np.isfinite(angle).all() and np.isfinite(rate).all()):
            self.trip("the estimate is not a number", now)
        elif abs(angle[-1] - self._rest) > self.bounds.largest_angle:
            self.trip(f"the last link turned by {angle[-1] - self._rest:.2f} rad, beyond the limit", now)
        elif np.abs(rate).max() > self.bounds.largest_rate:
            self.trip(f"a link turns at {np.abs(rate).max():.1f} rad/s, beyond the limit", now)
        elif not state.consistent:
            self.trip(f"the estimator lost its consistency: {state.fault}", now)

    def controller(self, now: int, fault: str) -> bool:
        """Look at what the controller says of its command; True where a fault begins."""
        begins, self._in_a_row = bool(fault) and not self._in_a_row, self._in_a_row + 1 if fault else 0
        if fault:
            self.controller_faults += 1
            if not self.controller_fault:
                self.controller_fault, self.controller_fault_time = fault, now
        if self._in_a_row > self.bounds.controller_faults:
            self.trip(f"in {self._in_a_row} periods in a row {fault}", now)
        return begins

    def command(self, now: int, command: Array) -> Array:
        """The commands (C,) [Pa] that may go out: 0 after a fault, and where it is not a number or out of limits."""
        for p in command.tolist():
            if not math.isfinite(p):
                self.trip(f"the command is {p}", now)
            elif not 0.0 <= p <= self.bounds.highest_pressure:
                factor, unit = shown_in(self.bounds.unit)
                self.trip(f"a command of {factor * p:.1f} {unit} is out of limits", now)
        if not self.fault:
            return command
        return np.zeros(command.size)
