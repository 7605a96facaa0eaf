"""Checks of the sample times of a recording (milliseconds that were read as seconds, and the reverse), and of a
measured pressure: its unit, its zero, clipping, and raw counts of a converter.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pliant.preprocessing.held import runs
from pliant.preprocessing.plausibility.contract import Case, Check
from pliant.recording.inputs import recorded_inputs
from pliant.units import PASCAL

SLOWEST, FASTEST = 1.0, 5e-5  # s from sample to sample
LEAST_PRESSURE, MOST_PRESSURE = 1e3, 2e6  # Pa: usual pressures of soft actuators
ABSOLUTE = "absolute pressure"  # name of a check
ATMOSPHERE = (7.9e4, 1.08e5)  # Pa: at 2000 m in low weather, and at sea level in high weather
VENTED = 2e4  # Pa: the gauge pressure of a vented body falls below it
OFFSET, HELD = 0.1, 0.5  # of the highest pressure: a vented body falls below the first, a held one stays above
COARSEST = 64  # counts: the last bits of a converter may not be used
FEWEST_LEVELS = 5
CLIPPED = 10  # consecutive samples exactly at the highest value, where others scatter
SCATTER = 0.25  # of the steps between other readings that reverse direction: two of three in noise


def time_unit(case: Case) -> str:
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


def chambers(case: Case) -> Iterator[tuple[str, NDArray]]:
    """Yield the name and the P measured values (P,) [Pa], without NaN, of each recorded pressure."""
    for channel in [] if case.recording is None else recorded_inputs(case.recording):
        if channel.kind == "pressure" and np.isfinite(channel.values).any():
            yield f"the pressure {channel.name}".rstrip(), channel.values[np.isfinite(channel.values)]


def ends(values: NDArray) -> tuple[float, float, float]:
    """Return three numbers [Pa] of a pressure (P,) [Pa] of P samples: its initial value, and its smallest and largest
    magnitude without outliers.
    """
    low, high = np.percentile(np.abs(values), [1, 99])
    passes_zero = np.prod(np.percentile(values, [1, 99])) < 0
    return float(np.median(values[:5])), 0.0 if passes_zero else float(low), float(high)


def whole_counts(values: NDArray) -> bool:
    """Return whether all values of a pressure (P,) [Pa] of P samples are whole multiples of one step, as raw counts of
    a converter are. The step must be a small whole number of a unit of pressure, such as 1 mbar.
    """
    levels = np.unique(np.round(values, 6))
    if len(levels) < FEWEST_LEVELS:
        return False
    step = float(np.diff(levels).min())
    counts = [step / pascal for pascal in PASCAL.values()]
    in_unit = any(abs(c - round(c)) < 1e-6 and 1 <= round(c) <= COARSEST for c in counts)
    ratio = levels / step
    return in_unit and bool(np.abs(ratio - np.rint(ratio)).max() < 1e-3)


def is_absolute(values: NDArray) -> bool:
    """Return whether a pressure (P,) [Pa] of P samples seems absolute: it starts or has its minimum near atmospheric
    pressure and never comes near 0.
    """
    start, low, _ = ends(values)
    return low > VENTED and any(ATMOSPHERE[0] <= p <= ATMOSPHERE[1] for p in (start, low))


def unloaded(values: NDArray) -> float:
    """Return the level [Pa] of a pressure (P,) [Pa] of P samples that seems absolute where nothing loads the body: its
    initial value if that can be the atmosphere, else its smallest magnitude without outliers.
    """
    start, low, _ = ends(values[np.isfinite(values)])
    return start if ATMOSPHERE[0] <= start <= ATMOSPHERE[1] else low


def never_vented(values: NDArray) -> bool:
    """Return whether a pressure (P,) [Pa] of P samples never comes near 0."""
    _, low, high = ends(values)
    return low > OFFSET * high


def unit(case: Case) -> str:
    """Return a sentence where the pressure is too low or too high for a soft actuator, which suggests a wrong unit;
    else "".
    """
    highest = max((float(np.abs(v).max()) for _, v in chambers(case)), default=0.0)
    if 0 < highest < LEAST_PRESSURE:
        return (f"the pressure never exceeds {highest:.3g} Pa: was a pressure in kPa, mbar or psi read as Pa? "
                "Correct its unit")
    if highest > MOST_PRESSURE:
        return f"the pressure reaches {highest / 1e6:.3g} MPa, too high for a soft actuator: check its unit"
    return ""


def absolute(case: Case) -> str:
    """Return a sentence where a pressure seems to be absolute instead of gauge pressure; else ""."""
    for name, values in chambers(case):
        if is_absolute(values):
            level = unloaded(values)
            counts = " (or raw counts of a converter: all values are whole numbers)" if whole_counts(values) else ""
            return (
                f"{name} reads {level / 1e3:.4g} kPa without load and never comes near 0: is it absolute{counts}? The "
                "model needs gauge pressure: subtract the atmosphere by linear = { pressure = { "
                f'offset = {-level / 1e3:.4g}, unit = "kPa" }} }} in the mapping, if it is absolute'
            )
    return ""


def raw_counts(case: Case) -> str:
    """Return a sentence where a pressure seems to be raw counts of an analogue-to-digital converter; else ""."""
    for name, values in chambers(case):
        if whole_counts(values) and never_vented(values) and not is_absolute(values):
            _, low, high = ends(values)
            return (
                f"{name} has only whole numbers and never falls below {100 * low / high:.0f} % of its highest "
                "value: is it raw counts of a converter? State pressure = scale * count + offset of the sensor by "
                'linear = { pressure = { scale = ..., offset = ..., unit = "kPa" } } in the mapping'
            )
    return ""


def offset(case: Case) -> str:
    """Return a sentence where a pressure never comes near 0, which suggests an offset of the sensor; else ""."""
    measured = list(chambers(case))
    for name, values in measured if len(measured) == 1 else ():  # of several chambers some hold the body
        start, low, high = ends(values)
        driven = LEAST_PRESSURE < low < HELD * high
        if driven and never_vented(values) and not whole_counts(values) and not is_absolute(values):
            return (
                f"{name} starts at {start / 1e3:.3g} kPa and never falls below {low / 1e3:.3g} kPa, "
                f"{100 * low / high:.0f} % of its highest value: correct an offset of the sensor by linear = {{ "
                'pressure = { offset = ..., unit = "kPa" } } in the mapping; change nothing if the body was never '
                "vented"
            )
    return ""


def clipped(case: Case) -> str:
    """Return a sentence where a pressure stays exactly at its highest value, as a saturated sensor does; else ""."""
    for name, values in chambers(case):
        size = np.abs(values)
        top = size == size.max()
        count = max((stop - start for start, stop in runs(top)), default=0)
        if not size.max() > 0 or count < CLIPPED:
            continue
        step = np.diff(values)
        turned = (step[1:] * step[:-1] < 0)[~top[1:-1]]
        if turned.size > CLIPPED and turned.mean() > SCATTER:
            return (f"{name} stays at its highest value, {values[top][0] / 1e3:.4g} kPa, for {count} samples in a "
                    "row, while other readings scatter: was the sensor saturated? Higher pressures are not recorded: "
                    "use a sensor of a wider range, or leave this recording out")  # fmt: skip
    return ""


CHECKS = (
    Check("unit of time", "recording", "the median step of the times of shape and pressure",
          f"the median step is above {SLOWEST:g} s, too slow for a motion, or below {1e6 * FASTEST:g} us, faster than "
          "sensors of motion and pressure sample", time_unit),
    Check("unit of pressure", "recording", "the highest measured pressure",
          f"the highest pressure is outside {LEAST_PRESSURE / 1e3:g} kPa to {MOST_PRESSURE / 1e6:g} MPa, the usual "
          "range of soft actuators", unit),
    Check(ABSOLUTE, "recording", "the measured pressure at its start and where it is lowest",
          f"the pressure at the start or the lowest one is within {ATMOSPHERE[0] / 1e3:g} to {ATMOSPHERE[1] / 1e3:g} "
          f"kPa, the atmosphere up to 2000 m, and the pressure is never below {VENTED / 1e3:g} kPa", absolute),
    Check("raw counts", "recording", "steps and lowest value of the measured pressure",
          f"all values are whole numbers of a unit and none is below {100 * OFFSET:g} % of the highest value, as for a "
          "sensor with an output of 0.5 to 4.5 V", raw_counts),
    Check("offset of pressure", "recording", "the lowest pressure, where one chamber was measured",
          f"the lowest pressure is above {100 * OFFSET:g} % of the highest, where a vented body has 0, but not above "
          f"{100 * HELD:g} %, where a chamber is held under pressure", offset),
    Check("clipped pressure", "recording", "readings at the highest value, and the scatter of the others",
          f"{CLIPPED} samples or more in a row equal the highest value exactly, and more than {100 * SCATTER:g} % of "
          "the other steps reverse direction", clipped),
)  # fmt: skip
