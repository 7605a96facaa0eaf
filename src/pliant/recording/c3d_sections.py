"""The three sections of a C3D file: header, parameters, data. Every count is checked against the bytes there.

Format: the public C3D user guide (c3d.org). Decoded here and not by a compiled library, because those end the
process on damaged parameters and return fewer frames in silence when a file is cut.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.c3d_facts import Header, compare_facts, judge_layout, judge_residuals

if TYPE_CHECKING:
    from numpy.typing import NDArray

BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86
SIGN_BYTE = {INTEL: 3, DEC: 1, MIPS: 0}
ITEM_SIZE = {-1: 1, 1: 1, 2: 2, 4: 4}
MOST_FRAMES = 65535  # what two bytes can count; longer files say more in their parameters


@dataclass(frozen=True)
class C3dContent:
    """Points and analog channels of a file.

    Attributes
    ----------
    parameters : dict
        ``parameters[group][name]`` is a list of text or numbers; names in upper case.
    points : (T, N, 3) array, unit of the file
    valid : (T, N) bool array
    analog : (T * samples, C) array
    rate, analog_rate : float, Hz
    doubts : tuple of str
        Facts that the file states twice and differently, one sentence each; see `pliant.recording.c3d_facts`.
    """

    parameters: dict[str, dict[str, list[Any]]]
    points: NDArray
    valid: NDArray
    analog: NDArray
    rate: float
    analog_rate: float
    doubts: tuple[str, ...] = ()


@dataclass
class _Walk:
    """What the walk through the parameter section has found so far."""

    names: dict[int, str] = field(default_factory=dict)
    entries: list[tuple[int, str, list[Any]]] = field(default_factory=list)


def decode_c3d(data: bytes, name: str) -> C3dContent:
    """Decode a C3D file from its bytes; InputError when a section does not end inside the file."""
    if len(data) < 2 * BLOCK or data[1] != 0x50:
        raise InputError(f"{name} is no C3D file, or it is cut inside its header: {len(data)} bytes came")
    start = (data[0] - 1) * BLOCK
    if start < BLOCK or start + 4 > len(data) or data[start + 3] not in SIGN_BYTE:
        raise InputError(f"{name} has no readable parameter section: the file is damaged")
    processor = data[start + 3]
    section = data[start : start + data[start + 2] * BLOCK]
    parameters = _parameters(section, processor, name)
    order = ">" if processor == MIPS else "<"
    count, analog_count, first, last = struct.unpack(order + "HHHH", data[2:10])
    block, samples = struct.unpack(order + "HH", data[16:20])
    scale, rate = _floats(data[12:16] + data[20:24], processor).tolist()
    is_float = bool(data[12 + SIGN_BYTE[processor]] & 0x80)
    frames = _frames(parameters, first, last)
    width = 4 * count + analog_count
    needed = max(block - 1, 0) * BLOCK + frames * width * (4 if is_float else 2)
    if frames < 1 or block < 2 or count < 1:
        raise InputError(f"{name} holds {count} points in {max(frames, 0)} frames: nothing to read")
    if needed > len(data):
        raise InputError(
            f"{name} is cut: it announces {frames} frames of {count} points, {needed} bytes in all, but the "
            f"file has {len(data)}; copy it again"
        )
    raw = _raw(data[(block - 1) * BLOCK : needed], processor, is_float=is_float).reshape(frames, width)
    points = raw[:, : 4 * count].reshape(frames, count, 4)
    samples = samples if analog_count else 1
    if analog_count and (samples < 1 or analog_count % samples):
        raise InputError(f"{name} announces {analog_count} analog values in {samples} samples a frame")
    analog = raw[:, 4 * count :].reshape(frames * samples, -1)
    header = Header(count, analog_count, first, last, block, samples, scale, rate)
    doubts = [*compare_facts(header, frames, parameters), *judge_layout(data, data[0] + data[start + 2], block, needed)]
    if is_float:
        doubts += judge_residuals(points[..., 3])
    return C3dContent(
        parameters, points[..., :3] * (1.0 if is_float else abs(scale)), points[..., 3] >= 0,
        _analog_values(analog, parameters, is_float=is_float), rate, rate * samples, tuple(doubts),
    )  # fmt: skip


def _parameters(section: bytes, processor: int, name: str) -> dict[str, dict[str, list[Any]]]:
    """Walk the entries: length of name, group, name, step to the next entry, then a parameter's value."""
    order = ">" if processor == MIPS else "<"
    damaged = InputError(f"{name} is cut or damaged inside its parameter section")
    walk, at = _Walk(), 4
    while at + 2 <= len(section) and section[at] != 0:
        length, group = struct.unpack("bb", section[at : at + 2])
        here = at + 2 + abs(length)
        if here + 2 > len(section) or group == 0:
            raise damaged
        text = section[at + 2 : here].decode("latin-1").upper()
        step = struct.unpack(order + "H", section[here : here + 2])[0]
        if here + step > len(section):
            raise damaged
        if group < 0:
            walk.names[-group] = text
        else:
            value = _value(section[here + 2 : here + step if step else len(section)], processor)
            if value is None:
                raise damaged
            walk.entries.append((group, text, value))
        if step == 0:
            break
        at = here + step
    found: dict[str, dict[str, list[Any]]] = {group: {} for group in walk.names.values()}
    for group, text, value in walk.entries:
        found.setdefault(walk.names.get(group, ""), {})[text] = value
    return found


