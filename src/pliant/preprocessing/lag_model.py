"""Model of the body's lag behind the pressure (second order, with creep), which separates that lag from an offset
between two clocks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing.detectors import without_spikes
from pliant.recording.inputs import inputs_on_one_clock
from pliant.recording.rules import shape_values
from pliant.units import input_words

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr
    from numpy.typing import NDArray

FEWEST = 10  # fewest samples of motion and of pressure
HOLE_STEPS, HOLE_S = 6.0, 0.1  # a gap in a log is longer than this number of its steps, and than this time
CREEP_S = 1.0  # s: time constant of the slow part of the response
SETTLE_S = 0.5  # s after a gap or the start of the log, during which motion is ignored
MOST_SAMPLES = 40_000
STARTS = ((1.0, 1.0), (4.0, 0.2), (10.0, 0.2), (0.3, 1.5))  # Hz, damping ratio
HYSTERESIS = 0.03  # of the pressure's range: width of a loop that looks like a delay under slow pressure
EDGE_SHARE, EDGE_TIMES_S = 0.15, (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
FIRST = 5  # samples that show an input when its log begins
HIGH = 0.3  # of the range of an input: how far from its rest value
BLOCK_S = 0.5  # s: closer residuals are correlated


class TimeSeries(NamedTuple):
    """Measured quantities over time: times (T,) [s] of T samples, values (T, K) of K quantities, weights (T,)."""

    time: NDArray  # (T,) s
    values: NDArray  # (T, K)
    weight: NDArray  # (T,) 0 where no value was measured


class Fitted(NamedTuple):
    """Result of `fit_lag`: a clock offset [s] with its uncertainty, and natural frequency and damping ratio of the
    body's response.
    """

    delay: float  # s
    uncertainty: float  # s
    drift: float
    drift_uncertainty: float
    explained: float  # fraction of the motion's variance where pressure and motion were recorded
    share: float  # fraction of the variance of all recorded motion
    frequency: float  # Hz
    damping: float  # ratio
    inside: float  # fraction of the shape's frames that the pressure log covers
    after_motion: bool  # whether an input is already high when its log begins


def body_course(recording: xr.Dataset) -> TimeSeries:
    """Return the motion of the body as one quantity over time: the first principal component of all positions or
    angles. Its weight is 0 at spikes and gaps.
    """
    columns = without_spikes(shape_values(recording)).reshape(recording.sizes["time"], -1)
    columns = columns[:, np.isfinite(columns).sum(0) >= FEWEST]
    course, finite = first_component(columns)
    if np.ptp(course[finite]) == 0:
        raise InputError("the motion is constant, so its clock cannot be compared with the pressure's: set clock to "
                         "the offset in seconds")
    time = recording["time"].values
    return TimeSeries(time, np.interp(time, time[finite], course[finite])[:, None], finite.astype(float))


def first_component(values: NDArray) -> tuple[NDArray, NDArray]:
    """Return the first principal component (T,) of several quantities (T, K) over T samples, and a mask (T,) of the
    samples without NaN.
    """
    if values.shape[1] == 0:
        raise InputError(f"comparing clocks needs at least {FEWEST} samples of motion: set clock to the offset in "
                         "seconds")
    finite = np.isfinite(values).all(1)
    if finite.sum() < max(FEWEST, 0.3 * len(values)):  # some columns are lost often: keep those that are seen most
        often = np.isfinite(values).sum(0)
        values = values[:, often >= np.quantile(often, 0.5)]
        finite = np.isfinite(values).all(1)
    if finite.sum() < FEWEST:
        raise InputError(f"comparing clocks needs at least {FEWEST} samples of motion in which every station is "
                         "seen: fill gaps, or set clock to the offset in seconds")
    centred = values - values[finite].mean(0)
    weights = np.linalg.eigh(centred[finite].T @ centred[finite])[1][:, -1]
    return centred @ weights, finite


def pressure_course(recording: xr.Dataset) -> TimeSeries:
    """Return the pressure, or other inputs, over time, with gaps interpolated. The first column is the first principal
    component of all inputs. Each further column is an input's distance from 0, or from its value nearest to 0, scaled
    by the range of all inputs of its unit.
    """
    inputs = inputs_on_one_clock(recording)
    clock, values = inputs[0].time, np.stack([channel.values for channel in inputs], axis=1)
    word = input_words([channel.unit for channel in inputs])[0]
    finite = np.isfinite(values).all(1)
    if finite.sum() < FEWEST:
        raise InputError(f"comparing clocks needs at least {FEWEST} samples of {word}: set clock to the offset in "
                         "seconds")
    values = np.stack([np.interp(clock, clock[finite], v[finite]) for v in values.T], axis=1)
    if not (np.ptp(values, axis=0) > 0).any():
        raise InputError(f"the {word} is constant, so its clock cannot be compared with the shape's: set clock to "
                         "the offset in seconds")
    moving = np.ptp(values, axis=0) > 0
    values, units = values[:, moving], np.array([channel.unit for channel in inputs])[moving]
    for unit in set(units):
        same_unit = units == unit
        rest = np.clip(0.0, values[:, same_unit].min(0), values[:, same_unit].max(0))
        values[:, same_unit] = (values[:, same_unit] - rest) / np.ptp(values[:, same_unit])
    main, _ = first_component(values)
    return TimeSeries(clock, np.column_stack([main, values]), np.ones(len(clock)))


def holes(clock: NDArray) -> list[tuple[float, float]]:
    """Return (start, end) [s] of each long gap in the sample times of a pressure log."""
    step = np.diff(clock)
    wide = np.flatnonzero(step > max(HOLE_STEPS * float(np.median(step)), HOLE_S))
    return [(float(clock[i]), float(clock[i + 1])) for i in wide]


def fit_lag(
    body: TimeSeries, pressure: TimeSeries, guess: float, *, starts: Sequence[tuple[float, float]] = STARTS,
    drift: bool = False, evaluations: int = 40,
) -> Fitted:
    """Fit the clock offset [s] between pressure and motion near `guess` [s] by least squares, together with natural
    frequency, damping ratio and, on request, clock drift.

    `starts` are pairs of initial frequency [Hz] and damping ratio. `evaluations` limits the evaluations from each.
    """
    from scipy.optimize import least_squares

    frame = LagFrame(body, pressure, guess, drift=drift)
    if frame.keep.sum() < 3 * FEWEST or np.ptp(frame.y) == 0:
        return Fitted(guess, np.inf, 0.0, np.inf, 0.0, 0.0, np.nan, np.nan, 0.0, after_motion=False)
    ends = []
    for hertz, ratio in starts:
        start = np.array([0.0, np.log(hertz), np.log(ratio), 0.0][: 4 if drift else 3])
        low = np.array([-0.5, np.log(0.02), np.log(0.01), -0.02][: start.size])
        high = np.array([0.5, np.log(100.0), np.log(20.0), 0.02][: start.size])
        ends.append(least_squares(frame.residual, start, bounds=(low, high), x_scale=frame.scale, max_nfev=evaluations,
                                  diff_step=1e-3))  # fmt: skip
    best = min(ends, key=lambda end: end.cost)
    errors = frame.standard_errors(best.x, best.fun)
    explained = 1.0 - float(best.fun @ best.fun) / float(frame.y @ frame.y)
    return Fitted(
        guess + float(best.x[0]) - (float(best.x[3]) * frame.middle if drift else 0.0),
        float(np.hypot(errors[0], HYSTERESIS * edge_time(pressure))),
        float(best.x[3]) if drift else 0.0, float(errors[3]) if drift else np.inf, explained,
        explained * frame.share, float(np.exp(best.x[1])),
        float(np.exp(best.x[2])), float(frame.inside.mean()),
        after_motion=begins_high(pressure),
    )


def begins_high(pressure: TimeSeries) -> bool:
    """Return whether one of the inputs is far from its rest value (0, or its value nearest to 0) when its log begins,
    so that its rise is not in the log.
    """
    inputs = pressure.values[:, 1:]
    rest = np.clip(0.0, *np.quantile(inputs, [0.05, 0.95], axis=0))
    return bool((np.abs(np.median(inputs[:FIRST], axis=0) - rest) > HIGH * np.ptp(inputs, axis=0)).any())


class LagFrame:
    """Least-squares problem for the clock offset near `guess` [s]: residual between measured motion and the modelled
    response to the pressure.
    """

    def __init__(self, body: TimeSeries, pressure: TimeSeries, guess: float, *, drift: bool) -> None:
        clock = pressure.time
        self.guess, self.drift = guess, drift
        self.middle = float(clock.mean())
        times = body.time - guess
        self.inside = (times >= clock[0]) & (times <= clock[-1])
        blind = [(clock[0] - np.inf, clock[0] + 0.05), *holes(clock)]
        settled = ~np.any([(times > a) & (times < b + SETTLE_S * (k > 0)) for k, (a, b) in enumerate(blind)], axis=0)
        self.keep = self.inside & settled & (body.weight > 0)
        self.at = times[self.keep]
        y = body.values[self.keep, 0]
        whole = body.values[body.weight > 0, 0]
        self.share = float(((y - y.mean()) ** 2).sum() / ((whole - whole.mean()) ** 2).sum()) if y.size else 0.0
        self.y = (y - y.mean()) / max(float(np.std(y)), 1e-300) if y.size else y
        step = min(float(np.median(np.diff(clock))), float(np.median(np.diff(body.time))), 5e-3)
        step = max(step, 1e-3, float(np.ptp(clock)) / MOST_SAMPLES)
        self.grid = np.arange(clock[0], clock[-1] + step, step)
        self.step = step
        base = np.stack([np.interp(self.grid, clock, v) for v in pressure.values.T[1:]], axis=1)
        self.columns = np.column_stack([base, base**2])
        self.scale = np.array([0.01, 0.3, 0.5, 1e-4][: 4 if drift else 3])

    def residual(self, x: NDArray) -> NDArray:
        """Return the residual (K,) of the motion at K frames, as a multiple of the motion's standard deviation, for the
        parameters x: clock offset [s], log of frequency [Hz], log of damping ratio and, on request, clock drift.
        """
        basis = self.response(x)
        return np.asarray(self.y - basis @ np.linalg.lstsq(basis, self.y, rcond=1e-10)[0])

    def response(self, x: NDArray) -> NDArray:
        """Return the regressors (K, columns) of the motion at K frames: the low-pass filtered pressure and squared
        pressure of each chamber, each of these with slow creep, and a constant.
        """
        from scipy.signal import lfilter, lfilter_zi

        numerator, denominator = second_order(np.exp(x[1]), np.exp(x[2]), self.step)
        moved = lfilter(numerator, denominator, self.columns, axis=0,
                        zi=lfilter_zi(numerator, denominator)[:, None] * self.columns[:1])[0]  # fmt: skip
        share = self.step / CREEP_S
        slow = lfilter([share], [1.0, share - 1.0], moved, axis=0, zi=(1.0 - share) * moved[:1])[0]
        times = self.at - x[0] - (x[3] * (self.at - self.middle) if self.drift else 0.0)
        columns = np.concatenate([moved, slow], axis=1)
        return np.stack([*(np.interp(times, self.grid, c) for c in columns.T), np.ones_like(times)], axis=1)

    def standard_errors(self, x: NDArray, residual: NDArray) -> NDArray:
        """Return the standard errors of the fitted parameters (offset, log frequency, log damping, drift), for
        residuals that are correlated within half a second.
        """
        tiny = np.array([1e-4, 1e-3, 1e-3, 1e-6][: x.size])
        slope = np.stack([(self.residual(x + d) - self.residual(x - d)) / (2 * s)
                          for s, d in zip(tiny, np.diag(tiny), strict=True)], axis=1)  # fmt: skip
        bread = np.linalg.pinv(slope.T @ slope)
        block = np.floor(self.at / BLOCK_S).astype(int)
        sums = np.stack([np.bincount(block - block.min(), g * residual) for g in slope.T], axis=1)
        plain = float(residual @ residual) / max(residual.size - x.size, 1) * bread
        grouped = bread @ (sums.T @ sums) @ bread
        return np.asarray(np.sqrt(np.maximum(np.diag(plain), np.diag(grouped))))


def edge_time(pressure: TimeSeries) -> float:
    """Return the time [s] that the pressure would need to cross its whole range at its fastest rate of change."""
    course = pressure.values[:, 0]
    for window in EDGE_TIMES_S:
        ahead = np.interp(pressure.time + window, pressure.time, course)
        share = float(np.abs(ahead - course).max() / np.ptp(course))
        if share >= EDGE_SHARE:
            return window / share
    return float(np.ptp(pressure.time))


def second_order(hertz: float, ratio: float, step: float) -> tuple[NDArray, NDArray]:
    """Return the numerator (3,) and denominator (3,) of a discrete second-order low-pass filter with static gain 1.

    It uses the trapezoidal rule, which shifts nothing in time. `hertz` is the natural frequency, `ratio` the damping
    ratio and `step` the sampling interval [s].
    """
    half = 0.5 * step * 2 * np.pi * hertz
    rest = np.array([1 + 2 * ratio * half + half**2, 2 * half**2 - 2, 1 - 2 * ratio * half + half**2])
    return half**2 * np.array([1.0, 2.0, 1.0]) / rest[0], rest / rest[0]
