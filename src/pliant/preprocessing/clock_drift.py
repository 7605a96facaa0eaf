"""Estimate the drift between two clocks from the offsets that single changes of an input show."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pliant.preprocessing.lag_model import LagFrame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pliant.preprocessing.lag_model import Fitted, TimeSeries

SMOOTH_S = 0.1  # s: the direction of an input is that of its mean over this time
CHANGES = 0.05  # of the range of the input: a smaller change is no event
SHARE = 0.02  # of the information of the best event: one of less is left out
FEWEST_FRAMES = 8
ALIKE = 0.2  # relative: durations of changes that differ by less are alike
FEWEST_SPARE = 2  # events beyond the parameters of the line through their offsets
SIGNIFICANCE = 0.99865  # one-sided, as three standard deviations of a normal distribution
ONE_SIGMA = 0.84134


class Drift(NamedTuple):
    """Relative drift between two clocks, its standard deviation, and whether the drift is significant."""

    value: float
    uncertainty: float
    significant: bool


UNKNOWN = Drift(0.0, np.inf, significant=False)


def drift_of_events(body: TimeSeries, pressure: TimeSeries, best: Fitted) -> Drift:
    """Estimate the drift between the clocks of shape and input from the offset of each event.

    An event is a change of the input in one direction, with the motion up to the next event. Its offset comes from the
    residual of the fit `best` with a constant offset. A line through the offsets gives the drift; rising and falling
    inputs may have different offsets, as valves and friction cause, and so may fast and slow ones. The scatter of the
    offsets about the line gives the standard deviation, so that a difference of lags between few events is no drift.
    """
    frame = LagFrame(body, pressure, best.delay, drift=False)
    x = np.array([0.0, np.log(best.frequency), np.log(best.damping)])
    offsets, weights, times, signs, durations = event_offsets(frame, x, input_events(pressure))
    if not len(offsets):
        return UNKNOWN
    columns = [np.ones_like(times), times - frame.middle]
    columns += [signs] if len(set(signs.tolist())) > 1 else []
    slow = np.log(durations)
    columns += [slow] if max(float(np.ptp(slow[signs == s])) for s in set(signs.tolist())) > ALIKE else []
    matrix = np.stack(columns, axis=1)
    spare = len(offsets) - matrix.shape[1]
    if spare < FEWEST_SPARE:
        return UNKNOWN
    from scipy.stats import t as student

    root = np.sqrt(weights)[:, None]
    scaled = matrix * root
    if np.linalg.cond(scaled / np.linalg.norm(scaled, axis=0)) > 1e6:
        return UNKNOWN
    coefficients = np.linalg.lstsq(scaled, offsets * root[:, 0], rcond=None)[0]
    rest = (offsets - matrix @ coefficients) * root[:, 0]
    error = float(np.sqrt(rest @ rest / spare * np.linalg.inv(scaled.T @ scaled)[1, 1]))
    value = float(coefficients[1])
    return Drift(value, error * float(student.ppf(ONE_SIGMA, spare)),
                 significant=abs(value) > error * float(student.ppf(SIGNIFICANCE, spare)))  # fmt: skip


def input_events(pressure: TimeSeries) -> list[tuple[float, float, int, float]]:
    """Return (start [s], end [s], direction, duration [s]) of each monotonic change of an input, on its own clock.
    Direction is 1 or -1; an event ends where the next one starts. The duration is that of 80 % of the change.
    """
    clock, course = pressure.time, pressure.values[:, 0]
    step = max(float(np.median(np.diff(clock))), 0.5 * SMOOTH_S)
    grid = np.arange(clock[0], clock[-1], step)
    sums = np.concatenate([[0.0], np.cumsum(np.diff(clock) * 0.5 * (course[1:] + course[:-1]))])
    low, high = (np.clip(grid + h, clock[0], clock[-1]) for h in (-0.5 * SMOOTH_S, 0.5 * SMOOTH_S))
    smooth = (np.interp(high, clock, sums) - np.interp(low, clock, sums)) / np.maximum(high - low, 1e-12)
    least, turns, top, bottom = CHANGES * float(np.ptp(course)), list[tuple[int, int]](), 0, 0
    for k in range(1, len(grid)):  # turning points that are more than `least` apart
        top, bottom = (k if smooth[k] > smooth[top] else top), (k if smooth[k] < smooth[bottom] else bottom)
        last = turns[-1][1] if turns else 0
        if last <= 0 and smooth[k] - smooth[bottom] > least:
            turns.append((bottom, 1))
            top = k
        elif last >= 0 and smooth[top] - smooth[k] > least:
            turns.append((top, -1))
            bottom = k
    ends = [k for k, _ in turns] + [len(grid) - 1]
    return [(float(grid[a]), float(grid[b]), sign, _duration(sign * smooth[a : b + 1], step))
            for a, b, (_, sign) in zip(ends[:-1], ends[1:], turns, strict=True)]  # fmt: skip


def _duration(rise: NDArray, step: float) -> float:
    """Return the time [s] from 10 to 90 % of a rise, sampled at each `step` [s]; no less than smoothing allows."""
    level = (rise - rise[0]) / max(float(rise.max() - rise[0]), 1e-300)
    return max(step * (int(np.argmax(level >= 0.9)) - int(np.argmax(level >= 0.1))), 2 * SMOOTH_S)


def event_offsets(
    frame: LagFrame, x: NDArray, events: list[tuple[float, float, int, float]]
) -> tuple[NDArray, ...]:
    """Return the offset (E,) [s] beyond that of the fit, its weight, the time [s], the direction and the duration [s]
    of each of E events. In each event a constant and the scale of the modelled motion are free.
    """
    tiny = 1e-3
    coefficients = np.linalg.lstsq(frame.response(x), frame.y, rcond=1e-10)[0]
    model, late, early = (frame.response(x + np.array([d, 0.0, 0.0])) @ coefficients for d in (0.0, tiny, -tiny))
    slope, rest = (late - early) / (2 * tiny), frame.y - model
    rows = []
    for start, end, sign, duration in events:
        inside = (frame.at >= start) & (frame.at < end)
        if inside.sum() < FEWEST_FRAMES:
            continue
        free = np.stack([np.ones(int(inside.sum())), model[inside]], axis=1)
        g, r = (v[inside] - free @ np.linalg.lstsq(free, v[inside], rcond=1e-10)[0] for v in (slope, rest))
        information = float(g @ g)
        if information > 0:
            centre = float((frame.at[inside] * g**2).sum() / information)
            rows.append((float(g @ r) / information, information, centre, float(sign), duration))
    most = max((row[1] for row in rows), default=0.0)
    table = np.array([row for row in rows if row[1] > SHARE * most]).reshape(-1, 5)
    return tuple(table.T)
