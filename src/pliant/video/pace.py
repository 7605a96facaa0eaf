"""Frames that a camera lost or repeated: what the times tell, and what the motion betrays."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
MOVES = 0.7  # pixels a frame, from which on a repeated frame is distinguished from rest
STANDS, LEAPS = 0.2, 1.7  # of the neighbours' steps
ALIKE = 0.35  # of the neighbours' change of the picture


def lost_in_times(time: Array) -> tuple[int, int]:
    """Return how many frames are missing in the times (T,), and at how many places."""
    step = np.diff(time)
    missing = np.rint(step / np.median(step)).astype(int) - 1
    return int(missing[missing > 0].sum()), int((missing > 0).sum())


def doubled_and_leaps(points: Array, change: Array, time: Array) -> tuple[Array, Array]:
    """Frames (T,) that repeat the one before, and steps (T,) twice as long as their neighbours, as if one were missing.

    Parameters
    ----------
    points : array (T, S, 2), pixels
        NaN where nothing was seen.
    change : array (T,), levels
        Mean change of the picture since the frame before.
    time : array (T,), s

    Both are reported where the body moves by `MOVES` or more and keeps its direction: at a turn two frames are alike.
    """
    step = np.diff(points, axis=0, prepend=np.nan)
    apart = (step**2).sum(axis=2)
    count = np.isfinite(apart).sum(axis=1)
    size = np.sqrt(np.where(count > 0, np.nansum(apart, axis=1), np.nan) / np.maximum(count, 1))
    even = np.rint(np.diff(time, prepend=time[0]) / np.median(np.diff(time))) <= 1
    doubled, leaps = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for k in range(2, len(points) - 1):
        before, after = size[k - 1], size[k + 1]
        if not np.isfinite([before, size[k], after]).all() or np.nansum(step[k - 1] * step[k + 1]) <= 0:
            continue
        least = min(before, after)
        alike = change[k] < ALIKE * min(change[k - 1], change[k + 1])
        doubled[k] = least > MOVES and size[k] < STANDS * least and alike
        leaps[k] = min(before, after) > MOVES and size[k] > LEAPS * max(before, after) and even[k - 1 : k + 2].all()
    leaps[1:] &= ~doubled[:-1]
    return doubled, leaps
