"""Predict free decays of a trunk in space from the other half of the trials, under several laws of its joints.

    PLIANT_DATA=../shared/data python benchmarks/trunk_decays.py [viscous payne]

Recordings, model and start values are in trunk_decays.toml. Each trial comes to rest in another pose:
every trial has rest turns of its own, with a prior. The laws are compared by their BIC on the training trials alone. Of
a predicted trial are used: its first frames (the pose from which it is released), its last half second (the rest
turns), and the whole for the moment of release.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pliant.identification import Experiment
from pliant.identification.edges import edges
from pliant.identification.fit import FitResult, fit, parameters_from
from pliant.identification.initial_guess import prepare
from pliant.identification.model_selection import Follows, follows, shared_bic
from pliant.identification.parameters import Parameter
from pliant.identification.prediction import predict
from pliant.model import Model
from pliant.numerics.ringdown import SMALL, turning_points
from pliant.study import load_study
from pliant.study.run import prepare_all

Array = np.ndarray
STUDY = Path(__file__).with_suffix(".toml")
AT_REST = 0.5  # s at the end of each trial that show where it rests
FIRST = 0.8  # s after the release within which the first swing reaches the far side
LEAST = 0.01  # of the first swing: smaller ones do not count
REST_PRIOR = 0.5  # rad, of a rest turn


def rest_turns(trial: str, joints: int, values: dict[str, float]) -> list[Parameter]:
    """Return the rest turns of one trial as free parameters, at `values` where these have them."""
    names = [f"{trial}.rest_turn_{axis}_{i + 1}" for i in range(joints) for axis in "xy"]
    return [Parameter(n, values.get(n, 0.0), prior=0.0, prior_std=REST_PRIOR) for n in names]


def rings(moments: Array, path: Array, held: Array, release: float) -> tuple[float, float]:
    """Return the frequencies [Hz] of the first swing and of the tail of a released point, nan where there is none.

    The point's path (T, 3) [m] is projected on the line from its rest, its mean over the last half second, to where it
    was `held`. The first swing lasts from the release to the far turning point. The tail are the later swings below a
    sixth of the first one.
    """
    rest = np.nanmean(path[moments > moments[-1] - AT_REST], axis=0)
    late = (moments >= release) & np.isfinite(path).all(axis=1)
    t, y = moments[late], (path[late] - rest) @ (held - rest) / np.linalg.norm(held - rest)
    far = int(np.argmin(np.where(t < release + FIRST, y, np.inf)))
    first = float(np.linalg.norm(held - rest) - y[far])
    at, value = turning_points(t, y, LEAST * first)
    turn = int(np.argmin(np.abs(at - t[far])))
    halves = np.diff(at[turn:])[np.abs(np.diff(value[turn:])) < SMALL * first]
    return 0.5 / (float(at[turn]) - release), 0.5 / float(halves.mean()) if halves.size else np.nan


def settled(exp: Experiment, model: Model, values: dict[str, float], step: float) -> FitResult:
    """Fit the rest turns of one trial to its last half second, all else fixed at `values` and let go as it was seen."""
    still = np.where((exp.time > exp.time[-1] - AT_REST)[:, None, None], exp.position, np.nan)
    began = Parameter(f"{exp.name}.release", edges(exp)["release"], free=False)
    fixed = [Parameter(n, v, free=False) for n, v in values.items() if not n.startswith("t_")]
    return fit([replace(exp, position=still)], model, [*fixed, began, *rest_turns(exp.name, model.n, {})],
               time_step=step, starts=1, max_evaluations=30)  # fmt: skip


def predicted(exp: Experiment, model: Model, values: dict[str, float], step: float) -> tuple[Array, float]:
    """Return the modelled positions (T, S, 3) [m] of a trial that the fit has not seen, and its release [s]."""
    rest, moment = settled(exp, model, values, step), f"{exp.name}.release"
    fixed = [p.with_(free=False, prior=None, prior_std=None) for p in rest.parameters if p.name != moment]
    began = Parameter(moment, edges(exp)["release"], lower=-1.0, upper=2.0)
    let_go = fit([exp], rest.model, [*fixed, began], time_step=step, starts=1, max_evaluations=8)
    return predict(let_go.model, exp, let_go.values, step)["position"], let_go.values[moment]


def fitted(train: list[Experiment], model: Model, entry: Any, step: float, evaluations: int) -> FitResult:
    """Fit a law to the training trials, each with rest turns of its own; 0 evaluations keep what the trials share."""
    shared = parameters_from(entry.parameters)
    fixed = [p.with_(free=False, prior=None, prior_std=None) for p in shared]
    own: list[Parameter] = []
    for exp in train:  # what each trial has of its own, with all else at its start
        rest = settled(exp, model, {p.name: float(p.value) for p in fixed if p.value is not None}, step)
        began = Parameter(f"{exp.name}.release", edges(exp)["release"], lower=-1.0, upper=2.0)
        turns = rest_turns(exp.name, model.n, rest.values)
        alone = fit([exp], rest.model, [*fixed, began, *turns], time_step=step, starts=1, max_evaluations=20,
                    regularise=True, weighting=entry.weighting).values  # fmt: skip
        own += [*rest_turns(exp.name, model.n, alone), began.with_(value=alone[began.name])]
    if evaluations:
        return fit(train, model, [*shared, *own], time_step=step, starts=1, max_evaluations=evaluations,
                   weighting=entry.weighting)  # fmt: skip
    made, parameters = prepare(train, model, [*shared, *own])
    return FitResult(made, tuple(parameters), "the values of the study as they are", {}, 0, 0.0, True)


def missed(exp: Experiment, modelled: Array, release: float) -> tuple[float, float, float]:
    """Return the errors of a trial: of all points in % of the travel, and of both frequencies in %."""
    off = np.sqrt(np.nanmean(np.sum((modelled - exp.position) ** 2, axis=-1)))
    assert exp.held is not None
    began, pull = edges(exp)["release"], exp.held[-1]
    seen = rings(exp.time, exp.position[:, -1], pull, began)
    made = rings(exp.time, modelled[:, -1], pull, began)
    swing, tail = (f"{s:.2f} Hz, modelled {m:.2f}" for s, m in zip(seen, made, strict=True))
    share = 100 * off / exp.travel
    print(f"  {exp.name}: {share:.1f} % of travel; first swing {swing}; tail {tail}; released at {release:.3f} s",
          flush=True)  # fmt: skip
    return float(share), *(100 * abs(m / s - 1.0) for s, m in zip(seen, made, strict=True))


def main() -> None:
    """Fit each law, print its BIC, and predict the other trials."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("laws", nargs="*", help="fits of the study; default: all")
    parser.add_argument("--evaluations", type=int, default=0, help="0: what the trials share is as in the study")
    given = parser.parse_args()
    study = load_study(STUDY)
    own_rest = study.alignment.model_copy(update={"common_rest": False})
    study = study.model_copy(update={"alignment": own_rest})
    ready = prepare_all(study, print)
    fits, criteria, errors = [], {}, {}
    for name in given.laws or study.fits:
        entry, began = study.fits[name], time.perf_counter()
        experiments = [ready.experiments[n] for n in entry.train]
        result = fitted(experiments, ready.model, entry, study.time_step, given.evaluations)
        quality: Follows = follows(experiments, result, study.time_step, entry.weighting)
        fits.append(quality)
        print(f"{name}: {time.perf_counter() - began:.0f} s, {result.status}")
        print("  " + ", ".join(f"{n} {v:.4g}" for n, v in result.values.items() if not n.startswith("t_")), flush=True)
        rows = []
        for n in entry.held_out:
            modelled, release = predicted(ready.experiments[n], result.model, result.values, study.time_step)
            rows.append(missed(ready.experiments[n], modelled, release))
        errors[name] = np.array(rows)
        plain = follows(experiments, result, study.time_step, "travel")
        criteria[name] = 100 * np.sqrt(plain.mean_square)
    for (name, rows), bic in zip(errors.items(), shared_bic(fits), strict=True):
        middle, worst = np.nanmedian(rows, axis=0), np.nanmax(rows, axis=0)
        print(f"{name}: BIC {bic:.0f}, training error of a coordinate {criteria[name]:.2f} %")
        for what, m, w in zip(("rms of travel", "first swing", "tail"), middle, worst, strict=True):
            print(f"  predicted, {what}: median {m:.1f} %, worst {w:.1f} %")


if __name__ == "__main__":
    main()
