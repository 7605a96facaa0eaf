"""Parts of the benchmark that need no other program: compiled kernels and start-up times; results as text or JSON."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

from pliant.files import write_text
from pliant.version import __version__
from speed.kernels import kernels
from speed.timing import machine

Part = Callable[[], dict[str, Any]]
FIRST = (
    "from pliant.actuators import chen2018; import pliant; "
    "pliant.simulate(chen2018.model(), pliant.Pulse(119e3, 0.12, 2.76), duration=4.0)"
)
MEANING = {
    "step_ns": "one implicit step of five links in a simulation, with energies",
    "rhs_ns": "one evaluation of the accelerations",
    "rhs_jacobian_ns": "one evaluation of the accelerations and their exact Jacobian",
    "c_step_ns": "one step in plain C, compiled on this machine, without energies",
    "c_rhs_ns": "one evaluation of the accelerations in plain C",
    "c_rhs_jacobian_ns": "one evaluation of the accelerations and their Jacobian in plain C",
    "step_over_c": "step_ns divided by the time of plain C", "rhs_over_c": "rhs_ns divided by the time of plain C",
    "rhs_jacobian_over_c": "rhs_jacobian_ns divided by the time of plain C",
    "help_s": "pliant --help in a fresh process", "first_simulation_s": "import and one simulation in a fresh process",
    "first_simulation_cold_s": "import and one simulation in a fresh process, with an empty cache of compiled code",
    "experiment_ms": "the paper's pulse of 4 s at the coarsest step that keeps all tips within the target",
    "experiment_tip_error_mm": "largest distance of a tip from the reference solution at that step",
    "experiment_step_ms": "that step", "experiment_labelled_ms": "the same through pliant.simulate, labels included",
    "ratio_lsoda": "times as long as pliant takes for the same error", "ratio_mujoco": "the same",
    "lsoda": "what the ratio was measured with", "mujoco": "the same",
    "batch_speedup_simd": "one core with lanes against a plain loop of the compiled march",
    "batch_speedup_cores": "two cores against one", "batch_cores": "cores of that",
    "batch_speedup_all_cores": "all cores against one", "batch_all_cores": "cores of that",
    "batch_speedup_over_simulate": "two cores and lanes against pliant.simulate",
    "batch_over_c": "one step of one sample on one core, times the lanes of its registers, over a step in plain C",
    "batch_lanes": "doubles in a register of this processor",
    "batch_memory_share": "bytes of its result over those that one core reads and writes in its time",
    "memory_gb_s": "copied by one core: read and written",
    "batch_us_per_sample": "one sample of the paper's pulse, all cores",
    "batch_ns_per_step_one_core": "one step of one sample, one core, everything counted",
    "batch_difference_mm": "largest distance from single runs", "batch_times_real_time": "simulated over elapsed time",
    "realtime_median_us": "what Stepper.step takes from Python, once a period",
    "realtime_p999_us": "99.9 % of the steps take no longer", "realtime_worst_us": "the longest",
    "realtime_missed": "steps that were not done when the next was due",
    "realtime_missed_by_an_empty_loop": "by the same loop with no step in it, in turns with the steps",
    "realtime_missed_by_the_system": "of those, steps that began late: the system gave the process no time",
    "realtime_steps": "how many", "realtime_late_p999_us": "99.9 % of the steps began no later than this",
    "realtime_seconds": "how long", "realtime_period_ms": "between two steps",
    "realtime_bytes_left": "memory that 20 000 steps keep",
}


def startup() -> dict[str, float]:
    """Return the wall times [s] of three new Python processes: `pliant --help`, one simulation with a full cache of
    compiled code, and one with an empty cache.
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
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    seconds = perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)[:80]} failed: {done.stderr[-500:]}")
    return seconds


PARTS: dict[str, Part] = {"kernels": kernels, "startup": startup}


def measure(
    parts: Mapping[str, Part], message: Callable[[str], None] = lambda _line: None,
) -> dict[str, Any]:
    """Run the parts of the benchmark one after the other and return all their numbers in one dict.

    `message` is called with the results of each part as text. The facts of the machine are under ``machine``.
    """
    results: dict[str, Any] = {"pliant": __version__, "machine": machine()}
    for name, job in parts.items():
        start = perf_counter()
        numbers = job()
        results |= numbers
        message("\n".join([f"{name} ({perf_counter() - start:.1f} s)", *lines(numbers)]))
    return results


def lines(numbers: Mapping[str, Any]) -> list[str]:
    """Return the lines of the printed table: name, value and meaning of each number."""
    return [f"  {name:<30} {as_text(value):<12} {MEANING.get(name, '')}".rstrip() for name, value in numbers.items()]


def as_text(value: Any) -> str:
    """Return a number as text with four digits; for a dictionary, its numbers in one line."""
    if isinstance(value, dict):
        return ", ".join(f"{k} {as_text(v)}" for k, v in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def write(results: Mapping[str, Any], path: str | Path) -> Path:
    """Write the results as a JSON file, atomically."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_text(path, json.dumps(results, indent=1) + "\n")
