"""Functions that detect faults in arrays of tracked positions: spikes, jumps, repeated frames, noise. They change no
array.

Positions are (T, S, 3) or (T, S, 2) in metres with NaN for drop-outs, times are (T,) in seconds.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

BLOCK_STATIONS = 16
BLOCK_FRAMES = 512
MAD = 0.6745  # median absolute deviation of a unit normal
SPIKE_RATIO = 10.0  # least ratio of a fault to its surroundings
WINDOW = 6
ORIENTATION_JUMP = np.deg2rad(30.0)
GRID_SHARE, OFF_GRID = 0.5, 0.2  # most distinct values relative to all; tolerance of a whole number
LEAST_NOISE = 1e-9  # m and rad: recordings without noise keep finite weights
FLOOR_SHARE = 3e-3  # faults below this fraction of the station's peak displacement are ignored


def by_blocks(detector: Callable[..., NDArray], position: NDArray, *known: NDArray, overlap: int = 0) -> NDArray:
    """Apply the function `detector` to the positions (T, S, d) of S stations over T frames in d dimensions, a few
    stations at a time to save memory. Return the result for all stations as one array.

    `known` are arrays (S,) of which the detector receives the values of its stations. Its result has the stations last.
    With `overlap` = 1 it has one value for each pair of neighbours.
    """
    first = range(0, max(position.shape[1] - overlap, 1), BLOCK_STATIONS)
    blocks = [slice(i, i + BLOCK_STATIONS + overlap) for i in first]
    return np.concatenate([detector(position[:, b], *(values[b] for values in known)) for b in blocks], axis=-1)


def seen_points(position: NDArray, about: NDArray) -> Iterator[NDArray]:
    """Yield, for one block of frames after another, the measured positions [m] minus the reference positions `about`,
    as N points (N, d) in d dimensions. Points with NaN are left out.
    """
    for i in range(0, len(position), BLOCK_FRAMES):
        points = (position[i : i + BLOCK_FRAMES] - about).reshape(-1, position.shape[-1])
        yield points[np.isfinite(points).all(1)]


def mean_place(position: NDArray) -> NDArray:
    """Return the mean position (S, d) [m] over time of each of S stations in d dimensions; NaN for one that was never
    measured.
    """
    total, count = np.zeros(position.shape[1:]), np.zeros((position.shape[1], 1))
    for i in range(0, len(position), BLOCK_FRAMES):
        part = position[i : i + BLOCK_FRAMES]
        complete = np.isfinite(part).all(2, keepdims=True)
        total += np.where(complete, part, 0.0).sum(0)
        count += complete.sum(0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def repeated_frames(position: NDArray, quaternion: NDArray | None = None) -> NDArray:
    """Return a mask (T,) that is True for each of T frames in which all positions, and quaternions if any, equal those
    of the previous frame.
    """
    same, repeats = np.ones(len(position), dtype=bool), np.zeros(len(position), dtype=bool)
    for values in (position, quaternion):
        if values is None:
            continue
        flat = values.reshape(len(position), -1)
        for i in range(1, len(flat), BLOCK_FRAMES):
            now, before = flat[i : i + BLOCK_FRAMES], flat[i - 1 : i - 1 + BLOCK_FRAMES][: len(flat) - i]
            same[i : i + BLOCK_FRAMES] &= ((now == before) | (np.isnan(now) & np.isnan(before))).all(axis=1)
            repeats[i : i + BLOCK_FRAMES] |= np.isfinite(now).any(axis=1)
    return same & repeats


def noise_level(position: NDArray) -> NDArray:
    """Return the standard deviation (S,) [m] of the noise per coordinate of S stations, from their positions (T, S, d)
    [m] over T frames in d dimensions. It is NaN with fewer than 8 frames.

    Third differences of white noise have sqrt(20) times its deviation, and smooth motion has hardly any. The median
    excludes fast motion and faults.
    """
    if len(position) < 8:
        return np.full(position.shape[1], np.nan)
    third = np.diff(position, n=3, axis=0)
    return np.sqrt(np.mean((_nanmedian(np.abs(third)) / MAD) ** 2 / 20.0, axis=1))


def quantum(values: NDArray) -> float:
    """Return the resolution of a sensor from its values (T,) at T samples, in their unit; 0 where the values are not
    multiples of a step.

    Values are on a grid where few of them differ and every distance of neighbours is a whole number of the smallest.
    """
    finite = values[np.isfinite(values)]
    levels = np.unique(np.round(finite, 12))
    if not 3 <= len(levels) <= GRID_SHARE * len(finite):
        return 0.0
    apart = np.diff(levels)
    apart = apart[apart > 1e-6 * np.ptp(levels)]
    ratio = apart / apart.min()
    return float(np.sum(apart) / np.sum(np.rint(ratio))) if np.abs(ratio - np.rint(ratio)).max() < OFF_GRID else 0.0


def travel(position: NDArray) -> NDArray:
    """Return the peak displacement (S,) [m] of S stations relative to their median positions, computed from the
    positions (T, S, d) [m] over T frames in d dimensions. It is NaN for a station that was never measured.
    """
    distance = _lengths(position - _nanmedian(position))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmax(distance, axis=0)


def rms_deviation(position: NDArray) -> NDArray:
    """Return the root-mean-square displacement (S,) [m] of S stations relative to their mean positions, computed from
    the positions (T, S, d) [m] over T frames in d dimensions.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.sqrt(np.nansum(np.nanvar(position, axis=0), axis=1))


