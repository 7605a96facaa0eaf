"""A sample as bytes: 4 bytes "PLN1", time [ns], lengths, name, unit, dimensions, float64 values, little endian."""

from __future__ import annotations

import math
import struct

import numpy as np

from pliant.errors import InputError
from pliant.loop.sample import Sample

HEAD = struct.Struct("<4sqBBB")
MAGIC = b"PLN1"
LARGEST = 65_507  # bytes, of a UDP datagram


def pack(sample: Sample) -> bytes:
    """The bytes of a sample; InputError when they do not fit one datagram."""
    name, unit = sample.name.encode(), sample.unit.encode()
    array = np.ascontiguousarray(sample.array, dtype="<f8")
    if max(len(name), len(unit), array.ndim) > 255:
        raise InputError("a sample's name and unit have at most 255 bytes")
    data = HEAD.pack(MAGIC, sample.time_ns, len(name), len(unit), array.ndim) + name + unit
    data += struct.pack(f"<{array.ndim}I", *array.shape) + array.tobytes()
    if len(data) > LARGEST:
        raise InputError(f"a sample of {array.size} numbers exceeds a datagram of {LARGEST} bytes: send fewer points")
    return data


def unpack(data: bytes) -> Sample:
    """The sample of these bytes; InputError when they are not one, whatever they are."""
    try:
        magic, time_ns, a, b, ndim = HEAD.unpack_from(data)
        at = HEAD.size
        name, unit = data[at : at + a].decode(), data[at + a : at + a + b].decode()
        at += a + b
        shape = struct.unpack_from(f"<{ndim}I", data, at)
        at += 4 * ndim
    except (struct.error, UnicodeDecodeError) as error:
        raise InputError(f"{len(data)} bytes are no sample: {error}") from None
    if magic != MAGIC or len(data) - at != 8 * math.prod(shape):
        raise InputError(f"{len(data)} bytes are no sample: wrong mark or length")
    return Sample(time_ns, name, np.frombuffer(data, "<f8", offset=at).reshape(shape).astype(float), unit)
