"""Batches against a plain loop: eight chains side by side, then all cores."""

from __future__ import annotations

from functools import partial
from time import perf_counter, process_time
from typing import Any

import numpy as np

from pliant.actuators import chen2018
from pliant.batch import simulate_batch
from pliant.mechanics import mechanics_of
from pliant.parallel import cores
from pliant.simulation import Pulse, simulate, state
from pliant.simulation.drive import drive
from pliant.simulation.initial_value import march
from speed.kernels import TORQUE, floor
from speed.timing import best, in_turn, of_processor

SAMPLES = 1024  # as many as a Monte Carlo run takes: the label on the arrays is then a small part
STEP = 1e-3  # s
COPIED = 64 * 2**20  # bytes: more than a cache holds


def bandwidth() -> float:
    """Return the bytes per second that one core reads and writes in a plain copy."""
    source = np.zeros(COPIED // 8)
    target = np.empty_like(source)
    return 2.0 * COPIED / best(lambda: np.copyto(target, source), clock=process_time)


def lanes_of(flags: set[str]) -> int:
    """Return the number of doubles in the widest register of a processor with these flags; 2 if the flags name none."""
    return 8 if "avx512f" in flags else 4 if "avx" in flags else 2


def batches() -> dict[str, Any]:
    """Return the speed-up by SIMD vectors on one core, by a second core, and the largest difference from single runs.

    The plain loop is the compiled march of one sample after the other with everything before it done once: what lanes
    are compared with is the arithmetic alone, the batch with all that it needs; both in processor time, which a busy
    machine lengthens less. The cores are compared by the clock on the wall.
    """
    rng = np.random.default_rng(7)
    model, pressure = chen2018.model(), Pulse(chen2018.PULSE_PRESSURE, chen2018.PULSE_START, chen2018.PULSE_WIDTH)
    times = np.arange(301) / 75.0
    changes = {"stiffness": 1.6067 * rng.uniform(0.8, 1.2, SAMPLES), "damping": 8e-3 * rng.uniform(0.7, 1.3, SAMPLES)}
    plan = drive(model, pressure, times, STEP)
    start = (mechanics_of(model).coordinates(state.equilibrium(model, plan.initial)), np.zeros(model.n))

    def batch(threads: int) -> Any:
        return simulate_batch(model, pressure, parameters=changes, times=times, time_step=STEP, threads=threads)

    one = best(lambda: march(model, plan, start, times.size), clock=process_time)
    single = best(lambda: simulate(model, pressure, times=times, time_step=STEP))
    work = best(lambda: batch(1), seconds=2.0, clock=process_time) / SAMPLES
    most = max(2, cores())
    counts = sorted({1, 2, most})
    for count in counts:
        batch(count)
    runs = in_turn([partial(batch, c) for c in counts], 5, seconds=6.0, clock=perf_counter)
    took = dict(zip(counts, runs.min(axis=1), strict=True))
    lanes, pair, everything = (took[c] / SAMPLES for c in (1, 2, most))
    made, difference = batch(2), 0.0
    for i in range(0, SAMPLES, 73):
        alone = simulate(
            model.with_(**{name: value[i] for name, value in changes.items()}), pressure, times=times, time_step=STEP
        )
        difference = max(difference, float(np.abs(alone["tip_position"] - made["tip_position"][i]).max()))
    ns, memory, lanes_there = 1e9 * work / plan.h.size, bandwidth(), lanes_of(set(of_processor("flags").split()))
    under = floor(model, 20_000, STEP, np.full(model.n, TORQUE))
    beside = {"batch_over_c": ns * lanes_there / under["c_step_ns"], "batch_lanes": lanes_there} if under else {}
    written = sum(v.nbytes for v in made.data_vars.values()) / SAMPLES
    return {
        **beside, "memory_gb_s": 1e-9 * memory, "batch_memory_share": written / work / memory,
        "batch_speedup_simd": one / work, "batch_speedup_cores": lanes / pair, "batch_cores": 2,
        "batch_speedup_all_cores": lanes / everything, "batch_all_cores": most,
        "batch_speedup_over_simulate": single / pair, "batch_us_per_sample": 1e6 * everything,
        "batch_ns_per_step_one_core": ns, "batch_difference_mm": 1e3 * difference,
        "batch_times_real_time": float(times[-1]) / everything,
    }
