"""How well a model taught by one chamber at a time predicts both: virtual bodies of two segments and of two sides.

Each body is recorded by the virtual fibre, with all its errors and by the transducers of both chambers, under pulses of
60 and 150 kPa in one chamber at a time. A chain of six links learns from these and predicts pulses in both chambers.
What is found of the chambers is held against the rod's own numbers, which share nothing with the chain; last, what
recordings teach in which both chambers follow one command.
Usage: python benchmarks/two_chambers.py [seeds of the sensors]
"""

from __future__ import annotations

import sys
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
MODELS = {"springs": (), "and creep": ("creep_share_1", "creep_time_1")}
UNEVEN = Parameter("stiffness_*", shrink=0.3)


def chambers(body: str) -> list[dict[str, object]]:
    """The chambers as a study states them: which joints each turns, and which way."""
    made = []
    for c in CHAMBERS[body]:
        joints = range(round(c.start * LINKS) + 1, round(c.stop * LINKS) + 1)
        made.append({"name": c.name, "joints": list(joints), "gain": float(np.sign(c.gain))})
    return made


def recorded(body: str, seed: int, names: Iterable[str] = CASES) -> tuple[dict[str, Experiment], Model]:
    """What the laboratory has of a body: its recordings, reduced to links, and the chain with guessed numbers."""
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
    """The fit to some recordings; one gain for each chamber, one stiffness unless `more` frees that of each joint."""
    plain = PLAIN[UNEVEN in more:]
    return fit(train, model, [*plain, *(f"{c.name}.torque_1" for c in CHAMBERS[body]), *more], starts=1)


def missed(exp: Experiment, fitted: FitResult) -> float:
    """Root mean square error of all link tips in a held-out record, % of its travel."""
    error = predict_held_out(exp, fitted)[0]["position"] - exp.position
    return 100.0 * float(np.sqrt(np.nanmean(np.sum(error**2, axis=-1)))) / exp.travel


def compliance(body: str, fitted: FitResult) -> tuple[np.ndarray, np.ndarray]:
    """Bend of the body per pressure of each chamber at small pressure, rad/Pa: as found, and the rod's own."""
    c = np.array([chamber.torque[0] * np.sum(chamber.joint_gain / fitted.model.stiffness)
                  for chamber in fitted.model.chambers])  # fmt: skip
    rod = build_body(actuator(body))
    lever = rod.gain * (1.0 + rod.gain_slope[:, None] * rod.rest_curvature)
    return c, (lever / rod.stiffness) @ rod.weight


def told(body: str, fitted: FitResult) -> str:
    """What was found of the chambers against the rod's own, with the standard errors of their gains."""
    std = {p.name: 100.0 * p.std / abs(p.value) for p in fitted.parameters if p.free and p.std is not None}
    return "bend per pressure against the rod's " + " and ".join(
        f"{100 * (f / t - 1):+.1f} % (gain +- {std[f'{c.name}.torque_1']:.1f} %)"
        for c, f, t in zip(CHAMBERS[body], *compliance(body, fitted), strict=True)
    )


def main(seeds: int) -> None:
    """Print a table for each body."""
    for body in BODIES:
        for seed in range(1, seeds + 1):
            experiments, model = recorded(body, seed)
            for title, more in MODELS.items():
                fitted = taught(body, [experiments[name] for name in TRAIN], model, more)
                held = {name: experiments[name] for name in HELD_OUT}
                errors = ", ".join(f"{name} {missed(exp, fitted):.2f} % of {1e3 * exp.travel:.0f} mm"
                                   for name, exp in held.items())  # fmt: skip
                print(f"{body}, sensors {seed}, {title}: {errors}; {told(body, fitted)}", flush=True)
            for title, more in {"springs": (), "K of each joint": (UNEVEN,)}.items():
                fitted = taught(body, [experiments[name] for name in TOGETHER], model, more)
                print(f"{body}, sensors {seed}, {title}, taught by both together: {told(body, fitted)}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3)
