"""Points beside the links: their coordinates along and across each of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.numerics.arcs import tangents

Array = np.ndarray


class LinkFrames(NamedTuple):
    """Inputs of the link positions: floats, or complex numbers that carry a derivative."""

    x: Any  # (n + S,) absolute angles, rad, strains behind them
    length: Any  # (n,) m
    base_length: Any  # m
    base_angle: Any  # rad
    share: Any  # (n + 1, S) part of each link that lies in each segment that lengthens


def link_coordinates(chain: LinkFrames, points: Array) -> tuple[Array, Array]:
    """Coordinates along and across (P, n + 1) each link of points (P, 2) [m], the base first.

    Coordinates along a link are those of the link unstretched.
    """
    n = len(chain.length)
    angle = np.append(chain.base_angle, chain.x[:n])
    stretch = 1.0 + chain.share @ chain.x[n:]
    (minus_s, c) = ahead = tangents(angle).T
    tips = np.cumsum(np.append(chain.base_length, chain.length) * stretch * ahead, axis=1)
    dx, dy = (points.T[:, :, None] - np.column_stack([np.zeros(2), tips[:, :-1]])[:, None])
    return (c * dy + minus_s * dx) / stretch, minus_s * dy - c * dx
