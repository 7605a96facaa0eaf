"""Start-up times of a fresh process: the help page, and a first simulation with a full and with an empty cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from time import perf_counter

FIRST = (
    "from pliant.actuators import chen2018; import pliant; "
    "pliant.simulate(chen2018.model(), pliant.Pulse(119e3, 0.12, 2.76), duration=4.0)"
)


def startup() -> dict[str, float]:
    """Return wall times [s] of fresh processes: `pliant --help`, and a first simulation with a full and an
    empty cache.
    """
    simulation = [sys.executable, "-c", FIRST]
    fresh(simulation)  # fills the cache
    with tempfile.TemporaryDirectory() as empty:
        cold = fresh(simulation, cache=empty)
    return {
        "help_s": min(fresh([sys.executable, "-m", "pliant", "--help"]) for _ in range(5)),
        "first_simulation_s": min(fresh(simulation) for _ in range(3)), "first_simulation_cold_s": cold,
    }


def fresh(command: list[str], cache: str | None = None) -> float:
    """Return the wall time [s] of a command in a new process; `cache` is the folder of Numba's cache."""
    environment = {**os.environ, **({"NUMBA_CACHE_DIR": cache} if cache else {})}
    start = perf_counter()
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)  # noqa: S603
    seconds = perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)[:80]} failed: {done.stderr[-500:]}")
    return seconds
