"""Metrics that compare a modelled motion with a measured one, with the same definitions for both.

They are errors, traits of the response, the lengthening of the body, swings of two sizes and errors of single joints.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.identification.edges import edges
from pliant.identification.experiment import Experiment
from pliant.identification.initial_guess import last_edge
from pliant.numerics.curve import arc_lengths
from pliant.numerics.ringdown import peak, ring_down, swings
from pliant.preprocessing.detectors import quantum
from pliant.reduction.links import swings_along

Array = np.ndarray
END_S = 0.2  # s at the end of the pulse or of the recording that count as steady state
LONGEST = 0.02  # fraction of the frames that counts as longest or shortest
FEWEST = 5  # frames
AT_REST, LEAVES = 0.1, 0.8  # of the peak of an input: below it is at rest; below it has left its plateau
ONE_STEP = 0.5  # of the plateau's duration: a longer rise to it is more than one step
NAMES = ("extension_mm", "extension_percent")
MODELLED = ("extension_modelled_mm", "extension_modelled_percent")
SETTLED_S = 0.2  # s at the end of the motion, whose median is the steady error
SIZES = ("large", "small")


class Metric(NamedTuple):
    """One metric of a recording.

    Attributes
    ----------
    label : str
        Name in tables and figures; empty for the words of the metric's name.
    kind : str
        Type of the value in metrics.json, a key of `metrics_file.KINDS`.
    formula : str
        TeX, in the symbols of docs/metrics.md; A_k are the swings between successive turning points.
    meaning : str
    """

    label: str
    kind: str
    formula: str
    meaning: str


METRICS = {  # of a recording of positions
    "rmse_mm": Metric("RMSE", "number", r"10^3\,e,\quad e=\sqrt{\frac{1}{N}\sum_{t,s}|r_{ts}-m_{ts}|^2}",
        "Euclidean distance between modelled and measured points, root mean square over stations and time, mm"),
    "max_mm": Metric("largest distance", "number", r"10^3\max_{t,s}|r_{ts}-m_{ts}|",
        "largest Euclidean distance over stations and time, mm"),
    "rmse_percent_of_travel": Metric("RMSE / peak displacement", "number", r"100\,e/\max_t|m_{tS}-m_0|",
        "rmse_mm in % of the peak displacement of the last station from its rest position"),
    "rmse_percent_of_length": Metric("RMSE / length", "number", r"100\,e/L", "rmse_mm in % of the body's length"),
    "fit_percent": Metric("NRMSE fit", "number or null",
        r"100\left(1-\sqrt{\frac{\sum_{t,s}|r_{ts}-m_{ts}|^2}{\sum_{t,s}|m_{ts}-\bar m_s|^2}}\right)",
        "100 (1 - |measured - modelled| / |measured - mean of measured|) over stations and time (NRMSE fit)"),
    "within_band_percent": Metric("within the 95 % band", "band",
        r"\frac{100}{2N}\,\#\{(t,s,c):\ l_{tsc}\le m_{tsc}\le h_{tsc}\}",
        "percentage of a held-out record's coordinates in the 95 % prediction band, which combines the parameters' "
        "uncertainty with the residuals of the training records; near 95 if the model is valid"),
    "frequency_hz": Metric("", "pair",
        r"\omega_d/2\pi\ \text{ of }\ a\,e^{-\sigma t}\cos(\omega_d t+\varphi)+b+c\,e^{-t/\tau}",
        "frequency of the damped ring-down after the pulse or the release, Hz"),
    "damping_ratio": Metric("", "pair", r"\sigma/\sqrt{\sigma^2+\omega_d^2}",
        "damping ratio of the ring-down after the pulse or the release"),
    "overshoot_percent": Metric("", "pair", r"100\left(u_{\text{peak}}/u_{\text{end}}-1\right)",
        "first peak above the value at the end of the pulse, in % of that value"),
    "steady_state_mm": Metric("", "pair",
        r"10^3\,u_{\text{end}},\quad u_{\text{end}}=\operatorname{median}_{t>t_{\text{end}}-w}u(t)",
        "displacement of the last station from its rest position at the end of the pulse or release, mm"),
    "extension_mm": Metric("", "number or null", r"10^3\,(\ell_{\text{most}}-\ell_{\text{rest}})",
        "largest change of the measured body's length, by arcs through the stations, from rest, mm"),
    "extension_percent": Metric("", "number or null", r"100\,(\ell_{\text{most}}/\ell_{\text{rest}}-1)",
        "extension_mm in % of the length in the first frames"),
    "extension_modelled_mm": Metric("", "number or null", r"10^3\,(\hat\ell_{\text{most}}-\hat\ell_{\text{rest}})",
        "change of the modelled body's length in the same frames, likewise, mm"),
    "extension_modelled_percent": Metric("", "number or null",
        r"100\,(\hat\ell_{\text{most}}/\hat\ell_{\text{rest}}-1)",
        "extension_modelled_mm in % of the length in the first frames"),
    "steady_state_error_mm": Metric("steady-state error", "number or null",
        r"10^3\left(u_{\text{end}}^{\text{modelled}}-u_{\text{end}}^{\text{measured}}\right)",
        "difference of steady_state_mm, modelled less measured, mm"),
    "travel_mm": Metric("", "number", r"10^3\max_t|m_{tS}-m_0|",
        "peak displacement: the largest measured displacement of the last station from its rest position, mm"),
    "frames": Metric("", "count", "", "frames of the recording that were compared"),
    "points_not_seen": Metric("", "count", "", "number of missing measurements, counted over stations and frames"),
    "fitted_edges_s": Metric("", "edges", "",
        "start and stop of a held-out pulse whose pressure was not measured, fitted to this record, s"),
    "swing_large_mm": Metric("", "pair", r"10^3\,\tfrac12\operatorname{mean}\{A_k:A_k\ge\tfrac13A_1\}",
        "mean amplitude (half a swing) of the last station after the release or the pulse, over swings larger than "
        "a third of the first one; a swing is the motion between two successive turning points"),
    "frequency_large_hz": Metric("frequency, large swings", "pair",
        r"\operatorname{mean}^{-1}\{2(t_{k+1}-t_k):A_k\ge\tfrac13A_1\}",
        "frequency of those large swings, from the time between turning points, Hz"),
    "damping_ratio_large": Metric("damping ratio, large swings", "pair",
        r"\delta/\sqrt{\pi^2+\delta^2},\quad\delta=\operatorname{mean}\ln(A_k/A_{k+1})",
        "damping ratio of those large swings, from the decrement of successive ones"),
    "swing_small_mm": Metric("", "pair", r"10^3\,\tfrac12\operatorname{mean}\{A_k:A_k\le\tfrac16A_1\}",
        "mean amplitude over swings smaller than a sixth of the first one and above the sensor's noise"),
    "frequency_small_hz": Metric("frequency, small swings", "pair",
        r"\operatorname{mean}^{-1}\{2(t_{k+1}-t_k):A_k\le\tfrac16A_1\}", "frequency of the small swings, Hz"),
    "damping_ratio_small": Metric("damping ratio, small swings", "pair", r"\delta/\sqrt{\pi^2+\delta^2}",
        "damping ratio of the small swings"),
    "joint_rmse_mrad": Metric("joints, RMSE", "joints", r"10^3\sqrt{\operatorname{mean}_t\,(q^r_{ti}-q^m_{ti})^2}",
        "root mean square over time of the difference between modelled and measured angles between the chords that "
        "join neighbouring stations, from the base on, mrad; opposite errors of neighbours cancel at the tip; null for "
        "one station and for angles alone"),
    "joint_steady_error_mrad": Metric("joints, steady error", "joints",
        r"10^3\operatorname{median}_{t>t_{\text{end}}-w}(q^r_{ti}-q^m_{ti})",
        "modelled less measured angle between these chords, at the end of plateau or record, mrad"),
}  # fmt: skip
ANGLES = {  # of a recording of angles alone, where they differ
    "rmse_deg": Metric("RMSE", "number", "",
        "difference of modelled and measured angles, root mean square over stations and time, degrees"),
    "max_deg": Metric("largest difference", "number", "",
        "largest difference of modelled and measured angles, degrees"),
    "rmse_percent_of_travel": Metric("RMSE / peak displacement", "number", "",
        "rmse_deg in % of the largest rotation of the last station from its rest angle"),
    "sensor_step_deg": Metric("step of the sensor", "number or null", "",
        "resolution of the last station's angle sensor, degrees; its noise is this over the root of 12"),
    "steady_state_deg": Metric("", "pair", "",
        "rotation of the last station from its rest angle at the end of the pulse or release, degrees"),
    "steady_state_error_deg": Metric("steady-state error", "number or null", "",
        "difference of steady_state_deg, modelled less measured, degrees"),
    "travel_deg": Metric("", "number", "",
        "largest measured rotation of the last station from its rest angle, degrees"),
    **{name.replace("_mm", "_deg"): metric for name, metric in METRICS.items() if name.startswith("swing")},
}  # fmt: skip


def metric_table(*, turns: bool) -> dict[str, Metric]:
    """Return the metrics of a recording of positions or, with `turns`, of one of angles."""
    if not turns:
        return METRICS
    of_places = ("_mm", "of_length", "extension_percent", "extension_modelled_percent")
    return {**ANGLES, **{k: v for k, v in METRICS.items() if not k.endswith(of_places) and k not in ANGLES}}


def definitions(*, turns: bool) -> dict[str, str]:
    """Return the definition of each metric, for positions or, with `turns`, for angles."""
    return {name: metric.meaning for name, metric in metric_table(turns=turns).items()}


def compare(exp: Experiment, modelled: Array, length: float) -> dict[str, Any]:
    """Compare the modelled motion (T, S, 2) [m] of S stations over T frames with a recording, and return the error
    metrics by name.

    Parameters
    ----------
    exp : Experiment
        A measured pressure must be on the clock of the shape: see `Experiment.synchronised`.
    modelled : (T, S, 2) or (T, S, 3) array, m
        For recordings of angles alone (T, S, 1) [rad]; metrics whose names end in ``_mm`` then end in ``_deg``.
    length : float
        Length of the body [m].

    Returns
    -------
    dict
        Plain numbers. ``frequency_hz`` and other traits are pairs {"measured": ..., "modelled": ...}, with None if the
        motion does not have this trait (no ring-down, no overshoot).
    """
    unit, factor = exp.shown_in
    distance = np.linalg.norm(modelled - exp.compared, axis=-1)
    valid = np.isfinite(distance)
    rmse = float(np.sqrt(np.mean(distance[valid] ** 2)))
    variation = exp.compared - np.nanmean(exp.compared, axis=0)
    spread = float(np.nansum(variation**2))
    fit = 100 * float(1.0 - np.sqrt(np.sum(distance[valid] ** 2) / spread)) if spread > 0 else None  # for a single pose
    compared = np.where(exp.warming[:, None], np.nan, modelled[:, -1])  # both begin at the first compared frame
    traits = {"measured": response(exp, exp.last_station), "modelled": response(exp, compared)}
    ends, begins = (traits[who][f"steady_state_{unit}"] for who in ("modelled", "measured"))
    resolution = {"sensor_step_deg": factor * quantum(exp.last_station[:, 0]) or None} if exp.without_positions else {
        "rmse_percent_of_length": 100 * rmse / length, **extension(exp, modelled)}
    return {
        f"rmse_{unit}": factor * rmse,
        f"max_{unit}": factor * float(distance[valid].max()),
        "rmse_percent_of_travel": 100 * rmse / exp.travel,
        "fit_percent": fit,
        **{name: {who: traits[who][name] for who in traits} for name in next(iter(traits.values()))},
        f"steady_state_error_{unit}": None if ends is None or begins is None else ends - begins,
        "frames": int(exp.time.size),
        "points_not_seen": int((~valid).sum()),
        f"travel_{unit}": factor * exp.travel,
        **resolution,
        **swing_metrics(exp, modelled, on_window(exp, exp.time)),
    }


def response(exp: Experiment, path: Array) -> dict[str, float | None]:
    """Return frequency, damping ratio, overshoot and steady state of one point's path (T, 2) [m], or of one angle (T,
    1) [rad], over T frames.
    """
    unit, factor = exp.shown_in
    measured = np.isfinite(path).all(axis=1)
    t, p = exp.time[measured], path[measured]
    u = np.linalg.norm(p - np.median(p[:5], axis=0), axis=1)
    late = t > last_edge(exp) + 0.03
    ring = None
    if late.sum() >= 16 and not exp.poses:
        direction = np.linalg.svd(p[late] - p[late].mean(axis=0), full_matrices=False)[2][0]
        ring = ring_down(t[late], p[late] @ direction)
    on, rise = on_window(exp, t), first_plateau(exp, t)
    end_s = np.ceil(END_S * ring.frequency) / ring.frequency if ring else END_S  # whole periods average the ringing out
    steady = overshoot = None
    if on is not None and on.any():
        steady = float(np.median(u[on & (t > t[on][-1] - end_s)]))
        overshoot = None if rise is None else overshoot_of(t[rise], u[rise], end_s)
    elif exp.excitation == "release":
        steady = float(np.median(u[t > t[-1] - end_s]))
    return {
        "frequency_hz": ring.frequency if ring else None,
        "damping_ratio": ring.damping_ratio if ring else None,
        "overshoot_percent": overshoot if overshoot is not None and overshoot > 0 else None,
        f"steady_state_{unit}": factor * steady if steady is not None else None,
    }


def overshoot_of(t: Array, u: Array, end_s: float) -> float | None:
    """Return by how much [%] the displacement u (P,) in the first half of a plateau at times t (P,) [s] exceeds its
    median in the last `end_s` [s]; None if that is 0 or the plateau is too short.
    """
    steady, first = float(np.median(u[t > t[-1] - end_s])), t < t[0] + 0.5 * (t[-1] - t[0])
    return 100 * (float(u[first].max()) / steady - 1.0) if steady > 0 and first.any() else None


def first_plateau(exp: Experiment, t: Array) -> Array | None:
    """Return a boolean for each of the times `t` [s], True on the first plateau of the pressure, if the pressure rises
    to it from rest in one step while no other input changes; None otherwise.

    An overshoot is a trait of such a step alone: a body that goes through several levels shows none.
    """
    on = on_window(exp, t)
    if on is None or not on.any() or exp.pressure is None:
        return on
    level = exp.pressure(t) / exp.peak
    start = int(np.argmax(on))
    low = np.flatnonzero(level[:start] < AT_REST)
    left = np.flatnonzero(level[start:] < LEAVES)
    run = on & (np.arange(t.size) < (start + left[0] if left.size else t.size))
    if not run.any() or not low.size:  # the frames begin on the plateau, or on its way down
        return None
    duration = t[run][-1] - t[start]
    if t[start] - t[low[-1]] > ONE_STEP * max(duration, float(np.median(np.diff(t)))):
        return None
    others = [trace(t) / peak(trace.pressure) for trace in exp.traces.values() if trace.pressure.any()]
    settled = run & (t >= t[start] + AT_REST * duration)
    steady = all(abs(v[low[-1]]) < AT_REST and np.ptp(v[settled]) < 2 * AT_REST for v in others)
    return run if steady else None


def on_window(exp: Experiment, t: Array) -> Array | None:
    """Return a boolean for each of the times `t` [s], True on the plateau of the pressure; None if there is no
    plateau.
    """
    if exp.nominal:
        edge = edges(exp)
        return (t > edge["start"]) & (t < edge.get("stop", np.inf))
    if exp.pressure is None or exp.poses:
        return None
    p = exp.pressure(t)
    level = peak(p)
    return p / level > 0.9 if level else None


def extension(exp: Experiment, modelled: Array) -> dict[str, float | None]:
    """Return the largest difference between the measured body's length and that in the first frames, in mm and in %.
    Also return the difference for the modelled body in the same frames.

    `modelled` is (T, S, 2) [m].
    """
    complete = np.isfinite(exp.position).all(axis=(1, 2))
    measured = growth(exp.position[complete], NAMES)
    if measured[NAMES[0]] is None:
        return {**measured, **dict.fromkeys(MODELLED)}
    frames = extreme_frames(arc_lengths(exp.position[complete]))
    return {**measured, **change(arc_lengths(modelled[complete]), frames, MODELLED)}


def growth(position: Array, names: tuple[str, str]) -> dict[str, float | None]:
    """Return the largest difference between a body's length and that in the first frames, in mm and in %. The length
    follows from the positions (T, S, 2) [m] of S points along the body over T frames.

    The length is that of circular arcs through the points (`pliant.numerics.curve`). The change is the median over the
    2 % of the frames (at least five) in which the body is longest, or shortest if it shortens by more.

    Returns
    -------
    dict
        Change in mm and in % of the length in the first frames, under the two `names`. None for a body measured at a
        single point, since its tilt would look like a change of length.
    """
    if position.shape[1] < 2 or len(position) < 2 * FEWEST or np.ptp(position[:, -1], axis=0).max() == 0:
        return dict.fromkeys(names)
    length = arc_lengths(position)
    return change(length, extreme_frames(length), names)


def extreme_frames(length: Array) -> Array:
    """Return the indices of the 2 % of frames (at least 5) in which a length (T,) over T frames differs most from that
    of the first frames.

    They are the longest or the shortest frames, whichever differ more.
    """
    away = length - np.median(length[:FEWEST])
    count = max(FEWEST, round(LONGEST * length.size))
    order = np.argsort(away)
    low, high = order[:count], order[-count:]
    return np.asarray(high if np.median(away[high]) >= -np.median(away[low]) else low)


def change(length: Array, frames: Array, names: tuple[str, str]) -> dict[str, float | None]:
    """Return by how much a length (T,) [m] over T frames is larger in the frames with the indices `frames` than in the
    first frames, in mm and in %. The two `names` are the keys of the returned dict.
    """
    rest, there = float(np.median(length[:FEWEST])), float(np.median(length[frames]))
    return dict(zip(names, (1e3 * (there - rest), 100 * (there / rest - 1)), strict=True))


def two_amplitudes(exp: Experiment, path: Array) -> dict[str, float | None]:
    """Return frequency, damping ratio and amplitude, for the large and for the small swings of one point's path (T, 2)
    [m] over T frames.

    All values are None for a step, since its first motion is the rise and not a swing.
    """
    unit, factor = exp.shown_in
    late = (exp.time > last_edge(exp)) & np.isfinite(path).all(axis=1) & (exp.excitation != "step")
    traits: dict[str, float | None] = {}
    p = path[late]
    along = p[:, 0]
    if len(p) >= 2:
        along = p @ np.linalg.svd(p - p.mean(axis=0), full_matrices=False)[2][0]
    for size, of in zip(SIZES, swings(exp.time[late], along), strict=True):
        traits[f"swing_{size}_{unit}"] = None if of.amplitude is None else factor * of.amplitude
        traits[f"frequency_{size}_hz"] = of.frequency
        traits[f"damping_ratio_{size}"] = of.damping_ratio
    return traits


def chord_angles(position: Array) -> Array:
    """Return the angles (T, S) [rad] between successive straight lines through S stations (T, S, 2) [m] over T frames.
    The first is measured from +y.

    In space, with stations (T, S, 3), the result is (T, S, 2): the rotation vector across the chord; the first from +z.
    """
    chords = np.diff(position, axis=1, prepend=0.0)
    if position.shape[2] == 3:
        return swings_along(chords)
    direction = np.arctan2(-chords[..., 0], chords[..., 1])
    change = np.diff(direction, axis=1, prepend=0.0)
    return np.asarray((change + np.pi) % (2.0 * np.pi) - np.pi)


def joint_errors(exp: Experiment, modelled: Array, settled: Array) -> dict[str, list[float] | None]:
    """Return the RMS error and the steady error [mrad] of the modelled angles between the straight lines that join the
    stations. Both are None if there is one station, or if only angles were recorded.

    `settled` (T,) marks the frames at the end of the motion.
    """
    if len(exp.stations) < 2 or exp.without_positions:
        return {"joint_rmse_mrad": None, "joint_steady_error_mrad": None}
    away = 1e3 * (chord_angles(modelled) - chord_angles(exp.position))
    away = np.linalg.norm(away, axis=2) if away.ndim == 3 else away
    complete = np.isfinite(away).all(axis=1)
    rms = np.sqrt(np.mean(away[complete] ** 2, axis=0))
    late = complete & settled
    return {
        "joint_rmse_mrad": rms.tolist(),
        "joint_steady_error_mrad": np.median(away[late], axis=0).tolist() if late.any() else None,
    }


def swing_metrics(exp: Experiment, modelled: Array, on: Array | None) -> dict[str, Any]:
    """Compare the modelled motion (T, S, 2) [m] of S stations over T frames with a recording: return frequency, damping
    and amplitude of large and of small swings, and the errors of single joints.

    `on` (T,) marks the frames of the pressure's plateau; None if there is none.
    """
    both = {who: two_amplitudes(exp, path) for who, path in (
        ("measured", exp.last_station), ("modelled", modelled[:, -1])
    )}
    end = exp.time[on][-1] if on is not None and on.any() else exp.time[-1]
    settled = (exp.time <= end) & (exp.time > end - SETTLED_S)
    pairs = {name: {who: both[who][name] for who in both} for name in both["measured"]}
    return {**pairs, **joint_errors(exp, modelled, settled)}
