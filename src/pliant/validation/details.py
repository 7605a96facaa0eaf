"""Details behind one number of a record: ringing while large and while small, and errors of single joints."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.identification.initial_guess import last_edge
from pliant.numerics.joint_rotations import swings_along
from pliant.numerics.swings import swings

Array = np.ndarray
SETTLED_S = 0.2  # s at the end of the motion, over which a steady error is a median
SIZES = ("large", "small")
DEFINITIONS = {
    "swing_large_mm": "half of the mean swing of the last station after the release or the pulse, of swings above a "
    "third of the first one; a swing is the way between two successive turning points, the release being the first",
    "frequency_large_hz": "frequency of those large swings, from the time between turning points, Hz",
    "damping_ratio_large": "damping ratio of those large swings, from the decrement of successive ones",
    "swing_small_mm": "as of the large ones, of swings below a sixth of the first one and clear of the sensor's noise",
    "frequency_small_hz": "frequency of the small swings, Hz",
    "damping_ratio_small": "damping ratio of the small swings",
    "joint_rmse_mrad": "difference of modelled and measured angles between neighbouring chords, from the base on "
    "through the stations, root mean square over time, mrad: where neighbours err apart, the tip stays where it is",
    "joint_steady_error_mrad": "the same difference, modelled less measured, at the end of plateau or record",
}
FORMULAS = {  # in TeX; A_k are the ways between successive turning points, t_k when they begin
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
    """Frequency, damping ratio and size of the large and of the small swings of one point, path (T, 2) [m].

    None of a step, whose first way is the rise and no swing.
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
    """Angles (T, S) [rad] from each chord to the next, through stations (T, S, 2) [m]; the first from +y.

    In space, through (T, S, 3), swings (T, S, 2); the first from +z.
    """
    chords = np.diff(position, axis=1, prepend=0.0)
    if position.shape[2] == 3:
        return swings_along(chords)
    direction = np.arctan2(-chords[..., 0], chords[..., 1])
    change = np.diff(direction, axis=1, prepend=0.0)
    return np.asarray((change + np.pi) % (2.0 * np.pi) - np.pi)


def joint_errors(exp: Experiment, modelled: Array, settled: Array) -> dict[str, list[float] | None]:
    """Errors of the angles between chords, in mrad; None for one station, whose chord is no joint.

    `settled` (T,) says which frames are the end of the motion.
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
    """Both, of a modelled motion (T, S, 2) [m]; `on` (T,) are the frames of the plateau, where there is one."""
    both = {who: two_amplitudes(exp, path) for who, path in (
        ("measured", exp.last_station), ("modelled", modelled[:, -1])
    )}
    end = exp.time[on][-1] if on is not None and on.any() else exp.time[-1]
    settled = (exp.time <= end) & (exp.time > end - SETTLED_S)
    pairs = {name: {who: both[who][name] for who in both} for name in both["measured"]}
    return {**pairs, **joint_errors(exp, modelled, settled)}
