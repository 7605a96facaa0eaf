"""Timing of functions, and facts about the machine."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np

from pliant.parallel import cores

Job = Callable[[], Any]
Clock = Callable[[], float]


def in_turn(jobs: Sequence[Job], rounds: int, seconds: float = 0.0, clock: Clock = process_time) -> np.ndarray:
    """Return the run times (jobs, rounds) [s] of functions that run in turn, so that disturbances affect all alike.

    There are at least `rounds` rounds, and more, up to 1000, until `seconds` have passed.
    """
    times: list[list[float]] = [[] for _ in jobs]
    began = perf_counter()
    while len(times[0]) < rounds or (perf_counter() - began < seconds and len(times[0]) < 1000):
        for job, runs in zip(jobs, times, strict=True):
            start = clock()
            job()
            runs.append(clock() - start)
    return np.array(times)


def best(job: Job, seconds: float = 0.5, repeats: int = 5, clock: Clock = perf_counter) -> float:
    """Return the shortest run time [s] of the function `job`, measured by `clock`. It is called for about `seconds` in
    total, and at least `repeats` times; one run before the timing is not counted.

    The shortest time is the best estimate, since other processes can only lengthen a run.
    """
    job()
    return float(in_turn([job], repeats, seconds, clock).min())


def machine() -> dict[str, Any]:
    """Return the facts that a benchmark's numbers depend on: processor, cores, load, system, versions."""
    from importlib.metadata import PackageNotFoundError, version

    versions = {}
    for name in ("numpy", "scipy", "numba", "mujoco", "scikit-sundae", "casadi", "pin"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "absent"
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    return {
        "processor": of_processor("model name") or platform.processor(), "cores": cores(), "load_before": load,
        "python": platform.python_version(), "system": platform.system(), **versions,
    }


def of_processor(field: str) -> str:
    """Return a field of the description of the processor, as Linux gives it; empty on other systems."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return next((line.partition(":")[2].strip() for line in lines if line.startswith(field)), "")
