"""Find the offset and drift between the clocks of pressure and shape, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.preprocessing.clock_drift import UNKNOWN, drift_of_events
from pliant.preprocessing.lag_model import Fitted, TimeSeries, body_course, fit_lag, holes, pressure_course
from pliant.recording.inputs import inputs_on_one_clock
from pliant.recording.schema import append_history, check_holds, check_recording
from pliant.units import input_words

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

LEAST_OVERLAP = 0.5  # of the shorter recording, at every offset that is tried
APART_S = 0.15  # s between two distinct candidate offsets
RIVALS = 4
LEAST_EXPLAINED = 0.5  # of the motion's variance
AMBIGUOUS = 1.5  # least ratio of the unexplained variances of second-best and best offset,
ALIKE = 0.75  # unless the second-best explains less than this fraction of what the best explains
COARSE_S = 0.02
ROUGH = 8  # evaluations of a fit that only ranks the offsets
DOUBTFUL_S = 0.02  # an uncertainty beyond this gives a warning
LONGEST_DRIFT = 5e-3
DRIFT_SIGMA = 3.0  # standard deviations: a smaller drift is not applied


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
    if not ({"position", "angle"} & set(recording)) or not inputs:
        raise InputError("sync compares motion with pressure or other inputs, but the recording lacks one of them: add "
                         "the missing one, or skip the synchronisation")  # fmt: skip
    body, pressure = body_course(recording), pressure_course(recording)
    best, rival = two_best(body, pressure, offsets(body.time, pressure.time, largest_s))
    check_fit(best, rival, largest_s)
    word = input_words([one.unit for one in inputs])[0]
    warnings = doubts(best, pressure, word)
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
    return Delay(best.delay, best.uncertainty, best.drift, best.drift_uncertainty if best.drift else 0.0,
                 best.explained, best.frequency, best.damping, tuple(warnings), word)


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

    (at, y), (clock, p) = sampled(body), sampled(pressure)
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
    lags = (np.arange(score.size) - (p.size - 1)) * COARSE_S + at[0] - clock[0]
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
    names = dict.fromkeys("pressure_time" if one.kind == "pressure" else "input_time" for one in inputs)
    shifted = recording
    for name in names:
        shifted = shifted.assign_coords({name: recording[name].values * (1.0 + drift) + delay_s})
        shifted[name].attrs = dict(recording[name].attrs)
    word = input_words([one.unit for one in inputs])[0]
    rate = f" and its rate by {1e6 * drift:+.0f} ppm" if drift else ""
    return append_history(shifted, f"clock of the {word} moved by {1e3 * delay_s:+.2f} ms{rate}")
