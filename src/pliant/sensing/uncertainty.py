"""Uncertainty of a shape that is integrated from uncertain curvature."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def tip_sigma(sigma_curvature: float, spacing: float, length: float) -> float:
    """Return the standard deviation [m] of the tip of a straight fibre across its axis.

    sigma_tip = sigma_kappa sqrt(ds L^3 / 3), for independent errors of the curvature samples

    Parameters
    ----------
    sigma_curvature : float, 1/m
        Standard deviation of one curvature sample.
    spacing, length : float, m
        Distance between samples, and length of the fibre.
    """
    return float(sigma_curvature * np.sqrt(spacing * length**3 / 3))


def point_covariance(
    points: ArrayLike,
    sigma_curvature: float,
    *,
    sigma_base_angle: float = 0.0,
    sigma_bias: float = 0.0,
) -> NDArray[np.float64]:
    """Return the covariance (S, 2, 2) [m^2] of each point of a planar curve, to first order.

    delta p_k = sum_{j<=k} S (p_k - p_j) delta kappa_j ds_j + S (p_k - p_0) delta phi_0,  S = [[0, -1], [1, 0]]

    Parameters
    ----------
    points : (S, 2) array, m
        Points of the curve, from the base.
    sigma_curvature : float, 1/m
        Standard deviation of the independent error of each curvature sample.
    sigma_base_angle : float, rad
        Standard deviation of the tangent angle at the base.
    sigma_bias : float, 1/m
        Standard deviation of a curvature error that is common to all samples.
    """
    p = np.asarray(points, dtype=np.float64)
    ds = np.linalg.norm(np.diff(p, axis=0), axis=1)
    share = np.concatenate((ds[:1] / 2, (ds[1:] + ds[:-1]) / 2, ds[-1:] / 2))  # trapezoidal weight of a sample
    arm = p[:, None, :] - p[None, :, :]
    lever = np.stack([-arm[..., 1], arm[..., 0]], axis=2) * (share * np.tri(len(p)))[..., None]
    covariance = sigma_curvature**2 * np.einsum("kja,kjb->kab", lever, lever)
    shared = lever.sum(axis=1)
    turned = np.stack([-(p - p[0])[:, 1], (p - p[0])[:, 0]], axis=1)
    for sigma, direction in ((sigma_bias, shared), (sigma_base_angle, turned)):
        covariance += sigma**2 * direction[:, :, None] * direction[:, None, :]
    return np.asarray(covariance)
