"""Sequential tests for contact with the body, whose thresholds come from recordings without contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.contact.likelihood_ratio import InnovationResponse, frames_of
from pliant.errors import InputError
from pliant.model import Model

Array = np.ndarray
CAP = 1.5  # upper limit of the cumulative sum, in thresholds
HOLD = 0.107  # s, window of the recent motion
LAGS = (0.05, 0.3, 3.0)  # s, time constants of torques that lag behind the pressure
RIDGE = 1e-4
BLOCK = 1.0  # s, length of a block whose maximum counts
LATER, BEFORE = 0.533, 0.133  # s, delay and averaging time of the torques before a contact
HEAVIEST = 0.3  # largest shape parameter of the tail
MANY = 40  # number of peaks from which the tail is the upper quartile, else the upper half


@dataclass(frozen=True)
class Sudden:
    """Test for forces that begin suddenly: the values that its likelihood ratio rarely exceeds without contact, by
    speed of motion, and the alarm threshold.

    Attributes
    ----------
    answer : InnovationResponse
    size : (B,) array
        99 % quantile of the ratio at each level of motion in `answer`, not falling with motion.
    threshold : float
        Threshold of the ratio over `size`.
    """

    answer: InnovationResponse
    size: Array
    threshold: float

    def statistic(self, ratio: Array, motion: Array) -> Array:
        """Return the likelihood ratio (T,) of each of T frames, divided by its alarm threshold, which depends on the
        motion.
        """
        return np.asarray(ratio / self.size[self.answer.case(motion)] / self.threshold)


@dataclass(frozen=True)
class FreeMotion:
    """Statistics of the external joint torques in motion without contact, and the thresholds of the two contact tests:
    for sudden forces and for lasting torques.

    Attributes
    ----------
    weights : (features, n) array
        Linear regression of the torques on the features of pressure and free motion, which describes model error.
    covariance : (n, n) array
        Covariance of the residual torques, N^2 m^2.
    growth : float
        Growth of that covariance with the activity of the motion: it is scaled by (1 + growth activity).
    slack : float
        Value subtracted from the normalised square at every frame, so that excursions of free motion decay.
    threshold : float
        Threshold of the cumulative sum.
    kept : float
        Fraction of the residual torques that remains after half a second; a contact is measured relative to it.
    change : (n, n) array
        Covariance of the change of the residual torques in half a second, with little motion, N^2 m^2.
    sudden : Sudden
        The test for forces that set in suddenly.
    duration : float
        Duration of the free motion, s.
    period : float
        Time between frames, s.
    rate : float
        Requested rate of false alarms, 1/h.
    extrapolated : bool
        Whether the free motion is shorter than the mean time between false alarms, so that the tail was extrapolated.
    """

    weights: Array
    covariance: Array
    growth: float
    slack: float
    threshold: float
    kept: float
    change: Array
    sudden: Sudden
    duration: float
    period: float
    rate: float
    extrapolated: bool

    def left_over(self, torque: Array, features: Array) -> Array:
        """Return the external torques (T, n) [N m] of n joints over T frames, minus the model error that the regressors
        `features` predict.
        """
        return np.asarray(torque - features @ self.weights)

    def scale(self, features: Array) -> Array:
        """Return the factor (T,) by which a frame's torque covariance exceeds that at rest.
        It grows with the mean square joint rate.
        """
        return np.asarray(1.0 + self.growth * activity(features, self.covariance.shape[0], self.period))

    def drift(self, frames: Array) -> Array:
        """Return the mean square by which the joint torques without contact drift over `frames` frames, divided by the
        mean square for half a second.

        It grows linearly as for a random walk, from `change` itself up to the total scatter of the torques.
        """
        most = float(np.trace(np.linalg.solve(self.change, self.covariance))) / len(self.change)
        return np.clip(frames / frames_of(LATER, self.period), 1.0, max(most, 1.0))

    def statistic(self, left: Array, features: Array) -> Array:
        """Return Page's cumulative sum (T,) over T frames for the torques `left` (T, n) [N m] of n joints. The sum adds
        the squares of the torques, normalised by the covariance without contact.
        """
        gain = normalised(left, self.covariance) / self.scale(features) - self.slack
        return cumulative(gain, CAP * self.threshold)


def features_of(model: Model, time: Array, pressure: Array, angle: Array, rate: Array) -> Array:
    """Return F regressors (T, F) over T frames that predict the model's error in motion without contact: functions of
    the chambers' torques, and the joint angles and rates that the model predicts.

    They are the torque of each chamber, its square, its lagged values, and the joint angles and rates that the model
    predicts under the pressure. None of them depends on a contact.
    """
    from scipy.signal import lfilter

    h, columns = float(np.median(np.diff(time))), [np.ones(len(angle))]
    for tau in model.actuation.torques_over(pressure).T:
        columns += [tau, tau**2 / max(float(np.abs(tau).max()), 1e-12)]
        for lag in LAGS:
            keep = float(np.exp(-h / lag))
            columns.append(lfilter([1.0 - keep], [1.0, -keep], tau, zi=[keep * tau[0]])[0])
    return np.column_stack([*columns, angle, rate])


def activity(features: Array, n: int, period: float) -> Array:
    """Return for each of T frames the largest mean square joint rate (T,) [rad^2/s^2] that the model predicts for the
    short time up to this frame.
    """
    power, hold = np.mean(features[:, -n:] ** 2, axis=1), frames_of(HOLD, period)
    padded = np.concatenate([np.full(hold - 1, power[0]), power])
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, hold).max(axis=1))


def growth_of(squares: Array, active: Array) -> tuple[float, float]:
    """Fit the line level * (1 + growth * activity) to squared joint torques, where activity is the recent maximum of
    the mean square joint rate. Return level and growth.
    """
    from scipy.optimize import nnls

    (level, slope), _ = nnls(np.column_stack([np.ones_like(active), active]), squares)
    level = max(float(level), 0.02 * float(squares.mean()))
    return level, float(slope) / level


def normalised(left: Array, covariance: Array) -> Array:
    """Return for each of T frames the mean square (T,) of the torques `left` (T, n) of n joints, whitened by their
    covariance (n, n).
    """
    white = np.linalg.solve(np.linalg.cholesky(covariance), left.T)
    return np.asarray(np.mean(white**2, axis=0))


def cumulative(gain: Array, cap: float = np.inf) -> Array:
    """Return the cumulative sum (T,) of Page's test over T frames, from the increments `gain` (T,): S_t = min(cap,
    max(0, S_{t-1} + gain_t)). It starts from 0.

    With the cap, the sum falls below its threshold soon after the cause has ended.
    """
    out = np.empty(len(gain))
    total = 0.0
    for k, step in enumerate(np.nan_to_num(gain)):
        total = min(cap, max(0.0, total + float(step)))
        out[k] = total
    return out


def fit_sudden_test(answer: InnovationResponse, ratios: list[Array], motions: list[Array], rate: float) -> Sudden:
    """Return the test for sudden forces, fitted to likelihood ratios without contact. Its alarm threshold is the one
    that they exceed `rate` times per hour.
    """
    ratio, case = np.concatenate(ratios), answer.case(np.concatenate(motions))
    size = np.full(len(answer.motion), 6.63)  # the 99 % quantile of chi-square
    enough = 2 * frames_of(BLOCK, answer.period)
    for b in range(len(size)):
        quantile = float(np.quantile(ratio[case == b], 0.99)) if np.count_nonzero(case == b) >= enough else 0.0
        size[b] = max(size[max(b - 1, 0)], quantile)
    scaled = [r / size[answer.case(a)] for r, a in zip(ratios, motions, strict=True)]
    highest = np.concatenate([blocks(s, answer.period) for s in scaled])
    return Sudden(answer, size, tail(highest, answer.period * len(ratio), rate)[0])


def blocks(values: Array, period: float) -> Array:
    """Return the maximum of a time series `values` in each block of `BLOCK` seconds."""
    count = max(1, len(values) // frames_of(BLOCK, period))
    return np.array([part.max() for part in np.array_split(values, count)])


def fit_free_motion(
    torques: list[Array], features: list[Array], sudden: Sudden, *, rate: float = 1.0, slack: float | None = None
) -> FreeMotion:
    """Return the statistics of the external joint torques in recordings without contact, and the thresholds of the two
    contact tests: for sudden forces and for lasting torques.

    The residuals of each recording come from a regression on the others (on itself, if it is the only one), as for a
    new recording. Peaks of the cumulative sum exceed the threshold `rate` times per hour.

    Parameters
    ----------
    torques, features : lists of (T, n) and (T, F) arrays
    sudden : Sudden
        The test for sudden forces, stored in the result.
    rate : float
        False alarms per hour.

    Raises
    ------
    InputError
        When there is no recording, or too few frames.
    """
    frames, period = sum(len(t) for t in torques), sudden.answer.period
    if not torques or frames < 3 * features[0].shape[1] or not rate > 0:
        raise InputError(f"{frames} frames of free motion are too few for a threshold: record some seconds more")
    left = []
    for k in range(len(torques)):
        rest = [i for i in range(len(torques)) if i != k] or [0]
        left.append(torques[k] - features[k] @ regression([torques[i] for i in rest], [features[i] for i in rest]))
    pooled = np.concatenate(left)
    n = pooled.shape[1]
    covariance = pooled.T @ pooled / len(pooled) + 1e-12 * np.sum(pooled**2) / pooled.size * np.eye(n)
    active = [activity(f, n, period) for f in features]
    squares = [normalised(part, covariance) for part in left]
    base, growth = growth_of(np.concatenate(squares), np.concatenate(active))
    covariance = base * covariance
    squares = [s / base / (1.0 + growth * a) for s, a in zip(squares, active, strict=True)]
    level = float(np.quantile(np.concatenate(squares), 0.99)) if slack is None else slack
    peaks = np.concatenate([excursions(cumulative(s - level)) for s in squares])
    duration = frames * period
    threshold, beyond = tail(peaks, duration, rate)
    decay, change = changes(left, active, growth, period)
    return FreeMotion(
        regression(torques, features), covariance, growth, level, threshold, decay, change, sudden, duration, period,
        rate, beyond,
    )


def changes(left: list[Array], active: list[Array], growth: float, period: float) -> tuple[float, Array]:
    """Fit a model of the residual torques of n joints: a fraction of their values half a second earlier plus a random
    change. Return the fraction, and the covariance (n, n) [N^2 m^2] of the change.
    """
    later = frames_of(LATER, period)
    now = np.concatenate([a[later:] for a in left])
    before = np.concatenate([running_mean(a, period)[: len(a) - later] for a in left])
    persistence = float(np.clip(np.sum(now * before) / max(float(np.sum(before**2)), 1e-300), 0.0, 1.0))
    rest = (now - persistence * before) / np.sqrt(1.0 + growth * np.concatenate([a[later:] for a in active]))[:, None]
    return persistence, rest.T @ rest / len(rest) + 1e-12 * np.sum(rest**2) / rest.size * np.eye(rest.shape[1])


def running_mean(values: Array, period: float) -> Array:
    """Return for each of T frames the mean (T, n) of n quantities `values` (T, n) over the last `BEFORE` seconds, or
    since the start where that is shorter.
    """
    total = np.cumsum(np.concatenate([np.zeros((1, values.shape[1])), values]), axis=0)
    first = np.maximum(np.arange(len(values)) + 1 - frames_of(BEFORE, period), 0)
    return np.asarray((total[1:] - total[first]) / (np.arange(len(values)) + 1 - first)[:, None])


def regression(torques: list[Array], features: list[Array]) -> Array:
    """Return the weights (F, n) of a ridge regression of n torques on F features scaled to unit size."""
    X, Y = np.concatenate(features), np.concatenate(torques)
    size = np.sqrt(np.mean(X**2, axis=0)) + 1e-300
    Z = X / size
    A = Z.T @ Z / len(Z) + RIDGE * np.eye(Z.shape[1])
    return np.asarray(np.linalg.solve(A, Z.T @ Y / len(Z)) / size[:, None])


def excursions(sums: Array) -> Array:
    """Return the maximum of a cumulative sum in each interval in which the sum is positive."""
    up = np.concatenate([[0], (sums > 0).astype(int), [0]])
    starts, stops = np.flatnonzero(np.diff(up) == 1), np.flatnonzero(np.diff(up) == -1)
    return np.array([sums[a:b].max() for a, b in zip(starts, stops, strict=True)])


def tail(peaks: Array, duration: float, rate: float) -> tuple[float, bool]:
    """Return the threshold that `peaks` exceed `rate` times per hour, and whether it is extrapolated beyond the data.

    `duration` [s] is that of the recordings. Excesses over the upper quartile follow a generalised Pareto law, with its
    shape from probability-weighted moments, limited to [0, `HEAVIEST`]: never lighter than exponential.

    Source: Hosking and Wallis (1987), Parameter and quantile estimation for the generalized Pareto distribution
    """
    if peaks.size < 3:
        raise InputError("the model error without contact has too few peaks for a threshold: record more free motion")
    base = float(np.quantile(peaks, 0.75)) if peaks.size >= MANY else float(np.median(peaks))
    above = np.sort(peaks[peaks > base] - base)
    wanted = rate * duration / 3600.0  # alarms expected within the record
    mean = float(above.mean())
    rank = (above.size - np.arange(above.size) - 0.65) / above.size
    weighted = float(np.mean(above * np.clip(rank, 0.0, 1.0)))
    shape = float(np.clip(2.0 - mean / max(mean - 2.0 * weighted, 1e-12), 0.0, HEAVIEST))
    scale = mean * (1.0 - shape)
    ratio = max(above.size / wanted, 1.0)
    reach = float(np.log(ratio)) if shape < 1e-6 else float((ratio**shape - 1.0) / shape)
    return base + scale * reach, bool(wanted < 1.0)
