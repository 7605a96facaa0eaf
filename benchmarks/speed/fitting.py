"""One fit: stiffness and damping from 3 s of five noisy tips at 1 kHz."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.actuators import chen2018
from pliant.identification import Parameter, experiment, fit
from pliant.recording import make_recording
from pliant.simulation import Pulse, simulate
from speed.timing import best

NOISE = 0.3e-3  # m
RATE = 1000.0  # Hz


def fitting() -> dict[str, Any]:
    """Return the time of the fit, its evaluations, and the errors of the two parameters."""
    model, pressure = chen2018.model(), Pulse(chen2018.PULSE_PRESSURE, 0.12, 1.5)
    times = np.arange(round(3.0 * RATE) + 1) / RATE
    tips = simulate(model, pressure, times=times, time_step=5e-4)["tip_position"].values
    seen = tips + NOISE * np.random.default_rng(3).standard_normal(tips.shape)
    edges = np.array([0.0, 0.12, 0.12, 1.62, 1.62, 3.0])
    recording = make_recording(
        times, seen, station=[p.name for p in model.points], frame="planar", pressure_time=times,
        pressure=np.asarray(pressure(times), dtype=float), source="benchmark",
    )
    record = experiment("pulse", recording)
    from dataclasses import replace

    from pliant.simulation import Trace

    record = replace(record, pressure=Trace(edges, np.asarray([0, 0, 1, 1, 0, 0]) * chen2018.PULSE_PRESSURE))
    wrong = [Parameter("stiffness", 1.3 * 1.6067), Parameter("damping", 0.7 * 8e-3)]

    def run() -> Any:
        return fit([record], model, wrong, time_step=2e-3, starts=1)

    found = run()
    return {
        "fit_s": best(run, seconds=0.0, repeats=3), "fit_evaluations": found.evaluations,
        "fit_stiffness_error_percent": 100 * (found.values["stiffness"] / 1.6067 - 1),
        "fit_damping_error_percent": 100 * (found.values["damping"] / 8e-3 - 1),
    }
