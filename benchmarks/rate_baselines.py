"""Methods that compute rates from angles without a model of the body, each tuned on one record.

Input are angles (T, n) [rad] at equal time steps; output are rates (T, n) [rad/s]. `tuned` chooses the setting with the
smallest error on a record whose rates are known. An engineer does not have this information, so the baselines are as
good as possible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from scipy.signal import butter, lfilter, savgol_coeffs, savgol_filter

Array = np.ndarray
Rates = Callable[[Array, float], Array]


def lowpass(angle: Array, rate: float, cutoff: float | None) -> Array:
    """Differences behind a Butterworth low-pass filter of second order; None: without filter."""
    raw = np.diff(angle, axis=0, prepend=angle[:1]) * rate
    return raw if cutoff is None else np.asarray(lfilter(*butter(2, cutoff / (0.5 * rate)), raw, axis=0))


def causal_polynomial(angle: Array, rate: float, window: int, order: int) -> Array:
    """Return the slope at the last of `window` frames of the polynomial that fits them best."""
    taps = savgol_coeffs(window, order, deriv=1, delta=1.0 / rate, pos=window - 1, use="dot")
    padded = np.concatenate([np.repeat(angle[:1], window - 1, axis=0), angle])
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, window, axis=0) @ taps)


def constant_acceleration(angle: Array, rate: float, jerk: float) -> Array:
    """Kalman filter of angle, rate and acceleration; `jerk` is its white density over the angles' variance."""
    h = 1.0 / rate
    F = np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    Q = jerk * np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h * h / 2], [h**3 / 6, h * h / 2, h]])
    P, x = np.diag([1.0, 1e4, 1e8]), np.zeros((3, angle.shape[1]))
    x[0] = angle[0]
    out = np.empty_like(angle)
    for k, seen in enumerate(angle):
        if k:
            x, P = F @ x, F @ P @ F.T + Q
        gain = P[:, 0] / (P[0, 0] + 1.0)
        x = x + np.outer(gain, seen - x[0])
        P = P - np.outer(gain, P[0])
        out[k] = x[1]
    return out


def centred_polynomial(angle: Array, rate: float, window: int, order: int) -> Array:
    """Savitzky-Golay filter: slope in the middle of a symmetric window."""
    return np.asarray(savgol_filter(angle, window, order, deriv=1, delta=1.0 / rate, axis=0, mode="nearest"))


CAUSAL: dict[str, tuple[Callable[..., Array], list[tuple[float | None, ...]]]] = {
    "low-pass": (lowpass, [(None,), *((f,) for f in (8.0, 12.0, 16.0, 20.0, 30.0))]),
    "polynomial": (causal_polynomial, [(w, o) for o in (1, 2, 3) for w in range(o + 1, 22)]),
    "constant acceleration": (constant_acceleration, [(10.0**e,) for e in np.arange(6.0, 16.1, 0.5)]),
}
CENTRED: dict[str, tuple[Callable[..., Array], list[tuple[float | None, ...]]]] = {
    "centred polynomial": (centred_polynomial, [(w, o) for o in (2, 4) for w in range(o + 1, 32, 2) if w % 2]),
}


def tuned(
    kinds: dict[str, tuple[Callable[..., Array], list[tuple[float | None, ...]]]], angle: Array, truth: Array,
    rate: float, error: Callable[[Array, Array], float],
) -> dict[str, tuple[Rates, tuple[float | None, ...]]]:
    """Return, for every kind, the setting with the smallest error on one record."""
    found: dict[str, tuple[Rates, tuple[float | None, ...]]] = {}
    for name, (make, settings) in kinds.items():
        best = min(settings, key=lambda s, make=make: error(make(angle, rate, *s), truth))
        found[name] = (lambda x, r, make=make, best=best: make(x, r, *best), best)
    return found


def errors(
    methods: dict[str, tuple[Rates, tuple[float | None, ...]]], angle: Array, truth: Array, rate: float,
    error: Callable[[Array, Array], float],
) -> dict[str, float]:
    """Return the error of every tuned method on a record."""
    return {name: error(made(angle, rate), truth) for name, (made, _) in methods.items()}


def span(values: Iterable[float]) -> str:
    """Return the smallest and the largest value."""
    found = sorted(values)
    return f"{found[0]:.2f} to {found[-1]:.2f}"
