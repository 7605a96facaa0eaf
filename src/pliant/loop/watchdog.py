"""The watchdog: conditions under which the loop vents (p = 0) and stays vented until it is reset."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

import numpy as np

from pliant.errors import InputError
from pliant.estimation.contract import State
from pliant.shapes import Float
from pliant.units import KIND_OF, shown_in

Array = np.ndarray


@dataclass(frozen=True)
class Bounds:
    """Limits of pressures, angles, rates and ages of readings, beyond which the watchdog vents the actuator.

    Parameters
    ----------
    shape_age, pressure_age : float
        Largest age [s] of the last complete reading.
    highest_pressure : float
        Highest pressure [Pa] of reading and command. Leave a margin for noise and overshoot.
    lowest_pressure : float
        Lowest pressure reading [Pa]; below, the sensor is taken as broken.
    largest_angle : float
        Largest angle [rad] of the last link against its rest angle.
    largest_rate : float
        Largest angular velocity [rad/s] of any link.
    clock_skew : float
        Time [s] by which a time stamp may be ahead of the loop's clock. Readings beyond it are not used.
    shape_repeats, pressure_repeats : int
        Largest number of consecutive identical readings; beyond, the sensor is taken as frozen. 0: no limit, for
        sensors whose resolution is coarser than their noise.
    controller_faults : int
        Largest number of consecutive periods in which the controller reports a fault, e.g. continues an earlier plan.
    stall : float
        Longest time [s] that one part of a period may take: the sources with the estimator's updates, the estimated
        state, the controller, and the sink with the log.
    unit : str
        SI unit of the inputs, and so of `highest_pressure` and `lowest_pressure`: "Pa", of tendons "N", "m" or "rad".
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
    stall: float = 0.2
    unit: str = "Pa"

    def __post_init__(self) -> None:
        for name in ("highest_pressure", "shape_age", "pressure_age", "largest_angle", "largest_rate", "stall"):
            if not getattr(self, name) > 0:
                raise InputError(f"watchdog bound {name} must be positive, got {getattr(self, name)}")
        for name in ("clock_skew", "shape_repeats", "pressure_repeats", "controller_faults"):
            if not getattr(self, name) >= 0:
                raise InputError(f"watchdog bound {name} must not be negative, got {getattr(self, name)}")
        if self.unit not in KIND_OF:
            raise InputError(f"watchdog bound unit must be one of {', '.join(KIND_OF)}, got {self.unit!r}")


