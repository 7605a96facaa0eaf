"""Functions for recordings of angles without positions: data quality, rest angles, and sign of the bending."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.preprocessing import detectors
from pliant.preprocessing.rest import rest_window
from pliant.recording import append_history, check_recording
from pliant.recording.inputs import recorded_inputs
from pliant.recording.rules import shape_values

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

COARSE = 0.005  # of the range of an angle: steps beyond that are reported


def angle_facts(recording: xr.Dataset) -> dict[str, Any]:
    """Return a dict of data quality of recorded angles or inclination, per station: numbers of lost samples and spikes;
    noise, largest deviation from the median and resolution of the sensor, in degrees.
    """
    names = [str(n) for n in recording["station"].values]
    columns = shape_values(recording)
    spikes, lost = detectors.spikes(columns).sum(0), np.isnan(columns).any(2).sum(0)
    each = np.moveaxis(columns, -1, 0)
    noise, steps = np.max([sensor_noise(c) for c in each], axis=0), np.max([coarse_steps(c) for c in each], axis=0)
    return {
        "stations": len(names),
        "missing": {n: int(c) for n, c in zip(names, lost, strict=True) if c},
        "spikes": {n: int(c) for n, c in zip(names, spikes, strict=True) if c},
        "noise_deg": dict(zip(names, np.degrees(noise).tolist(), strict=True)),
        "travel_deg": dict(zip(names, np.degrees(detectors.travel(columns)).tolist(), strict=True)),
        "step_deg": {n: float(np.degrees(q)) for n, q in zip(names, steps, strict=True) if q > 0},
    }


def sensor_noise(angle: NDArray) -> NDArray:
    """Return the standard deviation (S,) [rad] of the noise of S recorded angles (T, S) over T frames. For a sensor of
    coarse resolution it is the standard deviation of the rounding error.
    """
    plain = np.nan_to_num(detectors.noise_level(angle[..., None]))
    steps = np.array(coarse_steps(angle)) / np.sqrt(12.0)
    return np.where(steps > 0, steps, plain)


def coarse_steps(angle: NDArray) -> list[float]:
    """Return the resolution [rad] of the angle sensor of each station, from recorded angles (T, S) of S stations over T
    frames. It is 0 where the resolution is fine compared with the range of the angle.
    """
    steps = [detectors.quantum(a) for a in angle.T]
    return [q if q > COARSE * (np.nanmax(a) - np.nanmin(a)) else 0.0
            for q, a in zip(steps, angle.T, strict=True)]  # fmt: skip


def angle_sentences(facts: dict[str, float]) -> list[str]:
    """Return one sentence per station about the coarse resolution of its angle sensor, with the noise that this causes.
    `facts` maps the station's name to the resolution [degrees].
    """
    return [f"the angle of {name} has a resolution of {step:.2g} degrees, which acts as {step / np.sqrt(12.0):.2g} "
            "degrees of noise"
            for name, step in facts.items()]  # fmt: skip


def from_rest(recording: xr.Dataset, rest: tuple[float, float] | None = None) -> xr.Dataset:
    """Return a recording with each angle relative to its value at rest, and with its sign changed where positive
    pressure would make it negative.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording of angles without positions; a pressure must have its times synchronised with the angles.
    rest : (start, end), s, optional
        Start and end of the rest. Default: `rest_window`.

    Returns
    -------
    xarray.Dataset
        The history lists every constant that was subtracted and every sign that was changed.

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
    lines = [f"angles are relative to the rest at {start:.3g} to {end:.3g} s, subtracted degrees: {offsets}"]
    backward = [k for k in range(len(names)) if turns_back(recording, turned[:, k])]
    turned[:, backward] *= -1.0
    if backward:
        lines.append(f"positive pressure turned {', '.join(names[k] for k in backward)} to the negative side: the sign "
                     "was changed")  # fmt: skip
    relative = recording.assign(angle=recording["angle"].copy(data=turned))
    relative["angle"].attrs = {**recording["angle"].attrs, "reference": "rest"}
    return append_history(relative, *lines)


def turns_back(recording: xr.Dataset, angle: NDArray) -> bool:
    """Return whether an angle (T,) [rad] over T frames, 0 at rest, becomes negative when the pressure rises.

    Without a measured pressure its largest magnitude decides. With several chambers the result is False, as each may
    bend to its own side.
    """
    finite = np.isfinite(angle)
    if not finite.any():
        return False
    pressures = [channel for channel in recorded_inputs(recording) if channel.kind == "pressure"]
    if len(pressures) > 1:
        return False
    if pressures:
        p = np.interp(recording["time"].values, pressures[0].time, np.nan_to_num(pressures[0].values))
        away = p - np.median(p[:5])
        return bool(float(away[finite] @ angle[finite]) < 0)
    return bool(abs(np.min(angle[finite])) > abs(np.max(angle[finite])))
