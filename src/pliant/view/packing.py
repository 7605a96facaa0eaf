"""Packing of arrays into a page: small integers with a scale for each array, all in one compressed text."""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Array = np.ndarray
LEVELS = 65_000  # number of integer levels for an array's range; -32768 marks missing values
GAP = -32_768


@dataclass
class Pack:
    """A collection of arrays to be stored in a page; for each, a description says where it lies in the data.

    Values are rounded to 1/65 000 of their range, such as 3 um for 0.2 m, and stored as differences along the first
    axis, which compress well.
    """

    parts: list[bytes] = field(default_factory=list)
    used: int = 0

    def add(self, values: Any) -> dict[str, Any]:
        """Add an array of any shape and return its description: position in the data, shape and scale."""
        array = np.asarray(values, dtype=float)
        seen = np.isfinite(array)
        low, high = (float(f(array[seen])) if seen.any() else 0.0 for f in (np.min, np.max))
        scale = (high - low) / LEVELS or 1.0
        levels = np.full(array.shape, GAP, dtype=np.int64)
        levels[seen] = np.rint((array[seen] - low) / scale) - LEVELS // 2
        steps = np.diff(levels, axis=0, prepend=0).astype(np.uint16)  # differences may overflow, which their sum undoes
        note = {"at": self.used, "shape": list(array.shape), "low": low, "scale": scale}
        self.put(steps.astype("<u2").tobytes())
        return note

    def put(self, content: bytes) -> None:
        """Add raw bytes; their number must be even."""
        self.parts.append(content)
        self.used += len(content)

    def text(self) -> str:
        """Return all arrays as one compressed block in base64; the same arrays give the same text."""
        return base64.b64encode(zlib.compress(b"".join(self.parts), 9)).decode()


def unpack(text: str, note: dict[str, Any]) -> Array:
    """Return the array that a description refers to, as the page's script reads it."""
    content = zlib.decompress(base64.b64decode(text))
    count = int(np.prod(note["shape"]))
    steps = np.frombuffer(content, dtype="<u2", count=count, offset=note["at"]).reshape(note["shape"])
    levels = np.cumsum(steps, axis=0, dtype=np.uint16).astype(np.int16).astype(float)
    levels[levels == GAP] = np.nan
    return np.asarray((levels + LEVELS // 2) * note["scale"] + note["low"])
