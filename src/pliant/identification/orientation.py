"""Orientations of rigid bodies as observations: links are seen by two points on their axes, turns by rotation vectors.

A link's frame follows from its station and from two further points of the link, one metre along it and one metre aside.
They are observed as any point is, so that the frame has exact derivatives and passes through sensors.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.spatial_observation import angle_over_sine
from pliant.identification.observation_kind import TINY

Array = np.ndarray


def with_axes(places: Array, oriented: Array) -> Array:
    """Return coordinates along, across and aside (3, S) of points with those of the axes of `oriented` ones behind."""
    ends = places[:, oriented]
    ahead, aside = np.array([[1.0], [0.0], [0.0]]), np.array([[0.0], [0.0], [1.0]])
    return np.concatenate([places, ends + ahead, ends + aside], axis=1)


def repeated(values: Array, oriented: Array) -> Array:
    """Return the per-point values, followed twice by those of the `oriented` points, for their two axes."""
    return np.concatenate([values, values[oriented], values[oriented]])


def frames_of(rows: Array, oriented: Array) -> Array:
    """Return link frames (..., T, m, 3, 3) of rows (..., T, S + 2 m, 3) that `with_axes` laid, also complex ones."""
    m = len(oriented)
    start, ahead, aside = rows[..., oriented, :], rows[..., -2 * m : -m, :], rows[..., -m:, :]
    z = unit(ahead - start)
    x = aside - start
    x = unit(x - np.sum(x * z, axis=-1, keepdims=True) * z)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def unit(v: Array) -> Array:
    """Return vectors (..., 3) over their lengths, also complex ones."""
    return np.asarray(v / np.sqrt(np.sum(v * v, axis=-1, keepdims=True)))


def turns_off(rows: Array, oriented: Array, measured: Array) -> Array:
    """Return rotation vectors (..., T, m, 3) [rad] from measured to modelled turns since the first frame.

    `measured` (T, m, 3, 3) are rotations in the axes of the base frame; the vectors are in the measured body's axes.
    """
    frames = frames_of(rows, oriented)
    turned = frames @ np.swapaxes(frames[..., :1, :, :, :], -1, -2)
    return rotation_vectors(np.swapaxes(measured, -1, -2) @ turned)


def turn_slopes(rows: Array, derivatives: Array, oriented: Array, measured: Array) -> Array:
    """Return derivatives (P, T, m, 3) of `turns_off` from those (P, T, S + 2 m, 3) of the rows, by complex steps."""
    return np.asarray(turns_off(rows + 1j * TINY * derivatives, oriented, measured).imag / TINY)


def rotation_vectors(R: Array) -> Array:
    """Return rotation vectors (..., 3) [rad] of rotations (..., 3, 3), also complex ones: (theta / sin theta) v.

    v is the vector of the skew part.
    """
    skew = 0.5 * (R - np.swapaxes(R, -1, -2))
    v = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(angle_over_sine(cosine)[..., None] * v)
