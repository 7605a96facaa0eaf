"""Curves from their curvature, in the plane and in space, and lengths of circular arcs through points.

The base frame: origin, tangent t along +y, m1 along -x, m2 along +z, so that the first curvature component turns the
tangent about +z, as everywhere in the plane. It is Bishop's frame: it does not turn about the tangent, and therefore
has no singularity where the curvature vanishes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Array = np.ndarray
SMALL = 1e-4  # rad: below it the series of sin(x)/x and its like are exact in double precision


def planar_curve(curvature: ArrayLike, arc_length: ArrayLike, *, base_angle: float = 0.0) -> NDArray[np.float64]:
    """Return points (T, S, 2) [m] of T planar curves at S arc lengths, from their curvature (T, S) [1/m].
    The curves start at the origin along +y, turned by the base angle.

    Between two stations the curvature is the mean of the two, and the curve is a circular arc:
    p_{k+1} = p_k + ds sinc(a / 2) e(phi_k + a / 2),  a = kappa ds,  e(phi) = (-sin phi, cos phi)

    Parameters
    ----------
    curvature : (T, S) array, 1/m
        Positive turns the tangent about +z.
    arc_length : (S,) array, m
    base_angle : float, rad
        Angle of the tangent at the first station, from +y.
    """
    kappa, ds = _checked(curvature, arc_length, 2)
    bend = (kappa[:, 1:] + kappa[:, :-1]) / 2 * ds
    phi = base_angle + np.concatenate((np.zeros((len(kappa), 1)), np.cumsum(bend, axis=1)), axis=1)
    chord = ds * np.sinc(bend / (2 * np.pi))  # numpy's sinc(x) is sin(pi x) / (pi x)
    middle = phi[:, :-1] + bend / 2
    points = np.zeros((*kappa.shape, 2))
    np.cumsum(np.stack([-chord * np.sin(middle), chord * np.cos(middle)], axis=2), axis=1, out=points[:, 1:])
    return points


def spatial_curve(
    curvature: ArrayLike, arc_length: ArrayLike, *, twist: ArrayLike | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points (T, S, 3) [m] and frames (T, S, 3, 3) of T curves in space at S arc lengths, from their
    curvature and twist.

    g' = g xi,  xi = (omega, v) = ((k2, phi', k1), e_y); curvature and twist are linear between stations. Each step from
    station to station is the exponential of a Magnus expansion, of fourth order. Constant curvature is integrated
    exactly.

    Parameters
    ----------
    curvature : (T, S, 2) array, 1/m
        (k1, k2) along m1 and m2: t' = k1 m1 + k2 m2.
    arc_length : (S,) array, m
    twist : (T, S) array, rad/m, optional
        Rate at which the frame of the curvature components turns about the tangent, as for components in a frame fixed
        to the material. None: Bishop's frame, which does not turn.

    Returns
    -------
    points : (T, S, 3) array, m
    frames : (T, S, 3, 3) array
        Rotations; the columns are -m1, t, m2.
    """
    k, ds = _checked(curvature, arc_length, 3)
    omega = np.stack([k[..., 1], np.zeros(k.shape[:2]), k[..., 0]], axis=2)
    if twist is not None:
        omega[..., 1] = np.asarray(twist, dtype=np.float64)
    points, frames = np.zeros((*k.shape[:2], 3)), np.zeros((*k.shape[:2], 3, 3))
    frames[:, 0] = np.eye(3)
    forward = np.array([0.0, 1.0, 0.0])
    for j, h in enumerate(ds):
        early, late = omega[:, j], omega[:, j + 1]
        # Magnus with linear omega: mean + h^2/12 [early, late]; v is constant, so its bracket is (early - late) x v
        turn = h * (early + late) / 2 + h**2 / 12 * np.cross(early, late)
        move = h * forward + h**2 / 12 * np.cross(early - late, forward)
        rotation, shift = _exponential(turn, move)
        points[:, j + 1] = points[:, j] + np.einsum("tab,tb->ta", frames[:, j], shift)
        frames[:, j + 1] = frames[:, j] @ rotation
    return points, frames


def _exponential(
    turn: NDArray[np.float64], move: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the exponential of (turn, move) (T, 3): rotations (T, 3, 3) and translations (T, 3)."""
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    x = np.where(angle > SMALL, angle, 1.0)
    sine = np.where(angle > SMALL, np.sin(x) / x, 1 - angle**2 / 6)
    versine = np.where(angle > SMALL, 2 * np.sin(x / 2) ** 2 / x**2, 0.5 - angle**2 / 24)
    rest = np.where(angle > SMALL, (x - np.sin(x)) / x**3, 1 / 6 - angle**2 / 120)
    hat = np.zeros((len(turn), 3, 3))
    hat[:, 2, 1], hat[:, 0, 2], hat[:, 1, 0] = turn.T
    hat -= hat.transpose(0, 2, 1).copy()
    square = hat @ hat
    rotation = np.eye(3) + sine * hat + versine * square
    return rotation, ((np.eye(3) + versine * hat + rest * square) @ move[..., None])[..., 0]


def _checked(
    curvature: ArrayLike, arc_length: ArrayLike, ndim: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    kappa, s = np.asarray(curvature, dtype=np.float64), np.asarray(arc_length, dtype=np.float64)
    wanted = "(time, station)" if ndim == 2 else "(time, station, 2)"
    if kappa.ndim != ndim or s.ndim != 1 or kappa.shape[1] != s.size or (ndim == 3 and kappa.shape[2] != 2):
        raise InputError(
            f"curvature must have the shape {wanted}, with one arc length for each station, got {kappa.shape} and "
            f"{s.shape}"
        )
    ds = np.diff(s)
    if not (ds > 0).all():
        raise InputError("arc lengths must increase strictly from station to station: sort the stations by arc length")
    return kappa, ds


def tangents(angle: Array) -> Array:
    """Return the unit vectors (-sin, cos) (..., 2) at angles (...) [rad] from +y."""
    return np.stack([-np.sin(angle), np.cos(angle)], axis=-1)


def arc_lengths(position: Array) -> Array:
    """Return the length (T,) [m] of each of T curves of circular arcs, from the origin through S points (T, S, 2 or 3)
    [m].

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
