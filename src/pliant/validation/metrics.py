"""Metrics that compare a modelled motion with a measured one, with the same definitions for both."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.identification.edges import edges
from pliant.identification.experiment import Experiment
from pliant.identification.initial_guess import last_edge
from pliant.numerics.peak import peak
from pliant.numerics.ringdown import ring_down
from pliant.preprocessing.detectors import quantum
from pliant.validation import details
from pliant.validation.extension import extension

Array = np.ndarray
END_S = 0.2  # s at the end of the pulse or of the recording that count as steady state
DEFINITIONS = {
    "rmse_mm": "Euclidean distance between modelled and measured points, root mean square over stations and time, mm",
    "max_mm": "largest Euclidean distance over stations and time, mm",
    "rmse_percent_of_travel": "rmse_mm in % of the peak displacement of the last station from its rest position",
    "rmse_percent_of_length": "rmse_mm in % of the body's length",
    "fit_percent": "100 (1 - |measured - modelled| / |measured - mean of measured|) over stations and time (NRMSE fit)",
    "within_band_percent": "percentage of a held-out record's coordinates in the 95 % prediction band, which combines "
    "the parameters' uncertainty with the residuals of the training records; near 95 if the model is valid",
    "frequency_hz": "frequency of the damped ring-down after the pulse or the release, Hz",
    "damping_ratio": "damping ratio of the ring-down after the pulse or the release",
    "overshoot_percent": "first peak above the value at the end of the pulse, in % of that value",
    "steady_state_mm": "displacement of the last station from its rest position at the end of the pulse or release, mm",
    "extension_mm": "largest change of the measured body's length, by arcs through the stations, from rest, mm",
    "extension_percent": "extension_mm in % of the length in the first frames",
    "extension_modelled_mm": "change of the modelled body's length in the same frames, likewise, mm",
    "extension_modelled_percent": "extension_modelled_mm in % of the length in the first frames",
    "steady_state_error_mm": "difference of steady_state_mm, modelled less measured, mm",
    "travel_mm": "peak displacement: the largest measured displacement of the last station from its rest position, mm",
    "frames": "frames of the recording that were compared",
    "points_not_seen": "number of missing measurements, counted over stations and frames",
    "fitted_edges_s": "start and stop of a held-out pulse whose pressure was not measured, fitted to this record, s",
    **details.DEFINITIONS,
}
FORMULAS = {  # in TeX; docs/metrics.md defines the symbols
    "rmse_mm": r"10^3\,e,\quad e=\sqrt{\frac{1}{N}\sum_{t,s}|r_{ts}-m_{ts}|^2}",
    "max_mm": r"10^3\max_{t,s}|r_{ts}-m_{ts}|",
    "rmse_percent_of_travel": r"100\,e/\max_t|m_{tS}-m_0|",
    "rmse_percent_of_length": r"100\,e/L",
    "fit_percent": r"100\left(1-\sqrt{\frac{\sum_{t,s}|r_{ts}-m_{ts}|^2}{\sum_{t,s}|m_{ts}-\bar m_s|^2}}\right)",
    "within_band_percent": r"\frac{100}{2N}\,\#\{(t,s,c):\ l_{tsc}\le m_{tsc}\le h_{tsc}\}",
    "frequency_hz": r"\omega_d/2\pi\ \text{ of }\ a\,e^{-\sigma t}\cos(\omega_d t+\varphi)+b+c\,e^{-t/\tau}",
    "damping_ratio": r"\sigma/\sqrt{\sigma^2+\omega_d^2}",
    "overshoot_percent": r"100\left(u_{\text{peak}}/u_{\text{end}}-1\right)",
    "steady_state_mm": r"10^3\,u_{\text{end}},\quad u_{\text{end}}=\operatorname{median}_{t>t_{\text{end}}-w}u(t)",
    "steady_state_error_mm": r"10^3\left(u_{\text{end}}^{\text{modelled}}-u_{\text{end}}^{\text{measured}}\right)",
    "extension_mm": r"10^3\,(\ell_{\text{most}}-\ell_{\text{rest}})",
    "extension_percent": r"100\,(\ell_{\text{most}}/\ell_{\text{rest}}-1)",
    "extension_modelled_mm": r"10^3\,(\hat\ell_{\text{most}}-\hat\ell_{\text{rest}})",
    "extension_modelled_percent": r"100\,(\hat\ell_{\text{most}}/\hat\ell_{\text{rest}}-1)",
    "travel_mm": r"10^3\max_t|m_{tS}-m_0|",
    **details.FORMULAS,
}
ANGLES = {
    "rmse_deg": "difference of modelled and measured angles, root mean square over stations and time, degrees",
    "max_deg": "largest difference of modelled and measured angles, degrees",
    "rmse_percent_of_travel": "rmse_deg in % of the largest rotation of the last station from its rest angle",
    "sensor_step_deg": "resolution of the last station's angle sensor, degrees; its noise is this over the root of 12",
    "steady_state_deg": "rotation of the last station from its rest angle at the end of the pulse or release, degrees",
    "steady_state_error_deg": "difference of steady_state_deg, modelled less measured, degrees",
    "travel_deg": "largest measured rotation of the last station from its rest angle, degrees",
    **{k.replace("_mm", "_deg"): v for k, v in details.DEFINITIONS.items() if k.startswith("swing")},
}


def definitions(*, turns: bool) -> dict[str, str]:
    """Return the definition of each metric, for positions or, with `turns`, for angles."""
    if not turns:
        return DEFINITIONS
    of_places = ("_mm", "of_length", "extension_percent", "extension_modelled_percent")
    return {**ANGLES, **{k: v for k, v in DEFINITIONS.items() if not k.endswith(of_places) and k not in ANGLES}}


def compare(exp: Experiment, modelled: Array, length: float) -> dict[str, Any]:
    """Return the metrics of a modelled motion (T, S, 2) [m] against an experiment.

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
    seen = np.isfinite(distance)
    rmse = float(np.sqrt(np.mean(distance[seen] ** 2)))
    variation = exp.compared - np.nanmean(exp.compared, axis=0)
    spread = float(np.nansum(variation**2))
    fit = 100 * float(1.0 - np.sqrt(np.sum(distance[seen] ** 2) / spread)) if spread > 0 else None  # for a single pose
    traits = {"measured": response(exp, exp.last_station), "modelled": response(exp, modelled[:, -1])}
    ends, begins = (traits[who][f"steady_state_{unit}"] for who in ("modelled", "measured"))
    own = {"sensor_step_deg": factor * quantum(exp.last_station[:, 0]) or None} if exp.without_positions else {
        "rmse_percent_of_length": 100 * rmse / length, **extension(exp, modelled)}
    return {
        f"rmse_{unit}": factor * rmse,
        f"max_{unit}": factor * float(distance[seen].max()),
        "rmse_percent_of_travel": 100 * rmse / exp.travel,
        "fit_percent": fit,
        **{name: {who: traits[who][name] for who in traits} for name in next(iter(traits.values()))},
        f"steady_state_error_{unit}": None if ends is None or begins is None else ends - begins,
        "frames": int(exp.time.size),
        "points_not_seen": int((~seen).sum()),
        f"travel_{unit}": factor * exp.travel,
        **own,
        **details.details(exp, modelled, on_window(exp, exp.time)),
    }


