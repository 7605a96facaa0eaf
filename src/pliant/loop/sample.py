"""Samples of the loop: a time, a name, an array and a unit; the sources and sinks of samples."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from pliant.errors import InputError
from pliant.plugins import chosen

Array = np.ndarray
SHAPE, PRESSURE, COMMAND = "shape", "pressure", "command"
UNITS = {SHAPE: "m", PRESSURE: "Pa", COMMAND: "Pa"}


class Sender(NamedTuple):
    """Sender of a sample: its address, and its session where packets come under a key."""

    host: str
    port: int
    session: bytes = b""


class Sample(NamedTuple):
    """One reading or one command."""

    time_ns: int  # ns, on the clock of the loop
    name: str  # "shape", "pressure", "command", or a name of your own
    array: Array  # float64
    unit: str  # SI; a loop converts other units that it knows, and rejects the rest
    hold: float = 0.0  # s, of a command: without a newer one within it the receiver vents; 0: the receiver decides
    sender: Sender | None = None  # None: the source has one sender only

    @property
    def time(self) -> float:
        """Time in s."""
        return self.time_ns * 1e-9


class Source(Protocol):
    """A source of samples. It never waits: a loop has other things to do."""

    def read(self) -> Sample | None:
        """The oldest sample that has arrived and was not read yet; None when there is none."""

    @property
    def finished(self) -> bool:
        """Whether nothing will come any more."""

    def close(self) -> None:
        """Give back what is held."""


class Sink(Protocol):
    """A receiver of samples."""

    def write(self, sample: Sample) -> None:
        """Send a sample on."""

    def close(self) -> None:
        """Give back what is held."""


def sample(name: str, value: Any, time_ns: int, unit: str | None = None, hold: float = 0.0) -> Sample:
    """A sample of one of the known names in its SI unit, or of any name with its unit."""
    array = np.atleast_1d(np.asarray(value, dtype=float))
    return Sample(int(time_ns), name, array, unit or UNITS.get(name, "1"), hold)


def nanoseconds(seconds: float) -> int:
    """Seconds as a whole number of nanoseconds."""
    if not math.isfinite(seconds):
        raise InputError(f"a time must be finite, in seconds, got {seconds}")
    return round(seconds * 1e9)


def connection(kind: str, name: str) -> Callable[..., Any]:
    """A source or sink that another package offers: entry points of the groups ``pliant.sources``, ``pliant.sinks``.

    Raises
    ------
    InputError
        When nobody offers that name, or what it leads to cannot be called.
    """
    made = chosen(f"pliant.{kind}s", {}, object, name)
    if not callable(made):
        raise InputError(f"the {kind} {name!r} of an installed package cannot be called: it must make a {kind}")
    return made
