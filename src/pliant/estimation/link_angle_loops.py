"""Angles of the chords between a body's joints, compiled."""

from __future__ import annotations

import numpy as np


def joint_values(points, ends, out):
    """Angles of the links, each against the one before, from points (S, 2) along the body; NaN where one is lost.

    out (n,) [rad]: the first against +y. `ends` holds the point before each end of a link (n + 1,) and the share of the
    next one (n + 1,). Each angle is the one nearest to that of the link before.
    """
    left, share = ends
    for k in range(len(points)):
        if not (np.isfinite(points[k, 0]) and np.isfinite(points[k, 1])):
            for i in range(len(out)):
                out[i] = np.nan
            return
    before = 0.0
    for i in range(len(left) - 1):
        j = left[i]
        k = left[i + 1]
        x = (1.0 - share[i + 1]) * points[k, 0] + share[i + 1] * points[k + 1, 0]
        y = (1.0 - share[i + 1]) * points[k, 1] + share[i + 1] * points[k + 1, 1]
        x = x - ((1.0 - share[i]) * points[j, 0] + share[i] * points[j + 1, 0])
        y = y - ((1.0 - share[i]) * points[j, 1] + share[i] * points[j + 1, 1])
        turn = np.arctan2(-x, y)
        if i > 0:
            turn = turn - 2.0 * np.pi * np.round((turn - before) / (2.0 * np.pi))
        out[i] = turn - before
        before = turn
