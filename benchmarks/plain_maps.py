"""Errors of plain maps beside those of models, on recordings that neither has seen.

    PLIANT_DATA=../shared/data python benchmarks/plain_maps.py [STUDY ...]
    PLIANT_DATA=../shared/data python benchmarks/plain_maps.py --arm

Without --arm: run example studies (default: all), each fit from one start; print a line for every fit with held-out
records. With --arm: print the errors of maps on the pneumatic arm in space. Fitted to four of five recordings of one
session, they predict the fifth; fitted to all five, another session.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np

import pliant
from pliant.identification import Experiment
from pliant.simulation import Trace
from pliant.study import load_study
from pliant.validation.plain_map import plain_map
from pliant.validation.wording import sized

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
STUDIES = ("pneumatic_arm_pulses", "pneumatic_arm_levels", "planar_two_segment_arm", "planar_two_segment_arm_chambers",
           "planar_two_segment_arm_lengthens", "silicone_cantilever", "trunk_free_decay", "spatial_tendon_robot",
           "spatial_tentacle", "spatial_tendon_trunk")  # fmt: skip
SESSION, LATER = (1, 2, 4, 5, 8), 18
PSI = 6894.757


def study_lines(name: str) -> None:
    """Run an example from one start for each fit; print the errors of model and map on held-out records."""
    study = load_study(EXAMPLES / f"{name}.toml")
    fits = {k: f.model_copy(update={"starts": 1}) for k, f in study.fits.items() if f.held_out}
    outcome = pliant.run_study(study.model_copy(update={"fits": fits, "forecasts": {}, "model_selection": None}))
    for fit in outcome.fits:
        held = [r for r in fit.records if r.role == "held_out"]
        if fit.baseline is None or not held:
            continue
        model, plain = ([sized(m, "rmse")[0] for m in rows] for rows in (
            [r.metrics for r in held], [fit.baseline.records[r.name] for r in held]))
        outside = max(fit.baseline.outside[r.name] for r in held)
        print(f"| {name} | {fit.name} | {', '.join(r.name for r in held)} | {np.mean(model):.2f} | "
              f"{np.mean(plain):.2f} | {fit.baseline.title} | {outside:.0f} | {fit.baseline.suggestion} |", flush=True)
    print(f"{name}: plain maps in {outcome.timing['plain_maps_s']:.2f} s", file=sys.stderr)


def arm(number: int) -> Experiment:
    """Return one recording of the arm in space: tip, and pressures (the median of the pouches of a segment)."""
    path = Path(os.environ["PLIANT_DATA"]) / "spatial_pneumatic_arm" / f"experiment_{number}.csv"
    table = np.genfromtxt(path, delimiter=",", names=True)
    tip = np.stack([table[f"mocap_rigid_body_{axis}"] for axis in "xyz"], axis=1)
    tip[(tip == 0.0).all(axis=1)] = np.nan
    columns = [[n for n in table.dtype.names if n.startswith(f"Measured_pressure_Segment_{k}")] for k in (1, 2, 3, 4)]
    drives = {f"segment_{k}": Trace(table["time"], PSI * np.median([table[n] for n in names], axis=0))
              for k, names in enumerate(columns, 1)}
    return Experiment(f"e{number}", table["time"], tip[:, None], ("tip",), "trace", drives=drives)


def arm_lines() -> None:
    """Print the errors of the chosen map, and of each degree, on a recording of the session and on a later one."""
    recordings = {k: arm(k) for k in (*SESSION, LATER)}
    for held in (*SESSION, LATER):
        train = [recordings[k] for k in SESSION if k != held]
        for degree in (None, 1, 2, 3):
            began, exp = time.process_time(), recordings[held]
            plain = plain_map(train, degree=degree)
            seconds = time.process_time() - began
            error = 1e3 * np.sqrt(np.nanmean(np.sum((plain.predict(exp) - exp.compared) ** 2, axis=2)))
            print(f"| {held} | {degree or 'chosen'} | {plain.title} | {1e3 * plain.left_out_error:.2f} | {error:.2f} | "
                  f"{100 * plain.outside(exp):.0f} | {seconds:.2f} |", flush=True)


if __name__ == "__main__":
    if sys.argv[1:] == ["--arm"]:
        arm_lines()
    else:
        for study in sys.argv[1:] or STUDIES:
            study_lines(study)
