"""Detect constant stretches in a recording: stations for which a tracker repeats the last position, and inputs that
were updated more slowly than they were logged.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.preprocessing.detectors import noise_level, repeated_frames
from pliant.recording import append_history
from pliant.recording.inputs import recorded_inputs
from pliant.recording.typed_steps import BETWEEN, HELD

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

LEAST_REPEATS = 3  # consecutive repeated frames: fewer occur by chance
GRID_STEPS = 3.0  # resolutions: a station whose next step is smaller may only be slow
BEYOND_NOISE = 6.0  # noise levels by which another station must move during the repeats
LEAP = 3.0  # times the next step: a body at rest starts to move with a smaller step
MOST_REPEATS = 1 / 3  # of the frames of a log that misses single frames; more are those of a slower tracker
LEAST_CHANGES = 20  # changes of an input: fewer are steps and pulses, not a staircase
ALIKE, SHORTER = 0.6, 0.1  # fractions of intervals: at least near the median; at most shorter, as by noise
Span = tuple[float, float, int]  # first and last time [s] and number of repeated frames


def frozen(position: NDArray, quaternion: NDArray | None = None) -> NDArray:
    """Return a mask (T, S) of S stations over T frames that is True where a tracker repeats a station's last position
    although the body moves.

    Such a station repeats every number for at least three frames, then steps by more than its resolution, while another
    station moved. Or all stations repeat their numbers, then leap, or a log misses single frames of a motion that goes
    on. The first frame of the repeated values is not marked.

    Parameters
    ----------
    position : (T, S, 2 or 3) array, m
    quaternion : (T, S, 4) array, optional
    """
    flat = position if quaternion is None else np.concatenate([position, quaternion], axis=-1)
    marked = np.zeros(position.shape[:2], dtype=bool)
    marked[stopped(position, flat) | missed(position, flat)] = True
    candidates = {s: runs(repeated_frames(flat[:, s])) for s in range(position.shape[1])}
    candidates = {s: spans for s, spans in candidates.items() if spans}
    if not candidates:
        return marked
    noise = np.nan_to_num(noise_level(position))
    for s, spans in candidates.items():
        steps = np.abs(np.diff(position[:, s], axis=0)).max(axis=1)
        moving = steps[steps > 0]
        if not moving.size:  # it never moves
            continue
        resolution = moving.min()
        others = np.arange(position.shape[1]) != s
        for start, stop in spans:  # frames start to stop - 1 repeat frame start - 1
            after = steps[stop - 1] if stop < len(position) else np.median(moving)
            part = position[start - 1 : stop, others]
            apart = np.sqrt(((part - part[:1]) ** 2).sum(2))
            apart = np.where(np.isfinite(apart), apart, 0.0).max(axis=0)
            if after > GRID_STEPS * resolution and (apart > BEYOND_NOISE * noise[others]).any():
                marked[start:stop, s] = True
    return marked


def stopped(position: NDArray, flat: NDArray) -> NDArray:
    """Return a mask (T,) over T frames. It is True while a tracker repeats the numbers of all stations, after which the
    body seems to leap. `flat` (T, S, D) are the D numbers of each of S stations in each frame.

    The leap must be larger than the step after it, and the wait longer than the repeats of a tracker that is slower
    than its log.
    """
    stops = np.zeros(len(position), dtype=bool)
    again = repeated_frames(flat)
    usual = np.median(np.diff(np.flatnonzero(~again))) if (~again).sum() > 1 else np.inf
    spans = [(a, b) for a, b in runs(again) if b - a >= LEAST_REPEATS * usual]
    if not spans:
        return stops
    apart = np.linalg.norm(np.diff(position, axis=0), axis=2)
    steps = np.where(np.isfinite(apart), apart, 0.0).max(axis=1)
    noise = float(np.nan_to_num(noise_level(position)).max())
    for start, stop in spans:
        later = steps[stop:][steps[stop:] > 0]
        if later.size and steps[stop - 1] > max(LEAP * later[0], BEYOND_NOISE * noise):
            stops[start:stop] = True
    return stops


def missed(position: NDArray, flat: NDArray) -> NDArray:
    """Return a mask (T,) over T frames. It is True where a log has no new frame during a motion: it repeats the numbers
    of all stations for one or two frames. `flat` (T, S, D) are the D numbers of each of S stations in each frame.

    A station moves in one direction before and after the repeats, by more than three times its resolution and its
    noise. A log that repeats more than a third of its frames, as for a slower tracker or a long rest, is not marked.
    """
    late = np.zeros(len(position), dtype=bool)
    again = repeated_frames(flat)
    spans = [(a, b) for a, b in runs(again, 1) if a > 1 and b < len(position) and b - a < LEAST_REPEATS]
    if not spans or again.mean() > MOST_REPEATS:
        return late
    step = np.diff(position, axis=0)
    sizes = np.abs(step).max(axis=2)
    resolution = np.where(np.isfinite(step) & (step != 0), np.abs(step), np.inf).min(axis=(0, 2))
    noise = noise_level(np.where(again[:, None, None], np.nan, position))
    least = GRID_STEPS * np.maximum(resolution, np.nan_to_num(noise))
    for start, stop in spans:
        before, after = start - 2, stop - 1
        onward = np.sum(step[before] * step[after], axis=1) > 0
        late[start:stop] = (onward & (sizes[before] > least) & (sizes[after] > least)).any()
    return late


def runs(flags: NDArray, least: int = LEAST_REPEATS) -> list[tuple[int, int]]:
    """Return (first index, last index + 1) of each run of at least `least` successive True values in a mask `flags`
    (T,).
    """
    edge = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edge[::2], edge[1::2], strict=True) if b - a >= least]


def frozen_spans(time: NDArray, names: list[str], marked: NDArray) -> dict[str, tuple[Span, ...]]:
    """Return, by station name, the intervals in which a tracker repeats the station's position: first time [s], last
    time [s], number of frames. The mask `marked` (T, S) is True there, for S stations over T frames.
    """
    return {
        name: tuple((float(time[a]), float(time[b - 1]), b - a) for a, b in runs(marked[:, s], 1))
        for s, name in enumerate(names) if marked[:, s].any()
    }  # fmt: skip


def leave_out_frozen(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with NaN wherever the tracker repeated the last position of a station although the body
    moved.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording with unprocessed positions; a recording without positions is returned unchanged.
    """
    if "position" not in recording:
        return recording
    marked = frozen(recording["position"].values, recording["quaternion"].values if "quaternion" in recording else None)
    return without_marked(recording, marked, "a station was frozen")


