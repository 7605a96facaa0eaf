"""Checks of a measured pressure: its unit, its zero, and whether it is a pressure at all."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pliant.preprocessing.held import runs
from pliant.preprocessing.plausibility.contract import Case, Check
from pliant.units import PASCAL

LEAST_PRESSURE, MOST_PRESSURE = 1e3, 2e6  # Pa: what soft actuators are driven with
ATMOSPHERE = (7.9e4, 1.08e5)  # Pa: at 2000 m in low weather, and at sea level in high weather
VENTED = 2e4  # Pa: a gauge pressure of a body that is vented at all comes below it
OFFSET, HELD = 0.1, 0.5  # of the highest pressure: that of a vented body falls below the first; a held one stays above
COARSEST = 64  # counts: the last bits of a converter may not be used
FEWEST_LEVELS = 5
CLIPPED = 10  # samples in a row at the highest value to the digit, where the others scatter
SCATTER = 0.25  # of the steps between other readings, those that turn back: two of three in noise


def chambers(case: Case) -> Iterator[tuple[str, NDArray]]:
    """Name and finite values (P,) [Pa] of each measured pressure."""
    if case.recording is None or "pressure" not in case.recording:
        return
    recording = case.recording
    columns = recording["pressure"].values.reshape(recording.sizes["pressure_time"], -1)
    names = (
        [f"the pressure {c}" for c in recording["chamber"].values]
        if "chamber" in recording.coords
        else ["the pressure"]
    )
    for name, values in zip(names, columns.T, strict=True):
        if np.isfinite(values).any():
            yield name, values[np.isfinite(values)]


def ends(values: NDArray) -> tuple[float, float, float]:
    """Pressure at the start, and smallest and largest magnitude that it has or passes, Pa."""
    low, high = np.percentile(np.abs(values), [1, 99])
    passes_zero = np.prod(np.percentile(values, [1, 99])) < 0
    return float(np.median(values[:5])), 0.0 if passes_zero else float(low), float(high)


def whole_counts(values: NDArray) -> bool:
    """Whether all values are whole multiples of one of the units that a file may state, or of few of them."""
    levels = np.unique(np.round(values, 6))
    if len(levels) < FEWEST_LEVELS:
        return False
    step = float(np.diff(levels).min())
    counts = [step / pascal for pascal in PASCAL.values()]
    in_unit = any(abs(c - round(c)) < 1e-6 and 1 <= round(c) <= COARSEST for c in counts)
    ratio = levels / step
    return in_unit and bool(np.abs(ratio - np.rint(ratio)).max() < 1e-3)


def is_absolute(values: NDArray) -> bool:
    """Whether a pressure (P,) [Pa] reads the atmosphere where it begins or is lowest, and never comes near 0."""
    start, low, _ = ends(values)
    return low > VENTED and any(ATMOSPHERE[0] <= p <= ATMOSPHERE[1] for p in (start, low))


def never_vented(values: NDArray) -> bool:
    """Whether a pressure (P,) [Pa] never comes near 0."""
    _, low, high = ends(values)
    return low > OFFSET * high


def unit(case: Case) -> str:
    """Too low or too high for a soft actuator."""
    highest = max((float(np.abs(v).max()) for _, v in chambers(case)), default=0.0)
    if 0 < highest < LEAST_PRESSURE:
        return f"the pressure never exceeds {highest:.3g} Pa: was it kPa, mbar or psi read as Pa?"
    if highest > MOST_PRESSURE:
        return f"the pressure reaches {highest / 1e6:.3g} MPa: check its unit"
    return ""


def absolute(case: Case) -> str:
    """Absolute pressure where gauge pressure is needed."""
    for name, values in chambers(case):
        if is_absolute(values):
            start, low, _ = ends(values)
            at = start if ATMOSPHERE[0] <= start <= ATMOSPHERE[1] else low
            counts = " (or raw counts of a converter: all values are whole numbers)" if whole_counts(values) else ""
            return (
                f"{name} reads {at / 1e3:.4g} kPa without load and never comes near 0: is it absolute{counts}? The "
                f"model needs gauge pressure: subtract the atmosphere by linear = {{ pressure = {{ "
                f"offset = {-at / 1e3:.4g}, "
                'unit = "kPa" } } in the mapping, if that is what it was'
            )
    return ""


def raw_counts(case: Case) -> str:
    """Counts of an analogue-to-digital converter that were called a pressure."""
    for name, values in chambers(case):
        if whole_counts(values) and never_vented(values) and not is_absolute(values):
            _, low, high = ends(values)
            return (
                f"{name} takes whole numbers only and rests at {100 * low / high:.0f} % of its highest value: is it "
                "raw counts of a converter? State pressure = scale * count + offset of the sensor by "
                'linear = { pressure = { scale = ..., offset = ..., unit = "kPa" } } in the mapping'
            )
    return ""


def offset(case: Case) -> str:
    """A pressure that never comes to 0."""
    measured = list(chambers(case))
    for name, values in measured if len(measured) == 1 else ():  # of several chambers some hold the body
        start, low, high = ends(values)
        driven = LEAST_PRESSURE < low < HELD * high
        if driven and never_vented(values) and not whole_counts(values) and not is_absolute(values):
            return (
                f"{name} begins at {start / 1e3:.3g} kPa and never comes nearer to 0 than {low / 1e3:.3g} kPa, "
                f"{100 * low / high:.0f} % of its highest: a sensor's offset belongs into linear = {{ pressure = "
                '{ offset = ..., unit = "kPa" } } of the mapping; a body that was never vented is right as it is'
            )
    return ""


def clipped(case: Case) -> str:
    """A sensor at the end of its range: readings that scatter, but stand still at the highest."""
    for name, values in chambers(case):
        size = np.abs(values)
        top = size == size.max()
        count = max((stop - start for start, stop in runs(top)), default=0)
        if not size.max() > 0 or count < CLIPPED:
            continue
        step = np.diff(values)
        turned = (step[1:] * step[:-1] < 0)[~top[1:-1]]
        if turned.size > CLIPPED and turned.mean() > SCATTER:
            return (f"{name} stands at its highest value, {values[top][0] / 1e3:.4g} kPa, for {count} samples in a "
                    "row, while other readings scatter: did the sensor reach the end of its range? What lies beyond "
                    "is not in the record: use a sensor of a wider range, or leave the record out")  # fmt: skip
    return ""


CHECKS = (
    Check("unit of pressure", "recording", "the highest measured pressure",
          f"outside {LEAST_PRESSURE / 1e3:g} kPa to {MOST_PRESSURE / 1e6:g} MPa, with which soft actuators are driven",
          unit),
    Check("absolute pressure", "recording", "the measured pressure at its start and where it is lowest",
          f"{ATMOSPHERE[0] / 1e3:g} to {ATMOSPHERE[1] / 1e3:g} kPa, the atmosphere up to 2000 m, and never below "
          f"{VENTED / 1e3:g} kPa", absolute),
    Check("raw counts", "recording", "steps and lowest value of the measured pressure",
          f"only whole numbers of a unit, and never below {100 * OFFSET:g} % of the highest value, where the zero of a "
          "sensor of 0.5 to 4.5 V lies", raw_counts),
    Check("offset of pressure", "recording", "the lowest pressure, where one chamber was measured",
          f"above {100 * OFFSET:g} % of the highest, where a vented body has 0; not above {100 * HELD:g} %, where a "
          "chamber is held", offset),
    Check("clipped pressure", "recording", "readings at the highest value, beside how the others scatter",
          f"{CLIPPED} samples or more in a row equal the highest to the digit, and more than {100 * SCATTER:g} % of "
          "the other steps turn back", clipped),
)  # fmt: skip
