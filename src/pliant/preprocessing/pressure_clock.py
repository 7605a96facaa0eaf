"""Determine the sampling of a pressure that has its own times: number of samples, rate [Hz] and missing samples; and
how far the clocks of inputs and shape overlap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    import xarray as xr

NEAR = 0.2  # of the usual step: tolerance of a whole number of steps
REGULAR = 0.6  # fraction of steps near a whole number where a clock is regular; 0.4 by chance
MOST_NAMED = 5
Gap = tuple[int, float, float, int]  # sample before it, its start and length [s], samples missing


def pressure_clock(recording: xr.Dataset) -> dict[str, Any]:
    """Return a dict on the sampling of a pressure that has its own times: number of samples, duration [s], rate [Hz]
    and gaps. It is empty where the pressure has the times of the shape.

    A step of a regular clock that is longer than 1.5 usual steps is a gap, with as many missing samples as fit into it.
    """
    if "pressure" not in recording:
        return {}
    time = recording["pressure_time"].values
    if "time" in recording.coords and np.array_equal(time, recording["time"].values):
        return {}
    facts: dict[str, Any] = {"pressure_samples": len(time), "pressure_duration_s": float(time[-1] - time[0])}
    if len(time) < 2:
        return facts
    step = np.diff(time)
    usual = float(np.median(step[step <= 1.5 * np.percentile(step, 25)]))  # not the median: many samples may be missing
    usual = float(step[(step > 0.5 * usual) & (step < 1.5 * usual)].mean())  # times may be rounded
    facts["pressure_rate_hz"] = 1.0 / usual
    if np.mean(np.abs(step / usual - np.rint(step / usual)) < NEAR) < REGULAR:
        return facts | {"pressure_steps_s": (float(step.min()), float(step.max()))}
    lost = np.rint(step / usual).astype(int) - 1
    gaps = np.flatnonzero(lost > 0)
    return facts | {
        "pressure_gaps": tuple((int(k) + 1, float(time[k]), float(step[k]), int(lost[k])) for k in gaps),
    }


CLOCKS = {"pressure_time": ("pressure", "pressure"), "input_time": ("actuation", "other inputs")}
COVERED = 0.98  # fraction of the frames: inputs that cover less leave frames without a measured input


def clock_overlap(recording: xr.Dataset) -> dict[str, float]:
    """Return the fraction of the frames of the shape that lie within the times of the pressure and of other inputs,
    where these have their own times.
    """
    if "time" not in recording.coords:
        return {}
    time, overlap = recording["time"].values, {}
    for name, (variable, what) in CLOCKS.items():
        if variable in recording and not np.array_equal(recording[name].values, time):
            clock = recording[name].values
            overlap[what] = float(((time >= clock[0]) & (time <= clock[-1])).mean())
    return overlap


def overlap_sentences(recording: xr.Dataset, overlap: Mapping[str, float]) -> list[str]:
    """Return a sentence for each clock of inputs that covers less than `COVERED` of the frames of the shape."""
    said = []
    for name, (_, what) in CLOCKS.items():
        if overlap.get(what, 1.0) < COVERED:
            spans = [f"{t[0]:.6g} to {t[-1]:.6g} s" for t in (recording[name].values, recording["time"].values)]
            said.append(f"the clock of the {what} covers {100 * overlap[what]:.0f} % of the shape's frames: it has "
                        f"{spans[0]}, the shape {spans[1]}")  # fmt: skip
    return said


def clock_sentences(samples: int, gaps: tuple[Gap, ...], steps: tuple[float, ...]) -> list[str]:
    """Return a sentence where the sample times of the pressure are irregular or have gaps; else an empty list."""
    if steps:
        return [f"the times of the pressure are irregular: steps of {steps[0]:.3g} to {steps[1]:.3g} s"]
    if not gaps:
        return []
    missing, longest = sum(gap[3] for gap in gaps), max(gaps, key=lambda gap: gap[2])
    where = ", ".join(f"{row} ({start:.4g} s)" for row, start, _, _ in gaps[:MOST_NAMED])
    more = f" and {len(gaps) - MOST_NAMED} more" if len(gaps) > MOST_NAMED else ""
    count = f"{missing} of {samples + missing} samples of the pressure are missing, in {len(gaps)} gap(s)"
    length = f"the longest gap is {longest[2]:.3g} s ({longest[3]} missing) at {longest[1]:.4g} s"
    return [f"{count} after sample {where}{more}; {length}"]
