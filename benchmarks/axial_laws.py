"""Which laws of its segments a measured arm that lengthens asks for: one trial after another left out and predicted.

    PLIANT_DATA=../shared/data python benchmarks/axial_laws.py [--left-out second third] [--laws plain creep]

For each trial left out and each law: BIC on the training trials, all laws counting as many independent numbers as the
closest one (lower is better), and the error on the trial that was left out, of the whole shape (% of peak displacement
and mm), of the lengths between markers (near and far segment, mm) and across them (mm). A law is chosen by BIC alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import PliantError
from pliant.identification import FitResult, fit
from pliant.identification.fit import parameters_from
from pliant.identification.model_selection import follows, shared_bic
from pliant.study import load_study
from pliant.study.fits import predicted_outcome
from pliant.study.run import PreparedStudy, prepare_all
from pliant.study.schema import Fit, Study
from pliant.validation.outcome import RecordOutcome

ARM = Path(__file__).parents[1] / "examples" / "planar_two_segment_arm_lengthens.toml"
CREEP: dict[str, Any] = {"axial_creep_share_1": "free", "axial_creep_time_1": 30.0}
SLIP: dict[str, Any] = {"axial_slip_share_1": "free", "axial_slip_strain_1": 0.01}
CURVE: dict[str, Any] = {"axial_stiffening": "free"}
LAWS = {"plain": {}, "creep": CREEP, "slip": SLIP, "softening": CURVE, "creep, softening": CREEP | CURVE}
AXIAL = tuple(dict.fromkeys(name for law in LAWS.values() for name in law))
TRIALS = ("first", "second", "third")  # of chambers 1; the only one of chambers 2 is always learned from
OTHER = "opposite"


def main() -> None:
    parser = argparse.ArgumentParser(description="Laws of segments that lengthen, one trial after the other left out")
    parser.add_argument("--left-out", nargs="+", default=list(TRIALS), choices=TRIALS)
    parser.add_argument("--laws", nargs="+", default=list(LAWS), choices=list(LAWS))
    given = parser.parse_args()
    study = load_study(ARM)
    ready = prepare_all(study, lambda _line: None)
    for left in given.left_out:
        trained = [t for t in (*TRIALS, OTHER) if t != left]
        print(f"{left} left out, learned from {', '.join(trained)}", flush=True)
        compare(study, ready, trained, left, given.laws)


def compare(study: Study, ready: PreparedStudy, trained: Sequence[str], left: str, laws: Sequence[str]) -> None:
    """Fit each law to the trials `trained`, print how it predicts the one `left` out, and what BIC chooses."""
    experiments, kept = [ready.experiments[t] for t in trained], {}
    for law in laws:
        try:
            made = fitted(study, ready, trained, LAWS[law])
            record = predicted_outcome(ready.experiments[left], made, study.time_step)[0]
        except PliantError as error:
            print(f"  {law:18s} {error}", flush=True)
            continue
        kept[law] = follows(experiments, made, study.time_step, entry_of(study).weighting)
        print(f"  {law:18s} {described(record)}  {values(made.values)}", flush=True)
    if kept:
        scores = dict(zip(kept, shared_bic(list(kept.values())), strict=True))
        listed = ", ".join(f"{law} {score:.0f}" for law, score in scores.items())
        print(f"  BIC: {listed}; chosen: {min(scores, key=lambda law: scores[law])}", flush=True)


def entry_of(study: Study) -> Fit:
    """The one fit of the study."""
    return next(iter(study.fits.values()))


def fitted(study: Study, ready: PreparedStudy, trained: Sequence[str], law: Mapping[str, Any]) -> FitResult:
    """The fit of the study to other trials, with the parameters of a law in the place of those that it has."""
    entry = entry_of(study)
    own = Fit.model_validate({"train": list(trained), "parameters": dict(law)}).parameters
    parameters = {k: v for k, v in entry.parameters.items() if k not in AXIAL} | own
    experiments = [ready.experiments[t] for t in trained]
    return fit(experiments, ready.model, parameters_from(parameters), time_step=study.time_step, loss=entry.loss,
               starts=entry.starts, weighting=entry.weighting, rng=study.seed)  # fmt: skip


def described(record: RecordOutcome) -> str:
    """The errors of a record: whole, along and across the segments."""
    exp = record.experiment
    base = np.zeros((exp.time.size, 1, 2))
    seen, made = (np.concatenate([base, p[:, -2:]], axis=1) for p in (exp.position, record.modelled))
    ways = np.diff(seen, axis=1), np.diff(made, axis=1)
    length, modelled = (np.linalg.norm(way, axis=2) for way in ways)
    ahead = ways[0] / length[..., None]
    across = ahead[..., 0] * ways[1][..., 1] - ahead[..., 1] * ways[1][..., 0]
    grown, turned = (1e3 * np.sqrt(np.nanmean(off**2, axis=0)) for off in (modelled - length, across))
    whole = record.metrics["rmse_percent_of_travel"]
    return (
        f"{whole:5.2f} % ({whole * exp.travel * 10:.2f} mm), length {grown[0]:.2f} {grown[1]:.2f} mm, across "
        f"{turned[0]:.2f} {turned[1]:.2f} mm"
    )


def values(found: Mapping[str, float]) -> str:
    """The parameters of the law as they were found."""
    return ", ".join(f"{name} {found[name]:.3g}" for name in AXIAL if name in found)


if __name__ == "__main__":
    main()