class Watchdog:
    """Checks readings, estimate and commands of a control loop in every period, keeps the first fault, and sets the
    command to 0 from then on.

    Attributes
    ----------
    fault : str
        The reason for venting in one sentence; empty without a fault.
    fault_time : int
        Time of the fault [ns].
    controller_fault : str
        The first fault that the controller reported; empty without one.
    controller_fault_time : int
        Time of that fault [ns].
    controller_faults : int
        Number of periods in which the controller reported a fault.
    """

    def __init__(self, bounds: Bounds, rest_angle: float = 0.0) -> None:
        self.bounds, self._rest = bounds, rest_angle
        self.reset()

    def reset(self) -> None:
        """Clear all faults."""
        self.fault, self.fault_time = "", 0
        self.controller_fault, self.controller_fault_time, self.controller_faults, self._in_a_row = "", 0, 0, 0

    @property
    def summary(self) -> tuple[str, int]:
        """Description and time [ns] of the fault that vented the actuator; without one, those of the first fault that
        the controller reported.
        """
        if self.fault or not self.controller_faults:
            return self.fault, self.fault_time
        periods = "period" if self.controller_faults == 1 else "periods"
        return f"in {self.controller_faults} {periods} {self.controller_fault}", self.controller_fault_time

    def trip(self, sentence: str, now: int) -> None:
        """Set the fault `sentence`, if there is none yet, so that the loop vents from now on."""
        if not self.fault:
            self.fault, self.fault_time = sentence, now

    def readings(self, now: int, shape_time: int, pressure_time: int, pressure: Float[Array, " C"]) -> None:
        """Set a fault if the last complete reading of the shape or of the pressure is too old at the time `now` [ns],
        or if a pressure is outside its limits.
        """
        b = self.bounds
        kind = KIND_OF[b.unit]
        for what, latest, limit in (("shape", shape_time, b.shape_age), (kind, pressure_time, b.pressure_age)):
            age = (now - latest) * 1e-9
            if age > limit:
                self.trip(f"stale {what}: last complete reading {age * 1e3:.1f} ms ago, {limit * 1e3:.1f} allowed", now)
        self.pressure(now, pressure)

    def stalled(self, began: int, ended: int, part: str) -> int:
        """Set a fault if a `part` of a period took too long, from `began` to `ended` [ns]; return `ended`."""
        if (took := (ended - began) * 1e-9) > self.bounds.stall:
            self.trip(f"{part} took {took * 1e3:.1f} ms in one period, {self.bounds.stall * 1e3:g} allowed", ended)
        return ended

    def frozen(self, now: int, shape_repeats: int, pressure_repeats: int) -> None:
        """Set a fault if too many consecutive readings of the shape sensor or of the pressure sensor are identical."""
        b = self.bounds
        for what, count, most in (
            ("shape", shape_repeats, b.shape_repeats), (KIND_OF[b.unit], pressure_repeats, b.pressure_repeats),
        ):
            if 0 < most < count:
                self.trip(f"frozen {what}: {count} consecutive readings are identical, {most} allowed", now)

    def pressure(self, now: int, pressure: Float[Array, " C"]) -> None:
        """Set a fault if one of the pressures (C,) [Pa] measured in C chambers is not finite or outside the limits."""
        b = self.bounds
        for p in pressure.tolist():
            if not math.isfinite(p):
                self.trip(f"the {KIND_OF[b.unit]} reading is {p}", now)
            elif not b.lowest_pressure <= p <= b.highest_pressure:
                factor, unit = shown_in(b.unit)
                digits = 3 if b.unit == "rad" else 1
                value, low, high = (f"{factor * v:.{digits}f}" for v in (p, b.lowest_pressure, b.highest_pressure))
                self.trip(f"the {KIND_OF[b.unit]} of {value} {unit} is outside {low} ... {high} {unit}", now)

    def estimate(self, now: int, state: State) -> None:
        """Set a fault if the estimated state is not finite, out of limits, or inconsistent with the readings."""
        angle, rate = state.angle, state.rate
        if not (np.isfinite(angle).all() and np.isfinite(rate).all()):
            self.trip("the estimate is not a number", now)
        elif abs(angle[-1] - self._rest) > self.bounds.largest_angle:
            turn = angle[-1] - self._rest
            self.trip(f"the last link turned by {turn:.2f} rad, {self.bounds.largest_angle:g} rad allowed", now)
        elif np.abs(rate).max() > self.bounds.largest_rate:
            fastest = np.abs(rate).max()
            self.trip(f"a link turns at {fastest:.1f} rad/s, {self.bounds.largest_rate:g} rad/s allowed", now)
        elif not state.consistent:
            self.trip(f"the estimator lost its consistency: {state.fault}", now)

    def controller(self, now: int, fault: str) -> bool:
        """Count the faults that the controller reports, and set a fault after too many in a row. Return True at the
        first of a series.
        """
        begins, self._in_a_row = bool(fault) and not self._in_a_row, self._in_a_row + 1 if fault else 0
        if fault:
            self.controller_faults += 1
            if not self.controller_fault:
                self.controller_fault, self.controller_fault_time = fault, now
        if self._in_a_row > self.bounds.controller_faults:
            self.trip(f"in {self._in_a_row} periods in a row {fault}", now)
        return begins

    def command(self, now: int, command: Float[Array, " C"]) -> Float[Array, " C"]:
        """Return the commands to send to C chambers, (C,) [Pa]. All are 0 after a fault. A command that is not finite
        or out of limits is a fault.
        """
        for p in command.tolist():
            if not math.isfinite(p):
                self.trip(f"the command is {p}", now)
            elif not 0.0 <= p <= self.bounds.highest_pressure:
                factor, unit = shown_in(self.bounds.unit)
                digits = 3 if unit == "rad" else 1
                value, most = (f"{factor * v:.{digits}f}" for v in (p, self.bounds.highest_pressure))
                self.trip(f"the command of {value} {unit} is outside 0 ... {most} {unit}", now)
        if not self.fault:
            return command
        return np.zeros(command.size)


# all signals that end or stop a program and can be caught; the receiver handles SIGKILL, SIGSTOP, crash and power loss
NAMES = (
    "SIGTERM", "SIGHUP", "SIGQUIT", "SIGINT", "SIGBREAK", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM", "SIGPROF",
    "SIGXCPU", "SIGIO", "SIGPWR", "SIGSTKFLT", "SIGTSTP", "SIGTTIN", "SIGTTOU", "SIGPIPE",
)


class Ended(SystemExit):
    """Exception raised when a signal ends the program. The exit code is 128 plus the signal's number."""


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Context manager in which the first signal that would end the program raises `Ended`.

    SIGINT raises KeyboardInterrupt. Later signals are ignored until the end of the block, so that they cannot interrupt
    the reaction to the first one. The program's own signal handlers are kept. Signals reach only the main thread: in
    another thread the context manager does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def end(number: int, _frame: FrameType | None) -> None:
        came.append(number)
        if len(came) == 1:
            raise KeyboardInterrupt if number == signal.SIGINT else Ended(128 + number)

    before = {}
    for name in NAMES:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            before[number] = signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
