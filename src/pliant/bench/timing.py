"""Timing of a function, and facts about the machine."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from pliant.cores import cores


def best(
    job: Callable[[], Any], seconds: float = 0.5, repeats: int = 5, clock: Callable[[], float] = perf_counter,
) -> float:
    """Return the shortest run time of `job` [s] by `clock`, over at least `repeats` runs and about `seconds`.

    One run before the timing is not counted.

    The shortest time is the best estimate, since other processes can only lengthen a run.
    """
    job()
    times: list[float] = []
    began = perf_counter()
    while len(times) < repeats or (perf_counter() - began < seconds and len(times) < 1000):
        start = clock()
        job()
        times.append(clock() - start)
    return min(times)


def best_in_turn(jobs: Sequence[Callable[[], Any]], seconds: float = 6.0) -> list[float]:
    """Return the shortest wall time [s] of each job, running them in turn so that disturbances affect all alike."""
    for job in jobs:
        job()
    times: list[list[float]] = [[] for _ in jobs]
    began = perf_counter()
    while perf_counter() - began < seconds or len(times[0]) < 5:
        for job, own in zip(jobs, times, strict=True):
            start = perf_counter()
            job()
            own.append(perf_counter() - start)
    return [min(own) for own in times]


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
        "processor": processor(), "cores": cores(), "load_before": load, "python": platform.python_version(),
        "system": platform.system(), **versions,
    }


def processor() -> str:
    """Return the name of the processor, as the system reports it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor()


def processor_flags() -> set[str]:
    """Return the features of the processor, as Linux names them; empty on other systems."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return set()
    return set(next((line.partition(":")[2] for line in lines if line.startswith("flags")), "").split())
