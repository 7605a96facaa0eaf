"""Reader of C3D motion-capture files: markers become stations, in metres; invalid points become NaN.

ezc3d reads the file in a separate process; `pliant.recording.c3d` compares what the file states twice.

Checks of a C3D file for damage: facts that it states twice must agree, and its sections must not overlap.

Header and parameters state the same counts, rates and scale. Sections are consecutive blocks of 512 bytes. After the
last frame only the rest of its block follows, and blocks of zeros, which some systems append. A lost or doubled byte
shifts all later bytes, and ezc3d returns the shifted numbers without an error.

Source: the public C3D user guide (c3d.org)
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.errors import InputError, inside
from pliant.recording.apart import read_apart
from pliant.recording.mapping import FileMapping, PressureChannels, shorten
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.schema import make_recording
from pliant.recording.stated import Reading, Stated
from pliant.units import metre_per, pascal_per

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

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
    scale, rate = (one_float(data[offset : offset + 4], processor) for offset in (12, 20))
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


class C3dContent(NamedTuple):
    """Content of a C3D file: coordinates (T, N, 3) of N points over T frames, values of C analog channels, rates [Hz]
    and parameters.

    `doubts` are sentences about contradictions, `remarks` about oddities that may be harmless.
    """

    parameters: dict[str, dict[str, list[Any]]]
    points: NDArray
    analog: NDArray
    rate: float
    analog_rate: float
    doubts: list[str]
    remarks: list[str]
    frames: int  # that the header states


class C3dMapping(FileMapping):
    """Options of the C3D reader: unit of length, whether to read a file that contradicts itself, and channels of
    pressure.

    Attributes
    ----------
    length_unit : str, optional
        Unit of the points; needed where the file does not state POINT:UNITS, and replaces it otherwise.
    trust_header : bool
        Whether to read a file that contradicts itself by its header; the contradictions are listed in the history.
        Default: such a file is refused.
    pressure : dict, optional
        Analog channels that hold gauge pressure: ``{channels = [...], unit = "kPa"}``.
    """

    length_unit: str | None = None
    trust_header: bool = False
    pressure: PressureChannels | None = None


def read_c3d(path: Path, mapping: Mapping[str, Any] | None = None) -> Reading:
    """Read the markers of a C3D file as stations, and pressure from its analog channels where the mapping names them;
    return a recording.
    """
    options = C3dMapping.load(mapping, path.name)
    content = _content(path)
    if content.doubts and not options.trust_header:
        raise InputError(f"{path.name} contradicts itself: {'; '.join(content.doubts)}. It is damaged or was written "
                         "incorrectly: export it again, or set trust_header = true in its mapping")  # fmt: skip
    position = content.points * _scale(content, options, path.name)
    lost = np.isnan(position).any(-1)
    position[lost] = np.nan
    history = [*content.doubts, *content.remarks]
    if lost.any():
        history.append(f"{int(lost.sum())} of {lost.size} points are marked invalid and became NaN")
    history += _unused(content, options)
    names, renamed = _names(content, position.shape[1])
    if renamed:
        history.append(f"{renamed} point(s) had no name or a repeated one and got a number")
    with inside(path.name):
        recording = make_recording(
            np.arange(len(position)) / content.rate, position, station=names, history=history,
            **_analog_pressure(content, options, path.name),
        )  # fmt: skip
    return Reading(recording, (Stated("frames", "its header", content.frames, len(position)),))


def _content(path: Path) -> C3dContent:
    """Return the content of a C3D file as ezc3d reads it, checked against its header and its length."""
    data = path.read_bytes()
    header = read_header(data, path.name)
    if header.last < MOST_FRAMES:
        _check_length(data, header, header.last - header.first + 1, path.name)
    arrays, facts = read_apart("c3d", path, "C3D")
    parameters, points, analog = facts["parameters"], arrays["points"], arrays["analog"]
    frames = frames_of(header, parameters)
    _check_length(data, header, frames, path.name)
    short = bool(header.analog) and len(analog) < frames * header.samples
    if points.shape[1] != header.points or short:
        raise InputError(f"{path.name} is damaged: it holds {len(points)} frames of {points.shape[1]} points, but its "
                         f"header states {frames} of {header.points}; export it again")  # fmt: skip
    doubts, remarks = judge_layout(data, header, frames)
    doubts = [*compare_facts(header, frames, parameters), *doubts, *judge_residuals(data, header, frames)]
    return C3dContent(parameters, points[:frames], analog[: frames * header.samples], header.rate,
                      header.rate * header.samples, doubts, remarks, frames)  # fmt: skip


def _check_length(data: bytes, header: C3dHeader, frames: int, name: str) -> None:
    if frames < 1:
        raise InputError(f"{name} holds {header.points} points in {max(frames, 0)} frames: export it again with frames")
    needed = header.end(frames)
    if needed > len(data):
        raise InputError(f"{name} is truncated: its header states {frames} frames of {header.points} points, {needed} "
                         f"bytes in all, but the file has {len(data)}; copy it again")  # fmt: skip


def _unused(content: C3dContent, options: C3dMapping) -> list[str]:
    used = options.pressure.channels if options.pressure else []
    labels = _labels(content, "ANALOG")[: content.analog.shape[1]]
    labels += [f"channel {i + 1}" for i in range(len(labels), content.analog.shape[1])]
    left = [label for label in labels if label not in used]
    return [f"{len(left)} analog channel(s) were not used: {shorten(left)}"] if left else []


def _scale(content: C3dContent, options: C3dMapping, name: str) -> float:
    stated = next((str(unit) for unit in content.parameters.get("POINT", {}).get("UNITS", []) if unit), None)
    unit = options.length_unit or stated
    if unit is None:
        raise InputError(f"{name} does not state the unit of its points (POINT:UNITS): set length_unit in its mapping")
    return metre_per(unit)


def _labels(content: C3dContent, group: str) -> list[str]:
    """Return the names in LABELS, LABELS2, ... of a group; each parameter holds at most 255 names."""
    values = content.parameters.get(group, {})
    labels = [str(label) for label in values.get("LABELS", [])]
    for part in range(2, 258):
        labels += [str(label) for label in values.get(f"LABELS{part}", [])]
    return labels


def _names(content: C3dContent, count: int) -> tuple[list[str], int]:
    labels = _labels(content, "POINT")[:count]
    labels += [""] * (count - len(labels))
    names: list[str] = []
    renamed = 0
    for i, label in enumerate(labels):
        name = label or f"point {i + 1}"
        if not label or name in names:
            renamed += 1
        while name in names:
            name += f" #{i + 1}"
        names.append(name)
    return names, renamed


def _analog_pressure(content: C3dContent, options: C3dMapping, name: str) -> dict[str, Any]:
    if options.pressure is None:
        return {}
    labels = _labels(content, "ANALOG")[: content.analog.shape[1]]
    unknown = [c for c in options.pressure.channels if c not in labels]
    if unknown:
        available = ", ".join(labels) or "none"
        raise InputError(f"{name} has no analog channel {', '.join(unknown)}: correct pressure.channels in its "
                         f"mapping; available: {available}")
    channels = [labels.index(c) for c in options.pressure.channels]
    values = content.analog[:, channels] * pascal_per(options.pressure.unit)
    clock = np.arange(len(values)) / content.analog_rate
    chamber = options.pressure.chamber or options.pressure.channels
    return {"pressure": values, "pressure_time": clock, "chamber": chamber if len(channels) > 1 else None}


READER = Reader("c3d", ENDINGS["c3d"], read_c3d)
