"""Timing of a function, and facts about the machine."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

from pliant.parallel import cores


def best(
    job: Callable[[], Any], seconds: float = 0.5, repeats: int = 5, clock: Callable[[], float] = perf_counter,
) -> float:
    """Return the shortest run time [s] of the function `job`, measured by `clock`. It is called for about `seconds` in
    total, and at least `repeats` times.

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
