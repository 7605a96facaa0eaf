"""Measure how well models of growing detail predict an unseen pulse of the virtual actuators a, b and c.

The virtual fibre records each actuator under pulses of 60 and 180 kPa, slow triangles, and the paper's pulse of 119
kPa. The models are trained on the first three recordings and predict the pulse of 119 kPa over its 4.5 s. The fit of
every stage starts from the result of the previous stage. Usage: python benchmarks/accuracy.py [actuators] [links]
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from pliant.identification import Experiment, FitResult, Parameter, fit, predict_held_out
from pliant.model import Model
from pliant.recording.netcdf import write_netcdf
from pliant.study.run import prepare_all
from pliant.study.schema import Study
from pliant.testbed import generate
from pliant.validation.metrics import compare

TRAIN, HELD_OUT = ("pulse_60", "pulse_180", "triangle"), "pulse_119"
LINEAR = ("stiffness", "damping", "torque_1", "start")
CREEP = ("creep_share_1", "creep_time_1", "creep_share_2", "creep_time_2")
SLIP = ("slip_share_1", "slip_angle_1", "slip_share_2", "slip_angle_2")
STAGES: dict[str, tuple[str | Parameter, ...]] = {
    "linear": LINEAR,
    "+ torque law": (*LINEAR, "torque_2"),
    "+ softening springs": (*LINEAR, "torque_2", "stiffening"),
    "+ valve": (*LINEAR, "torque_2", "stiffening", "valve_rise_time", "valve_fall_time"),
    "+ K of each joint": ("stiffness_*", *LINEAR[1:], "torque_2", "stiffening", "valve_rise_time", "valve_fall_time"),
    "+ creep": ("stiffness_*", *LINEAR[1:], "torque_2", "stiffening", "valve_rise_time", "valve_fall_time", *CREEP),
    "+ hysteresis": ("stiffness_*", *LINEAR[1:], "torque_2", "stiffening", "valve_rise_time", "valve_fall_time",
                     *CREEP, *SLIP),
}


def recorded(body: str, links: int) -> tuple[dict[str, Experiment], Model]:
    """Return the recordings of a virtual actuator, reduced to links, and a chain with estimated K and D."""
    with tempfile.TemporaryDirectory() as folder:
        for name in (*TRAIN, HELD_OUT):
            write_netcdf(generate(name, body, seed=1).recording, Path(folder) / f"{name}.nc")
        study = Study.model_validate({
            "name": body, "folder": folder, "fits": {},
            "actuator": {"length": 0.17, "mass": 0.069, "tip_mass": 0.006},
            "fibre": {"body_length": 0.17, "cap_curvature": 50.0, "cap_length": 0.03, "gauge_length": 2.4e-3},
            "reduction": {"recording": "pulse_180", "links": links},
            "recordings": {name: {"file": f"{name}.nc"} for name in (*TRAIN, HELD_OUT)},
        })
        ready = prepare_all(study, lambda _line: None)
        return ready.experiments, ready.model


def begun(entry: str | Parameter, before: FitResult | None) -> Parameter:
    """Return a free parameter whose start value is the result of the previous stage."""
    p = Parameter(entry) if isinstance(entry, str) else entry
    found = before.values.get(p.name, before.values.get(p.name.removesuffix("_*"))) if before else None
    return p if found is None else p.with_(value=float(np.clip(found, p.lower, p.upper)))


def line(name: str, exp: Experiment, fitted: FitResult, seconds: float) -> str:
    """Return one row of the table, for the held-out pulse."""
    modelled, _ = predict_held_out(exp, fitted)
    m = compare(exp, modelled["position"], 0.17)
    tip = 1e3 * float(np.sqrt(np.nanmean(np.sum((modelled["position"] - exp.position)[:, -1] ** 2, axis=-1))))
    measured, found = ([m[k][who] or np.nan for k in ("frequency_hz", "overshoot_percent", "steady_state_mm")]
                       for who in ("measured", "modelled"))
    return (
        f"{name:<20} tip {tip:5.2f} mm ({tip / 1.7:4.2f} % L)   all tips {m['rmse_mm']:5.2f} mm   "
        f"f {100 * (found[0] / measured[0] - 1):+5.1f} %   overshoot {found[1] - measured[1]:+5.1f} points   "
        f"plateau {found[2] - measured[2]:+5.2f} mm   fit {seconds:5.1f} s CPU"
    )


def main(bodies: str, links: int) -> None:
    """Print the table of every actuator."""
    for body in bodies:
        experiments, model = recorded(body, links)
        held = experiments[HELD_OUT]
        print(f"actuator {body}, {links} links, travel {1e3 * held.travel:.1f} mm")
        fitted: FitResult | None = None
        for name, entries in STAGES.items():
            train = [experiments[n] for n in (TRAIN if "creep" in name or "hysteresis" in name else TRAIN[:2])]
            began = time.process_time()
            fitted = fit(train, model, [begun(e, fitted) for e in entries], starts=1)
            print(line(name, held, fitted, time.process_time() - began), flush=True)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "abc", int(sys.argv[2]) if len(sys.argv) > 2 else 5)
