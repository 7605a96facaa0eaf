"""Detect frames in which a tracker exchanged the labels of stations, and exchange the labels back, or replace the
positions of these stations in these frames by NaN.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from pliant.display import body_svg
from pliant.preprocessing import detectors
from pliant.recording.schema import append_history, check_holds

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

SHORTER = 0.25  # labels are exchanged where that shortens the steps of their points to this fraction
FAST = 4.0  # median steps of a station: a shorter step is not suspected
LONGEST_GAP_S = 0.2  # s between two measured samples that are compared


def label_order(position: NDArray, time: NDArray) -> NDArray[np.intp]:
    """Return an index (T, S): the number of the label under which the tracker recorded each of S stations in each of T
    frames.

    The index is 0, 1, ... where no labels are exchanged.

    Frames in which a station leaps are examined. Where points continue under the labels of other points, those have
    exchanged labels. The order that most frames have is taken as right.

    Parameters
    ----------
    position : (T, S, 2 or 3) array, m
        NaN for drop-outs.
    time : (T,) array, s
    """
    frames, stations = position.shape[:2]
    order = np.tile(np.arange(stations), (frames, 1))
    if frames < 4:  # no step is the usual one
        return order
    points, last = position, _last_seen(position)
    for t in _suspects(position, last, time):
        follows = _continuation(points, last, time, t)
        if follows is not None:  # from here on each station is where its point went on
            points = points.copy() if points is position else points
            moved = np.flatnonzero(follows != np.arange(stations))
            points[t:, moved] = points[t:, follows[moved]]
            order[t:, moved] = order[t:, follows[moved]]
            last[:, moved] = _last_seen(points[:, moved])
    rows, counts = np.unique(order, axis=0, return_counts=True)
    usual = rows[int(np.argmax(counts))]
    return np.asarray(order[:, np.argsort(usual)])


def exchanged(position: NDArray, time: NDArray, names: list[str]) -> dict[str, int]:
    """Return the number of frames in which a tracker exchanged the labels of stations, by the stations concerned, such
    as {"p2-p3": 20}.
    """
    order = label_order(position, time)
    wrong = order != np.arange(len(names))
    counts: dict[str, int] = {}
    for row in np.flatnonzero(wrong.any(axis=1)):
        for cycle in _cycles(order[row]):
            key = "-".join(names[i] for i in cycle)
            counts[key] = counts.get(key, 0) + 1
    return counts


def undo_swaps(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording in which labels of stations that a tracker exchanged are exchanged back, so that each
    station continues its own motion.
    """
    return _repaired(recording, undo=True)


