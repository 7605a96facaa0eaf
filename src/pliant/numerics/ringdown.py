"""Analysis of a free decay: a fitted damped sine, and frequency and damping of its large and small swings."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

Array = np.ndarray
SHARE_NEEDED = 0.5  # least fraction of the variance of the detrended signal explained by the damped sine
PERIODS_NEEDED = 2.0
MOST_DAMPED = 0.6  # damping ratio at which a hundredth of the amplitude is left after one period
NOWHERE = 1e6  # standard deviations of the signal: residual of invalid parameters
FAR = 20.0  # limit of the logarithms of the fitted parameters
LEAST_AMPLITUDE = 0.02  # of the range of the signal: a smaller sine is vibration of the rig, not the body's own motion
BEYOND_MONOTONE = 20.0  # mean square residuals of the sine by which a monotone motion must explain the signal less well
RETURN_NEEDED = 0.01  # of the range: an over-damped motion, fitted by a sine and an exponential, turns back by less
LARGE = 1.0 / 3.0  # of the first swing: larger swings count as large
SMALL = 1.0 / 6.0  # of the first swing: smaller swings count as small
NOISE = 6.0  # standard deviations of the noise: least size of a swing
LEAST_SWING = 0.01  # of the range of the signal: least size of a swing


class RingDown(NamedTuple):
    """Frequency, damping and amplitude of a damped sine fitted to a free decay."""

    frequency: float  # Hz, damped
    damping_ratio: float
    amplitude: float  # unit of the signal, at the start of the window
    explained: float  # fraction of the variance (trend removed) that the damped sine explains


def ring_down(time: Array, signal: Array) -> RingDown | None:
    """Fit offset + slow exponential + damped sine to a signal (T,) at times (T,) [s].
    Return None if it does not clearly oscillate.

    Parameters
    ----------
    time, signal : array (T,)
        Times in s (any origin) and a signal of any unit, evenly sampled within a few per cent, from just after the edge
        of the input.

    Returns
    -------
    RingDown or None
        The log decrement is 2 pi zeta / sqrt(1 - zeta^2). The slow exponential represents creep and filling.
    """
    t = np.asarray(time, dtype=float) - np.asarray(time, dtype=float)[:1]
    y = np.asarray(signal, dtype=float)
    if t.size < 16 or not np.isfinite(t + y).all() or np.ptp(y) == 0:
        return None
    return fitted_ring_down(t.tobytes(), y.tobytes())


@lru_cache(maxsize=256)
def fitted_ring_down(time: bytes, signal: bytes) -> RingDown | None:
    """Return the result of `ring_down` for the bytes of the time and signal arrays. Results are cached."""
    from scipy.optimize import least_squares

    t, y = np.frombuffer(time), np.frombuffer(signal)
    scale = float(np.std(y))
    y = y / scale
    span = float(t[-1])
    fits = []
    for f in peak_frequencies(t, y):
        start = [np.log(2 * np.pi * f), np.log(0.1 * 2 * np.pi * f), np.log(0.3 * span)]
        fits.append(least_squares(decay_residual, start, decay_jacobian, args=(t, y), method="lm", max_nfev=200))
    for fit in sorted(fits, key=lambda fit: fit.cost):  # the best may be a slow part without oscillation
        ring = oscillation(fit.x, t, y)
        if ring is not None and ring.amplitude > LEAST_AMPLITUDE * np.ptp(y):
            return ring._replace(amplitude=ring.amplitude * scale)
    return None


def oscillation(x: Array, t: Array, y: Array) -> RingDown | None:
    """Return the damped sine of a fit with parameters x (3,) to a signal y (T,) at times t (T,) [s]. Return None if the
    signal does not clearly oscillate.

    None is returned if the sine explains too little of the signal, the signal spans less than two periods, the damping
    is too strong, the motion does not turn back, or the signal does not swing back and a motion that never turns back
    explains it as well, such as the return of an over-damped body after a delay. `decay_basis` explains x.
    """
    omega, sigma = np.exp(x[0]), np.exp(x[1])
    basis = decay_basis(x, t)
    weights = np.linalg.lstsq(basis, y, rcond=None)[0]
    left = y - basis @ weights
    slow = y - basis[:, 2:] @ weights[2:]
    explained = 1.0 - float(np.sum(left**2) / max(np.sum((slow - slow.mean()) ** 2), 1e-300))
    frequency = float(omega / (2 * np.pi))
    highest = 0.4 / float(np.median(np.diff(t)))
    if explained < SHARE_NEEDED or frequency * float(t[-1]) < PERIODS_NEEDED or frequency > highest:
        return None
    curve = basis @ weights
    rise, fall = curve - np.minimum.accumulate(curve), np.maximum.accumulate(curve) - curve
    if min(float(rise.max()), float(fall.max())) < RETURN_NEEDED * float(np.ptp(curve)):
        return None
    ratio = float(sigma / np.hypot(sigma, omega))
    squares = float(left @ left)
    monotone = monotone_squares(y) - squares < BEYOND_MONOTONE * squares / y.size
    if ratio > MOST_DAMPED or (monotone and not swings_back(t, y)):
        return None
    return RingDown(frequency, ratio, float(np.hypot(weights[0], weights[1])), explained)


def swings_back(t: Array, y: Array) -> bool:
    """Return whether a signal y (T,) at times t (T,) [s] turns back at least twice, clear of noise and by the swing of
    the smallest sine that counts. A monotone sequence does not describe such a signal, however badly a sine fits it.
    """
    return turning_points(t, y, max(NOISE * noise_of(y), 2.0 * LEAST_AMPLITUDE * float(np.ptp(y))))[0].size > 2


def noise_of(y: Array) -> float:
    """Return the standard deviation of white noise on a smooth signal y (T,), from its second differences."""
    return float(np.median(np.abs(np.diff(y, 2)))) / 0.6745 / float(np.sqrt(6.0))


def monotone_squares(y: Array) -> float:
    """Return the sum of squared residuals of the monotone sequence, rising or falling, that is nearest to a signal y
    (T,).
    """
    from scipy.optimize import isotonic_regression

    return min(float(np.sum((y - isotonic_regression(y, increasing=up).x) ** 2)) for up in (True, False))


def peak_frequencies(t: Array, y: Array, count: int = 3) -> Array:
    """Return the frequencies [Hz] of the `count` strongest spectral peaks of a signal y (T,) at times t (T,) [s].

    A cubic polynomial fitted to the signal is subtracted first, so that slow drift gives no peak.
    """
    slow = np.polynomial.Polynomial.fit(t, y, 3)(t)
    power = np.abs(np.fft.rfft((y - slow) * np.hanning(y.size), 4 * y.size))
    frequency = np.fft.rfftfreq(4 * y.size, float(np.median(np.diff(t))))
    inner = (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]) & (frequency[1:-1] > 1.0 / t[-1])
    peaks = np.flatnonzero(inner) + 1
    return frequency[peaks[np.argsort(power[peaks])[::-1][:count]]]


def decay_basis(x: Array, t: Array) -> Array:
    """Return the four functions whose sum models a free decay at T times, (T, 4): a damped cosine, a damped sine, a
    constant and a slow exponential.

    x (3,) are the logarithms of angular frequency [rad/s], decay rate [1/s] and time constant of the exponential [s].
    """
    omega, sigma, lag = np.exp(np.clip(x, -FAR, FAR))
    envelope = np.exp(-np.minimum(sigma * t, 700.0))
    return np.stack(
        [envelope * np.cos(omega * t), envelope * np.sin(omega * t), np.ones_like(t), np.exp(-t / lag)], axis=1
    )


def decay_residual(x: Array, t: Array, y: Array) -> Array:
    """Return the residual (T,) of the least-squares fit of a damped sine, a constant and a slow exponential to a decay
    y (T,) at times t (T,) [s].

    x (3,) are the logarithms of the sine's angular frequency, its decay rate and the exponential's time constant.
    """
    if not np.isfinite(x).all():  # MINPACK makes such a step where a column of the Jacobian vanishes
        return np.full_like(y, NOWHERE)
    left, _, _ = directions(decay_basis(x, t))
    return np.asarray(y - left @ (left.T @ y))


def decay_jacobian(x: Array, t: Array, y: Array) -> Array:
    """Return the derivatives (T, 3) of the residual of a fitted decay with respect to its three parameters x, the
    logarithms of angular frequency, decay rate and time constant.

    Source: Golub and Pereyra (1973), The differentiation of pseudo-inverses and nonlinear least squares problems
    """
    basis = decay_basis(x, t)
    left, size, right = directions(basis)
    projected = left.T @ y
    weights, remaining = right.T @ (projected / size), y - left @ projected
    wave, constant, slow = basis[:, :2] * t[:, None], np.zeros((t.size, 2)), basis[:, 3:] * t[:, None]
    omega, sigma, lag = np.exp(np.clip(x, -FAR, FAR))
    moved = np.stack([  # of the basis, (3, T, 4)
        np.hstack([omega * wave[:, ::-1] * [-1.0, 1.0], constant]), np.hstack([-sigma * wave, constant]),
        np.hstack([constant, constant[:, :1], slow / lag]),
    ])
    moved[np.abs(x) >= FAR] = 0.0  # the basis is constant beyond this limit
    along = (moved @ weights).T
    return np.asarray(left @ (left.T @ along - right @ (remaining @ moved).T / size[:, None]) - along)


def directions(basis: Array) -> tuple[Array, Array, Array]:
    """Return the singular value decomposition U, s, V^T of a matrix, without singular values that are 0 to rounding."""
    left, size, right = np.linalg.svd(basis, full_matrices=False)
    significant = size > len(basis) * np.finfo(float).eps * size[0]
    return left[:, significant], size[significant], right[significant]


class Swings(NamedTuple):
    """Frequency and damping of the large or of the small swings of a decay; None if there are too few."""

    amplitude: float | None  # half of the mean swing, unit of the signal
    frequency: float | None  # Hz, from the mean time between turning points
    damping_ratio: float | None  # from the decrement of successive swings


NONE = Swings(None, None, None)


def swings(time: Array, signal: Array) -> tuple[Swings, Swings]:
    """Return frequency and damping of the large swings of a free decay, and those of its small swings.

    A swing is the motion between two successive turning points, so that the final position need not be known. Large
    swings exceed a third of the first one, small swings are below a sixth of it and clear of noise. The frequency is
    that of the half periods between turning points. A damping ratio needs two successive swings, whose decrement ln(A_k
    / A_{k+1}) is pi zeta / sqrt(1 - zeta^2).

    Parameters
    ----------
    time, signal : array (T,)
        Times in s and a signal of any unit, evenly sampled within a few per cent, from the release on.
    """
    t, y = np.asarray(time, dtype=float), np.asarray(signal, dtype=float)
    if t.size < 16 or np.ptp(y) == 0:
        return NONE, NONE
    times, value = turning_points(t, y, max(NOISE * noise_of(y), LEAST_SWING * float(np.ptp(y))))
    way = np.abs(np.diff(value))
    if way.size == 0:
        return NONE, NONE
    large = way >= LARGE * way[0]
    end = int(np.argmin(large)) if not large.all() else way.size
    few = np.flatnonzero(way > SMALL * way[0])[-1] + 1
    return swing_statistics(times, way, 0, end), swing_statistics(times, way, int(few), way.size)


def swing_statistics(at: Array, way: Array, first: int, last: int) -> Swings:
    """Return frequency and damping of the swings `first` to `last - 1` of a decay, from the times of its turning points
    and the sizes of the swings between them.

    `at` are the times of the turning points [s], `way` the sizes of the swings between them.
    """
    count = last - first
    if count < 1:
        return NONE
    half = float(at[last] - at[first]) / count
    ratio = None
    if count > 1:
        decrement = float(np.log(way[first] / way[last - 1])) / (count - 1) / np.pi
        ratio = decrement / float(np.hypot(1.0, decrement))
    return Swings(0.5 * float(way[first:last].mean()), 0.5 / half, ratio)


def turning_points(t: Array, y: Array, least: float) -> tuple[Array, Array]:
    """Return the times (K,) [s] and values (K,) of the K turning points of a signal. Successive values differ by at
    least `least`. The first sample counts as a turning point.

    Each turning point is the extreme of the parabola through the nearest three samples.
    """
    turns, way = [0], 0.0
    for k in range(1, y.size):
        move = y[k] - y[turns[-1]]
        if way == 0.0:
            if abs(move) >= least:
                way = float(np.sign(move))
                turns.append(k)
        elif move * way >= 0:
            turns[-1] = k
        elif abs(move) >= least:
            way = -way
            turns.append(k)
    inner = [k for k in turns[1:-1] if k > 0]  # the last one may not be a turning point
    times, value = [t[0]], [y[0]]
    for k in inner:
        bend = y[k - 1] - 2.0 * y[k] + y[k + 1]
        shift = 0.5 * (y[k - 1] - y[k + 1]) / bend if bend else 0.0
        times.append(t[k] + shift * (t[k + 1] - t[k]))
        value.append(y[k] - 0.25 * (y[k - 1] - y[k + 1]) * shift)
    return np.array(times), np.array(value)


def peak(values: Array) -> float:
    """Return the element farthest from 0, with its sign; NaN is ignored. For gauge pressures of a vacuum it is
    negative.
    """
    return float(values.ravel()[np.nanargmax(np.abs(values))])
