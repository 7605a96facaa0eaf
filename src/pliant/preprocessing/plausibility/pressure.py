"""Checks of the sample times of a recording (milliseconds that were read as seconds, and the reverse), and of a
measured pressure: its unit, its zero, clipping, and raw counts of a converter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pliant.numerics.ringdown import peak
from pliant.preprocessing import detectors
from pliant.preprocessing.held import runs
from pliant.preprocessing.plausibility.contract import Case, Check
from pliant.recording.inputs import recorded_inputs
from pliant.units import PASCAL

SLOWEST, FASTEST = 1.0, 5e-5  # s from sample to sample
LEAST_PRESSURE, MOST_PRESSURE = 1e3, 2e6  # Pa: usual pressures of soft actuators
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
    for one in [] if case.recording is None else recorded_inputs(case.recording):
        if one.kind == "pressure" and np.isfinite(one.values).any():
            yield f"the pressure {one.name}".rstrip(), one.values[np.isfinite(one.values)]


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
            start, low, _ = ends(values)
            at = start if ATMOSPHERE[0] <= start <= ATMOSPHERE[1] else low
            counts = " (or raw counts of a converter: all values are whole numbers)" if whole_counts(values) else ""
            return (
                f"{name} reads {at / 1e3:.4g} kPa without load and never comes near 0: is it absolute{counts}? The "
                "model needs gauge pressure: subtract the atmosphere by linear = { pressure = { "
                f'offset = {-at / 1e3:.4g}, unit = "kPa" }} }} in the mapping, if it is absolute'
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
    Check("absolute pressure", "recording", "the measured pressure at its start and where it is lowest",
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


COPIED, FEWEST = 0.5, 10  # of the frames of the shorter one, and at least this many: frames at rest may repeat
PLATEAU, LEAST_S = 0.9, 0.15  # of the highest pressure; s that it must last for the body to follow
MORE, LESS = 1.15, 0.85  # ratio of pressures above the first, yet ratio of displacements below the second


def beside(recordings: Mapping[str, xr.Dataset]) -> list[str]:
    """Return one sentence for each pair of recordings of one body that contradict each other: equal numbers, or
    exchanged pressure logs.

    Parameters
    ----------
    recordings : mapping of str to xarray.Dataset
        Recordings of one body in one frame and experimental set-up, by name.
    """
    return [*copies(recordings), *exchanged(recordings)]


def copies(recordings: Mapping[str, xr.Dataset]) -> Iterator[str]:
    """Yield a sentence for each pair of recordings that contain the same numbers, so that one seems to be a copy.

    A held-out copy of a training recording validates nothing.
    """
    shapes = {n: r["position" if "position" in r else "angle"].values for n, r in recordings.items()}
    seen = {n: {row.tobytes() for row in s.reshape(len(s), -1) if np.isfinite(row).any()} for n, s in shapes.items()}
    for one, other in combinations(recordings, 2):
        shared = len(seen[one] & seen[other])
        if shared >= max(FEWEST, COPIED * min(len(seen[one]), len(seen[other]))):
            yield (f"{one} and {other} hold the same numbers in {shared} frames: is one a copy of the other? Leave the "
                   "copy out: a recording cannot validate a model that was fitted to it")  # fmt: skip


def exchanged(recordings: Mapping[str, xr.Dataset]) -> Iterator[str]:
    """Yield a sentence for each pair of recordings in which the one with the higher pressure has the smaller
    displacement.

    Their pressure logs may be exchanged.
    """
    held = {n: found for n, r in recordings.items() if (found := plateau(r)) is not None}
    for one, other in combinations(held, 2):
        low, high = sorted((one, other), key=lambda n: abs(held[n][0]))
        (p, u), (higher, less) = held[low], held[high]
        if p * higher > 0 and abs(higher) > MORE * abs(p) and less < LESS * u:
            yield (f"{high} moves by {1e3 * less:.3g} mm under {higher / 1e3:.3g} kPa, but {low} by {1e3 * u:.3g} mm "
                   f"under only {p / 1e3:.3g} kPa: are their pressure logs exchanged, or was the body in {high} "
                   "loaded or touched?")  # fmt: skip


def plateau(recording: xr.Dataset) -> tuple[float, float] | None:
    """Return the highest pressure [Pa] of a recording, and the distance [m] of the last station from its initial
    position when that pressure ends. Return None where the pressure is held too briefly.
    """
    if "position" not in recording or "pressure" not in recording or recording["pressure"].ndim != 1:
        return None
    clock, measured = recording["pressure_time"].values, recording["pressure"].values
    time, place = recording["time"].values, detectors.without_spikes(recording["position"].values[:, -1:])[:, 0]
    known, seen = np.isfinite(measured), np.isfinite(place).all(axis=1)
    if known.sum() < 2 or seen.sum() < 2:
        return None
    pressure = np.interp(time, clock[known], measured[known])
    level = peak(pressure)
    on = np.flatnonzero((pressure / level > PLATEAU) & seen) if level else np.empty(0, dtype=int)
    if not on.size or time[on[-1]] - time[on[0]] < LEAST_S:
        return None
    rest, end = np.median(place[seen][:5], axis=0), np.median(place[on[-max(3, on.size // 3):]], axis=0)
    return level, float(np.linalg.norm(end - rest))
