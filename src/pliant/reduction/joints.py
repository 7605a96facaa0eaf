"""Compute the joint angles and link tips of a chain of links, in the plane and in space, from the positions of the
nodes at which the links meet.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pliant.numerics.curve import tangents
from pliant.numerics.joint_rotations import link_frames, swing_matrices, swings_along

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class LinkPoint(NamedTuple):
    """A point attached to a link of a spatial chain: the link's index, and the point's coordinates [m] in the link's
    frame, whose origin is the link's joint: `along` = z (along the link), `across` = -y, `aside` = x.
    """

    link: int  # 0 for the first link, -1 for the base
    along: float
    across: float
    aside: float


def joints_in_plane(nodes: Array, rest_nodes: Array, link_length: Array, start: int) -> tuple[Array, Array, Array]:
    """Return the rest angles (n,) [rad] of a planar chain of n links, its joint angles (T, n) [rad] over T frames, and
    its link tips (T, n, 2) [m]. The chain starts at the origin.
    """
    relative, (rest_angle,) = chain_of(nodes)[1], chain_of(rest_nodes[None])[1]
    turns = _unwrapped_from(relative, rest_angle, start)
    return rest_angle, turns - rest_angle, forward_tips(turns, link_length)


def joints_in_space(nodes: Array, rest_nodes: Array, link_length: Array) -> tuple[Array, Array, Array]:
    """Return the joint angles of a spatial chain of n links, two swing angles per joint: (2 n,) [rad] at rest, and (T,
    2 n) [rad] relative to rest over T frames. Also return the link tips (T, n, 3) [m].
    """
    rest_swing = swings_along(np.diff(rest_nodes, axis=0))
    rest = swing_matrices(rest_swing)
    swing = swings_along(np.diff(nodes, axis=1), rest)
    ahead = link_frames(swing, rest)[..., 2]
    return rest_swing.ravel(), swing.reshape(len(nodes), -1), np.cumsum(ahead * link_length[:, None], axis=1)


def beside_links(place: Array, before: float, link_length: Array, rest: Array) -> list[LinkPoint]:
    """Attach each of P points (P, 3) [m] on the body at rest to the nearest link of a spatial chain, and return them as
    `LinkPoint`s.

    Parameters
    ----------
    place : (P, 3) array, m
        Points in the base frame.
    before : float, m
        Length of the base before the first joint, which counts as a link.
    link_length : (n,) array, m
    rest : (n, 3, 3) array
        Rest rotation of each link.
    """
    frames = np.concatenate((np.eye(3)[None], link_frames(np.zeros((len(rest), 2)), rest)))
    length = np.append(before, link_length)
    starts = np.concatenate((np.zeros((1, 3)), np.cumsum(frames[:, :, 2] * length[:, None], axis=0)[:-1]))
    beside = np.einsum("kji,pkj->pki", frames, place[:, None] - starts)
    beyond = beside[..., 2] - np.clip(beside[..., 2], 0.0, length)
    nearest = np.hypot(np.hypot(beside[..., 0], beside[..., 1]), beyond).argmin(axis=1)
    found = beside[np.arange(len(place)), nearest]
    return [LinkPoint(int(k) - 1, float(z), float(-y), float(x)) for k, (x, y, z) in zip(nearest, found, strict=True)]


def chain_of(nodes: Array) -> tuple[Array, Array]:
    """Return the lengths (T, n) [m] of n planar links between successive nodes (T, n + 1, 2) [m] over T frames, and the
    angle (T, n) [rad] of each link to the previous one, in (-pi, pi].
    """
    chord = np.diff(nodes, axis=1)
    alpha = np.arctan2(-chord[:, :, 0], chord[:, :, 1])
    return np.hypot(chord[:, :, 0], chord[:, :, 1]), wrap(np.diff(alpha, axis=1, prepend=0.0))


def forward_tips(turns: Array, link_length: Array) -> Array:
    """Return the tips (T, n, 2) [m] of the n links of planar chains that start at the origin, over T frames. `turns`
    (T, n) [rad] is the angle of each link to the previous one: joint angle q plus rest angle theta_0.

    p^i = p^{i-1} + l_i (-sin phi_i, cos phi_i),  phi_i = sum_{k<=i} (q_k + theta_k0)

    The link lengths are (n,) or (T, n).

    Paper: Eq. (3) [eq:Rp^i]
    """
    return np.cumsum(tangents(np.cumsum(turns, axis=1)) * link_length[..., None], axis=1)


def wrap(angle: Array) -> Array:
    """Return angles [rad] wrapped to the interval (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


def _unwrapped_from(relative: Array, rest: Array, start: int) -> Array:
    """Return relative angles that are continuous over time and within half a turn of `rest` at frame `start`."""
    turns: Array = np.unwrap(relative, axis=0)
    return turns - 2 * np.pi * np.round((turns[start] - rest) / (2 * np.pi))
