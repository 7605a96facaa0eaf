"""Detect frames that a camera lost or repeated, from the frame times and from the motion."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
MOVES = 0.7  # pixels per frame: a repeated frame is detectable only in faster motion
STANDS, LEAPS = 0.2, 1.7  # relative to the neighbours' steps: of a repeated frame, and after a lost one
ALIKE = 0.35  # relative to the neighbours' change of the picture: of a repeated frame


def lost_in_times(time: Array) -> tuple[int, int]:
    """Return the number of missing frames in the times (T,) [s] and the number of gaps that they form."""
    step = np.diff(time)
    missing = np.rint(step / np.median(step)).astype(int) - 1
    return int(missing[missing > 0].sum()), int((missing > 0).sum())


def doubled_and_leaps(points: Array, change: Array, time: Array) -> tuple[Array, Array]:
    """Return masks (T,) of frames that repeat the previous one, and of steps twice as long as their neighbours.

    A step that is twice as long suggests a missing frame.

    Parameters
    ----------
    points : array (T, S, 2), pixels
        Tracked points; NaN where nothing was seen.
    change : array (T,), levels
        Mean change of the picture since the previous frame, in grey levels.
    time : array (T,), s

    Both are reported only where the body moves by `MOVES` or more and keeps its direction, as two frames at a reversal
    are alike.
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
