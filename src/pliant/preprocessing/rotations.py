"""Convert rotations between matrices and quaternions x, y, z, w; fit a rotation to two sets of points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def to_matrix(quaternion: NDArray) -> NDArray:
    """Return rotation matrices (..., 3, 3) of unit quaternions x, y, z, w (..., 4); NaN stays NaN."""
    x, y, z, w = np.moveaxis(quaternion, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def from_matrix(matrix: NDArray) -> NDArray:
    """Return unit quaternions x, y, z, w (..., 4), w >= 0, of rotation matrices (..., 3, 3); NaN stays NaN."""
    m = np.asarray(matrix)
    trace = np.trace(m, axis1=-2, axis2=-1)
    diagonal = np.diagonal(m, axis1=-2, axis2=-1)
    # four times the products of each component with all others; the row with the largest square is exact
    products = np.empty((*m.shape[:-2], 4, 4))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[..., i, i] = 1 + 2 * diagonal[..., i] - trace
        products[..., i, j] = products[..., j, i] = m[..., i, j] + m[..., j, i]
        products[..., i, 3] = products[..., 3, i] = m[..., k, j] - m[..., j, k]
    products[..., 3, 3] = 1 + trace
    squares = np.diagonal(products, axis1=-2, axis2=-1)
    best = np.argmax(np.nan_to_num(squares), axis=-1)
    quaternion = np.take_along_axis(products, best[..., None, None], axis=-2)[..., 0, :]
    quaternion = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return np.where(quaternion[..., 3:] < 0, -quaternion, quaternion)


def continuous(quaternion: NDArray) -> tuple[NDArray, int]:
    """Return the quaternions (T, S, 4) of S stations over T frames with signs chosen so that they do not jump over
    time, and the number of frames whose sign was changed.
    """
    result = quaternion.copy()
    turned = 0
    for s in range(result.shape[1]):
        rows = np.flatnonzero(np.isfinite(result[:, s]).all(-1))
        if rows.size < 2:
            continue
        q = result[rows, s]
        sign = np.where((q[1:] * q[:-1]).sum(-1) < 0, -1.0, 1.0)
        sign = np.concatenate([[1.0], np.cumprod(sign)])
        turned += int((sign < 0).sum())
        result[rows, s] = q * sign[:, None]
    return result, turned


def best_rotation(shape: NDArray, points: NDArray) -> NDArray:
    """Return the rotation matrices (T, 3, 3) that best map N reference points `shape` (N, 3) to the measured points (T,
    N, 3) of T frames.

    Both are taken about their centroids. Source: W. Kabsch, Acta Cryst. A32 (1976) 922.
    """
    centred = points - points.mean(1, keepdims=True)
    covariance = np.einsum("tni,nj->tij", centred, shape - shape.mean(0))
    u, _, vt = np.linalg.svd(covariance)
    sign = np.sign(np.linalg.det(u @ vt))
    u[..., :, -1] *= sign[:, None]
    return u @ vt


def mean_rotation(matrix: NDArray) -> NDArray:
    """Return the rotation matrix (..., 3, 3) closest to the mean of rotation matrices (T, ..., 3, 3) over T frames.
    Frames with NaN are left out.
    """
    finite = np.isfinite(matrix)
    count = finite.sum(0)
    mean = np.where(finite, matrix, 0.0).sum(0) / np.maximum(count, 1)
    u, _, vt = np.linalg.svd(mean)
    sign = np.linalg.det(u @ vt)
    u[..., :, -1] *= sign[..., None]
    return np.where(count > 0, u @ vt, np.nan)


def angle_about(matrix: NDArray, axis: NDArray) -> NDArray:
    """Return the signed angle [rad], in (-pi, pi], by which each rotation matrix in an array (..., 3, 3) turns about
    the unit vector `axis` (3,).

    The rotation is split into a turn about `axis` and one about a direction perpendicular to `axis` (swing and twist).
    """
    twist = np.einsum("...ij,ijk,k->...", matrix, _LEVI_CIVITA, axis)
    along = np.einsum("...ij,i,j->...", matrix, axis, axis)
    trace = np.trace(matrix, axis1=-2, axis2=-1)
    return np.arctan2(-twist, trace - along)


_LEVI_CIVITA = np.zeros((3, 3, 3))
_LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_LEVI_CIVITA[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = -1.0
