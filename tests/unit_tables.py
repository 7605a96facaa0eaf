"""A body of 120 mm that hangs along -z and bends towards x under a pulse of pressure."""

from __future__ import annotations

import numpy as np


def bending(level: float = 60.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return times (T,) [s], pressure (T,) [kPa], and positions (T, 3) of base and tip [m] with noise of 0.02 mm."""
    time = np.arange(0.0, 4.0, 0.02)
    pressure = level * np.clip((time - 0.5) / 0.3, 0, 1) - level * np.clip((time - 2.5) / 0.3, 0, 1)
    angle, state = np.zeros_like(time), 0.0
    for k, p in enumerate(pressure):
        state += 0.2 * (0.01 * p - state)
        angle[k] = state
    tip = 0.12 * np.stack([np.sin(angle / 2) * np.sinc(angle / 2 / np.pi), 0 * angle, -np.sinc(angle / np.pi)], axis=1)
    noise = np.random.default_rng(int(level)).normal(0, 2e-5, (2, time.size, 3))
    return time, pressure, noise[0], tip + noise[1]
