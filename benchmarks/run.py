"""Run every part of the benchmark with other programs, print ratios, and write benchmarks/results/bench.json.

`python benchmarks/run.py` runs all parts in less than ten minutes. Names of parts, or of scripts in this folder, select
what to run.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from time import perf_counter

from speed import batches, race, realtime
from speed.measure import PARTS, measure, write

HERE = Path(__file__).parent
REAL_TIME_S = 30.0
JOBS = {
    **PARTS, "experiment": race.experiment, "batch": batches.batches,
    "realtime": lambda: realtime.realtime(REAL_TIME_S),
}
NAMES = tuple(JOBS)
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


def parts(names: list[str]) -> None:
    """Measure, print, judge and write."""
    found = measure({n: JOBS[n] for n in names}, message=lambda text: print(text, flush=True))
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
    known = ", ".join(dict.fromkeys([*NAMES, *SCRIPTS]))
    parser.add_argument("names", nargs="*", help=f"of {known}; default: all")
    asked = parser.parse_args().names
    if unknown := [n for n in asked if n not in NAMES and n not in SCRIPTS]:
        parser.error(f"there is no part {unknown[0]!r}: use some of {known}")
    if named := [n for n in NAMES if n in asked or not asked]:
        parts(named)
    for name in SCRIPTS:
        if not asked or (name in asked and name not in NAMES):
            script(name)
    print(f"\nall in {perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
