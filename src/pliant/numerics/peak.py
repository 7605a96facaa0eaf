"""The peak of a series that may lie on either side of 0."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def peak(values: Array) -> float:
    """Return the value farthest from 0, missing ones aside: below 0 where a vacuum drives a body."""
    return float(values.ravel()[np.nanargmax(np.abs(values))])
