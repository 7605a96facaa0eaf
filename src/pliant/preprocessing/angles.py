"""Angles without places: what is in them, and how they are brought to the rest pose and the sign of the pressure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.preprocessing import detectors
from pliant.preprocessing.rest import rest_window
from pliant.recording import append_history, check_recording

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

COARSE = 0.005  # of the range of an angle: steps beyond that are reported


def angle_facts(recording: xr.Dataset) -> dict[str, Any]:
    """Fields of `Quality` that a recording of angles alone has: gaps, spikes, noise, turn and step of each station."""
    names = [str(n) for n in recording["station"].values]
    angle = recording["angle"].values
    columns = angle[..., None]
    spikes, lost = detectors.spikes(columns).sum(0), np.isnan(angle).sum(0)
    return {
        "stations": len(names),
        "missing": {n: int(c) for n, c in zip(names, lost, strict=True) if c},
        "spikes": {n: int(c) for n, c in zip(names, spikes, strict=True) if c},
        "noise_deg": dict(zip(names, np.degrees(sensor_noise(angle)).tolist(), strict=True)),
        "travel_deg": dict(zip(names, np.degrees(detectors.travel(columns)).tolist(), strict=True)),
        "step_deg": {n: float(np.degrees(q)) for n, q in zip(names, coarse_steps(angle), strict=True) if q > 0},
    }


def sensor_noise(angle: NDArray) -> NDArray:
    """(S,) standard deviation of angles' noise, rad: that of the numbers, or of the steps that they come in."""
    plain = np.nan_to_num(detectors.noise_level(angle[..., None]))
    steps = np.array(coarse_steps(angle)) / np.sqrt(12.0)
    return np.where(steps > 0, steps, plain)


def coarse_steps(angle: NDArray) -> list[float]:
    """Step in which each station's sensor counts, rad, where it is coarse beside the range of the angle; else 0."""
    steps = [detectors.quantum(a) for a in angle.T]
    return [q if q > COARSE * (np.nanmax(a) - np.nanmin(a)) else 0.0
            for q, a in zip(steps, angle.T, strict=True)]  # fmt: skip


def angle_sentences(facts: dict[str, float]) -> list[str]:
    """Return a sentence for each station whose angle sensor has a coarse resolution; `facts`: its step in degrees."""
    return [f"the angle of {name} comes in steps of {step:.2g} degrees: {step / np.sqrt(12.0):.2g} degrees of noise"
            for name, step in facts.items()]  # fmt: skip


def from_rest(recording: xr.Dataset, rest: tuple[float, float] | None = None) -> xr.Dataset:
    """Angles measured from the rest pose, turning to the positive side under positive pressure.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording of angles without places; where its pressure was measured, on the clock of the angles.
    rest : (start, end), s, optional
        When the body was at rest. Default: found, see `rest_window`.

    Returns
    -------
    xarray.Dataset
        Every constant that was taken off and every sign that was changed is in its history.

    Raises
    ------
    InputError
        When no rest is found.
    """
    check_recording(recording)
    start, end = rest or rest_window(recording)
    time, angle = recording["time"].values, recording["angle"].values
    still = angle[(time >= start) & (time <= end)]
    zero = np.array([np.median(s[np.isfinite(s)]) if np.isfinite(s).any() else 0.0 for s in still.T])
    turned = angle - zero
    names = [str(n) for n in recording["station"].values]
    offsets = ", ".join(f"{n} {np.degrees(z):.3g}" for n, z in zip(names, zero, strict=True))
    lines = [f"angles are measured from the rest at {start:.3g} to {end:.3g} s, degrees taken off: {offsets}"]
    backward = [k for k in range(len(names)) if turns_back(recording, turned[:, k])]
    turned[:, backward] *= -1.0
    if backward:
        lines.append(f"positive pressure turned {', '.join(names[k] for k in backward)} to the negative side: the sign "
                     "is turned")  # fmt: skip
    kept = recording.assign(angle=recording["angle"].copy(data=turned))
    kept["angle"].attrs = {**recording["angle"].attrs, "reference": "rest"}
    return append_history(kept, *lines)


def turns_back(recording: xr.Dataset, angle: NDArray) -> bool:
    """Whether an angle (T,) from rest goes to the negative side under pressure, or most where none was measured.

    Of several chambers each may bend to its own side: nothing is turned.
    """
    seen = np.isfinite(angle)
    if not seen.any():
        return False
    if "pressure" in recording and recording["pressure"].ndim > 1 and recording.sizes["chamber"] > 1:
        return False
    if "pressure" in recording:
        p = np.interp(
            recording["time"].values,
            recording["pressure_time"].values,
            np.nan_to_num(recording["pressure"].values.reshape(-1)),
        )
        away = p - np.median(p[:5])
        return bool(float(away[seen] @ angle[seen]) < 0)
    return bool(abs(np.min(angle[seen])) > abs(np.max(angle[seen])))
