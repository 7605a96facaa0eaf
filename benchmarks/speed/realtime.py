"""The stepping object against the clock: one step every millisecond, for as long as asked."""

from __future__ import annotations

import gc
import time
from typing import Any

import numpy as np

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.simulation import Stepper

Array = np.ndarray
TURN = 5.0  # s, of steps, then of the empty loop
SPIN_NS = 200_000  # the last part of a wait is spent looking at the clock: a sleep ends late


def realtime(seconds: float = 10.0, period: float = 1e-3) -> dict[str, Any]:
    """Step times and missed deadlines of a `Stepper` at a fixed rate.

    Returned are the median, 99.9 % and worst time of a step [us]; missed deadlines: steps that were not done when the
    next was due; how many of them had begun late because the system gave the process no time; deadlines that the same
    loop misses with no step in it, in turns with the steps.
    """
    count = round(seconds / period) if np.isfinite(seconds) and seconds > 0 else 0
    if count < 10:
        raise InputError(f"a real-time run needs at least ten steps, got {seconds} s in steps of {period} s")
    stepper = Stepper(chen2018.model(), period)
    pressures = 6e4 * (1.0 - np.cos(2 * np.pi * 0.5 * period * np.arange(count)))
    due = round(period * 1e9)
    turns = [
        (run_clock(stepper, part.tolist(), due), run_clock(None, part.tolist(), due))
        for part in np.array_split(pressures, int(np.ceil(seconds / TURN)))
    ]
    (took, late), empty = (np.concatenate(rows, axis=1) for rows in zip(*turns, strict=True))
    missed = took + late > due
    return {
        "realtime_median_us": 1e-3 * float(np.median(took)), "realtime_p999_us": 1e-3 * float(np.quantile(took, 0.999)),
        "realtime_worst_us": 1e-3 * float(took.max()), "realtime_missed": int(missed.sum()),
        "realtime_missed_by_an_empty_loop": int((empty.sum(axis=0) > due).sum()),
        "realtime_missed_by_the_system": int((missed & (late > due // 2)).sum()), "realtime_steps": count,
        "realtime_late_p999_us": 1e-3 * float(np.quantile(late, 0.999)), "realtime_seconds": seconds,
        "realtime_period_ms": 1e3 * period,
    }


def run_clock(stepper: Stepper | None, pressures: list[float], period: int) -> Array:
    """Return time and delay of each step (2, count), ns, with garbage collection switched off.

    Without a stepper the loop keeps time and does nothing.
    """
    took, late = np.zeros((2, len(pressures)), dtype=np.int64)
    now, step, sleep = time.perf_counter_ns, stepper.step if stepper else lambda _pressure: None, time.sleep
    for p in pressures[:100]:
        step(p)
    if stepper:
        stepper.reset(pressures[0])
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        due = now() + period
        for k, pressure in enumerate(pressures):
            while (left := due - now()) > 0:
                if left > SPIN_NS:
                    sleep((left - SPIN_NS) * 1e-9)
            began = now()
            step(pressure)
            took[k] = now() - began
            late[k] = began - due
            due = max(due + period, began)  # a step that missed is not made up for by a burst
    finally:
        gc.enable()
        gc.unfreeze()
    return np.stack([took, late])
