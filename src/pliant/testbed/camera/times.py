"""Edit the frame times in an MP4 file, so that lost frames leave gaps. OpenCV's writer cannot do this."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from pliant.errors import InputError
from pliant.files import whole

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

INSIDE = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts")  # boxes that hold boxes
# where a duration stands in the content of a box (version 0)
DURATION = {b"mvhd": 16, b"tkhd": 20, b"elst": 8, b"mdhd": 16}


def tell_gaps(path: Path, steps: list[int]) -> None:
    """Rewrite the frame times of an evenly spaced MP4 file so that lost frames appear as longer frames.

    `steps` gives the time from each frame to the next, as a multiple of the frame period.

    Parameters
    ----------
    path : Path
        MP4 file as OpenCV writes it: one track, with the index behind the pictures.
    steps : list of int
        One entry fewer than there are frames; if all are 1, the file is unchanged.
    """
    if all(step == 1 for step in steps):
        return
    content = path.read_bytes()
    longer = (sum(steps) + 1) / (len(steps) + 1)
    with whole(path) as draft:
        draft.write_bytes(b"".join(_boxes(content, [*steps, 1], longer)))


def _boxes(content: bytes, steps: list[int], longer: float) -> Iterator[bytes]:
    at = 0
    while at + 8 <= len(content):
        size, kind = struct.unpack_from(">I4s", content, at)
        if not 8 <= size <= len(content) - at:
            raise InputError("the film is not an MP4 file as OpenCV writes it: film it again")
        inner = content[at + 8 : at + size]
        if kind in INSIDE:
            inner = b"".join(_boxes(inner, steps, longer))
        elif kind == b"stts":
            inner = _table(inner, steps)
        elif kind in DURATION:
            inner = _longer(inner, DURATION[kind], longer)
        yield struct.pack(">I4s", len(inner) + 8, kind) + inner
        at += size


def _table(inner: bytes, steps: list[int]) -> bytes:
    count, tick = struct.unpack_from(">II", inner, 8)
    if count != len(steps):
        raise InputError(f"the film has {count} frames, expected {len(steps)}")
    rows = [(1, tick * step) for step in steps]
    return inner[:4] + struct.pack(">I", len(rows)) + b"".join(struct.pack(">II", *row) for row in rows)


def _longer(inner: bytes, at: int, longer: float) -> bytes:
    duration = struct.unpack_from(">I", inner, at)[0]
    return inner[:at] + struct.pack(">I", round(duration * longer)) + inner[at + 4 :]