def without_marked(recording: xr.Dataset, marked: NDArray, why: str) -> xr.Dataset:
    """Return the recording with NaN for the poses of S stations that are marked (T, S), because `why`; the history
    counts them.
    """
    if not marked.any():
        return recording
    changed = {name: recording[name].copy(data=np.where(marked[..., None], np.nan, recording[name].values))
               for name in ("position", "quaternion") if name in recording}  # fmt: skip
    count = ", ".join(f"{n} {k}" for n, k in zip(recording["station"].values, marked.sum(axis=0), strict=True) if k)
    return append_history(recording.assign(changed), f"left out frames in which {why}: {count}")


def frozen_sentences(spans: dict[str, tuple[Span, ...]], stations: int) -> list[str]:
    """Return one sentence per station whose position a tracker repeated, with the longest intervals. One sentence
    covers all stations where their intervals are equal, and one the single frames that a log misses.
    """
    single = max((sum(n for _, _, n in listed if n < LEAST_REPEATS) for listed in spans.values()), default=0)
    said = []
    if single:
        said.append(f"the log has no new frame in {single} frames of the motion, and repeats the one before; studies "
                    "leave these frames out")  # fmt: skip
    spans = {name: tuple(span for span in listed if span[2] >= LEAST_REPEATS) for name, listed in spans.items()}
    spans = {name: listed for name, listed in spans.items() if listed}
    together = len(spans) == stations > 1 and len(set(spans.values())) == 1
    for name, listed in list(spans.items())[: 1 if together else None]:
        longest = sorted(sorted(listed, key=lambda span: -span[2])[:3])
        where = ", ".join(f"{a:.2f} to {b:.2f} s" for a, b, _ in longest)
        more = f" and {len(listed) - len(longest)} shorter" if len(listed) > len(longest) else ""
        whose = f"all {stations} stations are" if together else f"{name} is"
        when = "and then leap" if together else "while others move"
        said.append(f"{whose} frozen in {sum(span[2] for span in listed)} frames {when} ({where}{more}): "
                    "the tracker repeated the last position; studies leave these frames out")  # fmt: skip
    return said


