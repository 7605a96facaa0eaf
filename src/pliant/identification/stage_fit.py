"""Fit of one stage of a model selection: alternative parameter sets, start values, and undetermined parameters."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from pliant.errors import FitError, PliantError
from pliant.failures import Failures, NotComputed
from pliant.identification.experiment import Experiment
from pliant.identification.fit import FitOptions, fit
from pliant.identification.fit_step import LONGEST
from pliant.identification.following import observed_rows
from pliant.identification.forward_model import forward_problem
from pliant.identification.initial_guess import prepare
from pliant.identification.memory_parameters import usual_start
from pliant.identification.model_selection import Follows, error, follows, missed, shared_bic, undetermined
from pliant.identification.names import stem_of
from pliant.identification.parameters import Parameter, kind_of, values_of
from pliant.identification.prediction import predict
from pliant.identification.problem import root_mean_square
from pliant.identification.result import FitResult, touches_bound
from pliant.identification.stages import Entry, Stage
from pliant.model import Model
from pliant.simulation import modes

Array = np.ndarray
STEPS_PER_PERIOD = 16  # of the first mode: twice what a simulation asks for
TRIAL = 12  # evaluations of a short fit that selects the best start


@dataclass(frozen=True)
class StageResult:
    """Result of fitting one stage of a model selection: fit, errors, cost, and why it was rejected, if so.

    Attributes
    ----------
    result : FitResult or None
        The fit; None if the stage could not be fitted, for the `reason` given.
    freed : tuple of str
        Names of all free parameters.
    train, held_out : dict
        RMS error of each recording, in % of its peak displacement.
    seconds : float
        Wall time of all fits of the stage, s.
    step_ns : float
        Wall time of one simulation step, ns.
    stands_on : str
        Name of the stage to whose free parameters this one adds; empty for the lowest.
    missed : dict
        Squared error (T,) of each frame of the held-out recordings, (% of peak displacement)^2.
    follows : Follows or None
        Quality of the fit on the training recordings, for `bic`.
    bic : float or None
        Bayesian information criterion, comparable within one selection; see `model_selection.shared_bic`.
    reason : str
        Why the stage could not be fitted, or was not chosen.
    open : str
        Parameters that the recordings do not determine, as text; empty if they determine all.
    given : tuple of str
        Parameters that keep the given model's values, since the recordings do not determine them on this stage.
    not_computed : tuple of NotComputed
        Held-out recordings that this stage cannot predict; `held_out` and `missed` lack them.
    """

    stage: Stage
    result: FitResult | None = None
    freed: tuple[str, ...] = ()
    train: dict[str, float] | None = None
    held_out: dict[str, float] | None = None
    seconds: float = 0.0
    step_ns: float = float("nan")
    stands_on: str = ""
    missed: dict[str, Array] | None = None
    follows: Follows | None = None
    bic: float | None = None
    reason: str = ""
    open: str = ""
    given: tuple[str, ...] = ()
    not_computed: tuple[NotComputed, ...] = ()

    @property
    def error(self) -> float:
        """Return the mean RMS error [% of peak displacement] over held-out recordings or, without any, over training
        ones.
        """
        return float(np.mean(list((self.held_out or self.train or {"": float("inf")}).values())))


@dataclass(frozen=True)
class StageFitter:
    """Recordings, model and settings with which every stage of a model selection is fitted."""

    train: Sequence[Experiment]
    held_out: Sequence[Experiment]
    model: Model
    options: FitOptions
    common: Sequence[str] = ()  # names of the parameters that are free on every stage

    @property
    def time_step(self) -> float:
        """Return the time step [s] of all stages."""
        return self.options["time_step"] or LONGEST

    def fit_stage(
        self, stage: Stage, below: StageResult, free: dict[str, Entry],
    ) -> tuple[StageResult, dict[str, Entry]]:
        """Fit the parameters that are `free` in the stage below, without those that this stage drops, together with
        those that it adds. Return the stage's result and its free parameters.
        """
        began = clock.perf_counter()
        reason, found = "", []
        for choice in stage.frees or ((),):
            taken = {n: e for n, e in free.items() if n not in stage.drops} | {
                entry_name(e): e for e in choice if entry_name(e) not in free
            }
            try:
                found.append(self.prune(stage, taken, below, {entry_name(e) for e in choice}))
            except PliantError as problem:
                reason = reason or str(problem)
        if not found:
            return StageResult(stage, seconds=clock.perf_counter() - began, reason=reason), free
        found = [pair for pair in found if not pair[0].open] or found
        best = int(np.argmin(shared_bic([s.follows for s, _ in found if s.follows])))
        chosen, taken = found[best]
        return replace(chosen, stands_on=below.stage.name, seconds=clock.perf_counter() - began), taken

    def prune(
        self, stage: Stage, taken: dict[str, Entry], below: StageResult, choice: set[str],
    ) -> tuple[StageResult, dict[str, Entry]]:
        """Fit the parameters `taken`. Then hold those that the recordings do not determine at their values in the given
        model, and fit the others again.

        Parameters are held one after another, the least certain first, while one of the stage's `choice` remains free.
        If some are still not determined then, the fit of all parameters is returned, with these listed in `open`.
        """
        ended, before = ends(below.result), tuple(n for n in below.given if n not in {*taken, *stage.drops})
        first = result, left = self.fit_once(stage, taken, below, ended)
        less, given = taken, before
        try:
            while loose := [p for p in result.parameters if p.name in left and p.name in less and self.has_given(p)]:
                worst = max(loose, key=doubt).name
                less, given = {n: e for n, e in less.items() if n != worst}, (*given, worst)
                if not choice & less.keys() - set(below.freed):
                    break
                result, left = self.fit_once(stage, less, below, ended)
                if not left:
                    return replace(self.judged(stage, result), given=given), less
        except PliantError:
            pass  # without it the rest cannot be fitted
        result, left = first
        return replace(self.judged(stage, result), open=", ".join(left.values()), given=before), taken

    def fit_once(
        self, stage: Stage, taken: dict[str, Entry], below: StageResult, ended: dict[str, Parameter],
    ) -> tuple[FitResult, dict[str, str]]:
        """Fit the parameters `taken` once; return the fit, and a sentence on each parameter it does not determine."""
        result = self.multistart(list(taken.values()), stage, ended)
        added = {p.name for p in result.parameters} - set(below.freed) - set(self.common)
        return result, undetermined(result, added)

    def has_given(self, p: Parameter) -> bool:
        """Return whether the model passed to the selection has a positive value for `p`, at which the parameter could
        be held.

        It does not for the parameters of hysteresis or single joints. Coefficients of a torque law are left to the
        alternatives of a stage.
        """
        return p.name not in self.common and not p.shrink and usual_start(p.name) is None and kind_of(p.name).lower >= 0

    def multistart(self, entries: Sequence[Entry], stage: Stage, ended: dict[str, Parameter]) -> FitResult:
        """Fit parameters of a stage from several start values: by a few evaluations from each, then fully from the
        best.

        The starts are the end of the stage below and fresh estimates, since parameters of the stage below may have
        compensated for those that this stage adds. Both are tried with each value of the stage's scan.
        """
        starts = [[self.bounded(started(e, way)) for e in entries] for way in ([ended, {}] if ended else [{}])]
        rows = [(name, row) for name, row in stage.scan if any(p.free and p.name == name for p in starts[0])]
        grid = [dict(zip((n for n, _ in rows), at, strict=True)) for at in zip(*(r for _, r in rows), strict=True)]
        if not grid and len(starts) == 1:
            return self.fitted(starts[0])
        trials, reason = [], ""
        for listed, at in product(starts, grid or [{}]):
            try:
                trial = self.fitted([p.with_(value=at.get(p.name, p.value)) for p in listed], TRIAL)
            except PliantError as problem:
                reason = reason or str(problem)
                continue
            trials.append((sum((trial.rmse[e.name] / e.travel) ** 2 for e in self.train), ends(trial), listed))
        if not trials:
            raise FitError(reason)
        _, start, listed = min(trials, key=lambda t: t[0])
        return self.fitted([self.bounded(started(p, start)) for p in listed])

    def bounded(self, p: Parameter) -> Parameter:
        """Return the parameter; a joint stiffness gets an upper bound, above which the time step would be too long."""
        if stem_of(p.name) != "stiffness":
            return p
        most = min(p.upper, simulable(self.model, self.time_step))
        return p.with_(upper=most, value=p.value if p.value is None else min(p.value, 0.9 * most))

    def fitted(self, listed: list[Parameter], most: int = 200) -> FitResult:
        """Fit the parameters with at most `most` evaluations. Without free parameters, the given model is returned."""
        if any(p.free for p in listed) or any(e.own_parameters for e in self.train):
            return fit(self.train, self.model, listed, **self.options, max_evaluations=most)
        model, filled = prepare(self.train, self.model, listed)
        values = values_of(filled)
        rmse = {
            e.name: root_mean_square(predict(model, e, values, self.time_step)["compared"], e.compared)
            for e in self.train
        }
        return FitResult(
            model, tuple(filled), "Nothing is free: the model as given.", rmse, len(rmse), 0.0, True,
            turns=self.train[0].without_positions, time_step=self.time_step,
        )

    def judged(self, stage: Stage, result: FitResult) -> StageResult:
        """Return the result of a fitted stage with its errors on all recordings and its simulation cost."""
        time_step = self.time_step
        failures, unseen = Failures(f"of stage {stage.title}"), {}
        for e in self.held_out:
            row = failures.attempt("prediction", e.name, partial(missed, e, result, time_step), "held_out")
            if row is not None:
                unseen[e.name] = row
        return StageResult(
            stage, result, tuple(p.name for p in result.parameters if p.free),
            train={e.name: 100 * result.rmse[e.name] / e.travel for e in self.train},
            held_out={name: error({name: row}) for name, row in unseen.items()}, missed=unseen,
            follows=follows(self.train, result, time_step, self.options["weighting"]),
            step_ns=step_cost(result, self.train[0], time_step), not_computed=tuple(failures),
        )


def step_cost(result: FitResult, exp: Experiment, time_step: float) -> float:
    """Return the wall time [ns] of one simulation step of an experiment, observation included; best of five runs."""
    forward = forward_problem(result.model, exp, result.values, time_step)
    best = float("inf")
    for _ in range(5):
        began = clock.perf_counter()
        observed_rows(forward, forward.numbers, exp.time.size)
        best = min(best, clock.perf_counter() - began)
    return 1e9 * best / max(forward.numbers.h.size, 1)


def doubt(p: Parameter) -> float:
    """Return the relative standard error of a fitted parameter, infinite at a bound or if it is not determined."""
    return float("inf") if p.std is None or not p.value or touches_bound(p) else p.std / abs(p.value)


def entry_name(entry: Entry) -> str:
    """Return the name of an entry of a stage, which is a `Parameter` or only the name of one."""
    return entry if isinstance(entry, str) else entry.name


def started(entry: Entry, ended: dict[str, Parameter]) -> Parameter:
    """Return the parameter of an entry, with its final value in a lower stage, from `ended`, as start value. If that
    stage fitted one value for all joints or chambers, this value is used.

    A parameter that ended at a bound starts afresh. Its scale stays that of the first start.
    """
    p = Parameter(entry) if isinstance(entry, str) else entry
    found = next((ended[n] for n in (p.name, p.name.removesuffix("_*"), p.name.rpartition(".")[2]) if n in ended), None)
    if found is None or found.value is None or not p.free or touches_bound(found):
        return p
    prior = found.prior if p.prior_std and p.prior is None else p.prior
    return p.with_(value=float(np.clip(found.value, p.lower, p.upper)), scale=p.scale or found.scale, prior=prior)


def simulable(model: Model, time_step: float) -> float:
    """Return the joint stiffness [N m/rad] above which the time step is too long for the chain's first mode.

    Without a ringing motion, a fit could increase stiffness, damping and torque together without limit.
    """
    frequency = float(modes(model)[0][0])
    return float(model.stiffness.mean()) * (1 / (STEPS_PER_PERIOD * time_step * frequency)) ** 2


def ends(result: FitResult | None) -> dict[str, Parameter]:
    """Return the fitted parameters by name, with their final values; {} without a fit."""
    return {p.name: p for p in result.parameters} if result else {}
