"""Run every part of the benchmark with other programs, print ratios, and write benchmarks/results/bench.json.

`python benchmarks/run.py` runs all parts in less than ten minutes. Names of parts, or of scripts in this folder, select
what to run.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

from speed import kernels, race, realtime
from speed.timing import machine

from pliant.files import write_text
from pliant.version import __version__

HERE = Path(__file__).parent
REAL_TIME_S = 30.0
SCRIPTS = {  # with what they are given, and after how long they are stopped, s
    "fit": (("fit",), 90), "work_precision": (("--seconds", "3"), 150),
}
# Ratios of what is measured side by side in one run, as another machine changes both. name: (limit, less is better)
TARGETS = {
    "step_over_c": (1.2, True), "rhs_over_c": (1.2, True), "rhs_jacobian_over_c": (1.2, True),
    "batch_over_c": (1.5, True),
    "experiment_tip_error_mm": (0.02, True), "ratio_lsoda": (10, False), "ratio_mujoco": (5, False),
    "batch_speedup_simd": (4, False), "batch_speedup_cores": (1.8, False), "realtime_missed_more": (0, True),
}
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


Part = Callable[[], dict[str, Any]]
JOBS: dict[str, Part] = {
    "kernels": kernels.kernels, "startup": startup, "experiment": race.experiment, "batch": kernels.batches,
    "realtime": lambda: realtime.realtime(REAL_TIME_S),
}


def measure(parts: Mapping[str, Part]) -> dict[str, Any]:
    """Run parts in turn, print the results of each, and return all numbers; `machine` has facts of the machine."""
    results: dict[str, Any] = {"pliant": __version__, "machine": machine()}
    for name, job in parts.items():
        start = perf_counter()
        numbers = job()
        results |= numbers
        print("\n".join([f"{name} ({perf_counter() - start:.1f} s)", *lines(numbers)]), flush=True)
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


def parts(names: list[str]) -> None:
    """Measure, print, judge and write."""
    found = measure({n: JOBS[n] for n in names})
    if "realtime_missed" in found:
        found["realtime_missed_more"] = found["realtime_missed"] - found["realtime_missed_by_an_empty_loop"]
    print("targets")
    for name, (limit, less) in TARGETS.items():
        if found.get(name) is not None:
            good = found[name] <= limit if less else found[name] >= limit
            print(f"  {name:<30} {found[name]:.4g} ({'<=' if less else '>='} {limit}: {'met' if good else 'MISSED'})")
    print(f"wrote {write(found, HERE / 'results' / 'bench.json')}", flush=True)


def script(name: str) -> None:
    """Run a script of this folder; a script that takes too long is stopped with a message."""
    path = HERE / f"{name}.py"
    more, limit = SCRIPTS[name]
    print(f"\n{name}", flush=True)
    try:
        done = subprocess.run([sys.executable, str(path), *more], timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        print(f"{name} stopped after {limit} s; alone it may take its time: python {path}")
        return
    if done.returncode:
        print(f"{name} failed with {done.returncode}")


def main() -> None:
    """Run everything, or the named parts."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does, before NumPy loads
    began = perf_counter()
    parser = argparse.ArgumentParser(description=__doc__)
    known = ", ".join([*JOBS, *SCRIPTS])
    parser.add_argument("names", nargs="*", help=f"of {known}; default: all")
    asked = parser.parse_args().names
    if unknown := [n for n in asked if n not in JOBS and n not in SCRIPTS]:
        parser.error(f"there is no part {unknown[0]!r}: use some of {known}")
    if named := [n for n in JOBS if n in asked or not asked]:
        parts(named)
    for name in SCRIPTS:
        if not asked or name in asked:
            script(name)
    print(f"\nall in {perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
