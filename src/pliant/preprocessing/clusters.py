"""Replace each cluster of markers on one rigid part by one station with a position and an orientation."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing.rotations import best_rotation, from_matrix
from pliant.recording import append_history, check_recording, make_recording
from pliant.recording.mapping import FileMapping
from pliant.recording.schema import refuse_loss

if TYPE_CHECKING:
    from collections.abc import Mapping

    import xarray as xr
    from numpy.typing import NDArray

FLATNESS = 0.02  # markers on a line closer than this share of their extent fix no orientation
PASSES = 4  # of averaging the shape; it settles to rounding in two


class Cluster(FileMapping):
    """Definition of a station by the markers on one rigid part: their names and the point that is the station's
    position.

    Attributes
    ----------
    markers : list of str
        Names of markers; ``*`` and ``?`` stand for any characters.
    point : str, optional
        Marker at the position of the station. Default: the centroid of the markers.
    offset : 3 floats, m, optional
        Offset from `point` to the position of the station, along the tracker's axes in the first frame.
    role : {"base", "body", "tip"}, optional
        Default: base when the station's name begins with ``base``.
    """

    markers: list[str]
    point: str | None = None
    offset: tuple[float, float, float] | None = None
    role: Literal["base", "body", "tip"] | None = None


def assemble(
    recording: xr.Dataset, mapping: Mapping[str, Any], *, tolerance_mm: float = 1.0
) -> xr.Dataset:
    """Return a recording in which each cluster of markers on a rigid part is replaced by one station with position and
    orientation.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording whose stations are markers.
    mapping : dict
        List of marker names, or a dict with the entries of `Cluster`, by station name, from base to tip.
    tolerance_mm : float
        Largest deviation from rigidity in mm, as the 95th percentile over frames of the root-mean-square
        residual of the markers.

    Returns
    -------
    xarray.Dataset
        Position of each station and, from three markers that are not on one line, its quaternion: the
        rotation since the first frame in which all its markers were seen. Coordinate ``rigidity``
        (station) holds the residual in metres. Frames with too few markers stay NaN and are counted.

    Raises
    ------
    InputError
        For an unknown marker (the message lists the known ones), a marker in two clusters, two base
        clusters, or markers that do not move as one rigid part.
    """
    check_recording(recording)
    if "position" not in recording or recording.attrs["frame"] != "tracker":
        raise InputError("clusters are assembled from positions in the tracker's frame: assemble them before the "
                         "alignment")
    clusters = _load(mapping)
    members = _members(clusters, [str(n) for n in recording["station"].values])
    shape = (recording.sizes["time"], len(members))
    centres, quaternion, residual, history = np.empty((*shape, 3)), np.empty((*shape, 4)), np.empty(shape[1]), []
    for k, (name, markers) in enumerate(members.items()):
        centres[:, k], quaternion[:, k], residual[k], line = _station(
            recording, name, clusters[name], markers, tolerance_mm * 1e-3
        )
        history.append(line)
    used = {m for markers in members.values() for m in markers}
    unused = [str(n) for n in recording["station"].values if str(n) not in used]
    if unused:
        history.append(f"{len(unused)} marker(s) belong to no cluster and were left out: {', '.join(unused)}")
    assembled = make_recording(
        recording["time"].values, centres, station=list(members),
        quaternion=quaternion if np.isfinite(quaternion).any() else None, attrs=dict(recording.attrs),
    )  # fmt: skip
    others = recording.drop_vars(["position", "quaternion", "station", "component", "arc_length"], errors="ignore")
    others = others.drop_dims("station", errors="ignore")
    assembled = others.merge(assembled, combine_attrs="override").assign_attrs(assembled.attrs)
    refuse_loss(recording, assembled, "assembling clusters", ("quaternion",))
    rigidity = ("station", residual,
                {"units": "m", "long_name": "deviation of the markers from a rigid body"})  # fmt: skip
    return check_recording(append_history(assembled.assign_coords(rigidity=rigidity), *history))


def _load(mapping: Mapping[str, Any]) -> dict[str, Cluster]:
    if not mapping:
        raise InputError("there is no cluster: name at least one station and its markers")
    clusters = {}
    for name, value in mapping.items():
        options = {"markers": [value]} if isinstance(value, str) else value
        options = options if hasattr(options, "items") else {"markers": list(options)}
        clusters[name] = Cluster.load(options, f"station {name!r}")
    bases = [n for n, c in clusters.items() if (c.role or n.lower()[:4]) == "base"]
    if len(bases) > 1:
        raise InputError(
            f"{len(bases)} clusters have the role base: {', '.join(bases)}; put all markers of the base into one "
            'cluster, or set role = "body" for the others'
        )
    return clusters


def _members(clusters: dict[str, Cluster], available: list[str]) -> dict[str, list[str]]:
    members: dict[str, list[str]] = {}
    owner: dict[str, str] = {}
    for name, cluster in clusters.items():
        members[name] = []
        for pattern in cluster.markers:
            exact = [pattern] if pattern in available else []
            names = exact or [m for m in available if fnmatchcase(m, pattern)]
            if not names:
                raise InputError(f"station {name!r} names a marker {pattern!r} that is not in the recording: correct "
                                 f"the name; available: {', '.join(available)}")  # fmt: skip
            for marker in names:
                if owner.setdefault(marker, name) != name:
                    raise InputError(f"marker {marker!r} belongs to two stations, {owner[marker]!r} and "
                                     f"{name!r}: assign it to one of them")  # fmt: skip
                if marker not in members[name]:
                    members[name].append(marker)
        if cluster.point is not None and cluster.point not in members[name]:
            raise InputError(f"point {cluster.point!r} of station {name!r} is not among its markers: set point "
                             f"to one of {', '.join(members[name])}")  # fmt: skip
        if not members[name]:
            raise InputError(f"station {name!r} has no marker: name its markers")
    return members


def _station(
    recording: xr.Dataset, name: str, cluster: Cluster, markers: list[str], tolerance: float
) -> tuple[NDArray, NDArray, float, str]:
    """Return position (T, 3), quaternion (T, 4), rigidity [m] and a history line of one station."""
    points = recording["position"].sel(station=markers).values
    complete = np.isfinite(points).all((1, 2))
    if not complete.any():
        raise InputError(f"the markers of station {name!r} are not all seen in any frame: leave out a marker that "
                         "is often hidden")
    shape = points[np.argmax(complete)]
    unturned = np.full((len(points), 4), np.nan)
    if not _fixes_orientation(shape):
        if cluster.offset is not None:
            raise InputError(f"station {name!r} has an offset, which needs an orientation: give it three markers "
                             "that are not on one line")  # fmt: skip
        middle = points.mean(1) if cluster.point is None else points[:, markers.index(cluster.point)]
        lost = int(np.isnan(middle).any(1).sum())
        line = f"station {name}: position of {len(markers)} marker(s), no orientation{_lost(lost)}"
        return middle, unturned, float("nan"), line
    shape = _mean_shape(shape, points[complete])
    rotation, centre, residual = _poses(shape, points)
    limit = float(np.nanpercentile(residual, 95))
    if limit > tolerance:
        raise InputError(
            f"the markers of station {name!r} do not move as one rigid part: they deviate by "
            f"{1e3 * limit:.2f} mm (95 % of the frames), more than {1e3 * tolerance:.2f} mm; check their names"
        )
    anchor = np.zeros(3) if cluster.point is None else shape[markers.index(cluster.point)]
    if cluster.offset is not None:
        anchor = anchor + np.asarray(cluster.offset)
    lost = int(np.isnan(residual).sum())
    line = (f"station {name}: pose of {len(markers)} markers, rigid within {1e3 * limit:.3f} mm "
            f"(95 % of the frames){_lost(lost)}")  # fmt: skip
    return rotation @ anchor + centre, from_matrix(rotation), limit, line


def _lost(count: int) -> str:
    return f", {count} frame(s) lack markers and stay NaN" if count else ""


def _fixes_orientation(shape: NDArray) -> bool:
    if len(shape) < 3:
        return False
    values = np.linalg.svd(shape - shape.mean(0), compute_uv=False)
    return bool(values[1] > FLATNESS * values[0])


def _mean_shape(first: NDArray, points: NDArray) -> NDArray:
    """Return the mean of points (T, N, 3) in a frame that moves with them; centred, turned as in the first frame."""
    shape = first
    centred = points - points.mean(1, keepdims=True)
    for _ in range(PASSES):
        rotation = best_rotation(shape, points)
        shape = np.einsum("tji,tnj->tni", rotation, centred).mean(0)
    return shape @ best_rotation(shape, first[None])[0].T


def _poses(shape: NDArray, points: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return rotation (T, 3, 3), centre (T, 3) and residual (T,) of each frame, from the markers that are seen."""
    frames = len(points)
    rotation = np.full((frames, 3, 3), np.nan)
    centre, residual = np.full((frames, 3), np.nan), np.full(frames, np.nan)
    complete = np.isfinite(points).all(2)
    for pattern in np.unique(complete, axis=0):
        if not _fixes_orientation(shape[pattern]):
            continue
        rows = np.flatnonzero((complete == pattern).all(1))
        part = points[np.ix_(rows, np.flatnonzero(pattern))]
        turn = best_rotation(shape[pattern], part)
        shift = part.mean(1) - turn @ shape[pattern].mean(0)
        misfit = part - (np.einsum("tij,nj->tni", turn, shape[pattern]) + shift[:, None])
        rotation[rows], centre[rows] = turn, shift
        residual[rows] = np.sqrt((misfit**2).sum(2).mean(1))
    return rotation, centre, residual
