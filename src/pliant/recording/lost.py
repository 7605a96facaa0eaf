"""Find the numbers that a tracker writes in place of a lost station, and turn them into gaps.

Many loggers cannot write "not seen". They write the position 0, 0, 0, or another fixed position, and the quaternion
0, 0, 0, 0. `without_lost` finds such a position by its exact numbers: the station leaps to it, and from it back to its
path. A station that rests at the position or passes through it arrives and leaves in steps of its usual size.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

ATTRIBUTE = "lost"
FEWEST = 8  # steps between other positions of the station, with which a leap is compared
NEAR = 4  # steps before and after a leap
LEAP = 3.0  # of the largest step near it
LONGEST_STEP = 4  # usual times between two updates: longer steps lead over gaps and are not compared
REPEATS = 3  # successive frames of one position, at least, where it is written only once
TWICE = 2  # such frames, where the position is impossible
FINE = 0.05  # most positions of a station that occur again, where they have many digits
STRETCH = 1.5  # times the largest distance between two stations of a body, at least, where one of them is lost
MOST_MARKS = 4  # positions that are tested for a station
ROUNDING = 1e-12  # difference from length 1 by rounding
NORM_TOLERANCE = 0.05  # a quaternion whose length differs more from 1 is no rotation
REFUSED = "quaternion that is incomplete or not of unit length"


class Path(NamedTuple):
    """The different successive positions of one station: R positions, without gaps and without repeats."""

    row: NDArray  # (R,) frame in which each begins
    point: NDArray  # (R, d) m
    label: NDArray  # (R,) the same number for the same position
    length: NDArray  # (R,) frames that it lasts


def lost_frames(position: NDArray) -> NDArray:
    """Return a mask (T, S) that is True where a tracker wrote a fixed position in place of a lost station.

    The position 0, 0, 0 counts wherever a station leaps to it and back. Another position counts if it does so several
    times, or lasts for several frames. If the numbers of a station are so coarse that positions recur by chance, the
    position must also be far from all others, or other stations must have it at the same time.

    Parameters
    ----------
    position : (T, S, d) array, m
        Positions of S stations over T frames in d dimensions as they were recorded; NaN for gaps.
    """
    marked = np.zeros(position.shape[:2], dtype=bool)
    for s in range(position.shape[1]):
        for marks in (repeated_marks, zero_mark):  # the second without the positions that the first finds
            path = path_of(np.where(marked[:, s, None], np.nan, position[:, s]))
            if path is not None:
                marked[:, s] |= frames_at(marks(path), path, position, s)
    return marked


def frames_at(marks: list[int], path: Path, position: NDArray, station: int) -> NDArray:
    """Return a mask (T,) of the frames in which a station's path is at one of the positions with the labels `marks`
    that stand for "lost". The positions (T, S, d) [m] are those of all stations.
    """
    lost = np.zeros(len(position), dtype=bool)
    for mark in marks:
        visits = visits_of(path, mark)
        if visits is not None and is_mark(path, visits, position, station):
            lost |= rows_of(path, visits, len(position))
    return lost


def path_of(position: NDArray) -> Path | None:
    """Return the path of one station from its positions (T, d) [m] over T frames; None if no position recurs."""
    rows = np.flatnonzero(np.isfinite(position).all(axis=1))
    points = position[rows] + 0.0  # -0.0 is 0.0
    if len(rows) <= FEWEST:
        return None
    changed = (points[1:] != points[:-1]).any(axis=1) | (np.diff(rows) > 1)
    first = np.concatenate([[0], np.flatnonzero(changed) + 1])
    point, length = points[first], np.diff(np.append(first, len(rows)))
    mixed = np.zeros(len(point), dtype=np.uint64)
    for column in np.ascontiguousarray(point).view(np.uint64).T:
        mixed = (mixed ^ column) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    label = np.unique(mixed, return_inverse=True)[1]
    if label.max() + 1 == len(label) and length.max() < TWICE and point.any(axis=1).all():
        return None
    return Path(rows[first], point, label, length)


def repeated_marks(path: Path) -> list[int]:
    """Return the labels of the positions beside 0, 0, 0 that may stand for a lost station: of those that recur or last
    long, the few with the largest steps to them and from them.
    """
    step = np.linalg.norm(np.diff(path.point, axis=0), axis=1)
    shorter = np.fmin(np.append(step, np.inf), np.insert(step, 0, np.inf))  # of the steps to and from each position
    counts = np.bincount(path.label)
    lasting = path.length >= TWICE * np.median(path.length)
    possible = np.unique(path.label[((counts[path.label] > 1) | lasting) & path.point.any(axis=1)])
    if possible.size == 0:
        return []
    total = np.bincount(path.label, weights=np.where(np.isfinite(shorter), shorter, 0.0))
    return possible[np.argsort(-total[possible] / counts[possible], kind="stable")][:MOST_MARKS].tolist()


def zero_mark(path: Path) -> list[int]:
    """Return the label of the position 0, 0, 0, if it is on the path."""
    return np.unique(path.label[~path.point.any(axis=1)]).tolist()


class Visits(NamedTuple):
    """The V times at which a path is at one position, compared with the rest of the path."""

    run: NDArray  # (V,) positions of the path
    into: NDArray  # (V,) step to it, relative to the largest step near it; inf at the begin of the recording
    away: NDArray  # (V,) step from it; inf at the end of the recording
    ends: NDArray  # (V,) whether the recording begins or ends with it
    others: NDArray  # (R - V,) the other positions of the path
    steps: int  # number of steps between the others


def visits_of(path: Path, mark: int) -> Visits | None:
    """Return the visits of a path to the position with the label `mark`; None if there is no other position."""
    run, others = np.flatnonzero(path.label == mark), np.flatnonzero(path.label != mark)
    if others.size == 0:
        return None
    apart = np.diff(path.row[others])
    step = np.linalg.norm(np.diff(path.point[others], axis=0), axis=1)
    step[(step == 0) | (apart > LONGEST_STEP * np.median(apart) if apart.size else apart > 0)] = np.nan
    steps = int(np.isfinite(step).sum())
    step = step if steps else np.zeros(1)
    after = np.searchsorted(others, run)  # index among the others of the next one
    near = after[:, None] + np.arange(-NEAR, NEAR + 1) - 1  # step k leads from other k to k + 1
    beside = np.where((near >= 0) & (near < len(step)), step[np.clip(near, 0, len(step) - 1)], np.nan)
    largest = np.fmax.reduce(beside, axis=1)
    largest = np.maximum(np.where(np.isnan(largest), np.nanmax(step), largest), np.finfo(float).tiny)
    point = path.point[run[0]]
    away = np.linalg.norm(path.point[others] - point, axis=1)
    with np.errstate(over="ignore"):  # beside steps of 0
        into = np.where(after > 0, away[np.maximum(after - 1, 0)] / largest, np.inf)
        out = np.where(after < len(others), away[np.minimum(after, len(others) - 1)] / largest, np.inf)
    return Visits(run, into, out, (after == 0) | (after == len(others)), others, steps)


def is_mark(path: Path, visits: Visits, position: NDArray, station: int) -> bool:
    """Return whether the visits of a station's path to one position show that the position stands for "lost"."""
    leaps = (visits.into > LEAP) & (visits.away > LEAP)
    if not leaps.any():
        return False
    point, rest = path.point[visits.run[0]], path.point[visits.others]
    recurs = np.bincount(path.label)[path.label[visits.others]] > 1
    known = visits.steps >= FEWEST
    fine = known and recurs.mean() < FINE
    extent = float(np.linalg.norm(np.ptp(rest, axis=0)))
    far = known and float(np.linalg.norm(rest - point, axis=1).min()) > extent
    odd = impossible(position, station, path.row[visits.run[leaps]], path.row[visits.others])
    if not (fine or odd or far):
        return False
    if not point.any():
        return True
    longer = path.length[visits.run].sum() > path.length[visits.others].sum()
    if longer or (np.fmin(visits.into, visits.away) < 1.0).any():  # it is where the station rests
        return False
    lasts = path.length[visits.run] >= (TWICE if odd else max(
        REPEATS, LEAP * np.percentile(path.length[visits.others], 90)))  # fmt: skip
    twice = np.count_nonzero(leaps & ~visits.ends) > 1
    once = leaps & lasts & (far | odd | ~visits.ends)
    return bool(twice or ((fine or odd) and once.any()))


