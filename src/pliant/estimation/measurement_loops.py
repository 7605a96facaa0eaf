"""What a frame of the shape sees of the links, and its slopes: compiled for filters and observers."""

from __future__ import annotations

import numpy as np

ANGLE, ALONG_X, ALONG_Y, JOINT = 0, 1, 2, 3  # what a row of a measurement sees


def observe(phi, frame, seen, H):
    """What each row of a measurement sees (m,), and its slopes H (m, n) with respect to the absolute angles.

    A row is (kind, link, along, across): the angle of a link, from +y or from the link before it, or x or y of a point
    fixed to it. Where links lengthen, points move along with them, and H (m, n + S) has the slopes by the strains too.
    """
    l = frame.link_length
    rows = frame.rows
    n = len(l)
    for r in range(rows.shape[0]):
        kind = int(rows[r, 0])
        link = int(rows[r, 1])
        for k in range(len(phi)):
            H[r, k] = 0.0
        if kind in (ANGLE, JOINT):
            seen[r] = phi[link]
            H[r, link] = 1.0
            if kind == JOINT and link > 0:
                seen[r] -= phi[link - 1]
                H[r, link - 1] = -1.0
            continue
        value = frame.first_joint[kind - 1]
        for i in range(n, len(phi)):
            H[r, i] = frame.share[0, i - n] * frame.first_joint[kind - 1]
            value += H[r, i] * phi[i]
        for k in range(link + 1):
            along = rows[r, 2] if k == link else l[k]
            across = rows[r, 3] if k == link else 0.0
            c = np.cos(phi[k])
            s = np.sin(phi[k])
            reach = along
            for i in range(n, len(phi)):
                part = frame.share[k + 1, i - n] * reach
                along += part * phi[i]
                H[r, i] += part * (-s if kind == ALONG_X else c)
            if kind == ALONG_X:
                value += -along * s - across * c
                H[r, k] = -along * c + across * s
            else:
                value += along * c - across * s
                H[r, k] = -along * s - across * c
        seen[r] = value
