"""Samples of the control loop (time, name, array, unit), and the interfaces of their sources and sinks."""

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
    """Sender of a sample: network address, and the session if packets are authenticated by a key."""

    host: str
    port: int
    session: bytes = b""


class Sample(NamedTuple):
    """One sensor reading or one command."""

    time_ns: int  # ns, on the clock of the loop
    name: str  # "shape", "pressure", "command", or a name of your own
    array: Array  # float64
    unit: str  # SI; a loop converts other known units and rejects unknown ones
    hold: float = 0.0  # s, time after which the receiver vents without a newer command; 0: the receiver's default
    sender: Sender | None = None  # None: the source has one sender only

    @property
    def time(self) -> float:
        """Time of the sample, s."""
        return self.time_ns * 1e-9


class Source(Protocol):
    """Interface of a source of samples whose methods never wait."""

    def read(self) -> Sample | None:
        """Return the oldest sample that has arrived and was not read yet, or None."""

    @property
    def finished(self) -> bool:
        """Whether no more samples will arrive."""

    def close(self) -> None:
        """Release the resources."""


class Sink(Protocol):
    """Interface of a receiver of samples."""

    def write(self, sample: Sample) -> None:
        """Send a sample."""

    def close(self) -> None:
        """Release the resources."""


def sample(name: str, value: Any, time_ns: int, unit: str | None = None, hold: float = 0.0) -> Sample:
    """Return a sample with the value as an array; the unit defaults to the SI unit of a known name."""
    array = np.atleast_1d(np.asarray(value, dtype=float))
    return Sample(int(time_ns), name, array, unit or UNITS.get(name, "1"), hold)


def nanoseconds(seconds: float) -> int:
    """Return a time in seconds as a whole number of nanoseconds."""
    if not math.isfinite(seconds):
        raise InputError(f"a time must be finite, in seconds, got {seconds}")
    return round(seconds * 1e9)


def connection(kind: str, name: str) -> Callable[..., Any]:
    """Return the constructor of a source, sink or plant that an installed package provides.

    The constructors are entry points of the groups ``pliant.sources``, ``pliant.sinks`` and ``pliant.plants``; `kind`
    is the group's name in the singular, e.g. "source".

    Raises
    ------
    InputError
        When no installed package provides that name, or the entry point cannot be called.
    """
    constructor = chosen(f"pliant.{kind}s", {}, object, name)
    if not callable(constructor):
        raise InputError(
            f"the {kind} {name!r} of an installed package is not callable: its entry point must construct a {kind}"
        )
    return constructor
