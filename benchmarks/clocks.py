"""Measure the error of clock offsets estimated from motion and pressure, over random cases.

The motions are bundled recordings of the virtual actuator, a rod with hysteresis and creep that shares no code with the
second-order body of `sync`. Each case draws a recording, an offset, both sample rates, noise and resolution of both
signals, the number of tracked points, and how much of the log is missing at its start. Run::

    python benchmarks/clocks.py [--cases 100] [--seed 1] [--json results/clocks.json]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing.sync import sync
from pliant.recording import make_recording
from pliant.testbed.bundle import BUNDLED, bundled_recording
from pliant.testbed.fibre import FibreSensor

LATENCY = FibreSensor().latency  # s by which the virtual sensor's stamps are late: part of the truth


def case(rng: np.random.Generator, recordings: dict) -> tuple[object, float, dict]:
    """Return the recording of a random case, its true offset and the drawn values."""
    name = rng.choice(BUNDLED)
    ds = recordings[name]
    ds = ds.isel(time=np.isfinite(ds["position"].values).all(axis=(1, 2)))  # lost frames: noise is added below
    time, clock = ds["time"].values, ds["pressure_time"].values
    drawn = {
        "recording": str(name), "offset_s": rng.uniform(-20, 20),
        "shape_hz": float(np.exp(rng.uniform(np.log(15), np.log(75)))),
        "pressure_hz": float(np.exp(rng.uniform(np.log(20), np.log(500)))), "stations": int(rng.integers(1, 6)),
        "noise_share": float(np.exp(rng.uniform(np.log(2e-4), np.log(2e-2)))),
        "pressure_noise_share": float(np.exp(rng.uniform(np.log(1e-3), np.log(2e-2)))),
        "late_s": float(rng.uniform(-0.5, 0.25)),
    }
    at = np.arange(time[0] + rng.uniform(0, 0.05), time[-1], 1 / drawn["shape_hz"])
    chosen = np.sort(rng.choice(np.arange(100, ds.sizes["station"] - 40), drawn["stations"], replace=False))
    place = ds["position"].values[:, chosen]
    place = np.stack([[np.interp(at, time, place[:, s, k]) for k in range(3)] for s in range(len(chosen))])
    place = np.moveaxis(place, -1, 0)
    travel = np.ptp(place[:, -1], axis=0).max()
    place = place + drawn["noise_share"] * travel * rng.standard_normal(place.shape)
    log = np.arange(clock[0] + max(drawn["late_s"], 0.0), clock[-1], 1 / drawn["pressure_hz"])
    pressure = np.interp(log, clock, ds["pressure"].values)
    range_pa = np.ptp(pressure)
    pressure = pressure + drawn["pressure_noise_share"] * range_pa * rng.standard_normal(log.size)
    pressure = np.round(pressure / (range_pa / 400)) * (range_pa / 400)  # a ten-bit converter, not used to its end
    made = make_recording(at, place, pressure=pressure, pressure_time=log - drawn["offset_s"])
    return made, drawn["offset_s"] + LATENCY, drawn


def main() -> None:
    """Run the cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    recordings = {name: bundled_recording(name) for name in BUNDLED}
    rows = []
    for k in range(options.cases):
        ds, truth, drawn = case(rng, recordings)
        try:
            found = sync(ds)
        except InputError as error:
            rows.append({**drawn, "refused": str(error)})
            print(f"{k:3d} {drawn['recording']:10} refused: {error}")
            continue
        wrong = found.delay_s - truth
        rows.append({**drawn, "error_s": wrong, "uncertainty_s": found.uncertainty_s, "warnings": found.warnings})
        warned = any(w.startswith("WARNING") for w in found.warnings)
        print(f"{k:3d} {drawn['recording']:10} {drawn['shape_hz']:5.1f} Hz {drawn['pressure_hz']:6.1f} Hz noise "
              f"{100 * drawn['noise_share']:5.2f} %: error {1e3 * wrong:+7.2f} +- {1e3 * found.uncertainty_s:5.2f} ms"
              f"{'  warned' if warned else ''}")
    told = [r for r in rows if "error_s" in r]
    errors = np.abs([r["error_s"] for r in told])
    silent = [r for r in told if abs(r["error_s"]) > 0.05 and not any(w.startswith("WARNING") for w in r["warnings"])]
    inside = np.mean([abs(r["error_s"]) < 2 * np.hypot(r["uncertainty_s"], 2e-3) for r in told])
    sharp = [abs(r.get("error_s", np.inf)) < 0.01 for r in rows if r["recording"] != "triangle"]
    print(f"with edges (all but the slow triangle): {100 * np.mean(sharp):.0f} % of {len(sharp)} within 10 ms")
    close = 100 * (errors < 0.01).sum() / len(rows)
    print(f"{len(rows)} cases, {len(rows) - len(told)} refused; within 10 ms: {close:.0f} % of all; median "
          f"{1e3 * np.median(errors):.2f} ms, largest {1e3 * errors.max():.1f} ms; beyond 50 ms in silence: "
          f"{len(silent)}; within two stated deviations (and 2 ms of the body's own): {100 * inside:.0f} %")
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
