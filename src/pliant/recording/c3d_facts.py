"""Checks of a C3D file for damage: facts that it states twice must agree, and its sections must not overlap.

Header and parameters state the same counts, rates and scale. Sections are consecutive blocks of 512 bytes. After the
last frame only the rest of its block follows, and blocks of zeros, which some systems append. A lost or doubled byte
shifts all later bytes, and ezc3d returns the shifted numbers without an error.

Source: the public C3D user guide (c3d.org)
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError

BLOCK = 512
SAME = 1e-4  # relative: rates and scales are single precision, some are written as rounded decimals
INTEL, DEC, MIPS = 84, 85, 86  # processors: how the bytes of a number lie
MOST_FRAMES = 65535  # what two bytes can count; longer files say more in their parameters
LARGEST_RESIDUAL = 1e4  # of a reconstructed point, in the unit of the file


class C3dHeader(NamedTuple):
    """Numbers in the header of a C3D file: points and analog values per frame, range of frames, frame rate [Hz],
    position of the data.
    """

    points: int
    analog: int
    first: int
    last: int
    block: int
    samples: int
    scale: float
    rate: float
    processor: int
    parameters_end: int  # the first block behind the parameters, counted from 1

    @property
    def word(self) -> int:
        """Return the number of bytes per number in the data of a C3D file: 4 for floats (marked by a negative scale),
        else 2.
        """
        return 4 if np.signbit(self.scale) else 2

    def end(self, frames: int) -> int:
        """Return the number of bytes from the start of a C3D file to the end of its last frame."""
        return (self.block - 1) * BLOCK + frames * (4 * self.points + self.analog) * self.word


def read_header(data: bytes, name: str) -> C3dHeader:
    """Return the numbers in the header of a C3D file from its bytes `data`; raise InputError where the header is
    damaged.
    """
    if len(data) < 2 * BLOCK or data[1] != 0x50:
        raise InputError(f"{name} is not a C3D file, or it is truncated inside its header: it has {len(data)} bytes; "
                         "export it again")
    start = (data[0] - 1) * BLOCK
    if start < BLOCK or start + 4 > len(data) or data[start + 3] not in (INTEL, DEC, MIPS):
        raise InputError(f"{name} has no readable parameter section: the file is damaged, so export it again")
    processor = data[start + 3]
    if processor == MIPS:
        raise InputError(f"{name} is in the number format of MIPS processors, which ezc3d does not read: export it "
                         "again in Intel (PC) format")  # fmt: skip
    points, analog, first, last, _, _, _, block, samples = struct.unpack("<9H", data[2:20])
    scale, rate = (one_float(data[at : at + 4], processor) for at in (12, 20))
    samples = samples if analog else 1
    if points < 1 or block < 2:
        raise InputError(f"the header of {name} states {points} points from block {block} on: the file holds no points "
                         "or is damaged, so export it again")
    if samples < 1 or analog % samples:
        raise InputError(f"{name} states {analog} analog values in {samples} samples per frame: the file is damaged, "
                         "so export it again")
    if not 0 < rate < np.inf:
        raise InputError(f"{name} states a frame rate of {rate:g} Hz: the file is damaged, so export it again")
    return C3dHeader(points, analog, first, last, block, samples, scale, rate, processor, data[0] + data[start + 2])


def one_float(content: bytes, processor: int) -> float:
    """Decode four bytes as a floating-point number in the format of the processor that wrote a C3D file (Intel or DEC).

    DEC swaps the two halves and has an exponent that is higher by two.
    """
    if processor == DEC:
        return float(struct.unpack("<f", content[2:] + content[:2])[0]) / 4
    return float(struct.unpack("<f", content)[0])


def frames_of(header: C3dHeader, parameters: dict[str, dict[str, list[Any]]]) -> int:
    """Return the number of frames of a C3D file, from its header or, where the number exceeds the header's 16 bits,
    from its parameters.
    """
    frames = header.last - header.first + 1
    if header.last < MOST_FRAMES:
        return frames
    trial = parameters.get("TRIAL", {})
    begin, end = (_word(trial.get(f"ACTUAL_{which}_FIELD", [])) for which in ("START", "END"))
    if begin is not None and end is not None:
        return end - begin + 1
    stated = _stated(parameters).get("POINT:LONG_FRAMES", np.nan)
    return max(frames, int(stated)) if np.isfinite(stated) else frames


def compare_facts(header: C3dHeader, frames: int, parameters: dict[str, dict[str, list[Any]]]) -> list[str]:
    """Return one sentence for each number, such as the frame rate, that differs between the header and the parameters
    of a C3D file.

    `frames` is the number of frames that is read.
    """
    stated = _stated(parameters)
    samples = header.samples if header.analog else 1
    facts: list[tuple[str, float]] = [
        ("POINT:USED", header.points), ("POINT:DATA_START", header.block), ("POINT:RATE", header.rate),
        ("POINT:SCALE", header.scale), ("POINT:FRAMES", frames), ("POINT:LONG_FRAMES", frames),
        ("ANALOG:USED", header.analog / max(samples, 1)),
    ]  # fmt: skip
    if header.analog:
        facts.append(("ANALOG:RATE", header.rate * samples))
    said = []
    for name, value in facts:
        other = stated.get(name)
        if other is None or (name == "POINT:FRAMES" and other % 65536 in (frames % 65536, 65535)):
            continue  # two bytes hold no more; longer recordings write -1 there
        if not abs(other - value) <= SAME * abs(value):
            said.append(f"{name} is {other:g}, but the header has {value:g}")
    fields = [_word(parameters.get("TRIAL", {}).get(f"ACTUAL_{end}_FIELD", [])) for end in ("START", "END")]
    if None not in fields and fields[1] - fields[0] + 1 != frames:  # type: ignore[operator]
        said.append(f"TRIAL has frames {fields[0]} to {fields[1]}, but the header has {frames} frames")
    return said


def _stated(parameters: dict[str, dict[str, list[Any]]]) -> dict[str, float]:
    """Return the single numbers of the groups POINT and ANALOG by ``GROUP:NAME``."""
    return {
        f"{group}:{name}": float(value[0])
        for group in ("POINT", "ANALOG")
        for name, value in parameters.get(group, {}).items()
        if len(value) == 1 and not isinstance(value[0], str)
    }


def _word(pair: list[Any]) -> int | None:
    """Return the number that two 16-bit words form, the low word first."""
    if len(pair) != 2 or any(isinstance(v, str) or not np.isfinite(v) for v in pair):
        return None
    return int(pair[0] % 65536) + 65536 * int(pair[1] % 65536)


def judge_layout(data: bytes, header: C3dHeader, frames: int) -> tuple[list[str], list[str]]:
    """Return two lists of sentences on a C3D file: sections that overlap or end in the wrong place, and oddities that
    may be harmless.
    """
    said, remarks = [], []
    block, end, needed = header.block, header.parameters_end, header.end(frames)
    if block < end:
        said.append(f"the data begin in block {block}, but the parameters end before block {end}")
    elif data[(end - 1) * BLOCK : (block - 1) * BLOCK].strip(b"\0"):
        said.append(f"{block - end} block(s) between the parameters and the data are not empty")
    filled = needed + -needed % BLOCK  # the end of the block of the last frame
    if len(data) > needed and len(data) % BLOCK:
        rest = len(data) - needed
        said.append(f"{rest} bytes follow the last frame, and they do not fill a block: bytes were lost or doubled")
    elif data[filled:].strip(b"\0"):
        said.append(f"{len(data) - needed} bytes follow the last frame that the header states")
    elif data[needed:filled].strip(b"\0"):
        remarks.append("the block of the last frame is not filled up with zeros: bytes may be shifted")
    return said, remarks


def judge_residuals(data: bytes, header: C3dHeader, frames: int) -> list[str]:
    """Return a list with one sentence where points of a C3D file have an impossible residual (the fourth number of each
    point); else an empty list.

    The fourth number of a point is a whole number of two bytes (a residual and a mask of cameras), or, as some systems
    write it, the residual itself. The majority of a file's points decides which, and the others must agree.
    """
    if header.word != 4 or header.processor != INTEL:
        return []
    values = np.frombuffer(data[(header.block - 1) * BLOCK : header.end(frames)], "<f4").reshape(frames, -1)
    with np.errstate(invalid="ignore"):
        points = values[:, : 4 * header.points].reshape(frames, -1, 4).astype(np.float64)
        words, empty = points[..., 3], np.isnan(points).all(axis=2)
        invalid = (words < 0) | np.isnan(words)
        whole = (words >= -32768.0) & (words < 65536.0) & (words == np.floor(words))
        real = (words == 0) | ((words > 1e-9) & (words < LARGEST_RESIDUAL)) | (words == -1)
    counted = ~invalid & (words != 0)
    good = whole if (whole & counted).sum() * 2 >= counted.sum() else real
    wrong = int((~good & ~empty).sum())
    return [f"{wrong} of {words.size} points have no whole residual: bytes may be shifted"] if wrong else []