def spikes(position: NDArray, floor: NDArray | None = None) -> NDArray:
    """Return a mask (T, S) over T frames and S stations. It is True where a station leaves its path for a single frame
    and then returns.

    The residual against the cubic through two neighbours on each side must exceed its surroundings by far, and the
    steps to and from the frame must oppose each other. `floor` is the `fault_floor`, where it is known.
    """
    spiked = np.zeros(position.shape[:2], dtype=bool)
    if len(position) < 2 * WINDOW:
        return spiked
    x = position
    residual = np.zeros_like(x)
    residual[2:-2] = x[2:-2] - (4 * (x[1:-3] + x[3:-1]) - x[:-4] - x[4:]) / 6
    size = _lengths(residual)
    step = np.diff(x, axis=0)
    opposed = (step[:-1] * step[1:]).sum(2) < 0
    returned = _lengths(x[2:] - x[:-2]) < 0.5 * size[1:-1]
    largest = (size[1:-1] >= size[:-2]) & (size[1:-1] >= size[2:])
    spiked[1:-1] = opposed & returned & largest
    return spiked & _stands_out(size, 3, _floor_of(position) if floor is None else floor)


def without_spikes(position: NDArray) -> NDArray:
    """Return the positions (T, S, d) [m] of S stations over T frames in d dimensions, with NaN where a station leaves
    its path for a single frame, or for the frames that repeat it.
    """
    spiked = spiked_frames(position)
    return np.where(spiked[..., None], np.nan, position) if spiked.any() else position


def spiked_frames(position: NDArray, quaternion: NDArray | None = None) -> NDArray:
    """Return a mask (T, S) of the `spikes` of S stations over T frames. Frames that repeat the previous one count as
    one frame with it, as where a log runs faster than its tracker.
    """
    fresh = ~repeated_frames(position, quaternion)
    return by_blocks(spikes, position[fresh])[np.maximum(np.cumsum(fresh) - 1, 0)]


def spikes_bridged(position: NDArray) -> NDArray:
    """Return the positions (T, S, d) [m] of S stations over T frames in d dimensions. Where a station leaves its path
    for a single frame, its position is the mean of the neighbouring frames.
    """
    spiked = by_blocks(spikes, position)  # none in the first and the last frame
    if not spiked.any():
        return position
    result = position.copy()
    result[1:-1][spiked[1:-1]] = 0.5 * (position[:-2] + position[2:])[spiked[1:-1]]
    return result


def jumps(position: NDArray, time: NDArray, floor: NDArray | None = None) -> NDArray:
    """Return a mask (T, S) over T frames and S stations. It is True where a station suddenly moves and does not return.
    Steps across a gap in time are not counted.

    The step is compared with the velocities before and after it.
    """
    jumped = np.zeros(position.shape[:2], dtype=bool)
    if len(position) < 2 * WINDOW:
        return jumped
    dt = np.diff(time)
    step = np.diff(position, axis=0)
    velocity = step / dt[:, None, None]
    # step k leads from frame k to k + 1; its neighbours are the steps k - 1 and k + 1
    expected = 0.5 * (velocity[:-2] + velocity[2:]) * dt[1:-1, None, None]
    excess = np.zeros(step.shape[:2])
    excess[1:-1] = _lengths(step[1:-1] - expected)
    neighbours = _lengths(velocity[:-2]) + _lengths(velocity[2:])
    sudden = _stands_out(excess, 2, _floor_of(position) if floor is None else floor)
    sudden[1:-1] &= excess[1:-1] > 2.0 * neighbours * dt[1:-1, None]
    sudden &= (dt < 1.5 * np.median(dt))[:, None]
    jumped[1:] = sudden
    return jumped


def sign_flips(quaternion: NDArray) -> NDArray:
    """Return, for each of S stations, the number (S,) of frames in which its quaternion changes sign although its
    orientation hardly changes.
    """
    product = (quaternion[1:] * quaternion[:-1]).sum(2)
    return (product < -np.cos(0.5 * ORIENTATION_JUMP)).sum(0)


