"""Choose the terms of models from training recordings, and print their errors on recordings not used in the choice.

    python benchmarks/selection.py bodies [names]  # virtual actuators, default a b c 901 902 903 904
    python benchmarks/selection.py spatial [STUDY [names]]  # the fabric arm in space, each recording left out
    python benchmarks/selection.py known [first last]  # data of a known structure: terms added and missed

Virtual actuators are trained on pulses of 60 and 180 kPa, and predict the pulse of 119 kPa and the step to 240 kPa.
STUDY is a copy of examples/spatial_pneumatic_arm.toml beside its recordings, which the file says where to find; each
choice has five minutes.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pliant.identification import Experiment, Parameter
from pliant.identification import fit as fitted
from pliant.identification.parameters import apply
from pliant.model import Model, Station, chain_model
from pliant.recording.netcdf import write_netcdf
from pliant.selection import select_model, terms_for
from pliant.simulation import Trace, simulate
from pliant.study import Study, demo_study, load_study, run_study
from pliant.study.prepare import all_aligned
from pliant.study.schema import SelectionEntry
from pliant.testbed import family_member, generate
from pliant.testbed.family import member
from pliant.validation.outcome import StudyOutcome
from pliant.validation.wording import sized

SPATIAL = Path(__file__).parents[1] / "examples" / "spatial_pneumatic_arm.toml"


def chosen(study: Study) -> StudyOutcome:
    """Return the results of a study in which only a model selection and the linear fit are left."""
    entry = SelectionEntry.model_validate({
        "train": ["pulse_60", "pulse_180"], "held_out": ["pulse_119", "step_240"], "minutes": 30})
    fits = {"linear": study.fits["linear"]}
    return run_study(study.model_copy(update={"model_selection": entry, "forecasts": {}, "wiring": None, "fits": fits}))


def virtual(name: str, folder: Path) -> Study:
    """Return the demo's study with new recordings of another virtual actuator."""
    study, recordings, changes = load_study(demo_study()), {}, dict[str, Any]()
    who = family_member(int(name)) if name.isdigit() else name
    for record, entry in study.recordings.items():
        write_netcdf(generate(record, who, seed=1).recording, folder / f"{record}.nc")
        recordings[record] = entry.model_copy(update={"file": f"{record}.nc"})
    if not isinstance(who, str):
        known = who.known()
        changes["actuator"] = study.actuator.model_copy(update={
            "length": known["body_length"], "mass": known["body_mass"], "tip_mass": known["tip_mass"]})
        changes["fibre"] = study.fibre.model_copy(update={
            "body_length": known["body_length"], "cap_curvature": who.body.cap_curvature,
            "cap_length": who.body.cap_length, "gauge_length": known["gauge_length"]})
    return study.model_copy(update={"folder": str(folder), "recordings": recordings, **changes})


def bias_errors(name: str, study: Study) -> dict[str, float]:
    """Return the RMS error [% of length] of the shape in each recording that is due to the bias of its fibre."""
    who, shapes = member(name), []
    with tempfile.TemporaryDirectory() as folder:
        for record in study.recordings:
            clean = generate(record, replace(who, fibre=replace(who.fibre, bias=0.0)), seed=1)
            write_netcdf(clean.recording, Path(folder) / f"{record}.nc")
        for where in (study.folder, folder):
            aligned = all_aligned(study.model_copy(update={"folder": where}))
            shapes.append({n: a.body["position"].values for n, a in aligned.items()})
    off = {n: np.sum((shape - shapes[1][n]) ** 2, axis=-1) for n, shape in shapes[0].items()}
    return {n: 100.0 / study.actuator.length * float(np.sqrt(np.nanmean(e))) for n, e in off.items()}


def show(name: str, outcome: StudyOutcome, bias: dict[str, float], began: float) -> None:
    """Print the chosen terms, and the errors of every fit on the held-out recordings beside those of the fibre."""
    assert outcome.model_selection is not None
    print(f"{name}: {', '.join(outcome.model_selection.terms) or 'no term'}; {time.process_time() - began:.0f} s CPU")
    for fit in outcome.fits:
        for r in (r for r in fit.records if r.role == "held_out"):
            m = r.metrics
            band = f", {m['within_band_percent']:.0f} % within its band" if r.band is not None else ""
            print(f"  {fit.title[:40]:40} {r.name:10} {m['rmse_percent_of_travel']:6.2f} % of the peak displacement, "
                  f"{m['rmse_percent_of_length']:5.2f} % of length{band}; bias of the fibre "
                  f"{bias[r.name]:.2f} %", flush=True)


