"""Clocks of a control loop, and statistics of its timing."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

SPIN = 500_000  # ns before a deadline, from which the clock is polled instead of sleeping


class Clock(Protocol):
    """Interface of a clock that counts in nanoseconds."""

    def now(self) -> int:
        """Return the time since the clock's start [ns]."""

    def sleep_until(self, deadline: int) -> None:
        """Wait until the time `deadline` [ns]; return at once if it has passed."""


class SystemClock:
    """The machine's monotonic clock.

    Parameters
    ----------
    shared : bool
        If True, use the system's monotonic time, which all processes of a machine share. Otherwise time starts at 0
        when the clock is constructed.
    """

    def __init__(self, *, shared: bool = False) -> None:
        self._start = 0 if shared else time.monotonic_ns()

    def now(self) -> int:
        """Return the time since the clock's start [ns]."""
        return time.monotonic_ns() - self._start

    def sleep_until(self, deadline: int) -> None:
        """Wait until `deadline` [ns]: sleep, then poll the clock for the last 0.5 ms, because a sleep ends late."""
        left = deadline - self.now()
        if left > SPIN:
            time.sleep((left - SPIN) * 1e-9)
        while self.now() < deadline:
            pass


class VirtualClock:
    """A clock that advances only when a caller sleeps, for reproducible simulations without waiting."""

    def __init__(self) -> None:
        self._now = 0

    def now(self) -> int:
        """Return the virtual time since the clock's construction [ns]."""
        return self._now

    def sleep_until(self, deadline: int) -> None:
        """Advance the virtual time to `deadline` [ns] at once."""
        self._now = max(self._now, deadline)


@dataclass
class Timing:
    """Timing statistics of a loop with a fixed period; all times in ns.

    Attributes
    ----------
    periods : int
        Number of periods run.
    overruns : int
        Number of periods whose work lasted beyond the next deadline.
    skipped : int
        Number of deadlines that were skipped because of overruns.
    latest : int
        Largest delay of the start of a period after its deadline.
    longest : int
        Longest computing time of a period.
    """

    period: int
    periods: int = 0
    overruns: int = 0
    skipped: int = 0
    latest: int = 0
    longest: int = 0
    _late: float = 0.0
    _square: float = 0.0
    _work: float = 0.0

    def begin(self, deadline: int, now: int) -> None:
        """Record that the period due at `deadline` [ns] starts at `now` [ns]."""
        late = max(now - deadline, 0)
        self.periods += 1
        self.latest = max(self.latest, late)
        self._late += late
        self._square += float(late) ** 2

    def end(self, began: int, deadline: int, now: int) -> int:
        """Record that the work of a period, begun at `began`, ended at `now`, and return the next deadline (all in ns).

        Deadlines that have passed are skipped.
        """
        self.longest = max(self.longest, now - began)
        self._work += now - began
        ahead = deadline + self.period
        if now > ahead:
            self.overruns += 1
            missed = (now - ahead) // self.period + 1
            self.skipped += missed
            ahead += missed * self.period
        return ahead

    @property
    def jitter(self) -> float:
        """Standard deviation [ns] of the delays with which the periods started."""
        n = max(self.periods, 1)
        return float(np.sqrt(max(self._square / n - (self._late / n) ** 2, 0.0)))

    def summary(self) -> dict[str, float]:
        """Return the statistics as a dict whose keys name the units."""
        return {
            "periods": self.periods, "overruns": self.overruns, "skipped": self.skipped,
            "period_ms": self.period * 1e-6, "worst_lateness_us": self.latest * 1e-3, "jitter_us": self.jitter * 1e-3,
            "longest_work_us": self.longest * 1e-3, "mean_work_us": self._work / max(self.periods, 1) * 1e-3,
        }
