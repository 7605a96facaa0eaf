"""Coordinates of points along and across each link of a planar chain."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.numerics.arcs import tangents

Array = np.ndarray


class LinkFrames(NamedTuple):
    """Angles and lengths of the links, as floats or as complex numbers for derivatives."""

    x: Any  # (n + S,) absolute angles, rad, strains behind them
    length: Any  # (n,) m
    base_length: Any  # m
    base_angle: Any  # rad
    share: Any  # (n + 1, S) fraction of each link that lies in each segment that lengthens


def link_coordinates(chain: LinkFrames, points: Array) -> tuple[Array, Array]:
    """Return the coordinates [m] of points (P, 2) along and across each link, as two arrays (P, n + 1), base first.

    Coordinates along a link refer to the unstretched link.
    """
    n = len(chain.length)
    angle = np.append(chain.base_angle, chain.x[:n])
    stretch = 1.0 + chain.share @ chain.x[n:]
    (minus_s, c) = ahead = tangents(angle).T
    tips = np.cumsum(np.append(chain.base_length, chain.length) * stretch * ahead, axis=1)
    dx, dy = (points.T[:, :, None] - np.column_stack([np.zeros(2), tips[:, :-1]])[:, None])
    return (c * dy + minus_s * dx) / stretch, minus_s * dy - c * dx
