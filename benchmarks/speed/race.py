"""Error against time: every method at every setting, and what each needs to meet one error.

All run on one core and are timed in processor time: what else the machine does then disturbs them little.
"""

from __future__ import annotations

from functools import partial
from time import perf_counter, process_time
from typing import Any

import numpy as np

from speed.methods import TARGET_MM, Method, Problem, mujoco_methods, pliant_midpoint, scipy_methods, solved
from speed.timing import best

USELESS_MM = 20.0  # beyond, a setting is no answer
LONG_S = 1.0  # a run that takes longer is timed once: what disturbs it is a small part of it


def error_of(problem: Problem, method: Method, setting: float) -> float:
    """Return the largest tip error at one setting, mm; infinite if the method fails."""
    try:
        with np.errstate(all="ignore"):
            tips = method.solve(setting)
    except Exception:  # noqa: BLE001  a peer that fails at a setting has no error there, and the race goes on
        return np.inf
    if tips.shape != problem.truth.shape or not np.isfinite(tips).all():
        return np.inf
    return problem.error_mm(tips)


def to_target(problem: Problem, method: Method, target_mm: float = TARGET_MM) -> dict[str, Any] | None:
    """Return the coarsest setting from which on the error stays within the target: setting, error, time; or None."""
    errors = [error_of(problem, method, s) for s in method.settings]
    good = len(errors)
    while good and errors[good - 1] <= target_mm:
        good -= 1
    if good == len(errors):
        return None
    setting = method.settings[good]
    seconds = best(lambda: method.solve(setting), seconds=0.3, clock=process_time)
    return {"method": method.name, "setting": setting, "error_mm": errors[good], "ms": 1e3 * seconds}


def curve(problem: Problem, method: Method, seconds: float = np.inf) -> list[dict[str, float]]:
    """Return error and time at every successful setting, from coarse to fine; ends after about `seconds`."""
    rows = []
    error_of(problem, method, method.settings[0])  # compiles
    began = perf_counter()
    for setting in method.settings:
        start = process_time()
        error = error_of(problem, method, setting)
        took = process_time() - start
        if error < USELESS_MM:
            if took < LONG_S:
                took = best(partial(method.solve, setting), seconds=0.05, repeats=3, clock=process_time)
            rows.append({"setting": setting, "error_mm": error, "ms": 1e3 * took})
        if perf_counter() - began > seconds:
            break
    return rows


def experiment() -> dict[str, Any]:
    """Solve the paper's pulse with all tips within 0.02 mm, and compare other methods' times at the same error."""
    from pliant.simulation import simulate

    problem = solved(Problem())
    ours = to_target(problem, pliant_midpoint(problem))
    if ours is None:
        raise RuntimeError("the midpoint rule does not reach the target at its finest step")
    run = partial(simulate, problem.model, problem.pressure, times=problem.times, time_step=ours["setting"])
    labelled = best(run, clock=process_time)
    found: dict[str, Any] = {
        "experiment_ms": ours["ms"], "experiment_tip_error_mm": ours["error_mm"],
        "experiment_step_ms": 1e3 * ours["setting"], "experiment_labelled_ms": 1e3 * labelled,
    }
    for key, methods in (("lsoda", scipy_methods(problem)[:2]), ("mujoco", mujoco_methods(problem))):
        met = [r for r in (to_target(problem, m) for m in methods) if r]
        first = min(met, key=lambda r: r["ms"]) if met else None
        found[f"ratio_{key}"] = first["ms"] / ours["ms"] if first else None
        found[key] = first or "absent, or never within the target"
    return found
