"""Detailed metrics of a recording: frequency and damping of large and small swings, and errors of single joints."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.identification.initial_guess import last_edge
from pliant.numerics.joint_rotations import swings_along
from pliant.numerics.swings import swings

Array = np.ndarray
SETTLED_S = 0.2  # s at the end of the motion, whose median is the steady error
SIZES = ("large", "small")
DEFINITIONS = {
    "swing_large_mm": "mean amplitude (half a swing) of the last station after the release or the pulse, over swings "
    "larger than a third of the first one; a swing is the motion between two successive turning points",
    "frequency_large_hz": "frequency of those large swings, from the time between turning points, Hz",
    "damping_ratio_large": "damping ratio of those large swings, from the decrement of successive ones",
    "swing_small_mm": "mean amplitude over swings smaller than a sixth of the first one and above the sensor's noise",
    "frequency_small_hz": "frequency of the small swings, Hz",
    "damping_ratio_small": "damping ratio of the small swings",
    "joint_rmse_mrad": "root mean square over time of the difference between modelled and measured angles between the "
    "chords that join neighbouring stations, from the base on, mrad; opposite errors of neighbours cancel at the tip",
    "joint_steady_error_mrad": "modelled less measured angle between these chords, at the end of plateau or record, "
    "mrad",
}
FORMULAS = {  # in TeX; A_k are the swings between successive turning points, t_k their start times
    "swing_large_mm": r"10^3\,\tfrac12\operatorname{mean}\{A_k:A_k\ge\tfrac13A_1\}",
    "frequency_large_hz": r"\operatorname{mean}^{-1}\{2(t_{k+1}-t_k):A_k\ge\tfrac13A_1\}",
    "damping_ratio_large": r"\delta/\sqrt{\pi^2+\delta^2},\quad\delta=\operatorname{mean}\ln(A_k/A_{k+1})",
    "swing_small_mm": r"10^3\,\tfrac12\operatorname{mean}\{A_k:A_k\le\tfrac16A_1\}",
    "frequency_small_hz": r"\operatorname{mean}^{-1}\{2(t_{k+1}-t_k):A_k\le\tfrac16A_1\}",
    "damping_ratio_small": r"\delta/\sqrt{\pi^2+\delta^2}",
    "joint_rmse_mrad": r"10^3\sqrt{\operatorname{mean}_t\,(q^r_{ti}-q^m_{ti})^2}",
    "joint_steady_error_mrad": r"10^3\operatorname{median}_{t>t_{\text{end}}-w}(q^r_{ti}-q^m_{ti})",
}


def two_amplitudes(exp: Experiment, path: Array) -> dict[str, float | None]:
    """Return frequency, damping ratio and amplitude of the large and the small swings of a path (T, 2) [m].

    All values are None for a step, since its first motion is the rise and not a swing.
    """
    unit, factor = exp.shown_in
    late = (exp.time > last_edge(exp)) & np.isfinite(path).all(axis=1) & (exp.excitation != "step")
    found: dict[str, float | None] = {}
    p = path[late]
    along = p[:, 0]
    if len(p) >= 2:
        along = p @ np.linalg.svd(p - p.mean(axis=0), full_matrices=False)[2][0]
    for size, of in zip(SIZES, swings(exp.time[late], along), strict=True):
        found[f"swing_{size}_{unit}"] = None if of.amplitude is None else factor * of.amplitude
        found[f"frequency_{size}_hz"] = of.frequency
        found[f"damping_ratio_{size}"] = of.damping_ratio
    return found


def turns(position: Array) -> Array:
    """Return the angles (T, S) [rad] from each chord to the next, through stations (T, S, 2) [m]; the first from +y.

    In space, with stations (T, S, 3), the result is (T, S, 2): the rotation vector across the chord; the first from +z.
    """
    chords = np.diff(position, axis=1, prepend=0.0)
    if position.shape[2] == 3:
        return swings_along(chords)
    direction = np.arctan2(-chords[..., 0], chords[..., 1])
    change = np.diff(direction, axis=1, prepend=0.0)
    return np.asarray((change + np.pi) % (2.0 * np.pi) - np.pi)


def joint_errors(exp: Experiment, modelled: Array, settled: Array) -> dict[str, list[float] | None]:
    """Return the errors of the angles between chords [mrad]; None for a single station or angles alone.

    `settled` (T,) marks the frames at the end of the motion.
    """
    if len(exp.stations) < 2 or exp.without_positions:
        return {"joint_rmse_mrad": None, "joint_steady_error_mrad": None}
    away = 1e3 * (turns(modelled) - turns(exp.position))
    away = np.linalg.norm(away, axis=2) if away.ndim == 3 else away
    seen = np.isfinite(away).all(axis=1)
    rms = np.sqrt(np.mean(away[seen] ** 2, axis=0))
    late = seen & settled
    return {
        "joint_rmse_mrad": rms.tolist(),
        "joint_steady_error_mrad": np.median(away[late], axis=0).tolist() if late.any() else None,
    }


def details(exp: Experiment, modelled: Array, on: Array | None) -> dict[str, Any]:
    """Return the two-amplitude and joint metrics of a modelled motion (T, S, 2) [m].

    `on` (T,) marks the frames of the pressure's plateau; None if there is none.
    """
    both = {who: two_amplitudes(exp, path) for who, path in (
        ("measured", exp.last_station), ("modelled", modelled[:, -1])
    )}
    end = exp.time[on][-1] if on is not None and on.any() else exp.time[-1]
    settled = (exp.time <= end) & (exp.time > end - SETTLED_S)
    pairs = {name: {who: both[who][name] for who in both} for name in both["measured"]}
    return {**pairs, **joint_errors(exp, modelled, settled)}
