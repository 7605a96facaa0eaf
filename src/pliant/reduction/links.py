"""Fit a chain of rigid links to the shape of a body: each link is the chord between two nodes on the curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.numerics.joint_rotations import swing_matrices
from pliant.numerics.spline import local_cubic_matrix
from pliant.reduction.body import body_of
from pliant.reduction.joints import LinkPoint, beside_links, joints_in_plane, joints_in_space
from pliant.reduction.placement import equal_nodes

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

    from pliant.reduction.body import BodyShape

    Array = NDArray[np.float64]

REST_DURATION = 0.1
PRESSURE_AT_REST = 0.05  # of the range of the pressure


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
        places = np.asarray(place, dtype=np.float64)
        return beside_links(places, float(self.node_arc_length[0]), self.link_length, self.rest_rotation)

    def to_xarray(self) -> xr.Dataset:
        """Return link lengths, joint angles and positions of the link tips over time as an `xarray.Dataset`."""
        import xarray as xr

        def described(dims: tuple[str, ...], values: object, units: str, long_name: str) -> object:
            return (dims, values, {"units": units, "long_name": long_name})

        d = len(self.base)
        turn = "joint" if d == 2 else "coordinate"
        data = {
            "joint_angle": described(("time", turn), self.joint_angle, "rad", "joint angle from rest"),
            "tip": described(("time", "link", "axis"), self.tips, "m", "measured position of the link tips"),
            "residual": described(("time", "link"), self.residual, "m", "distance of the chain from the tips"),
            "link_length": described(("link",), self.link_length, "m", "link length"),
            "rest_angle": described((turn,), self.rest_angle, "rad", "joint angle at rest"),
            "length_variation": described(("link",), self.length_variation, "1", "relative range of the length"),
            "node_arc_length": described(("node",), self.node_arc_length, "m", "arc length of the nodes"),
            "base": described(("axis",), self.base, "m", "position of the base"),
        }
        clock = described(("time",), self.time, "s", "time on the clock of the shape")
        coords = {"time": clock, "axis": list("xyz"[:d])}
        if d == 3:
            coords["coordinate"] = [f"{letter}_{k + 1}" for k in range(self.n) for letter in "ab"]
        return xr.Dataset(data, coords, {"notes": "\n".join(self.notes)})


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
        raise InputError("nodes between stations need at least 4 stations: choose nodes at stations")
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
