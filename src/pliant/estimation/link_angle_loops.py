"""Compiled loop that computes link angles from points along the body."""

from __future__ import annotations

import numpy as np


def joint_values(points, ends, out):
    """Write to `out` (n,) [rad] the angles of n links, each relative to the link before, computed from S points (S, 2)
    [m] on the body.

    The first angle is relative to +y; all are NaN if a point is lost. `ends` holds for each end of a link the index of
    the point before it (n + 1,) and the weight of the point after it (n + 1,). Angles are unwrapped.
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
