"""Find the offset and drift between the clocks of pressure and shape, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.preprocessing.lag_model import Fitted, LagFrame, TimeSeries, body_course, fit_lag, holes, pressure_course
from pliant.recording.inputs import inputs_on_one_clock
from pliant.recording.rules import shape_variable
from pliant.recording.schema import append_history, check_holds, check_recording
from pliant.units import input_words

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from pliant.preprocessing.lag_model import Fitted, TimeSeries

LEAST_OVERLAP = 0.5  # of the shorter recording, at every offset that is tried
APART_S = 0.15  # s between two distinct candidate offsets
RIVALS = 4
LEAST_EXPLAINED = 0.5  # of the motion's variance
AMBIGUOUS = 1.5  # least ratio of the unexplained variances of second-best and best offset,
ALIKE = 0.75  # unless the second-best explains less than this fraction of what the best explains
COARSE_S = 0.02
LATE_S = 1e6  # a clock that begins later, such as times since 1970, is rounded too coarsely for derivatives
ROUGH = 8  # evaluations of a fit that only ranks the offsets
DOUBTFUL_S = 0.02  # an uncertainty beyond this gives a warning
LONGEST_DRIFT = 5e-3
DRIFT_SIGMA = 3.0  # standard deviations: a smaller drift is not applied


SMOOTH_S = 0.1  # s: the direction of an input is that of its mean over this time
CHANGES = 0.05  # of the range of the input: a smaller change is no event
SHARE = 0.02  # of the information of the best event: one of less is left out
FEWEST_FRAMES = 8
MATCHING = 0.2  # relative: durations of changes that differ by less are alike
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
    columns += [slow] if max(float(np.ptp(slow[signs == s])) for s in set(signs.tolist())) > MATCHING else []
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


@dataclass(frozen=True, repr=False)
class Delay(Shown):
    """Offset and drift between the clocks of pressure and shape: time of the shape = time of the pressure * (1 + drift)
    + delay.

    Attributes
    ----------
    delay_s : float
        Offset to add to the pressure's times, s. The lag of the body is excluded: it is modelled separately, as a
        second-order response with slow creep.
    uncertainty_s : float
        Standard deviation of the offset, s.
    drift, drift_uncertainty : float
        Relative difference of the clock rates and its standard deviation; 0 where no significant drift was found or
        `drift` was not requested.
    explained : float
        Fraction of the motion's variance that the delayed pressure explains.
    frequency_hz, damping_ratio : float
        Natural frequency and damping ratio of the modelled response of the body.
    warnings : tuple of str
        One sentence for each reason why the offset may be wrong.
    input : str
        What was compared with the motion: "pressure", "tension", "displacement", "motor angle" or "input".
    """

    delay_s: float
    uncertainty_s: float
    drift: float
    drift_uncertainty: float
    explained: float
    frequency_hz: float
    damping_ratio: float
    warnings: tuple[str, ...] = ()
    input: str = "pressure"

    def summary(self) -> str:
        """Return the clock offset, its uncertainty and the warnings as text."""
        drift = f", a drift of {1e6 * self.drift:+.0f} +- {1e6 * self.drift_uncertainty:.0f} ppm" if self.drift else ""
        moved = f"{1e3 * self.delay_s:+.1f} +- {1e3 * self.uncertainty_s:.1f} ms{drift}"
        how = f"estimated from {self.input} and motion ({100 * self.explained:.1f} % of the motion explained)"
        return ". ".join([f"the {self.input}'s clock is moved by {moved}, {how}", *self.warnings])

    def card(self) -> Card:
        """Return the clock offset, its uncertainty and the warnings for display in a notebook."""
        return Card(self.summary(), [])


def sync(recording: xr.Dataset, *, largest_s: float | None = None, drift: bool = False) -> Delay:
    """Find the offset [s] and, on request, the drift between the clocks of pressure and shape by comparing pressure and
    motion.

    The motion is modelled as a second-order response to the pressure, with gains on the pressure and on its square and
    with slow creep. The offset that explains most of the motion is refined below one frame by least squares over
    offset, frequency and damping. Its uncertainty accounts for correlated residuals.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording with pressure, or other inputs, and with position or angle.
    largest_s : float, optional
        Largest offset that is tried, of either sign. Default: every offset at which half of the shorter recording
        overlaps with the other.
    drift : bool
        Whether to estimate a difference of the clock rates too. It is used when it exceeds three times its
        uncertainty, which follows from the scatter of the offsets of single changes of the input; at least four or
        five such changes are needed.

    Raises
    ------
    InputError
        When pressure or motion is missing or constant, when no offset explains the motion, or when two offsets explain
        it equally well, as with a periodic pressure.
    """
    check_recording(recording)
    inputs = inputs_on_one_clock(recording)
    if not shape_variable(recording) or not inputs:
        raise InputError("sync compares motion with pressure or other inputs, but the recording lacks one of them: add "
                         "the missing one, or skip the synchronisation")  # fmt: skip
    body, stated = body_course(recording), pressure_course(recording)
    zero = float(stated.time[0]) if abs(stated.time[0]) > LATE_S else 0.0
    pressure = stated._replace(time=stated.time - zero)
    best, rival = two_best(body, pressure, offsets(body.time, stated.time, largest_s) + zero)
    of_clock = None if rival is None else rival._replace(delay=rival.delay - zero)
    check_fit(best._replace(delay=best.delay - zero), of_clock, largest_s)
    word = input_words([channel.unit for channel in inputs])[0]
    warnings = doubts(best, stated, word)
    change = drift_of_events(body, pressure, best) if drift else UNKNOWN
    if change.significant:
        clear = fit_lag(
            body, pressure, best.delay, starts=((best.frequency, best.damping),), drift=True, evaluations=60
        )
        error = max(clear.drift_uncertainty, change.uncertainty)
        agree = abs(clear.drift - change.value) < DRIFT_SIGMA * error
        if abs(clear.drift) > DRIFT_SIGMA * error and agree and clear.explained >= best.explained:
            best = clear._replace(drift_uncertainty=error)
            if abs(best.drift) > LONGEST_DRIFT:
                warnings.append(f"a drift of {100 * best.drift:.2g} % is larger than between real clocks: check the "
                                "stated rates")
    return Delay(best.delay - zero * (1.0 + best.drift), best.uncertainty, best.drift,
                 best.drift_uncertainty if best.drift else 0.0, best.explained, best.frequency, best.damping,
                 tuple(warnings), word)


def check_fit(best: Fitted, rival: Fitted | None, largest_s: float | None) -> None:
    """Raise InputError where the clock offset of the fit `best` explains too little of the motion, lies at the end of
    the search range, or explains the motion no better than the fit `rival` at another offset.
    """
    if best.explained < LEAST_EXPLAINED:
        raise InputError(
            f"no offset between the clocks makes the pressure explain the motion (at best "
            f"{100 * max(best.explained, 0.0):.0f} %): check that pressure and shape are of the same test, or set "
            "clock to the offset in seconds"
        )
    if largest_s is not None and abs(best.delay) > largest_s - COARSE_S:
        raise InputError(f"the best offset is at the end of the search range, {best.delay:.3g} s: increase largest_s")
    if rival is not None and rival.share > ALIKE * best.share and (
        1 - rival.explained < AMBIGUOUS * (1 - best.explained)
    ):
        raise InputError(
            f"offsets of {best.delay:.3g} s and of {rival.delay:.3g} s explain the motion equally well (a periodic "
            "pressure?): set clock to the offset in seconds, or reduce largest_s"
        )


def doubts(best: Fitted, pressure: TimeSeries, word: str = "pressure") -> list[str]:
    """Return one sentence for each reason why the fitted clock offset `best` may be wrong, such as gaps in the log of
    the pressure or of other inputs, which `word` names.
    """
    said = []
    if best.uncertainty > DOUBTFUL_S:
        said.append(f"WARNING: the offset is uncertain by {1e3 * best.uncertainty:.0f} ms; a recording whose {word} "
                    "changes fast, more than once, determines it better")  # fmt: skip
    if best.inside < 0.98:
        said.append(f"the {word} log covers {100 * best.inside:.0f} % of the shape's frames")
    if best.after_motion:
        said.append(f"WARNING: the {word} is already high when its log begins: the first rise is not recorded")
    if gaps := holes(pressure.time):
        longest = max(gaps, key=lambda gap: gap[1] - gap[0])
        said.append(f"the {word} log has {len(gaps)} gap(s), the longest {longest[1] - longest[0]:.3g} s at "
                    f"{longest[0]:.3g} s of its clock; they were left out here, and are interpolated linearly in a "
                    "simulation")  # fmt: skip
    return said


def offsets(time: NDArray, clock: NDArray, largest_s: float | None) -> NDArray:
    """Return the clock offsets [s] to try: those up to `largest_s` [s] or, where it is None, those at which motion and
    pressure overlap long enough.
    """
    if largest_s is not None:
        if not (np.isfinite(largest_s) and largest_s > 0):
            raise InputError(f"largest_s must be a positive number of seconds, not {largest_s}")
        return np.arange(-largest_s, largest_s + COARSE_S, COARSE_S)
    overlap = LEAST_OVERLAP * min(np.ptp(time), np.ptp(clock))
    return np.arange(time[0] - clock[-1] + overlap, time[-1] - clock[0] - overlap + COARSE_S, COARSE_S)


def two_best(body: TimeSeries, pressure: TimeSeries, delays: NDArray) -> tuple[Fitted, Fitted | None]:
    """Return two fits of the clock offset: the best one, and the best one at a clearly different offset (None where
    there is none).
    """
    scores = coarse_scores(body, pressure, delays)
    fits: list[Fitted] = []
    for _ in range(RIVALS):
        k = int(np.argmax(scores))
        if scores[k] <= 0:
            break
        fits.append(fit_lag(body, pressure, float(delays[k]), evaluations=ROUGH))
        scores[np.abs(delays - delays[k]) < 2 * APART_S] = 0.0
    if not fits:
        raise InputError("no offset correlates pressure and motion: check that both are of the same test")
    fits.sort(key=lambda f: -f.share)
    best = polished(body, pressure, fits[0])
    others = [polished(body, pressure, f) for f in fits[1:]]
    return best, next((f for f in others if abs(f.delay - best.delay) > APART_S), None)


def polished(body: TimeSeries, pressure: TimeSeries, found: Fitted) -> Fitted:
    """Continue the least-squares fit `found` of the clock offset with further iterations, and return the result."""
    if not np.isfinite(found.frequency):
        return found
    return fit_lag(body, pressure, found.delay, starts=((found.frequency, found.damping),), evaluations=60)


def coarse_scores(body: TimeSeries, pressure: TimeSeries, delays: NDArray) -> NDArray:
    """Return the squared correlation (D,) of the motion with the pressure delayed by each of D offsets `delays` [s]."""
    from scipy.signal import correlate

    def sampled(course: TimeSeries) -> tuple[NDArray, NDArray]:
        grid = np.arange(course.time[0], course.time[-1] + COARSE_S / 2, COARSE_S)
        values = np.interp(grid, course.time, course.values[:, 0])
        return grid, values - values.mean()

    (times, y), (clock, p) = sampled(body), sampled(pressure)
    ones = (np.ones_like(y), np.ones_like(p))
    full = {name: correlate(a, b, method="fft") for name, (a, b) in {
        "yp": (y, p), "y": (y, ones[1]), "p": (ones[0], p), "yy": (y**2, ones[1]), "pp": (ones[0], p**2), "n": ones,
    }.items()}
    n = np.maximum(full["n"], 1.0)
    covariance = full["yp"] - full["y"] * full["p"] / n
    variances = (full["yy"] - full["y"] ** 2 / n) * (full["pp"] - full["p"] ** 2 / n)
    floor = 1e-6 * float((y**2).sum() * (p**2).sum())
    score = covariance**2 / np.maximum(variances, floor)
    score = np.where(variances > floor, score, 0.0) * np.sqrt(n / n.max())  # a short overlap may correlate by chance
    lags = (np.arange(score.size) - (p.size - 1)) * COARSE_S + times[0] - clock[0]
    return np.asarray(np.interp(delays, lags, score, left=0.0, right=0.0))


def shift_pressure(recording: xr.Dataset, delay_s: float, drift: float = 0.0) -> xr.Dataset:
    """Return the recording with the sample times t [s] of the pressure, and of other inputs with the same clock,
    replaced by ``t * (1 + drift) + delay_s``.
    """
    check_recording(recording)
    inputs = inputs_on_one_clock(recording)
    if not inputs:
        check_holds(recording, "pressure", "shift_pressure")
    if not (np.isfinite(delay_s) and np.isfinite(drift)):
        raise InputError(f"delay_s (in seconds) and drift must be finite, not {delay_s!r} and {drift!r}")
    names = dict.fromkeys("pressure_time" if channel.kind == "pressure" else "input_time" for channel in inputs)
    shifted = recording
    for name in names:
        shifted = shifted.assign_coords({name: recording[name].values * (1.0 + drift) + delay_s})
        shifted[name].attrs = dict(recording[name].attrs)
    word = input_words([channel.unit for channel in inputs])[0]
    rate = f" and its rate by {1e6 * drift:+.0f} ppm" if drift else ""
    return append_history(shifted, f"clock of the {word} moved by {1e3 * delay_s:+.2f} ms{rate}")
