"""Predict free decays of a trunk in space from the other half of the trials, under several laws of its joints.

    PLIANT_DATA=../shared/data python benchmarks/trunk_decays.py [viscous payne]

Recordings, model and start values are in trunk_decays.toml. Each trial comes to rest in another pose:
every trial has rest turns of its own, with a prior. The laws are compared by the error measure of the training trials
alone: the squares of the rms error and of the errors of both frequencies, each over its target. `--evaluations` fits
positions, `--refine` then fits the error measure; without them, the shared values of the study are used as they are. Of
a predicted trial are used: its first frames (the pose from which it is released), its last half second (the rest
turns), and the whole for the moment of release.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from pliant.identification import Experiment
from pliant.identification.edges import edges
from pliant.identification.fit import FitResult, fit, parameters_from
from pliant.identification.held_pose import solved_pose
from pliant.identification.initial_guess import prepare
from pliant.identification.model_selection import Follows, follows, shared_bic
from pliant.identification.parameters import Parameter, apply
from pliant.identification.prediction import predict
from pliant.model import Model
from pliant.numerics.ringdown import SMALL, turning_points
from pliant.study import load_study
from pliant.study.run import prepare_all

Array = np.ndarray
STUDY = Path(__file__).with_suffix(".toml")
AT_REST = 0.5  # s at the end of each trial that show where it rests
FIRST = 0.8  # s after the release within which the first swing reaches the far side
STARTS = (0.0, 0.4, 0.8)  # start values of the rest turns over the bends of the pose at rest
LEAST = 0.01  # of the first swing: smaller ones do not count
REST_PRIOR = 0.5  # rad, of a rest turn
TARGETS = np.array([0.03, 0.05, 0.08])  # of the rms error over the travel, and of both frequencies
NOISE = 3e-4  # m, least difference between turning points of a half swing
AMPLITUDES = (1e-4, 3e-4, 6e-4, 1e-3, 2e-3, 4e-3, 8e-3, 16e-3, 32e-3, 0.1)  # m, between which half swings are compared
PRIOR_WEIGHT = 0.15  # of a prior beside the measures of a trial


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
    """Fit the rest turns of one trial to its last half second, all else fixed at `values` and let go as it was seen.

    Of several starts, along the bends of the pose at rest, the one with the least error is taken.
    """
    late = exp.time > exp.time[-1] - AT_REST
    shown = [replace(exp, position=np.where(late[:, None, None], exp.position, np.nan))]
    began = Parameter(f"{exp.name}.release", edges(exp)["release"], free=False)
    fixed = [Parameter(n, v, free=False) for n, v in values.items() if not n.startswith("t_")]
    placed = apply(prepare(shown, model, [*fixed, began, *rest_turns(exp.name, model.n, {})])[0], values)
    shift = np.array([values[f"base_{axis}"] for axis in "xyz"])
    points = [p for p in placed.points if p.name in exp.stations]
    bends = solved_pose(placed, points, np.nanmean(exp.position[late], axis=0) - shift)
    results = []
    for part in STARTS:
        turns = dict(zip((p.name for p in rest_turns(exp.name, model.n, {})), part * bends, strict=True))
        results.append(fit(shown, model, [*fixed, began, *rest_turns(exp.name, model.n, turns)],
                           time_step=step, starts=1, max_evaluations=20))  # fmt: skip
    return min(results, key=lambda r: r.rmse[exp.name])


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


def measures(exp: Experiment, modelled: Array) -> Array:
    """Return the errors of a modelled trial over the targets: of all coordinates, (T S 3,), whose squares add up to
    that of the rms error, and of the logarithms of both frequencies.
    """
    off = ((modelled - exp.position) / exp.travel).ravel() / np.sqrt(exp.position[..., 0].size)
    assert exp.held is not None
    began, pull = edges(exp)["release"], exp.held[-1]
    seen, made = (np.array(rings(exp.time, path[:, -1], pull, began)) for path in (exp.position, modelled))
    return np.concatenate([off / TARGETS[0], np.nan_to_num(np.log(made / seen), nan=-1.0) / TARGETS[1:]])


def refined(train: list[Experiment], result: FitResult, step: float, evaluations: int) -> FitResult:
    """Fit the rms error and both frequencies of the training trials, each over its target, from the values of `result`.

    The frequency of the tail weighs little among the positions of a fit, because an early error of the phase hides it.
    """
    free = [p for p in result.parameters if p.free]
    start = np.array([p.value for p in free], dtype=float)
    size = np.array([0.1 * abs(v) if p.lower >= 0.0 else p.scale for p, v in zip(free, start, strict=True)])
    prior = np.array([(p.prior, p.prior_std / PRIOR_WEIGHT) if p.prior_std else (0.0, np.inf) for p in free]).T

    def residual(z: Array) -> Array:
        values = {**result.values, **dict(zip((p.name for p in free), start + (z - 1.0) * size, strict=True))}
        parts = [measures(e, np.asarray(predict(result.model, e, values, step)["position"])) for e in train]
        return np.concatenate([*parts, (start + (z - 1.0) * size - prior[0]) / prior[1]])

    counts = [e.position.size + 2 for e in train]
    acts = [[not p.name.startswith("t_") or p.name.startswith(f"{e.name}.") for p in free] for e in train]
    pattern = np.concatenate([np.repeat(acts, counts, axis=0), np.eye(len(free), dtype=bool)])
    bounds = tuple((np.array([getattr(p, end) for p in free]) - start) / size + 1.0 for end in ("lower", "upper"))
    best = least_squares(residual, np.ones(len(free)), jac_sparsity=pattern, diff_step=0.02, bounds=bounds,
                         max_nfev=evaluations)  # fmt: skip
    print(f"  measures of the training trials: {np.sum(residual(np.ones(len(free))) ** 2):.2f} to {2 * best.cost:.2f}")
    values = dict(zip((p.name for p in free), start + (best.x - 1.0) * size, strict=True))
    moved = tuple(p.with_(value=values.get(p.name, p.value)) for p in result.parameters)
    return replace(result, parameters=moved)


def half_swings(moments: Array, path: Array, held: Array, release: float) -> Array:
    """Return the amplitudes [m] and frequencies [Hz] (2, K) of the K half swings of a released point, as `rings`."""
    rest = np.nanmean(path[moments > moments[-1] - AT_REST], axis=0)
    late = (moments >= release) & np.isfinite(path).all(axis=1)
    at, value = turning_points(moments[late], (path[late] - rest) @ (held - rest) / np.linalg.norm(held - rest), NOISE)
    return np.array([0.5 * np.abs(np.diff(value)), 0.5 / np.diff(at)])


def show_training(train: list[Experiment], result: FitResult, step: float) -> None:
    """Print the error measure of the training trials, and the median frequencies of half swings by their amplitude."""
    paths = [np.asarray(predict(result.model, e, result.values, step)["position"]) for e in train]
    total = sum(float(np.sum(measures(e, path) ** 2)) for e, path in zip(train, paths, strict=True))
    print(f"  error measure of the training trials: {total:.1f}")
    for what, shown in (("measured", [e.position for e in train]), ("modelled", paths)):
        swings = [half_swings(e.time, p[:, -1], e.held[-1], edges(e)["release"])
                  for e, p in zip(train, shown, strict=True) if e.held is not None]  # fmt: skip
        size, frequency = np.concatenate(swings, axis=1)
        rows = [np.median(frequency[(size >= low) & (size < high)]) for low, high in pairwise(AMPLITUDES)]
        print(f"  half swings, {what}:", ", ".join(f"{f:.2f} Hz" for f in rows), flush=True)


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
    """Fit each law, print its error measure and BIC, and predict the other trials."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("laws", nargs="*", help="fits of the study; default: all")
    parser.add_argument("--evaluations", type=int, default=0, help="0: what the trials share is as in the study")
    parser.add_argument("--refine", type=int, default=0, help="evaluations of the fit of the measures after that")
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
        if given.refine:
            result = refined(experiments, result, study.time_step, given.refine)
        quality: Follows = follows(experiments, result, study.time_step, entry.weighting)
        fits.append(quality)
        print(f"{name}: {time.perf_counter() - began:.0f} s, {result.status}")
        print("  " + ", ".join(f"{n} {v:.4g}" for n, v in result.values.items() if not n.startswith("t_")), flush=True)
        show_training(experiments, result, study.time_step)
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
