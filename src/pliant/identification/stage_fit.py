"""One stage of a model selection: its choices, its starts, its fit, and what the recordings say of it."""

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
from pliant.identification.following import moved
from pliant.identification.forward_model import set_up
from pliant.identification.initial_guess import prepare
from pliant.identification.memory_parameters import usual_start
from pliant.identification.model_selection import Follows, error, follows, missed, shared_bic, undetermined
from pliant.identification.parameters import Parameter, kind_of
from pliant.identification.prediction import predict
from pliant.identification.problem import root_mean_square
from pliant.identification.result import FitResult, touches_bound
from pliant.identification.stages import Entry, Stage
from pliant.model import Model
from pliant.simulation import modes

Array = np.ndarray
STEPS_PER_PERIOD = 16  # of the first mode: twice what a simulation asks for
TRIAL = 12  # evaluations of a fit that only tells which start is worth a whole one


@dataclass(frozen=True)
class Step:
    """One stage after its fit.

    Attributes
    ----------
    result : FitResult or None
        None where the recordings cannot tell what the stage frees; `reason` then says why.
    freed : tuple of str
        Names of all free parameters.
    train, held_out : dict
        Euclidean error of each record, in % of its travel.
    seconds : float
        Of all its fits.
    step_ns : float
        Of one step of a simulation.
    stands_on : str
        Name of the stage that it frees more than; empty for the lowest.
    missed : dict
        Squared error (T,) of each frame of the held-out records, (% of travel)^2.
    follows : Follows or None
        How the training records are followed, for `bic`.
    bic : float or None
        Bayesian information criterion, to be compared within one selection; see `model_selection.shared_bic`.
    reason : str
        Why it could not be fitted, or is not the chosen one.
    open : str
        Which parameters the recordings do not determine; empty where they determine all.
    given : tuple of str
        Parameters that stay as the given model has them, since the recordings do not determine them on this stage.
    not_computed : tuple of NotComputed
        Held-out records that this stage cannot predict; `held_out` and `missed` lack them.
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
        """Mean error of the held-out records, or of the training ones where none is held out, % of travel."""
        return float(np.mean(list((self.held_out or self.train or {"": float("inf")}).values())))


@dataclass(frozen=True)
class StageFitter:
    """Data and settings on which every stage is fitted and judged."""

    train: Sequence[Experiment]
    held_out: Sequence[Experiment]
    model: Model
    options: FitOptions
    common: Sequence[str] = ()  # names of what every stage frees

    def fit_stage(self, stage: Stage, below: Step, free: dict[str, Entry]) -> tuple[Step, dict[str, Entry]]:
        """Fit a stage that builds on `below`, whose free parameters are `free`; return it and its own free ones."""
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
            return Step(stage, seconds=clock.perf_counter() - began, reason=reason), free
        found = [pair for pair in found if not pair[0].open] or found
        best = int(np.argmin(shared_bic([s.follows for s, _ in found if s.follows])))
        step, taken = found[best]
        return replace(step, stands_on=below.stage.name, seconds=clock.perf_counter() - began), taken

    def prune(
        self, stage: Stage, taken: dict[str, Entry], below: Step, choice: set[str],
    ) -> tuple[Step, dict[str, Entry]]:
        """The fit of what is `taken`, where the recordings determine it; else of less.

        What they leave open and the given model has a value for stays as given, the worst first, while something of the
        stage's `choice` is left. Where that does not help, the stage is what it was with all of it, and open.
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
        self, stage: Stage, taken: dict[str, Entry], below: Step, ended: dict[str, Parameter],
    ) -> tuple[FitResult, dict[str, str]]:
        """The fit of what is `taken`, and what of it the recordings do not determine."""
        result = self.multistart(list(taken.values()), stage, ended)
        added = {p.name for p in result.parameters} - set(below.freed) - set(self.common)
        return result, undetermined(result, added)

    def has_given(self, p: Parameter) -> bool:
        """Whether the given model has a value for a positive number of a stage: not for what memory or joints add.

        Coefficients of a law are left to the choices of a stage.
        """
        return p.name not in self.common and not p.shrink and usual_start(p.name) is None and kind_of(p.name).lower >= 0

    def multistart(self, entries: Sequence[Entry], stage: Stage, ended: dict[str, Parameter]) -> FitResult:
        """The fit of some parameters from the best of several starts, each of which a short fit tries.

        A start is where the stage below ended, or afresh: what this stage adds, others may have taken up below. Of
        both, each value of the stage's scan is tried.
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
        """The parameter; a stiffness bounded to what can be simulated."""
        if not p.name.startswith("stiffness"):
            return p
        most = min(p.upper, simulable(self.model, self.options["step"]))
        return p.with_(upper=most, value=p.value if p.value is None else min(p.value, 0.9 * most))

    def fitted(self, listed: list[Parameter], most: int = 200) -> FitResult:
        """The fit, of at most so many evaluations; where nothing at all is free, the model as it is."""
        if any(p.free for p in listed) or any(e.own_parameters for e in self.train):
            return fit(self.train, self.model, listed, **self.options, max_evaluations=most)
        model, filled = prepare(self.train, self.model, listed)
        values = {p.name: float(p.value) for p in filled if p.value is not None}
        rmse = {
            e.name: root_mean_square(predict(model, e, values, self.options["step"])["compared"], e.compared)
            for e in self.train
        }
        return FitResult(model, tuple(filled), "Nothing is free: the model as given.", rmse, len(rmse), 0.0, True,
                         turns=self.train[0].without_positions)  # fmt: skip

    def judged(self, stage: Stage, result: FitResult) -> Step:
        """Errors and cost of a fitted stage."""
        step = self.options["step"]
        failures, unseen = Failures(f"of stage {stage.title}"), {}
        for e in self.held_out:
            row = failures.attempt("prediction", e.name, partial(missed, e, result, step), "held_out")
            if row is not None:
                unseen[e.name] = row
        return Step(
            stage, result, tuple(p.name for p in result.parameters if p.free),
            train={e.name: 100 * result.rmse[e.name] / e.travel for e in self.train},
            held_out={name: error({name: row}) for name, row in unseen.items()}, missed=unseen,
            follows=follows(self.train, result, step, self.options["weighting"]),
            step_ns=step_cost(result, self.train[0], step), not_computed=tuple(failures),
        )


def step_cost(result: FitResult, exp: Experiment, step: float) -> float:
    """Time of one step of a simulation of an experiment, observing included, ns: the best of five."""
    made = set_up(result.model, exp, result.values, step)
    best = float("inf")
    for _ in range(5):
        began = clock.perf_counter()
        moved(made, made.numbers, exp.time.size)
        best = min(best, clock.perf_counter() - began)
    return 1e9 * best / max(made.numbers.h.size, 1)


def doubt(p: Parameter) -> float:
    """Standard error of a parameter in shares of its value; without end where it lies at a bound or does not show."""
    return float("inf") if p.std is None or not p.value or touches_bound(p) else p.std / abs(p.value)


def entry_name(entry: Entry) -> str:
    """Name of a parameter, or of one given by its name alone."""
    return entry if isinstance(entry, str) else entry.name


def started(entry: Entry, ended: dict[str, Parameter]) -> Parameter:
    """A parameter that starts where it `ended` on a lower stage; each joint's or chamber's where that of all did.

    What ended on a bound starts afresh. The size stays that of the first start.
    """
    p = Parameter(entry) if isinstance(entry, str) else entry
    found = next((ended[n] for n in (p.name, p.name.removesuffix("_*"), p.name.rpartition(".")[2]) if n in ended), None)
    if found is None or found.value is None or not p.free or touches_bound(found):
        return p
    return p.with_(value=float(np.clip(found.value, p.lower, p.upper)), scale=p.scale or found.scale)


def simulable(model: Model, step: float) -> float:
    """The stiffness of a joint, N m/rad, above which the steps could not follow the first mode of the chain.

    Where nothing rings, a fit may drive stiffness, damping and torque up together without end.
    """
    frequency = float(modes(model)[0][0])
    return float(model.stiffness.mean()) * (1 / (STEPS_PER_PERIOD * step * frequency)) ** 2


def ends(result: FitResult | None) -> dict[str, Parameter]:
    """Return the end value of each parameter of a fit."""
    return {p.name: p for p in result.parameters} if result else {}
