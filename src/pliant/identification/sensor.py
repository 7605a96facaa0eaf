"""First-order lag of the position sensors, integrated on a grid finer than the frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Array = np.ndarray
LAG_STEP = 5e-3  # s, longest interval of the grid on which a lag is integrated
LEAST_LAG = 1e-9  # s: a shorter one is none


def lags_of(own: Mapping[str, float], stations: Sequence[str]) -> Array:
    """Return the time constant (S,) [s] of each station's sensor from parameters by name; empty if none is given."""
    if not any(name.rpartition(".")[2] == "sensor_lag" for name in own):
        return np.zeros(0)
    return np.array([own.get(f"{s}.sensor_lag", own.get("sensor_lag", 0.0)) for s in stations])


def between_frames(times: Array) -> tuple[Array, Array]:
    """Return times that refine `times` (T,) to steps of at most 5 ms, and the indices of `times` in them."""
    parts = np.maximum(np.ceil(np.diff(times) / LAG_STEP - 1e-9), 1).astype(int)
    frames = np.append(0, np.cumsum(parts))
    return np.interp(np.arange(frames[-1] + 1), frames, times), frames


def behind_sensors(rows: Array, between: tuple[Array, Array], lags: Array) -> Array:
    """Return frames (T, S, 3) of rows (R, S, 3) at the times of `between_frames`, after sensor lags (S,) [s]."""
    times, frames = between
    return np.asarray((lagged(rows, times, lags) if lags.size else rows)[frames])


def lagged(rows: Array, times: Array, lags: Array) -> Array:
    """Return rows (R, S, 3) after first-order sensors with time constants `lags` (S,) [s], settled at the first row.

    tau y' = u - y is solved exactly for motions that are linear between two rows. The rows may be complex.
    """
    from scipy.linalg import solve_banded

    out = rows.copy()
    step = np.diff(times)
    for s, lag in enumerate(lags):
        tau: Any = lag if np.real(lag) > LEAST_LAG else LEAST_LAG + lag - np.real(lag)
        kept = np.exp(-step / tau)
        rise = (1.0 - kept) * tau / step
        banded = np.ones((2, times.size), dtype=rows.dtype)
        banded[1, :-1] = -kept
        aim = rows[:, s].copy()
        aim[1:] = (rise - kept)[:, None] * rows[:-1, s] + (1.0 - rise)[:, None] * rows[1:, s]
        out[:, s] = solve_banded((1, 0), banded, aim)
    return out
