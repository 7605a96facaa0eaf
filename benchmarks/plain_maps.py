"""Errors of plain maps beside those of models, on recordings that neither has seen.

    PLIANT_DATA=../shared/data python benchmarks/plain_maps.py [STUDY ...]

Run example studies (default: all), each fit from one start; print a line for every fit with held-out records.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import pliant
from pliant.study import load_study
from pliant.validation.wording import sized

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
STUDIES = ("pneumatic_arm_pulses", "pneumatic_arm_levels", "planar_two_segment_arm", "planar_two_segment_arm_chambers",
           "planar_two_segment_arm_lengthens", "silicone_cantilever", "trunk_free_decay", "spatial_tendon_robot",
           "spatial_tentacle", "spatial_tendon_trunk")  # fmt: skip


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


if __name__ == "__main__":
    for study in sys.argv[1:] or STUDIES:
        study_lines(study)