def impossible(position: NDArray, station: int, rows: NDArray, others: NDArray) -> bool:
    """Return whether a station cannot be on the body in the frames `rows`: another station has exactly its position, or
    is much farther from it than in any of the frames `others`.
    """
    apart = np.linalg.norm(position - position[:, station : station + 1], axis=2)
    apart[:, station] = np.nan
    usual = np.nan_to_num(np.fmax.reduce(apart[others], axis=0), nan=np.inf)
    least = np.nan_to_num(np.fmin.reduce(apart[others], axis=0))
    wrong = (apart[rows] > STRETCH * usual) | ((apart[rows] == 0) & (least > 0))
    return bool(wrong.any(axis=1).all())


def rows_of(path: Path, visits: Visits, frames: int) -> NDArray:
    """Return a mask (frames,) of the frames of all visits that leap, or that differ from the path by more than a usual
    step.
    """
    marked = np.zeros(frames, dtype=bool)
    for k in visits.run[(np.fmax(visits.into, visits.away) > 1.0)]:
        marked[path.row[k] : path.row[k] + path.length[k]] = True
    return marked


def without_lost(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with gaps where a tracker wrote numbers in place of a lost station, see `lost_frames`. The
    history and the attribute ``lost`` count them.
    """
    if "position" not in recording:
        return recording
    position = recording["position"].values
    marked = lost_frames(position)
    if not marked.any():
        return recording
    changed = {name: recording[name].copy(data=np.where(marked[..., None], np.nan, recording[name].values))
               for name in ("position", "quaternion") if name in recording}  # fmt: skip
    if "angle" in recording:
        changed["angle"] = recording["angle"].copy(data=np.where(marked, np.nan, recording["angle"].values))
    reasons: dict[str, dict[str, int]] = {}
    for s in np.flatnonzero(marked.any(axis=0)):
        points, counts = np.unique(position[marked[:, s], s] + 0.0, axis=0, return_counts=True)
        reasons[str(recording["station"].values[s])] = {
            f"position exactly {', '.join(f'{v:.6g}' for v in point)}": int(n)
            for point, n in zip(points, counts, strict=True)
        }
    return counted(recording.assign(changed), reasons)


def counted(recording: xr.Dataset, reasons: dict[str, dict[str, int]]) -> xr.Dataset:
    """Return the recording with frames of lost stations added to its attribute ``lost`` and its history. `reasons` are
    the numbers of frames by station and by what the tracker wrote.
    """
    listed = known_losses(recording)
    for station, counts in reasons.items():
        for reason, n in counts.items():
            listed.setdefault(station, {})[reason] = listed.get(station, {}).get(reason, 0) + n
    history = [str(recording.attrs.get("history", "")), *loss_sentences(reasons)]
    return recording.assign_attrs({ATTRIBUTE: json.dumps(listed), "history": "\n".join(filter(None, history))})


def known_losses(recording: xr.Dataset) -> dict[str, dict[str, int]]:
    """Return, by station and by what the tracker wrote, the numbers of frames in which a station was lost."""
    try:
        stored = json.loads(str(recording.attrs.get(ATTRIBUTE, "{}")))
        return {str(s): {str(r): int(n) for r, n in of.items()} for s, of in stored.items()}
    except (ValueError, AttributeError, TypeError):  # the attribute of another program
        return {}


def loss_sentences(losses: dict[str, dict[str, int]]) -> list[str]:
    """Return a sentence for each thing that a tracker wrote in place of lost stations, with the frames by station."""
    reasons = dict.fromkeys(reason for counts in losses.values() for reason in counts)
    return [f"lost by the tracker, which wrote a {reason}; read as gaps: "
            f"{listed({s: counts[reason] for s, counts in losses.items() if reason in counts})}" for reason in reasons]


def listed(counts: dict[str, int]) -> str:
    """Return the counts of up to six stations as a text, such as "tip 5, base 2"."""
    if len(counts) > 6 and len(set(counts.values())) == 1:
        return f"{next(iter(counts.values()))} in each of {len(counts)} stations"
    largest = sorted(counts.items(), key=lambda item: -item[1])
    more = f" and {len(counts) - 6} more" if len(counts) > 6 else ""
    return ", ".join(f"{name} {count}" for name, count in largest[:6]) + more


def unit_poses(quaternion: NDArray, position: NDArray | None) -> tuple[NDArray, NDArray | None, NDArray, NDArray]:
    """Return quaternions of length 1, the positions, the number of refused frames (S,) of each station, and a mask (S,)
    of stations without orientation.

    A quaternion (T, S, 4) whose length differs from 1 by less than 0.05 is normalised. Another one is refused: it and
    the position (T, S, d) of its frame become NaN, since a tracker that loses a body loses both. A station whose
    quaternions are all 0, 0, 0, 0 has no orientation, but keeps its positions. A station without a valid quaternion is
    left as it is otherwise.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # 1e999 is no quaternion either
        norm = np.linalg.norm(quaternion, axis=-1)
    good = np.abs(norm - 1.0) < NORM_TOLERANCE
    stated = ~np.isnan(quaternion).all(axis=-1)
    bare = stated.any(axis=0) & ((norm == 0) | ~stated).all(axis=0)
    refused = ~good & stated & good.any(axis=0)
    scale = np.where(good & (np.abs(norm - 1.0) > ROUNDING), norm, 1.0)  # a unit quaternion keeps its bits
    unit = np.where((refused | bare)[..., None], np.nan, quaternion / scale[..., None])
    if position is not None and position.shape[:2] == refused.shape:
        position = np.where(refused[..., None], np.nan, position)
    return unit, position, refused.sum(axis=0), bare
