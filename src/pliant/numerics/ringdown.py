"""Frequency and damping of a free decay, fitted without a model of the body."""

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
RETURN_NEEDED = 0.01  # of the range: an over-damped motion, fitted by a sine and an exponential, turns back by less


class RingDown(NamedTuple):
    """A damped sine fitted to a free decay."""

    frequency: float  # Hz, damped
    damping_ratio: float
    amplitude: float  # unit of the signal, at the start of the window
    explained: float  # fraction of the variance (trend removed) that the damped sine explains


def ring_down(time: Array, signal: Array) -> RingDown | None:
    """Fit offset + slow exponential + damped sine to a free decay; return None when there is no clear oscillation.

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
    return found(t.tobytes(), y.tobytes())


@lru_cache(maxsize=256)
def found(time: bytes, signal: bytes) -> RingDown | None:
    """Return the result of `ring_down` for arrays given as bytes; results are cached."""
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
        if ring is not None:
            return ring._replace(amplitude=ring.amplitude * scale)
    return None


def oscillation(x: Array, t: Array, y: Array) -> RingDown | None:
    """Return the damped sine of the fitted parameters x (3,), or None.

    None where it explains too little of the signal, spans less than two periods, is damped too strongly or does not
    return.
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
    if ratio > MOST_DAMPED:
        return None
    return RingDown(frequency, ratio, float(np.hypot(weights[0], weights[1])), explained)


def peak_frequencies(t: Array, y: Array, count: int = 3) -> Array:
    """Return the strongest spectral peaks [Hz] of the signal, at most `count`, after removing its slow part."""
    slow = np.polynomial.Polynomial.fit(t, y, 3)(t)
    power = np.abs(np.fft.rfft((y - slow) * np.hanning(y.size), 4 * y.size))
    frequency = np.fft.rfftfreq(4 * y.size, float(np.median(np.diff(t))))
    inner = (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]) & (frequency[1:-1] > 1.0 / t[-1])
    peaks = np.flatnonzero(inner) + 1
    return frequency[peaks[np.argsort(power[peaks])[::-1][:count]]]


def decay_basis(x: Array, t: Array) -> Array:
    """Return the columns (T, 4) with linear weights: damped cosine, damped sine, constant, slow exponential.

    x (3,) are the logarithms of angular frequency [rad/s], decay rate [1/s] and time constant of the exponential [s].
    """
    omega, sigma, lag = np.exp(np.clip(x, -FAR, FAR))
    envelope = np.exp(-np.minimum(sigma * t, 700.0))
    return np.stack(
        [envelope * np.cos(omega * t), envelope * np.sin(omega * t), np.ones_like(t), np.exp(-t / lag)], axis=1
    )


def decay_residual(x: Array, t: Array, y: Array) -> Array:
    """Return the residual (T,) with the best linear weights of `decay_basis` (variable projection)."""
    if not np.isfinite(x).all():  # MINPACK makes such a step where a column of the Jacobian vanishes
        return np.full_like(y, NOWHERE)
    left, _, _ = directions(decay_basis(x, t))
    return np.asarray(y - left @ (left.T @ y))


def decay_jacobian(x: Array, t: Array, y: Array) -> Array:
    """Return the derivatives (T, 3) of `decay_residual` by x.

    Source: Golub and Pereyra (1973), The differentiation of pseudo-inverses and nonlinear least squares problems
    """
    basis = decay_basis(x, t)
    left, size, right = directions(basis)
    seen = left.T @ y
    weights, remaining = right.T @ (seen / size), y - left @ seen
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
    """Return the singular value decomposition of a basis without singular values at the level of rounding."""
    left, size, right = np.linalg.svd(basis, full_matrices=False)
    kept = size > len(basis) * np.finfo(float).eps * size[0]
    return left[:, kept], size[kept], right[kept]
