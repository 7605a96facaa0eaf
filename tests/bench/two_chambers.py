"""Measure how well a model trained on one chamber at a time predicts both, for virtual bodies with two chambers.

The virtual fibre with all its errors, and the pressure sensors of both chambers, record each body under pulses of 60
and 150 kPa in one chamber at a time. A chain of six links is trained on these recordings and predicts pulses in both
chambers. The fitted chamber parameters are compared with the true values of the rod, which shares no code with the
chain. Finally the program evaluates recordings in which both chambers follow one command.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pliant.identification import Experiment, FitResult, Parameter, fit, predict_held_out
from pliant.model import Model
from pliant.recording.netcdf import write_netcdf
from pliant.study.run import prepare_all
from pliant.study.schema import Study
from pliant.testbed import generate
from pliant.testbed.rod import CHAMBERS, actuator, build_body

LINKS = 6
BODIES = ("two_segment", "antagonistic")
TRAIN = {"first_60": "pulse_60+0_1500ms", "first_150": "pulse_150+0_1500ms", "second_60": "pulse_0+60_1500ms",
         "second_150": "pulse_0+150_1500ms"}  # fmt: skip
TOGETHER = {"same_60": "pulse_60_1500ms", "same_150": "pulse_150_1500ms"}  # one command for both
HELD_OUT = {"both": "pulse_100+130_1500ms", "overlapping": "overlapping", "in_turn": "in_turn"}
CASES = {**TRAIN, **TOGETHER, **HELD_OUT}
PLAIN = ("stiffness", "damping", "stiffening", "start")
UNEVEN = Parameter("stiffness_*", shrink=0.3)


def chambers(body: str) -> list[dict[str, object]]:
    """Return the chambers as a study states them: the joints of each, and the direction."""
    made = []
    for c in CHAMBERS[body]:
        joints = range(round(c.start * LINKS) + 1, round(c.stop * LINKS) + 1)
        made.append({"name": c.name, "joints": list(joints), "joint_gain": float(np.sign(c.gain))})
    return made


def recorded(body: str, seed: int, names: Iterable[str] = CASES) -> tuple[dict[str, Experiment], Model]:
    """Return the recordings of a body, reduced to links, and the chain with estimated parameters."""
    with tempfile.TemporaryDirectory() as folder:
        recordings = {}
        for name in names:
            write_netcdf(generate(CASES[name], body, seed).recording, Path(folder) / f"{name}.nc")
            recordings[name] = {"file": f"{name}.nc", "drive": {c.name: c.name for c in CHAMBERS[body]}}
        study = Study.model_validate({
            "name": body, "folder": folder, "fits": {}, "recordings": recordings,
            "actuator": {"length": 0.17, "mass": 0.069, "tip_mass": 0.006, "chambers": chambers(body)},
            "fibre": {"body_length": 0.17, "cap_curvature": 50.0, "cap_length": 0.03, "gauge_length": 2.4e-3},
            "reduction": {"recording": "first_150", "links": LINKS, "joint_placement": "midsegment"},
        })
        ready = prepare_all(study, lambda _line: None)
        return ready.experiments, ready.model


def taught(
    body: str, train: Sequence[Experiment], model: Model, more: Sequence[str | Parameter] = (),
) -> FitResult:
    """Fit some recordings with one gain for each chamber and one stiffness, or with the stiffness of each joint
    (`more`).
    """
    plain = PLAIN[UNEVEN in more:]
    return fit(train, model, [*plain, *(f"{c.name}.torque_1" for c in CHAMBERS[body]), *more], starts=1)


def missed(exp: Experiment, fitted: FitResult) -> float:
    """Return the root mean square error of all link tips in a held-out recording, % of the peak displacement."""
    error = predict_held_out(exp, fitted)[0]["position"] - exp.position
    return 100.0 * float(np.sqrt(np.nanmean(np.sum(error**2, axis=-1)))) / exp.travel


def compliance(body: str, fitted: FitResult) -> tuple[np.ndarray, np.ndarray]:
    """Return the bend per pressure of each chamber at small pressure, rad/Pa: fitted, and of the rod."""
    c = np.array([chamber.torque[0] * np.sum(chamber.joint_gain / fitted.model.stiffness)
                  for chamber in fitted.model.chambers])  # fmt: skip
    rod = build_body(actuator(body))
    lever = rod.gain * (1.0 + rod.gain_slope[:, None] * rod.rest_curvature)
    return c, (lever / rod.stiffness) @ rod.weight
