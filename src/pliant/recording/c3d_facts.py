"""What a C3D file states twice, and how its sections must lie: where two statements differ, one of them is damage.

Header and parameters hold the same counts, rates and scale; sections are blocks of 512 bytes, one after the other; the
last frame ends the file but for the rest of its block. A byte that was lost or doubled shifts all that follows it, and
nothing else shows it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

BLOCK = 512
SAME = 1e-4  # relative: rates and scales are single precision, some are written as rounded decimals


class Header(NamedTuple):
    """Numbers of the header: points, analog values a frame, first and last frame, block of the data, and so on."""

    points: int
    analog: int
    first: int
    last: int
    block: int
    samples: int
    scale: float
    rate: float


def compare_facts(header: Header, frames: int, parameters: dict[str, dict[str, list[Any]]]) -> list[str]:
    """Sentences about the facts in which header and parameters differ; `frames` is what the reader goes by."""
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
            said.append(f"{name} is {other:g} where the header has {value:g}")
    fields = [_word(parameters.get("TRIAL", {}).get(f"ACTUAL_{end}_FIELD", [])) for end in ("START", "END")]
    if None not in fields and fields[1] - fields[0] + 1 != frames:  # type: ignore[operator]
        said.append(f"TRIAL has frames {fields[0]} to {fields[1]} where the header has {frames} frames")
    return said


def _stated(parameters: dict[str, dict[str, list[Any]]]) -> dict[str, float]:
    """Single numbers of the groups POINT and ANALOG."""
    return {
        f"{group}:{name}": float(value[0])
        for group in ("POINT", "ANALOG")
        for name, value in parameters.get(group, {}).items()
        if len(value) == 1 and not isinstance(value[0], str)
    }


def _word(pair: list[Any]) -> int | None:
    """A number of two words, the low one first."""
    if len(pair) != 2 or any(isinstance(v, str) or not np.isfinite(v) for v in pair):
        return None
    return int(pair[0] % 65536) + 65536 * int(pair[1] % 65536)


def judge_layout(data: bytes, parameters_end: int, block: int, needed: int) -> list[str]:
    """Sentences about sections that overlap or do not end where they should.

    `parameters_end` and `block` count blocks from 1: the first one behind the parameters, and that of the data.
    """
    said = []
    if block < parameters_end:
        said.append(f"the data begin in block {block}, but the parameters end before block {parameters_end}")
    elif data[(parameters_end - 1) * BLOCK : (block - 1) * BLOCK].strip(b"\0"):
        said.append(f"{block - parameters_end} block(s) between the parameters and the data are not empty")
    rest = len(data) - needed
    if rest >= BLOCK:
        said.append(f"{rest} bytes follow the last frame that is announced")
    elif rest and len(data) % BLOCK:
        said.append(f"{rest} bytes follow the last frame, and they do not fill a block: bytes were lost or doubled")
    elif data[needed:].strip(b"\0"):
        said.append("the block of the last frame is not filled up with zeros: bytes may be shifted")
    return said


def judge_residuals(words: NDArray) -> list[str]:
    """A sentence about fourth words that cannot be what they are: a whole number of two bytes."""
    whole = (words >= -32768.0) & (words < 65536.0) & (words == np.floor(words))
    wrong = int((~whole & ~np.isnan(words)).sum())
    return [f"{wrong} of {words.size} points have no whole residual: bytes may be shifted"] if wrong else []
