"""Every part of the benchmark, peers in the same run; prints ratios and writes benchmarks/results/bench.json.

`python benchmarks/run.py` runs all in less than ten minutes; names of parts, or of scripts beside this one, run those.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from time import perf_counter

from pliant.bench.run import NAMES, measure, write

HERE = Path(__file__).parent
SCRIPTS = {  # with what they are given, and after how long they are stopped, s
    "fit": ((), 40), "growth": ((), 120), "work_precision": (("--seconds", "6"), 150), "accuracy": (("a",), 60),
}
TARGETS = {  # name: (limit, whether less is better)
    "step_ns": (250, True), "rhs_jacobian_ns": (300, True), "experiment_ms": (1.0, True),
    "experiment_tip_error_mm": (0.02, True), "ratio_lsoda": (10, False), "ratio_mujoco": (5, False),
    "batch_speedup_simd": (4, False), "batch_speedup_cores": (1.8, False), "realtime_missed": (0, True),
    "help_s": (0.3, True), "first_simulation_s": (1.5, True), "first_simulation_cold_s": (6.0, True),
}


def parts(names: list[str]) -> None:
    """Measure, print, judge and write."""
    found = measure(names, seconds=60.0, tell=lambda text: print(text, flush=True))
    print("targets")
    for name, (limit, less) in TARGETS.items():
        if found.get(name) is not None:
            good = found[name] <= limit if less else found[name] >= limit
            print(f"  {name:<30} {found[name]:.4g} ({'<=' if less else '>='} {limit}: {'met' if good else 'MISSED'})")
    print(f"wrote {write(found, HERE / 'results' / 'bench.json')}", flush=True)


def script(name: str) -> None:
    """Run a script beside this one; what takes too long is stopped, and said so."""
    path = HERE / f"{name}.py"
    if not path.exists():
        return
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
    """Everything, or what is named."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does, before NumPy loads
    began = perf_counter()
    asked = sys.argv[1:]
    named = [n for n in asked if n in NAMES or n not in SCRIPTS]
    if named or not asked:
        parts(named or list(NAMES))
    for name in SCRIPTS:
        if not asked or (name in asked and name not in NAMES):
            script(name)
    print(f"\nall in {perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
