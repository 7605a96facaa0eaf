"""Arrays of a report, as the page's script reads them."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np

from pliant.view.data import GAP, LEVELS


def unpack(text: str, note: dict[str, Any]) -> np.ndarray:
    """Return the array that the description `note` locates in the packed `text`."""
    content = zlib.decompress(base64.b64decode(text))
    count = int(np.prod(note["shape"]))
    steps = np.frombuffer(content, dtype="<u2", count=count, offset=note["at"]).reshape(note["shape"])
    levels = np.cumsum(steps, axis=0, dtype=np.uint16).astype(np.int16).astype(float)
    levels[levels == GAP] = np.nan
    return (levels + LEVELS // 2) * note["scale"] + note["low"]