def orientation_jumps(quaternion: NDArray) -> NDArray:
    """Return, for each of S stations, the number (S,) of rotations by more than 30 degrees between two successive
    measured frames.

    A tracker that cannot distinguish the orientations of a symmetric marker cluster jumps between them.
    """
    counts = []
    for s in range(quaternion.shape[1]):
        q = quaternion[np.isfinite(quaternion[:, s]).all(1), s]
        half = np.arccos(np.clip(np.abs((q[1:] * q[:-1]).sum(1)), 0.0, 1.0))
        counts.append(int((2.0 * half > ORIENTATION_JUMP).sum()))
    return np.array(counts)


def stretched(position: NDArray, share: float) -> NDArray:
    """Return a mask (T, S - 1) over T frames and the pairs of neighbours among S stations. It is True where the
    distance of a pair differs from its median over time by more than the fraction `share` of that median.
    """
    spacing = _lengths(np.diff(position, axis=1))
    middle = _nanmedian(spacing)
    return np.abs(spacing - middle) > share * middle


def out_of_plane_share(position: NDArray) -> float:
    """Return the ratio (0 to 1) of the root-mean-square motion out of the plane of bending to the whole motion, from
    positions (T, S, d) [m] of S stations over T frames in d dimensions.

    That plane contains the mean chord from the first to the last station and the direction perpendicular to the chord
    with most motion. The plane of a single station is the one with most of its motion.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        centres = by_blocks(lambda part: np.nanmean(part, axis=0).T, position).T
    chord = np.nan_to_num(centres[-1] - centres[0])
    length = np.linalg.norm(chord)
    chord = chord / length if length > 0 else chord
    scatter, whole = np.zeros((position.shape[-1],) * 2), 0.0
    for moved in seen_points(position, centres):
        across = moved - (moved @ chord)[:, None] * chord
        scatter += across.T @ across
        whole += float((moved**2).sum())
    values = np.linalg.eigvalsh(scatter)[1 if length > 0 else 0:]  # the chord's own is zero
    return float(np.sqrt(max(values[0], 0.0) / max(whole, 1e-300)))


def fault_floor(noise: NDArray, travel: NDArray) -> NDArray:
    """Return the smallest sudden displacement (S,) [m] of S stations that counts as a fault, from their noise [m] and
    peak displacement [m].
    """
    return SPIKE_RATIO * np.nan_to_num(noise) + FLOOR_SHARE * np.nan_to_num(travel)


def _lengths(vectors: NDArray) -> NDArray:
    """Return the lengths (...) of vectors (..., 2 or 3), faster than NumPy for so few components."""
    return np.sqrt(sum(vectors[..., k] ** 2 for k in range(vectors.shape[-1])))


def _floor_of(position: NDArray) -> NDArray:
    return fault_floor(noise_level(position), travel(position))


def _stands_out(size: NDArray, hole: int, floor: NDArray) -> NDArray:
    """Return a mask (T, S) of values above the floor and far above the median of the frames around them.

    The median leaves out the frame itself and frames closer than `hole`. It is computed for values above the floor
    only, which are few.
    """
    outliers = np.zeros(size.shape, dtype=bool)
    rows, columns = np.nonzero(size > floor)
    offsets = np.array([k for k in range(-WINDOW, WINDOW + 1) if abs(k) >= hole])
    around = np.clip(rows[:, None] + offsets, 0, len(size) - 1)
    level = np.nan_to_num(_nanmedian(size[around, columns[:, None]].T))
    outliers[rows, columns] = size[rows, columns] > SPIKE_RATIO * level + floor[columns]
    return outliers


def _nanmedian(values: NDArray) -> NDArray:
    """Return the median over the first dimension, NaN where all is NaN; ten times as fast as NumPy's."""
    ordered, counts = np.sort(values, axis=0), np.count_nonzero(~np.isnan(values), axis=0)[None]  # NaN comes last
    low, high = (np.take_along_axis(ordered, np.maximum(k, 0), axis=0)[0] for k in ((counts - 1) // 2, counts // 2))
    return 0.5 * (low + high)


def white_noise(data: NDArray) -> NDArray:
    """Return the standard deviation (S, C) of white noise in the C coordinates of S stations, from second differences
    of `data` (T, S, C) over T frames.
    """
    bend = np.abs(np.diff(data, 2, axis=0))
    noise = np.full(data.shape[1:], 1.0)
    for index in np.ndindex(*noise.shape):
        column = bend[(slice(None), *index)]
        if np.isfinite(column).any():
            noise[index] = max(float(np.nanmedian(column)) / 0.6745 / np.sqrt(6.0), LEAST_NOISE)
    return noise
