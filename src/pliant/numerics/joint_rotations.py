"""Bending of joints in space, as rotation vectors (a, b, 0) perpendicular to the link along z, and frames of the links.

A swing (a, b) [rad] is the rotation vector (a, b, 0) in the frame of the link before. It takes z to (sin(v) b / v,
-sin(v) a / v, cos(v)), v = |(a, b)|. Frames that follow a curve by swings alone do not twist about it (parallel
transport), and are defined where the curve is straight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

STRAIGHT = 1e-150  # sine of the angle below which a direction is taken as z


def swing_matrices(swing: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (a, b, 0). `swing` (..., 2) [rad] holds (a, b)."""
    v = np.asarray(swing, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1)
    sine, versine = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # sin(v)/v, (1 - cos v)/v^2
    a, b = v[..., 0], v[..., 1]
    rows = [
        [1 - versine * b * b, versine * a * b, sine * b],
        [versine * a * b, 1 - versine * a * a, -sine * a],
        [-sine * b, sine * a, 1 - versine * angle**2],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def swings_to(direction: ArrayLike) -> NDArray[np.float64]:
    """Return the smallest rotations that turn the z axis into given directions (..., 3). Each is a rotation vector
    (a, b, 0), given by its components (..., 2) [rad]; its angle is at most pi.
    """
    u = np.asarray(direction, dtype=np.float64)
    across = np.hypot(u[..., 0], u[..., 1])
    angle = np.arctan2(across, u[..., 2])
    straight = across <= STRAIGHT * np.abs(u[..., 2])
    factor = np.where(straight, 1.0, angle) / np.where(straight, u[..., 2], across)
    swing = np.stack([-factor * u[..., 1], factor * u[..., 0]], axis=-1)
    back = straight & (u[..., 2] < 0)
    return np.where(back[..., None], [np.pi, 0.0], swing)  # half a turn about any axis


def swings_along(directions: ArrayLike, rest: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Return the joint rotations of a chain in space whose n links point along given directions (..., n, 3). Each is
    given by the components (a, b) of its rotation vector (a, b, 0); the result is (..., n, 2) [rad].

    Link k has the frame R_k = R_{k-1} R_rest,k exp([a_k, b_k, 0]^), R_{-1} the identity, and points along its z.

    Parameters
    ----------
    directions : (..., n, 3) array
        Directions from base to tip, of any length > 0.
    rest : (n, 3, 3) array, optional
        Rest rotations. Default: none, which returns the swings from a straight chain.
    """
    u = np.asarray(directions, dtype=np.float64)
    frame = np.broadcast_to(np.eye(3), (*u.shape[:-2], 3, 3))
    swings = np.empty((*u.shape[:-1], 2))
    for k in range(u.shape[-2]):
        frame = frame if rest is None else frame @ rest[k]
        swings[..., k, :] = swings_to(np.einsum("...ji,...j->...i", frame, u[..., k, :]))
        frame = frame @ swing_matrices(swings[..., k, :])
    return swings


def link_frames(swings: ArrayLike, rest: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Return the rotation matrices (..., n, 3, 3) of n links from their joint rotations (..., n, 2) [rad], which are
    the components (a, b) of rotation vectors (a, b, 0). `rest` (n, 3, 3) holds the rotations of the joints at rest.
    """
    turns = swing_matrices(swings)
    turns = turns if rest is None else rest @ turns
    frames = np.empty_like(turns)
    frame = np.eye(3)
    for k in range(turns.shape[-3]):
        frame = frame @ turns[..., k, :, :]
        frames[..., k, :, :] = frame
    return frames