def _value(entry: bytes, processor: int) -> list[Any] | None:
    """List of a parameter: one text per row of characters, or the numbers in storage order; None if cut."""
    if len(entry) < 2 or len(entry) < 2 + entry[1]:
        return None
    kind = struct.unpack("b", entry[:1])[0]
    dimensions = list(entry[2 : 2 + entry[1]])
    size = ITEM_SIZE.get(kind)
    count = int(np.prod(dimensions, dtype=np.int64)) if dimensions else 1
    at = 2 + len(dimensions)
    if size is None or at + size * count > len(entry):
        return None
    content = entry[at : at + size * count]
    if kind == -1:
        width = dimensions[0] if dimensions else 1
        rows = [content[i : i + width] for i in range(0, count, width)] if width else []
        return [row.decode("latin-1").strip("\0 ") for row in rows]
    if kind == 4:
        return _floats(content, processor).tolist()
    order = ">" if processor == MIPS else "<"
    return np.frombuffer(content, "i1" if kind == 1 else f"{order}i2").tolist()


def _floats(content: bytes, processor: int) -> NDArray[np.float64]:
    if processor == MIPS:
        return np.frombuffer(content, ">f4").astype(np.float64)
    if processor == INTEL:
        return np.frombuffer(content, "<f4").astype(np.float64)
    words = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]  # DEC: halves swapped, exponent two higher
    return np.ascontiguousarray(words).view("<f4").ravel().astype(np.float64) / 4


def _raw(content: bytes, processor: int, *, is_float: bool) -> NDArray[np.float64]:
    if is_float:
        return _floats(content, processor)
    return np.frombuffer(content, ">i2" if processor == MIPS else "<i2").astype(np.float64)


def _frames(parameters: dict[str, dict[str, list[Any]]], first: int, last: int) -> int:
    frames = last - first + 1
    if last < MOST_FRAMES:
        return frames
    trial = parameters.get("TRIAL", {})
    begin, end = trial.get("ACTUAL_START_FIELD", []), trial.get("ACTUAL_END_FIELD", [])
    if len(begin) == 2 and len(end) == 2:  # low and high word
        low_high = [(low % 65536) + 65536 * (high % 65536) for low, high in (begin, end)]
        return int(low_high[1] - low_high[0] + 1)
    stated = parameters.get("POINT", {}).get("LONG_FRAMES", [])
    return max(frames, int(stated[0])) if stated and np.isfinite(stated[0]) else frames


def _analog_values(raw: NDArray, parameters: dict[str, dict[str, list[Any]]], *, is_float: bool) -> NDArray:
    """(raw - offset) * scale * general scale of each channel."""
    group = parameters.get("ANALOG", {})
    channels = raw.shape[1]
    unsigned = "".join(map(str, group.get("FORMAT", []))).upper().startswith("UNSIGNED")
    if unsigned and not is_float:
        raw = raw % 65536
    scale = (group.get("SCALE", []) + [1.0] * channels)[:channels]
    offset = np.array((group.get("OFFSET", []) + [0.0] * channels)[:channels], dtype=np.float64)
    general = (group.get("GEN_SCALE", []) or [1.0])[0]
    if any(isinstance(value, str) for value in [*scale, *offset, general]):
        raise InputError("ANALOG:SCALE, OFFSET and GEN_SCALE must be numbers: the file is damaged")
    return (raw - (offset % 65536 if unsigned else offset)) * np.array(scale, dtype=np.float64) * general
