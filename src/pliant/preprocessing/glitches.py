"""Detect updates of an input that its neighbours and its sister channels contradict, and interpolate over them.

A log of pressures may hold single values that no body ever saw, such as 28 psi between 0 and 2 psi. Such a value leaps
away from the series and back. It counts as a glitch only if other inputs that usually vary alike stay where they are,
or if it lies far outside all other values of the input.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.recording import append_history
from pliant.recording.inputs import recorded_inputs

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from pliant.recording.inputs import RecordedInput

FEWEST = 20  # updates of an input: with fewer its usual step is not known
LEAP = 10.0  # of the usual step, at least, from a series to a glitch
OF_RANGE = 0.25  # of the usual range of the input, at least
RETURNED = 0.3  # of the leap: the series goes on at least this near
LONGEST = 10  # updates of one glitch
ALIKE = 0.7  # correlation of two inputs that usually vary alike
QUIET = 0.2  # of the leap: sister channels vary by less
OUTSIDE = 1.5  # of the range of all other values: a value farther away is a glitch without sister channels
ACTUATED = 8.0  # usual steps: noise has a range of about 4
RAREST = 3  # excursions of an input without sister channels: more are its pulses
AROUND = 6  # updates whose steps are compared
Glitch = tuple[float, float, int]  # time [s] at which it begins, its value farthest off [SI], number of samples


def input_glitches(recording: xr.Dataset) -> dict[str, tuple[Glitch, ...]]:
    """Return, by name, the glitches of each recorded input: time [s], value [SI] and number of samples of each. The
    only pressure of a recording has the name ``p``.
    """
    return {
        channel.name or "p": tuple(
            (float(channel.time[a]), farthest(channel.values, a, b), b - a) for a, b in spans
        ) for channel, spans in glitch_spans(recording) if spans
    }  # fmt: skip


def farthest(values: NDArray, start: int, stop: int) -> float:
    """Return the value of samples `start` to `stop` - 1 that differs most from the sample beside them."""
    beside = values[start - 1] if start else values[min(stop, len(values) - 1)]
    part = values[start:stop]
    return float(part[np.argmax(np.abs(part - beside))])


def glitch_spans(recording: xr.Dataset) -> list[tuple[RecordedInput, list[tuple[int, int]]]]:
    """Return each recorded input with its glitches, as (first sample, last sample + 1)."""
    inputs = recorded_inputs(recording)
    possible = [excursions(entry.values) for entry in inputs]
    if not any(possible):
        return [(entry, []) for entry in inputs]
    smooth = [bridged(entry.time, entry.values, spans) for entry, spans in zip(inputs, possible, strict=True)]
    glitches = []
    for k, (entry, spans) in enumerate(zip(inputs, possible, strict=True)):
        sisters = [(other, smooth[j]) for j, other in enumerate(inputs) if j != k and len(other.time) == len(entry.time)
                   and other.kind == entry.kind and alike(smooth[k], smooth[j])]  # fmt: skip
        rare = sisters or len(spans) <= RAREST
        glitches.append((entry, [s for s in spans if rare and contradicted(entry.values, smooth[k], s, sisters)]))
    return glitches


def excursions(values: NDArray) -> list[tuple[int, int]]:
    """Return (first sample, last sample + 1) of each part of a series (P,) that leaps away by far more than usual and
    leaps back within ten updates.
    """
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < FEWEST:
        return []
    first = rows[np.concatenate([[True], np.diff(values[rows]) != 0])]
    level = values[first]
    if len(level) < FEWEST:
        return []
    step = np.diff(level)
    usual = usual_steps(np.abs(step))
    usually = max(float(np.ptp(np.percentile(of, [5, 95]))) for of in (level, values[rows]))
    lasting = LONGEST * float(np.median(np.diff(first)))
    leaps = np.flatnonzero(np.abs(step) > np.maximum(LEAP * usual, OF_RANGE * usually))
    spans: list[tuple[int, int]] = []
    for k in leaps:  # update k + 1 is the first that is off
        if spans and first[k + 1] < spans[-1][1] + 1:
            continue
        for m in leaps[(leaps > k) & (leaps <= k + LONGEST)]:
            back = abs(level[m + 1] - level[k])
            brief = first[m + 1] - first[k + 1] <= lasting
            if brief and step[k] * step[m] < 0 and back < RETURNED * min(abs(step[k]), abs(step[m])):
                spans.append((int(first[k + 1]), int(first[m + 1])))
                break
    return spans


def usual_steps(size: NDArray) -> NDArray:
    """Return the median (P,) of each of P step sizes and of the `AROUND` steps before and after it, fewer at the
    ends.
    """
    from scipy.ndimage import median_filter

    usual = np.asarray(median_filter(size, 2 * AROUND + 1))
    for k in {*range(min(AROUND, size.size)), *range(max(size.size - AROUND, 0), size.size)}:
        usual[k] = np.median(size[max(k - AROUND, 0) : k + AROUND + 1])
    return usual


def bridged(time: NDArray, values: NDArray, spans: list[tuple[int, int]]) -> NDArray:
    """Return a series (P,) at P times [s] with straight lines over the samples of `spans`, where it is known."""
    off = np.zeros(len(values), dtype=bool)
    for a, b in spans:
        off[a:b] = True
    known = np.isfinite(values) & ~off
    return np.where(off & known.any(), np.interp(time, time[known], values[known]), values) if known.any() else values


def alike(one: NDArray, other: NDArray) -> bool:
    """Return whether two series (P,) of the same samples usually vary alike."""
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < FEWEST or np.ptp(one[both]) == 0 or np.ptp(other[both]) == 0:
        return False
    return bool(np.corrcoef(one[both], other[both])[0, 1] > ALIKE)


def contradicted(
    values: NDArray, smooth: NDArray, span: tuple[int, int], sisters: list[tuple[RecordedInput, NDArray]]
) -> bool:
    """Return whether the sister channels of an input vary little during an excursion, or its values lie far outside
    all others. Sister channels are given with their series without excursions.
    """
    a, b = span
    if sisters:
        wide = slice(max(a - (b - a), 0), b + (b - a))
        size = float(np.nanmax(np.abs(values[a:b] - smooth[a:b])))
        scale = np.nanstd(smooth)
        moved = [np.nanmax(np.abs(other.values[wide] - calm[wide])) / max(np.nanstd(calm), 1e-300)
                 for other, calm in sisters]  # fmt: skip
        return bool(np.median(moved) * scale < QUIET * size)
    low, high = np.nanmin(smooth), np.nanmax(smooth)
    off = np.fmax(values[a:b] - high, low - values[a:b])
    one_update = np.ptp(values[a:b]) == 0
    return bool(one_update and high > low and off.max() > (OUTSIDE - 1.0) * (high - low) and varies(smooth))


def varies(smooth: NDArray) -> bool:
    """Return whether a series (P,) without its excursions still shows an actuation, not only noise: its range is far
    larger than its usual step.
    """
    known = smooth[np.isfinite(smooth)]
    step = np.abs(np.diff(known))
    low, high = np.percentile(known, [5, 95])
    return bool(high - low > ACTUATED * np.median(step[step > 0])) if step.any() else False


def leave_out_glitches(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with straight lines in place of the glitches of its inputs, counted in the history."""
    glitches = [(entry, spans) for entry, spans in glitch_spans(recording) if spans]
    if not glitches:
        return recording
    changed: dict[str, NDArray] = {}
    columns = {"pressure": 0, "actuation": 0}
    spans_of = {entry.name: spans for entry, spans in glitches}
    for entry in recorded_inputs(recording):
        variable = "pressure" if entry.kind == "pressure" else "actuation"
        values = changed.setdefault(variable, recording[variable].values.reshape(len(entry.time), -1).copy())
        values[:, columns[variable]] = bridged(entry.time, entry.values, spans_of.get(entry.name, []))
        columns[variable] += 1
    data: dict[str, Any] = {n: recording[n].copy(data=v.reshape(recording[n].shape)) for n, v in changed.items()}
    count = "; ".join(f"{entry.name or 'p'} {len(spans)} (at "
                      f"{', '.join(f'{entry.time[a]:.2f}' for a, _ in spans[:6])} s)"
                      for entry, spans in glitches)  # fmt: skip
    return append_history(recording.assign(data), f"left out glitches of inputs and joined their neighbours: {count}")


def glitch_sentences(glitches: dict[str, tuple[Glitch, ...]], units: dict[str, tuple[float, str]]) -> list[str]:
    """Return a sentence for each input with glitches. `units` holds the factor from the SI unit and the display unit
    by input.
    """
    said = []
    for name, listed in glitches.items():
        factor, unit = units.get(name, (1.0, ""))
        where = ", ".join(f"{factor * value:.3g} {unit} at {time:.2f} s".replace("  ", " ")
                          for time, value, _ in listed[:4])  # fmt: skip
        more = f" and {len(listed) - 4} more" if len(listed) > 4 else ""
        said.append(f"glitches of input {name}: {where}{more}, which its neighbours and the other inputs contradict; "
                    'studies leave them out unless spikes = "keep"')  # fmt: skip
    return said
