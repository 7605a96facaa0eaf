"""Fit the terms of the demo's first fit to recordings of the virtual actuators a, b and c, and predict 119 and 240 kPa.

The recordings of each actuator are made like the bundled ones, which are those of actuator a with seed 1. The terms
were chosen on the bundled pulses of 60 and 180 kPa (`model_selection.py lead`), so that b and c are a test of them.

Usage: python benchmarks/demo_bodies.py [actuators, default abc] [seeds of the sensors, default 3]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from pliant.recording.netcdf import write_netcdf
from pliant.study import demo_study, load_study, run_study
from pliant.testbed import generate
from pliant.validation.outcome import FitOutcome


def predicted(body: str, seed: int, folder: Path) -> FitOutcome:
    """Return the demo's first fit to new recordings of one virtual actuator."""
    study = load_study(demo_study())
    title, lead = next(iter(study.fits.items()))
    recordings = {}
    for name, entry in study.recordings.items():
        write_netcdf(generate(name, body, seed=seed).recording, folder / f"{name}.nc")
        recordings[name] = entry.model_copy(update={"file": f"{name}.nc"})
    changes = {"folder": folder, "recordings": recordings, "fits": {title: lead}, "forecasts": {}}
    return run_study(study.model_copy(update=changes)).fits[0]


def main(bodies: str, seeds: int) -> None:
    """Print the errors and the bands of every held-out recording."""
    for body in bodies:
        for seed in range(1, seeds + 1):
            with tempfile.TemporaryDirectory() as folder:
                fit = predicted(body, seed, Path(folder))
            print(f"actuator {body}, seed {seed}: {fit.result.status}")
            for r in fit.records:
                m = r.metrics
                within = "" if r.band is None else f", {m['within_band_percent']:.1f} % within the 95 % band"
                print(f"  {r.role:8} {r.name:10} {m['rmse_percent_of_length']:5.2f} % of length, "
                      f"{m['rmse_percent_of_travel']:5.2f} % of peak displacement{within}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "abc", int(sys.argv[2]) if len(sys.argv) > 2 else 3)
