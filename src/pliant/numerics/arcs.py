"""Tangents of planar curves, and lengths of circular arcs through points."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def tangents(angle: Array) -> Array:
    """Return the unit vectors (-sin, cos) (..., 2) at angles (...) [rad] from +y."""
    return np.stack([-np.sin(angle), np.cos(angle)], axis=-1)


def arc_lengths(position: Array) -> Array:
    """Return the lengths (T,) [m] of curves of circular arcs from the origin through the points (T, S, d), d = 2 or 3.

    Each arc is tangent to the one before. The first begins at the origin along +y, in space along +z. The result is
    exact where the curvature between the points is constant.
    """
    chords = np.diff(position, axis=1, prepend=0.0)
    reach = np.linalg.norm(chords, axis=2)
    if position.shape[2] == 3:
        return _lengths_in_space(chords, reach)
    angle = np.unwrap(np.arctan2(-chords[..., 0], chords[..., 1]), axis=1)
    tangent = np.zeros(len(position))
    total = np.zeros(len(position))
    for k in range(reach.shape[1]):
        half = angle[:, k] - tangent
        total += reach[:, k] / np.sinc(half / np.pi)
        tangent = tangent + 2 * half
    return total


def _lengths_in_space(chords: Array, reach: Array) -> Array:
    """Return the lengths (T,) [m] of arcs over the chords (T, S, 3) of length `reach` (T, S), the first along +z."""
    tangent = np.broadcast_to([0.0, 0.0, 1.0], chords[:, 0].shape)
    total = np.zeros(len(reach))
    for k in range(reach.shape[1]):
        ahead = chords[:, k] / reach[:, k, None]
        along = (tangent * ahead).sum(axis=1)
        half = np.arctan2(np.linalg.norm(np.cross(tangent, ahead), axis=1), along)
        total += reach[:, k] / np.sinc(half / np.pi)
        tangent = 2 * along[:, None] * ahead - tangent  # the end tangent is the start tangent mirrored at the chord
    return total