def spatial(file: str | Path = SPATIAL, *names: str) -> None:
    """Choose the model of the fabric arm without each recording, and print its error there beside the plain map's. The
    recordings start in a pose, as `pliant new` drafts them.
    """
    study = load_study(file)
    posed = {name: entry.model_copy(update={"start": "pose"}) for name, entry in study.recordings.items()}
    study = study.model_copy(update={"recordings": posed})
    assert study.model_selection is not None
    for held_out in names or tuple(study.recordings):
        began, train = time.monotonic(), [name for name in study.recordings if name != held_out]
        entry = study.model_selection.model_copy(update={"train": train, "held_out": [held_out]})
        outcome = run_study(study.model_copy(update={"model_selection": entry, "fits": {}}))
        assert outcome.model_selection is not None
        (fit,) = outcome.fits
        assert fit.baseline is not None
        (record,) = [r for r in fit.records if r.role == "held_out"]
        plain = fit.baseline.records[held_out]
        print(f"| {held_out} | {sized(record.metrics, 'rmse')[0]:.2f} | {sized(plain, 'rmse')[0]:.2f} | "
              f"{', '.join(outcome.model_selection.terms) or 'no term'} | {time.monotonic() - began:.0f} |", flush=True)


def known(first: int = 0, last: int = 100) -> None:
    """Choose terms for two pulses of a chain with up to three of five terms, chosen and sized at random, and noise.
    Print how many terms are chosen that are not there, and how many are missed although the noise does not hide them.
    """
    wrong = missed = real = runs = 0
    for seed in range(first, last):
        rng = np.random.default_rng(seed)
        names = tuple(rng.permutation(list(PRESENT))[: rng.integers(0, 4)])
        model = chain_model(length=0.12, mass=0.03, links=2, stiffness=0.5, damping=3e-3, torque=[6e-7],
                            stations=(Station("tip", 1, 0.06),))  # fmt: skip
        values = {name: value for term in names for name, value in PRESENT[term](rng).items()}
        train = [followed(model, values, level, f"p{level:.0f}", rng) for level in (5e4, 1e5)]
        given = model.with_(torque=np.zeros(1), stiffness=0.4)
        terms = terms_for(given, train, only=[*PRESENT, "torque_3", "joints", "cubic"])
        found = select_model(train, given, terms=terms)
        extra = [t for t in found.terms if t not in (*names, "stiffness")]  # its scale is no law of its own
        lost = [t for t in names if t not in found.terms and matters(model, values, t, train)]
        wrong, missed, real, runs = wrong + len(extra), missed + len(lost), real + len(names), runs + 1
        print(f"{seed}: {', '.join(names) or 'linear'}; added {', '.join(extra) or '-'}; "
              f"missed {', '.join(lost) or '-'}; {found.seconds:.0f} s", flush=True)
    print(f"{runs} searches: {wrong} terms added that are not there, {missed} of {real} missed")


PRESENT: dict[str, Callable[[np.random.Generator], dict[str, float]]] = {  # term: sizes of its parameters
    "softening": lambda rng: {"stiffening": float(rng.uniform(-0.8, -0.2)), "stiffening_bound": 0.75},
    "creep": lambda rng: {"creep_share_1": float(rng.uniform(0.1, 0.4)), "creep_time_1": float(rng.uniform(0.1, 0.6))},
    "slip": lambda rng: {"slip_share_1": float(rng.uniform(0.1, 0.4)), "slip_angle_1": float(rng.uniform(0.005, 0.05))},
    "torque_2": lambda rng: {"torque_2": float(rng.uniform(1e-12, 4e-12))},
    "lag": lambda rng: dict.fromkeys(("valve_rise_time", "valve_fall_time"), float(rng.uniform(0.02, 0.08))),
}
TIMES = np.arange(0.0, 2.0, 0.02)
NOISE = 2e-5  # m


def followed(
    model: Model, values: dict[str, float], level: float, name: str, rng: np.random.Generator | None,
) -> Experiment:
    """Return a simulated pulse of a chain with parameters, with noise if there is a generator."""
    trace = Trace(np.array([0.1, 0.13, 1.0, 1.03]), np.array([0.0, level, level, 0.0]))
    path = simulate(apply(model, values), trace, times=TIMES, time_step=5e-4)["station_position"].values
    noise = 0.0 if rng is None else NOISE * rng.normal(size=path.shape)
    return Experiment(name, TIMES, path + noise, ("tip",), "trace", trace)


def matters(model: Model, values: dict[str, float], term: str, train: list[Experiment]) -> bool:
    """Return whether a model without a term, fitted to the recordings, leaves more than 1.2 times their noise."""
    rest = {n: v for n, v in values.items() if n not in PRESENT[term](np.random.default_rng(0))}
    names = ["stiffness", "damping", "torque_1", *(n for n in rest if n != "stiffening_bound")]
    fixed = [Parameter(n, v, free=False) for n, v in rest.items() if n == "stiffening_bound"]
    result = fitted(train, apply(model, rest), [*names, *fixed], starts=1)
    return bool(max(result.rmse.values()) > 1.2 * np.sqrt(2.0) * NOISE)


def main(what: str, names: list[str]) -> None:
    """Choose models for the virtual actuators, for the fabric arm, or for data of a known structure."""
    if what == "spatial":
        spatial(*names)
    if what == "known":
        known(*map(int, names))
    for name in names or ["a", "b", "c", "901", "902", "903", "904"] if what == "bodies" else ():
        began = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            study = virtual(name, Path(folder))
            show(name, chosen(study), bias_errors(name, study), began)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "bodies", sys.argv[2:])
