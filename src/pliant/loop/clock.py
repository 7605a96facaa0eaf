"""Clocks, and what is counted of a loop's punctuality."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

SPIN = 500_000  # ns before a deadline from which on the clock is watched instead of slept on


class Clock(Protocol):
    """A time that passes, in ns."""

    def now(self) -> int:
        """Time since the clock began, ns."""

    def sleep_until(self, deadline: int) -> None:
        """Come back at `deadline` [ns], or at once when it has passed."""


class SystemClock:
    """The machine's monotonic clock.

    Parameters
    ----------
    shared : bool
        Counted as the system counts it, so that all processes of one machine agree; otherwise from when it was made.
    """

    def __init__(self, *, shared: bool = False) -> None:
        self._start = 0 if shared else time.monotonic_ns()

    def now(self) -> int:
        """Time since the clock began, ns."""
        return time.monotonic_ns() - self._start

    def sleep_until(self, deadline: int) -> None:
        """Sleep to within half a millisecond, then watch the clock: a sleep alone wakes up late."""
        left = deadline - self.now()
        if left > SPIN:
            time.sleep((left - SPIN) * 1e-9)
        while self.now() < deadline:
            pass


class VirtualClock:
    """A clock that stands still but when slept on: simulations as fast as they go, the same each time."""

    def __init__(self) -> None:
        self._now = 0

    def now(self) -> int:
        """Time since the clock was made, ns."""
        return self._now

    def sleep_until(self, deadline: int) -> None:
        """Be at the deadline."""
        self._now = max(self._now, deadline)


@dataclass
class Timing:
    """Counters of a loop of fixed period; all times in ns.

    Attributes
    ----------
    periods : int
    overruns : int
        Periods whose work went beyond the next deadline.
    skipped : int
        Deadlines that passed meanwhile and were left out.
    latest : int
        Worst lateness of a period's beginning.
    longest : int
        Longest work of a period.
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
        """A period due at `deadline` begins."""
        late = max(now - deadline, 0)
        self.periods += 1
        self.latest = max(self.latest, late)
        self._late += late
        self._square += float(late) ** 2

    def end(self, began: int, deadline: int, now: int) -> int:
        """A period's work is done; returns the next deadline that still lies ahead."""
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
        """Standard deviation of the lateness, ns."""
        n = max(self.periods, 1)
        return float(np.sqrt(max(self._square / n - (self._late / n) ** 2, 0.0)))

    def summary(self) -> dict[str, float]:
        """The counters with their units in the names."""
        return {
            "periods": self.periods, "overruns": self.overruns, "skipped": self.skipped,
            "period_ms": self.period * 1e-6, "worst_lateness_us": self.latest * 1e-3, "jitter_us": self.jitter * 1e-3,
            "longest_work_us": self.longest * 1e-3, "mean_work_us": self._work / max(self.periods, 1) * 1e-3,
        }