def response(exp: Experiment, path: Array) -> dict[str, float | None]:
    """Return frequency, damping ratio, overshoot and steady state of one point's path (T, 2) [m] or angle
    (T, 1) [rad].
    """
    unit, factor = exp.shown_in
    seen = np.isfinite(path).all(axis=1)
    t, p = exp.time[seen], path[seen]
    u = np.linalg.norm(p - np.median(p[:5], axis=0), axis=1)
    late = t > last_edge(exp) + 0.03
    ring = None
    if late.sum() >= 16 and not exp.poses:
        direction = np.linalg.svd(p[late] - p[late].mean(axis=0), full_matrices=False)[2][0]
        ring = ring_down(t[late], p[late] @ direction)
    on = on_window(exp, t)
    end_s = np.ceil(END_S * ring.frequency) / ring.frequency if ring else END_S  # whole periods average the ringing out
    steady = overshoot = None
    if on is not None and on.any():
        end = t[on][-1]
        steady = float(np.median(u[on & (t > end - end_s)]))
        first = on & (t < t[on][0] + 0.5 * (end - t[on][0]))
        overshoot = 100 * (float(u[first].max()) / steady - 1.0) if steady > 0 and first.any() else None
    elif exp.excitation == "release":
        steady = float(np.median(u[t > t[-1] - end_s]))
    return {
        "frequency_hz": ring.frequency if ring else None,
        "damping_ratio": ring.damping_ratio if ring else None,
        "overshoot_percent": overshoot if overshoot is not None and overshoot > 0 else None,
        f"steady_state_{unit}": factor * steady if steady is not None else None,
    }


def on_window(exp: Experiment, t: Array) -> Array | None:
    """Return which of the times `t` lie in the plateau of the pressure, as booleans; None if there is no plateau."""
    if exp.excitation in ("pulse", "step"):
        edge = edges(exp)
        return (t > edge["start"]) & (t < edge.get("stop", np.inf))
    if exp.pressure is None or exp.poses:
        return None
    p = exp.pressure(t)
    level = peak(p)
    return p / level > 0.9 if level else None
