"""Fit a chain of rigid links to the shape of a body: each link is the chord between two nodes on the curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.numerics.curve import tangents
from pliant.numerics.spline import local_cubic_matrix
from pliant.reduction.body import body_of
from pliant.reduction.placement import equal_nodes

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

    from pliant.reduction.body import BodyShape

Array = np.ndarray
REST_DURATION = 0.1
PRESSURE_AT_REST = 0.05  # of the range of the pressure
STRAIGHT = 1e-150  # sine of the angle below which a direction is taken as z


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
    offsets = beside[np.arange(len(place)), nearest]
    return [LinkPoint(int(k) - 1, float(z), float(-y), float(x)) for k, (x, y, z) in zip(nearest, offsets, strict=True)]


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


@dataclass(frozen=True)
class LinkPlacement:
    """Chain of n rigid links fitted to a shape over time: link lengths, rest angles, joint angles and tip positions.
    Joint i is at the base of link i; index 0 is the base.

    N is n in the plane. In space N is 2 n, with the two swing angles of each joint interleaved (a_1, b_1, ..., a_n,
    b_n). The chain does not twist about its links, neither at rest nor in motion.

    Attributes
    ----------
    time : (T,) array, s
    link_length : (n,) array, m
        Constant lengths of the links.
    rest_angle : (N,) array, rad
        theta_i0: angle of each link to the previous one (the first: to the base tangent) at rest; in space its swing.
    joint_angle : (T, N) array, rad
        q_i: change of that angle from rest, continuous over time; in space the swing after that of the rest shape.
    node_arc_length : (n + 1,) array, m
        Arc lengths of the nodes, base and tip included.
    base : (d,) array, m
        Mean position of the first node.
    tips : (T, n, d) array, m
        Measured positions of the link tips.
    length_variation : (n,) array
        Range of each link's length over time, divided by `link_length`.
    residual : (T, n) array, m
        Distance between the measured tips and those of the chain with constant link lengths.
    notes : tuple of str
        Assumptions and remarks, one sentence each.
    """

    time: Array
    link_length: Array
    rest_angle: Array
    joint_angle: Array
    node_arc_length: Array
    base: Array
    tips: Array
    length_variation: Array
    residual: Array
    notes: tuple[str, ...]

    @property
    def n(self) -> int:
        """Number of links in the chain."""
        return len(self.link_length)

    @property
    def rest_rotation(self) -> Array:
        """Rotation matrix (n, 3, 3) of each link of a spatial chain relative to the previous link at rest."""
        return swing_matrices(self.rest_angle.reshape(self.n, 2))

    @property
    def rest_bend(self) -> Array:
        """Angle (n,) [rad] between each of n links and the previous one at rest; unsigned for a spatial chain."""
        if len(self.base) == 2:
            return self.rest_angle
        return np.asarray(np.linalg.norm(self.rest_angle.reshape(self.n, 2), axis=1))

    def beside(self, place: ArrayLike) -> list[LinkPoint]:
        """Attach each of P points `place` (P, 3) [m], on the body at rest in the base frame, to the nearest link of a
        spatial chain, and return them as `LinkPoint`s.

        Each point is assigned to the nearest link, or to the base before the first joint where that is nearest.
        """
        positions = np.asarray(place, dtype=np.float64)
        return beside_links(positions, float(self.node_arc_length[0]), self.link_length, self.rest_rotation)


def links_of(
    recording: xr.Dataset, n: int | None = None, *, node_arc_length: ArrayLike | None = None,
    stations: Sequence[str] | None = None, length: str = "rest", rest: tuple[float, float] | None = None,
) -> LinkPlacement:
    """Fit a chain of rigid links, planar or spatial, to the recorded shape of a body and return its link lengths and
    joint angles over time.

    alpha_i = atan2(-dx, dy) of chord i;  theta_i = alpha_i - alpha_{i-1}, alpha_0 = 0 (the base tangent +y);
    theta_i0 = theta_i of the rest shape;  q_i = theta_i - theta_i0
    In space the same by rotations: R_i = R_{i-1} R_rest,i exp([a_i, b_i, 0]^), z of R_i along chord i.

    Parameters
    ----------
    recording : xarray.Dataset
        Aligned recording, with stations from base to tip.
    n : int, optional
        Number of links of equal arc length.
    node_arc_length : (n + 1,) array, m, optional
        Arc lengths of the nodes from base to tip, instead of `n`.
    stations : names, optional
        Names of the stations that are nodes, instead of `n`.
    length : {"rest", "mean"}
        Whether link lengths are those of the rest shape or their mean over time. The mean is better for large bends,
        which shorten the chords.
    rest : (start, stop), s, optional
        Time window of the rest shape; default the first 0.1 s.

    Returns
    -------
    LinkPlacement

    Raises
    ------
    InputError
        When the recording is not aligned, the nodes are unusable, or the rest window holds no frame.
    """
    if recording.attrs.get("frame") == "tracker":
        raise InputError("links_of needs an aligned recording (base at the origin, base tangent +y, in space +z): "
                         "align it first")  # fmt: skip
    if length not in ("rest", "mean"):
        raise InputError(f"length must be 'rest' or 'mean', not {length!r}")
    body = body_of(recording, fewest_stations=2)
    knots = _chosen_nodes(recording, body, n, node_arc_length, stations)
    nodes = np.matmul(_node_matrix(body.arc_length, knots), body.position)
    still, notes = _rest_frames(recording, body.time, rest)
    rest_nodes = nodes[still].mean(axis=0)
    lengths = np.linalg.norm(np.diff(nodes, axis=1), axis=2)
    link_length = np.linalg.norm(np.diff(rest_nodes, axis=0), axis=1) if length == "rest" else lengths.mean(axis=0)
    if nodes.shape[2] == 2:
        rest_angle, joint_angle, chain = joints_in_plane(nodes, rest_nodes, link_length, int(np.argmax(still)))
    else:
        rest_angle, joint_angle, chain = joints_in_space(nodes, rest_nodes, link_length)
    base, tips = nodes[:, 0].mean(axis=0), nodes[:, 1:]
    variation, residual = np.ptp(lengths, axis=0) / link_length, np.linalg.norm(chain + base - tips, axis=2)
    return LinkPlacement(body.time, link_length, rest_angle, joint_angle, knots, base, tips, variation, residual,
                         notes=(*body.notes, *notes))  # fmt: skip


def _chosen_nodes(
    recording: xr.Dataset, body: BodyShape, n: int | None, node_arc_length: ArrayLike | None,
    stations: Sequence[str] | None,
) -> Array:
    if sum(option is not None for option in (n, node_arc_length, stations)) != 1:
        raise InputError("links_of needs exactly one of n, node_arc_length and stations: set one of them and leave the "
                         "others out")
    s = body.arc_length
    if n is not None:
        if n < 1:
            raise InputError(f"n, the number of links, must be 1 or more, not {n}")
        knots = equal_nodes(s, n)
    elif stations is not None:
        names = [str(name) for name in recording["station"].values]
        unknown = [name for name in stations if name not in names]
        if unknown:
            raise InputError(f"the recording has no station {', '.join(unknown)}: choose stations among "
                             f"{', '.join(names)}")
        knots = s[[names.index(name) for name in stations]]
    else:
        knots = np.array(node_arc_length, dtype=np.float64)
    tolerance = 1e-9 * s[-1]
    if knots.ndim != 1 or knots.size < 2 or not (np.diff(knots) > tolerance).all():
        raise InputError(f"nodes must increase in arc length from base to tip, but are at {np.round(knots, 6)} m")
    if knots[0] < -tolerance or knots[-1] > s[-1] + tolerance:
        raise InputError(f"nodes must be between 0 and {s[-1]:.6g} m along the body, not at {np.round(knots, 6)} m")
    return knots


def _node_matrix(s: Array, knots: Array) -> Array:
    nearest = np.abs(s[None, :] - knots[:, None]).argmin(axis=1)
    if np.allclose(s[nearest], knots, rtol=0, atol=1e-9 * s[-1]):
        return np.eye(s.size)[nearest]
    if s.size < 4:
        raise InputError(f"the shape has {s.size} stations, but nodes between stations need at least 4: choose nodes "
                         "at stations")
    return local_cubic_matrix(s, knots)


def _rest_frames(
    recording: xr.Dataset, time: Array, rest: tuple[float, float] | None
) -> tuple[NDArray[np.bool_], list[str]]:
    start, stop = (time[0], time[0] + REST_DURATION) if rest is None else rest
    still = (time >= start) & (time <= stop)
    if not still.any():
        raise InputError(
            f"the rest window {start:g} to {stop:g} s contains no complete frame: set rest within "
            f"{time[0]:g} to {time[-1]:g} s, the time of the recording"
        )
    notes = [f"rest shape: mean of {int(still.sum())} frame(s) from {start:g} to {stop:g} s"]
    if "pressure" in recording:
        clock = recording["pressure_time"].values
        pressure = np.abs(recording["pressure"].values).reshape(clock.size, -1)
        window = pressure[(clock >= start) & (clock <= stop)]
        if window.size and np.nanmax(window) > PRESSURE_AT_REST * np.nanmax(pressure) > 0:
            notes.append(f"the pressure reaches {np.nanmax(window):.0f} Pa in the rest window")
    return still, notes


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
