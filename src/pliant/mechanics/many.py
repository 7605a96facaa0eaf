"""Linearised dynamics of many planar chains at once, as arrays whose last axis is the chain."""

from __future__ import annotations

import numpy as np

from pliant.equations import inertia
from pliant.mechanics.springs import Springs

Array = np.ndarray


def small_motions(
    constants: tuple[Array, Array, Array], gravity: Array, springs: Springs, q: Array, phi: Array,
) -> tuple[Array, Array]:
    """Return the inertia and stiffness matrices (N, n, n), in joint angles, of N planar chains of n links for small
    motions about given shapes.

    Parameters
    ----------
    constants : arrays (n, n, N), (n, N), (n, N)
        The results of `model.inertia.inertia_constants`.
    gravity : array (2, N)
        Gravity in the base frame, m/s^2.
    q, phi : array (n, N)
        Joint angles and absolute link angles, rad.
    """
    B, rotary, h = constants
    c, s = np.cos(phi), np.sin(phi)
    X, M = np.empty_like(B), np.empty_like(B)
    inertia.inertia_absolute(c, s, B, rotary, X)
    inertia.to_joint_angles(X, M)
    n = len(q)
    tail = np.cumsum((h * (gravity[1] * c - gravity[0] * s))[::-1], axis=0)[::-1]
    stiffness = springs.slope(q) * np.eye(n)[..., None] + tail[np.maximum.outer(np.arange(n), np.arange(n))]
    return np.moveaxis(M, -1, 0), np.moveaxis(stiffness, -1, 0)
