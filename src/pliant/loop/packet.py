"""A sample as bytes: 4 bytes "PLN2", time [ns], hold [us], lengths, name, unit, dimensions, float64, little endian.

`hold` is the dead-man's time: a receiver of a command to which no newer one comes within it must vent. Packets "PLN1",
which have none, are read.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from pliant.errors import InputError
from pliant.loop.sample import Sample, Sender

HEAD = struct.Struct("<4sqIBBB")
OLD_HEAD = struct.Struct("<4sqBBB")
MAGIC, OLD_MAGIC = b"PLN2", b"PLN1"
LARGEST = 65_507  # bytes, of a UDP datagram
MOST_DIMENSIONS = 8
LONGEST_HOLD = 2**32 - 1  # us


def pack(sample: Sample) -> bytes:
    """The bytes of a sample; InputError when they do not fit one datagram."""
    name, unit = sample.name.encode(), sample.unit.encode()
    array = np.ascontiguousarray(sample.array, dtype="<f8")
    if max(len(name), len(unit)) > 255:
        raise InputError("a sample's name and unit have at most 255 bytes")
    if array.ndim > MOST_DIMENSIONS:
        raise InputError(f"a sample has at most {MOST_DIMENSIONS} dimensions, got {array.ndim}")
    if not 0 <= sample.hold * 1e6 <= LONGEST_HOLD:
        raise InputError(f"a sample holds for 0 to {LONGEST_HOLD * 1e-6:g} s, got {sample.hold}")
    hold = math.ceil(sample.hold * 1e6 - 1e-3)  # never 0 where a time was given
    data = HEAD.pack(MAGIC, sample.time_ns, hold, len(name), len(unit), array.ndim) + name + unit
    data += struct.pack(f"<{array.ndim}I", *array.shape) + array.tobytes()
    if len(data) > LARGEST:
        raise InputError(f"a sample of {array.size} numbers exceeds a datagram of {LARGEST} bytes: send fewer points")
    return data


def unpack(data: bytes, sender: Sender | None = None) -> Sample:
    """The sample of these bytes and of that sender; InputError when they are not one, whatever they are."""
    try:
        head = OLD_HEAD if data[:4] == OLD_MAGIC else HEAD
        magic, time_ns, *hold, a, b, ndim = head.unpack_from(data)
        at = head.size
        name, unit = data[at : at + a].decode(), data[at + a : at + a + b].decode()
        at += a + b
        shape = struct.unpack_from(f"<{ndim}I", data, at)
        at += 4 * ndim
    except (struct.error, UnicodeDecodeError) as error:
        raise InputError(f"{len(data)} bytes are no sample: {error}") from None
    if magic not in (MAGIC, OLD_MAGIC) or ndim > MOST_DIMENSIONS or len(data) - at != 8 * math.prod(shape):
        raise InputError(f"{len(data)} bytes are no sample: wrong mark, dimensions or length")
    values = np.frombuffer(data, "<f8", offset=at).reshape(shape).astype(float)
    return Sample(time_ns, name, values, unit, 1e-6 * sum(hold), sender)
