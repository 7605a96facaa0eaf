"""The value of largest size in an array, with its sign."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def peak(values: Array) -> float:
    """Return the value farthest from 0, with its sign, ignoring NaN (a vacuum has a negative peak)."""
    return float(values.ravel()[np.nanargmax(np.abs(values))])
