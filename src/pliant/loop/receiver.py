"""The other end of the wire: commands that arrive drive a valve, and silence vents it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pliant.errors import InputError
from pliant.loop.clock import Clock
from pliant.loop.endings import ended_by_signals
from pliant.loop.sample import COMMAND, Sample, Source, nanoseconds
from pliant.units import PASCAL

Array = np.ndarray
MOST = 256  # samples read at once: a flood cannot hold up the receiver


class ValveReceiver:
    """Drives a valve by commands that arrive, and vents it when none comes within the time that the last one holds.

    It runs where the valve is: nothing that happens to the loop's program, its machine or the network (a kill, a crash,
    a lost supply, a pulled cable) leaves the valve at pressure for longer than a command's `Sample.hold`. What happens
    to this program itself is the hardware's part: the valve that it drives must close without current.

    Parameters
    ----------
    source : Source
        Of samples named "command", e.g. `UdpSource`.
    drive : callable
        ``drive(pressure)`` sets the valve, Pa; an array for several chambers.
    highest : float
        Pa; a command beyond is not a command.
    clock : Clock
    hold : float
        s that a command is in force that does not say it itself.

    Attributes
    ----------
    command : float or array
        Pa, in force.
    rejected, late : int
        Commands that were none (unit, number, limit), and those not newer than one before.
    vented : int
        How often silence vented the valve.
    """

    def __init__(
        self, source: Source, drive: Callable[[float | Array], None], highest: float, clock: Clock, *, hold: float = 0.1
    ) -> None:
        if not (highest > 0 and math.isfinite(highest) and hold > 0 and math.isfinite(hold)):
            raise InputError(f"a receiver needs a positive highest pressure and hold, got {highest} Pa and {hold} s")
        self._source, self._drive, self._highest, self._clock = source, drive, highest, clock
        self._hold, self._until = hold, clock.now()
        self._newest: int | None = None
        self.command: float | Array = 0.0
        self.rejected = self.late = self.vented = 0

    def poll(self) -> float | Array:
        """Take what has arrived and set the valve; call it every millisecond or so. Returns the command in force."""
        for _ in range(MOST):
            arrived = self._source.read()
            if arrived is None:
                break
            if arrived.name == COMMAND:
                self._take(arrived)
        if self._clock.now() >= self._until:
            self.vented += bool(np.any(self.command))
            self.command, self._newest = 0.0 * self.command, None  # whoever comes back may have another clock
        self._drive(self.command)
        return self.command

    def _take(self, arrived: Sample) -> None:
        pressure = arrived.array.ravel() * PASCAL.get(arrived.unit.lower(), math.nan)
        if not (pressure.size and (pressure >= 0.0).all() and (pressure <= self._highest).all()):  # NaN is neither
            self.rejected += 1
        elif self._newest is not None and arrived.time_ns <= self._newest:
            self.late += 1
        else:
            self._newest = arrived.time_ns
            self.command = float(pressure[0]) if pressure.size == 1 else pressure
            self._until = self._clock.now() + nanoseconds(arrived.hold or self._hold)

    def run(self, duration: float | None = None, *, period: float = 1e-3) -> None:
        """Poll for `duration` [s], or until the source ends; whatever ends it, the valve is vented."""
        deadline = self._clock.now()
        stop = None if duration is None else deadline + nanoseconds(duration)
        with ended_by_signals():
            try:
                while (stop is None or deadline < stop) and not self._source.finished:
                    self._clock.sleep_until(deadline)
                    self.poll()
                    deadline = max(deadline + nanoseconds(period), self._clock.now())
            finally:
                self.command = 0.0 * self.command
                self._drive(self.command)
