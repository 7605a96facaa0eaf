"""Checks of the sample times of a recording: milliseconds that were read as seconds, and the reverse."""

from __future__ import annotations

import numpy as np

from pliant.preprocessing.plausibility.contract import Case, Check

SLOWEST, FASTEST = 1.0, 5e-5  # s from sample to sample


def unit(case: Case) -> str:
    """Return a sentence where the times between samples are implausibly long or short for a soft body, which suggests a
    wrong unit of time; else "".
    """
    for name, what in (("time", "frames"), ("pressure_time", "samples of pressure")):
        if case.recording is None or name not in case.recording.coords or case.recording.sizes.get(name, 0) < 2:
            continue
        step = float(np.median(np.diff(case.recording[name].values)))
        if step > SLOWEST:
            return (f"the {what} are {step:.4g} s apart: were times in ms or us read as s? Name the column t_ms or "
                    "t_us, or set time_unit in the mapping")  # fmt: skip
        if step < FASTEST:
            return f"the {what} are {step:.3g} s apart: were times in s read as ms or us? Check time_unit"
    return ""


CHECKS = (
    Check("unit of time", "recording", "the median step of the times of shape and pressure",
          f"the median step is above {SLOWEST:g} s, too slow for a motion, or below {1e6 * FASTEST:g} us, faster than "
          "sensors of motion and pressure sample", unit),
)  # fmt: skip