def exclude_swaps(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with NaN for each station in those frames in which a tracker exchanged its label."""
    return _repaired(recording, undo=False)


def _repaired(recording: xr.Dataset, *, undo: bool) -> xr.Dataset:
    check_holds(recording, "position", "detecting exchanged labels", "leave swaps out")
    names = [str(n) for n in recording["station"].values]
    order = label_order(recording["position"].values, recording["time"].values)
    listed = ", ".join(
        f"{n} {c}" for n, c in exchanged(recording["position"].values, recording["time"].values, names).items()
    )
    wrong = order != np.arange(len(names))
    for name in ("position", "quaternion", "angle"):
        if name in recording:
            values = recording[name].values
            index = order.reshape(*order.shape, *[1] * (values.ndim - 2))
            gone = wrong.reshape(index.shape)
            new = np.take_along_axis(values, index, axis=1) if undo else np.where(gone, np.nan, values)
            recording = recording.assign({name: recording[name].copy(data=new)})
    what = "exchanged labels are undone" if undo else "stations with exchanged labels are left out"
    return append_history(recording, f"{what}, frames: {listed or 'none'}")


def _last_seen(position: NDArray) -> NDArray[np.intp]:
    """Return the last frame (T, S) before each frame in which a station was seen; -1 where there is none."""
    finite = np.isfinite(position).all(2)
    frame = np.where(finite, np.arange(len(position))[:, None], -1)
    before = np.maximum.accumulate(frame, axis=0)
    return np.concatenate([np.full((1, position.shape[1]), -1), before[:-1]])


def _suspects(position: NDArray, last: NDArray[np.intp], time: NDArray) -> NDArray[np.intp]:
    """Return the frames in which a station steps much farther than its median step and its noise."""
    sizes = (detectors.by_blocks(f, position) for f in (detectors.noise_level, detectors.travel))
    floor = detectors.fault_floor(*sizes)
    columns = np.arange(position.shape[1])
    leaps = np.zeros(position.shape[:2], dtype=bool)
    step = detectors.by_blocks(lambda part: np.sqrt((np.diff(part, axis=0) ** 2).sum(2)), position)
    usual = np.nan_to_num(np.nanmedian(np.where(np.isfinite(step).any(0), step, 0.0), axis=0))
    near = (last >= 0) & (time[:, None] - time[last] <= LONGEST_GAP_S)
    for i in range(1, len(position), detectors.BLOCK_FRAMES):
        rows = slice(i, i + detectors.BLOCK_FRAMES)
        way = position[rows] - position[last[rows], columns]
        leaps[rows] = near[rows] & (np.sqrt((way**2).sum(2)) > FAST * usual + floor)
    return np.flatnonzero(leaps.any(axis=1))


def _continuation(position: NDArray, last: NDArray[np.intp], time: NDArray, t: int) -> NDArray[np.intp] | None:
    """Return the label (S,) under which each station's point continues at frame t; None without a change.

    The label of a point that is hidden at frame t may be on another point. The hidden point then gets a free label.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial import cKDTree
    from scipy.spatial.distance import cdist

    recent = last[t] >= 0
    recent[recent] &= time[t] - time[last[t][recent]] <= LONGEST_GAP_S
    points = np.flatnonzero(recent)
    labels = np.flatnonzero(recent & np.isfinite(position[t]).all(1))
    expected, measured = _expected(position, last, time, t, points), position[t, labels]
    mine = np.searchsorted(points, labels)
    shortest, nearest = cKDTree(expected).query(measured)
    own = np.sqrt(((expected[mine] - measured) ** 2).sum(axis=1))
    if not np.any((nearest != mine) & (shortest <= SHORTER * own)):  # then no exchange is that much shorter
        return None
    away = cdist(expected, measured)
    rows, columns = linear_sum_assignment(away)
    own_row = mine[columns]
    moved = rows != own_row
    if not moved.any() or away[rows, columns][moved].sum() > SHORTER * away[own_row, columns][moved].sum():
        return None
    order = np.full(position.shape[1], -1)
    order[points[rows]] = labels[columns]
    left = np.flatnonzero(order < 0)
    free = np.setdiff1d(np.arange(order.size), order)
    stays = np.isin(left, free)
    order[left[stays]] = left[stays]
    order[left[~stays]] = np.setdiff1d(free, left[stays])
    return order


def _expected(
    position: NDArray, last: NDArray[np.intp], time: NDArray, t: int, which: NDArray[np.intp]
) -> NDArray:
    """Return the expected positions of the stations `which` at frame t, extrapolated from their last two sightings."""
    latest = last[t, which]
    two = last[latest, which]
    start = position[latest, which]
    known = (two >= 0) & (time[latest] - time[two] <= LONGEST_GAP_S)
    ahead = (time[t] - time[latest]) / np.where(known, time[latest] - time[two], np.inf)
    return start + ahead[:, None] * np.where(known[:, None], start - position[two, which], 0.0)


def _cycles(order: NDArray[np.intp]) -> list[list[int]]:
    """Return the groups of stations that exchange labels among themselves."""
    left, cycles = {i for i, label in enumerate(order) if label != i}, []
    while left:
        start = min(left)
        cycle, label = [start], int(order[start])
        while label != start:
            cycle.append(label)
            label = int(order[label])
        cycles.append(sorted(cycle))
        left -= set(cycle)
    return cycles


INSTANTS, MOST_FRAMES, MOST_STATIONS = 5, 400, 60  # that are drawn; a longer or denser recording is thinned


def recording_svg(recording: xr.Dataset, title: str) -> str:
    """Return an SVG drawing of the body at five instants, in the plane of its motion.

    The instants run from the first frame to the largest displacement of the last station. The first station is at the
    bottom, the line from it to the last station upright. Stations with faults are drawn as recorded.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording; positions (T, S, 2 or 3), m.
    title : str
        Text for readers who cannot see the drawing.

    Returns
    -------
    str
        Empty where fewer than two frames show all stations, or there are fewer than two stations.
    """
    if "position" not in recording or min(recording.sizes["time"], recording.sizes["station"]) < 2:
        return ""
    frames = np.unique(np.linspace(0, recording.sizes["time"] - 1, MOST_FRAMES).astype(int))
    stations = np.unique(np.linspace(0, recording.sizes["station"] - 1, MOST_STATIONS).astype(int))
    position = recording["position"].values[frames][:, stations]
    whole = np.flatnonzero(np.isfinite(position).all(axis=(1, 2)))
    if whole.size < 2:
        return ""
    projected = on_plane(position - position[whole[0], 0], whole)
    away = np.linalg.norm(projected[whole, -1] - projected[whole[0], -1], axis=1)
    reached = [int(whole[np.argmax(away >= f * away.max())]) for f in np.linspace(0, 1, INSTANTS)]
    return body_svg([*(("measured", projected[k]) for k in dict.fromkeys(reached)), ("path", projected[:, -1])], title)


def on_plane(position: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Return the coordinates (T, S, 2) [m] of S stations over T frames in the plane of most motion: across and along
    the line from the first to the last station.

    `whole` holds the indices of frames that show all stations.
    """
    first = position[whole[0]]
    up = first[-1] - first[0]
    length = float(np.linalg.norm(up))
    up = up / length if length > 0 else np.eye(position.shape[-1])[1]
    moved = (position[whole] - first).reshape(-1, position.shape[-1])
    across = moved - np.outer(moved @ up, up)
    along = np.linalg.svd(across, full_matrices=False)[2][0]
    along = along - (along @ up) * up
    size = float(np.linalg.norm(along))
    if size < 0.5:  # nothing moves across the line: any direction across it
        along = np.eye(position.shape[-1])[int(np.argmin(np.abs(up)))]
        along = along - (along @ up) * up
        size = float(np.linalg.norm(along))
    along = along / size
    farthest = moved[np.argmax(np.linalg.norm(moved, axis=1))] @ along
    return np.stack([position @ along * (1.0 if farthest >= 0 else -1.0), position @ up], axis=-1)
