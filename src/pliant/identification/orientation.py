"""Orientations of rigid bodies as observations, from a link's station and two points on the link's axes.

The two further points of the link lie one metre along it and one metre aside. They are observed like any point, so that
the frame has exact derivatives and passes through the model of the sensors.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.spatial_observation import angle_over_sine
from pliant.identification.observation_kind import TINY

Array = np.ndarray


def with_axes(places: Array, oriented: Array) -> Array:
    """Return the link coordinates (3, S + 2 m) of all points and of two axis points for each of the m `oriented`."""
    ends = places[:, oriented]
    ahead, aside = np.array([[1.0], [0.0], [0.0]]), np.array([[0.0], [0.0], [1.0]])
    return np.concatenate([places, ends + ahead, ends + aside], axis=1)


def repeated(values: Array, oriented: Array) -> Array:
    """Return per-point values (S + 2 m,) with those of the m `oriented` points repeated for their two axis points."""
    return np.concatenate([values, values[oriented], values[oriented]])


def frames_of(rows: Array, oriented: Array) -> Array:
    """Return link frames (..., T, m, 3, 3) from rows (..., T, S + 2 m, 3) with the axis points of `with_axes`."""
    m = len(oriented)
    start, ahead, aside = rows[..., oriented, :], rows[..., -2 * m : -m, :], rows[..., -m:, :]
    z = unit(ahead - start)
    x = aside - start
    x = unit(x - np.sum(x * z, axis=-1, keepdims=True) * z)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def unit(v: Array) -> Array:
    """Return vectors (..., 3) divided by their lengths; they may be complex."""
    return np.asarray(v / np.sqrt(np.sum(v * v, axis=-1, keepdims=True)))


def turns_off(rows: Array, oriented: Array, measured: Array) -> Array:
    """Return rotation vectors (..., T, m, 3) [rad] from the measured to the modelled rotations since the first frame.

    `measured` (T, m, 3, 3) holds rotation matrices in the axes of the base frame. The vectors are in the axes of the
    measured body.
    """
    frames = frames_of(rows, oriented)
    turned = frames @ np.swapaxes(frames[..., :1, :, :, :], -1, -2)
    return rotation_vectors(np.swapaxes(measured, -1, -2) @ turned)


def turn_slopes(rows: Array, derivatives: Array, oriented: Array, measured: Array) -> Array:
    """Return derivatives (P, T, m, 3) of `turns_off`, given those (P, T, S + 2 m, 3) of the rows (complex steps)."""
    return np.asarray(turns_off(rows + 1j * TINY * derivatives, oriented, measured).imag / TINY)


def rotation_vectors(R: Array) -> Array:
    """Return rotation vectors (..., 3) [rad] of rotation matrices (..., 3, 3), which may be complex.

    The rotation vector is (theta / sin theta) v, where v is the vector of the matrix's skew part.
    """
    skew = 0.5 * (R - np.swapaxes(R, -1, -2))
    v = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(angle_over_sine(cosine)[..., None] * v)