def staircases(recording: xr.Dataset) -> dict[str, tuple[int, float]]:
    """Return, by name, the time between two updates (in samples and in seconds) of each input that was logged faster
    than it was updated.

    An input is held where the intervals between its changes are nearly equal and longer than a sample, and most changes
    are larger than its resolution. The only pressure of a recording has the name ``p``. Typed steps, which a reader
    held between the rows of a table, are no staircase.
    """
    stairs = {}
    for channel in recorded_inputs(recording):
        variable = "pressure" if channel.kind == "pressure" else "actuation"
        every = 1 if recording[variable].attrs.get(BETWEEN) == HELD else _interval(channel.values)
        if every > 1:
            stairs[channel.name or "p"] = (every, every * float(np.median(np.diff(channel.time))))
    return stairs


def _interval(values: NDArray) -> int:
    """Return the number of samples from one change of a held input to the next; 1 where it is not held."""
    step = np.diff(values)
    changed = np.flatnonzero(np.nan_to_num(step))
    if changed.size < LEAST_CHANGES:
        return 1
    size, apart = np.abs(step[changed]), np.diff(changed)
    every = int(np.median(apart))
    alike = np.abs(apart - every) <= (1 if every > 2 else 0)
    coarse = np.mean(size > 1.5 * size.min()) < 0.5
    shorter = (apart < every) & ~alike
    return 1 if coarse or np.mean(alike) < ALIKE or np.mean(shorter) > SHORTER else every


def staircase_sentences(held: dict[str, tuple[int, float]]) -> list[str]:
    """Return sentences on the inputs that were updated more slowly than logged: one sentence for all inputs with the
    same interval.
    """
    said = []
    for every, seconds in sorted(set(held.values())):
        names = ", ".join(n for n, v in held.items() if v == (every, seconds))
        said.append(f"held inputs: {names}, a new value every {every} samples ({1e3 * seconds:.3g} ms); "
                    'set staircase = "lines" to interpolate linearly between the changes')  # fmt: skip
    return said


def lines_between_changes(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with each stepwise constant input replaced by straight lines between its changes.

    Other inputs are unchanged. A value that stays longer than one and a half intervals is kept until one interval
    before the next change.
    """
    stairs = staircases(recording)
    if not stairs:
        return append_history(recording, "no input is a staircase: none was changed")
    changed: dict[str, NDArray] = {}
    columns = {"pressure": 0, "actuation": 0}
    for channel in recorded_inputs(recording):
        variable = "pressure" if channel.kind == "pressure" else "actuation"
        values = changed.setdefault(variable, recording[variable].values.reshape(len(channel.time), -1).copy())
        if (channel.name or "p") in stairs:
            values[:, columns[variable]] = _lines(channel.time, channel.values, stairs[channel.name or "p"][0])
        columns[variable] += 1
    data: dict[str, Any] = {n: recording[n].copy(data=v.reshape(recording[n].shape)) for n, v in changed.items()}
    return append_history(recording.assign(data), f"straight lines between the changes of {', '.join(stairs)}")


def _lines(time: NDArray, values: NDArray, every: int) -> NDArray:
    """Return values (P,) that are linear between the samples at which `values` change; NaN stays NaN."""
    finite = np.isfinite(values)
    rows = np.flatnonzero(finite)
    new = rows[np.concatenate([[True], np.diff(values[rows]) != 0])]
    late = new[1:][np.diff(new) > 1.5 * every] - every  # the last update that brought the same value
    knots = np.union1d(new, late[finite[late]])
    return np.where(finite, np.interp(time, time[knots], values[knots]), np.nan)
