"""Samples of the control loop (time, name, array, unit), and the interfaces of their sources and sinks.

Convert samples to packets of bytes and back (little endian).

A packet holds in this order: the mark "PLN2" (4 bytes), the time (int64, ns), the hold time (uint32, us), the length of
the name, the length of the unit and the number of dimensions (1 byte each), name, unit (UTF-8), the dimensions (uint32
each) and the values (float64). A receiver must vent if no newer command arrives within the hold time.
"""

from __future__ import annotations

import math
import struct
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


HEAD = struct.Struct("<4sqIBBB")
MAGIC = b"PLN2"
LARGEST = 65_507  # bytes, of a UDP datagram
MOST_DIMENSIONS = 8
LONGEST_HOLD = 2**32 - 1  # us


def pack(sample: Sample) -> bytes:
    """Return a sample as a packet of bytes; raise InputError when it does not fit in one datagram."""
    name, unit = sample.name.encode(), sample.unit.encode()
    array = np.ascontiguousarray(sample.array, dtype="<f8")
    if max(len(name), len(unit)) > 255:
        raise InputError("a sample's name and unit may have at most 255 bytes each: shorten them")
    if array.ndim > MOST_DIMENSIONS:
        raise InputError(f"a sample may have at most {MOST_DIMENSIONS} dimensions, got {array.ndim}")
    if not 0 <= sample.hold * 1e6 <= LONGEST_HOLD:
        raise InputError(f"the hold time of a sample must be 0 to {LONGEST_HOLD * 1e-6:g} s, got {sample.hold}")
    hold = math.ceil(sample.hold * 1e6 - 1e-3)  # never 0 where a time was given
    data = HEAD.pack(MAGIC, sample.time_ns, hold, len(name), len(unit), array.ndim) + name + unit
    data += struct.pack(f"<{array.ndim}I", *array.shape) + array.tobytes()
    if len(data) > LARGEST:
        raise InputError(f"a sample of {array.size} numbers exceeds a datagram of {LARGEST} bytes: send fewer points")
    return data


def unpack(data: bytes, sender: Sender | None = None) -> Sample:
    """Return the sample in a packet of bytes; raise InputError when the bytes are not a sample."""
    try:
        magic, time_ns, hold, a, b, ndim = HEAD.unpack_from(data)
        offset = HEAD.size
        name, unit = data[offset : offset + a].decode(), data[offset + a : offset + a + b].decode()
        offset += a + b
        shape = struct.unpack_from(f"<{ndim}I", data, offset)
        offset += 4 * ndim
    except (struct.error, UnicodeDecodeError) as error:
        raise InputError(f"a packet of {len(data)} bytes is not a sample: {error}; make packets by "
                         "pliant.loop.sample.pack") from None
    if magic != MAGIC or ndim > MOST_DIMENSIONS or len(data) - offset != 8 * math.prod(shape):
        raise InputError(f"a packet of {len(data)} bytes is not a sample: its first bytes, dimensions or length are "
                         "wrong; make packets by pliant.loop.sample.pack")
    values = np.frombuffer(data, "<f8", offset=offset).reshape(shape).astype(float)
    return Sample(time_ns, name, values, unit, 1e-6 * hold, sender)
