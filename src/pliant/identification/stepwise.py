"""Stepwise model selection: each stage frees more parameters, and one is chosen by held-out errors or by its BIC."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Unpack

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import FitError, InputError
from pliant.identification.chamber_parameters import has_effect
from pliant.identification.experiment import Experiment
from pliant.identification.fit import FIT_OPTIONS, FitOptions
from pliant.identification.fit_step import starting_step
from pliant.identification.model_selection import DETERMINED, lead, shared_bic
from pliant.identification.result import FitResult
from pliant.identification.stage_fit import StageFitter, StageResult, entry_name
from pliant.identification.stages import STAGES, Entry, Stage, each_chamber, of_chambers
from pliant.model import Model
from pliant.options import with_defaults

ChooseBy = Literal["held_out", "training"]
MATERIAL = 0.05  # of the held-out error: a smaller gain does not justify another stage
SELECTION_OPTIONS: FitOptions = {**FIT_OPTIONS, "starts": 1}


@dataclass(frozen=True, repr=False)
class ModelSelection(Shown):
    """Result of `select_model`: all stages, the name of the chosen stage, and the reason for the choice."""

    stages: tuple[StageResult, ...]
    chosen: str
    reason: str

    @property
    def chosen_stage(self) -> StageResult:
        """Return the result of the chosen stage."""
        (chosen,) = (s for s in self.stages if s.stage.name == self.chosen)
        return chosen

    @property
    def result(self) -> FitResult:
        """Return the fit of the chosen stage."""
        assert self.chosen_stage.result is not None  # a stage without a fit is never chosen
        return self.chosen_stage.result

    def card(self) -> Card:
        """Return a display card: table of the error, BIC and cost of every stage."""
        rows = [[
            s.stage.title + " *" * (s.stage.name == self.chosen), str(len(s.freed)), shown(s.train), shown(s.held_out),
            f"{s.bic:.0f}" if s.bic is not None else "-", f"{s.step_ns:.0f}", f"{s.seconds:.2g}",
        ] for s in self.stages]
        head = ("stage", "free", "training %", "held out %", "BIC", "ns/step", "fit s")
        refused = [f"{s.stage.title}: {s.reason}." for s in self.stages if s.reason]
        return Card("Model selection; * chosen", (self.reason, *refused), head, rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the model selection as a dictionary of plain numbers and strings for JSON."""
        return {
            "chosen": self.chosen, "reason": self.reason,
            "stages": {
                s.stage.name: {
                    "title": s.stage.title, "stands_on": s.stands_on, "free": list(s.freed), "train_percent": s.train,
                    "held_out_percent": s.held_out, "bic": s.bic, "fit_s": s.seconds,
                    "step_ns": s.step_ns if s.result else None, "reason": s.reason, "not_determined": s.open,
                    "as_given": list(s.given),
                } for s in self.stages
            },
        }


def select_model(
    train: Sequence[Experiment], held_out: Sequence[Experiment], model: Model, *, common: Sequence[Entry] = (),
    stages: Sequence[Stage] = STAGES, choose_by: ChooseBy = "held_out", late: bool = True,
    progress: Callable[[str], None] | None = None, **options: Unpack[FitOptions],
) -> ModelSelection:
    """Fit models of increasing complexity, and choose the simplest that predicts held-out recordings as well as the
    best.

    Each stage frees further parameters and starts where a lower stage ended. A stage is passed over, and the next one
    does not build on it, if its BIC is higher than that of the stage on which it builds, or if the recordings do not
    determine its parameters (standard error above half of the value). A parameter that is not determined keeps the
    value of the given model, if it has one and the stage is determined without that parameter. The held-out recordings
    are not used in this; they choose at the end, among the determined stages.

    Parameters
    ----------
    train, held_out : sequences of Experiment
        Training recordings, and recordings that no stage is fitted to.
    model : Model
        The given model: the lowest stage fits nothing of it but `common`. If it has no torque law, torque_1 (of each
        chamber) is free on every stage.
    common : sequence of Parameter or str
        Parameters that are free on every stage, such as the position of a marker.
    stages : sequence of Stage
    choose_by : {"held_out", "training"}
        "training": the determined stage with the lowest BIC of the training recordings is chosen. The held-out
        recordings then judge a model that they did not choose.
    late : bool
        Whether a stage that replaces parameters by finer ones, as `joints` does, is tried again at the end, as
        ``NAME_late``, if it was passed over and later stages were accepted.
    time_step : float, s
        Longest time step of all stages; default: that of a fit of the first stage.
    weighting, loss, starts, rng
        As in `fit`, for each stage; the default of `starts` is 1.
    progress : callable, optional
        Called with one line of text for each stage.

    Returns
    -------
    ModelSelection

    Raises
    ------
    FitError
        When no stage can be fitted.
    InputError
        As `fit`.
    TypeError
        For an unknown keyword.
    """
    how = with_defaults(select_model, options, SELECTION_OPTIONS)
    if not stages:
        raise InputError("a model selection needs at least one stage: add one to stages")
    if len({r.name for r in stages}) < len(stages):
        raise InputError(f"a model selection needs stages whose names differ, got {', '.join(r.name for r in stages)}: "
                         "rename one")  # fmt: skip
    free = {entry_name(e): e for e in common}
    if "torque_1" not in free and any(e.excitation != "release" for e in train):
        pressed = [c for c in model.chambers if has_effect("torque_1", c)]
        laws = zip(each_chamber("*.torque_1", model), pressed, strict=True)
        free |= {entry_name(e): e for e, c in laws if not c.torque.any() and entry_name(e) not in free}
    each = [of_chambers(r, model) for r in stages]
    first = {**free, **{entry_name(e): e for choice in each[0].frees[:1] for e in choice}}
    how["time_step"] = how["time_step"] or starting_step(train, model, list(first.values()))
    fitter = StageFitter(train, held_out, model, how, tuple(free))
    results = fit_stages(fitter, each, free, late=late, progress=progress or (lambda _line: None))
    return chosen(results, choose_by)


def fit_stages(
    fitter: StageFitter, stages: Sequence[Stage], free: dict[str, Entry], *, late: bool,
    progress: Callable[[str], None],
) -> list[StageResult]:
    """Fit all stages of a model selection in order. With `late`, a stage that replaces parameters but was no
    improvement is tried again at the end, on top of the stages that succeeded after it.

    Stages that add new parameters are not tried again: a spring law tried that late improved training recordings only.
    """
    below, results, replaced = StageResult(Stage("", "")), list[StageResult](), set[str]()

    def paid(stage: Stage) -> bool:
        nonlocal below, free
        added, taken = fitter.fit_stage(stage, below, free)
        results.append(added)
        progress(f"stage {stage.title}: {added.reason or f'{added.error:.3g} % of travel'}")
        for failure in added.not_computed:
            progress(f"warning: {failure.sentence}")
        if not added.result or added.open or not pays(added, below):
            return False
        below, free = added, taken
        replaced.update(stage.drops)
        return True

    passed = [(stage, below.stage.name) for stage in stages if not paid(stage)]
    for stage, on in passed if late else ():
        names = {entry_name(e) for choice in stage.frees for e in choice}
        if stage.drops and on != below.stage.name and not replaced & names:
            paid(stage._replace(name=f"{stage.name}_late", title=f"{stage.title}, late"))
    return results


def pays(this: StageResult, below: StageResult) -> bool:
    """Return whether a stage of a model selection has a lower BIC than the stage below, to which it adds parameters."""
    if below.follows is None or this.follows is None:
        return True
    mine, theirs = shared_bic([this.follows, below.follows])
    return mine < theirs


def chosen(results: Sequence[StageResult], by: ChooseBy = "held_out") -> ModelSelection:
    """Choose the lowest stage as good as the best on held-out recordings; without any, or by "training", the stage of
    lowest BIC.

    "As good" means that its error exceeds the best by less than 5 % of it (`MATERIAL`), or by less than one standard
    error of the difference. Stages with undetermined parameters, and stages that cannot predict a held-out recording
    which another stage predicts, are chosen only if there is no other.
    """
    fitted = [s for s in results if s.result and s.follows]
    if not fitted:
        raise FitError(f"no stage of the model selection can be fitted: {results[0].reason}")
    bic = shared_bic([s.follows for s in fitted if s.follows])
    criteria = {s.stage.name: value for s, value in zip(fitted, bic, strict=True)}
    results = tuple(replace(s, bic=criteria.get(s.stage.name)) for s in results)
    determined = [s for s in fitted if not s.open] or fitted
    able = most_predicted(determined)
    if by == "training":
        enough = min(determined, key=lambda s: criteria[s.stage.name])
        reason = f"{enough.stage.title}: lowest BIC of the training recordings; held-out recordings had no part in it."
    elif not able[0].held_out:
        enough = min(able, key=lambda s: criteria[s.stage.name])
        why = "no stage can predict a held-out recording" if enough.not_computed else "no recording is held out"
        reason = f"{enough.stage.title}: lowest BIC; {why}, so the choice is not validated."
    else:
        best = min(able, key=lambda s: s.error)
        enough, why = next((s, why) for s in able if (why := as_good(s, best)))
        below = able[: able.index(enough)]
        said = f"{enough.stage.title}: error {enough.error:.3g} % of travel on held-out recordings"
        said += f", against {below[-1].error:.3g} % one stage lower" if below else ""
        reason = f"{said}; {why}."
    if enough.not_computed and enough.held_out and by == "held_out":
        reason += f" No stage can predict {', '.join(n.record for n in enough.not_computed)}."
    if enough.given:
        reason += f" The recordings do not determine {' and '.join(enough.given)}: held at the given model's values."
    judged = tuple(replace(s, reason=s.reason or refusal(s, enough, by)) for s in results)
    return ModelSelection(judged, enough.stage.name, reason)


def most_predicted(results: Sequence[StageResult]) -> list[StageResult]:
    """Return those stages of a model selection that predict the largest set of held-out recordings."""
    most = max(results, key=lambda s: len(s.held_out or ()))
    return [s for s in results if (s.held_out or {}).keys() == (most.held_out or {}).keys()]


def refusal(this: StageResult, chosen: StageResult, by: ChooseBy) -> str:
    """Return the reason why a fitted stage was not chosen, as text; '' for the chosen stage."""
    if this.stage.name == chosen.stage.name or not this.result:
        return ""
    if this.open:
        return f"not determined by the recordings (standard error over {100 * DETERMINED:.0f} %): {this.open}"
    if by == "held_out" and this.not_computed and (this.missed or {}).keys() != (chosen.missed or {}).keys():
        return " ".join(n.sentence for n in this.not_computed)
    if by == "training" or not (this.missed and chosen.missed):
        return "its BIC is higher"
    gain, error = lead(chosen.missed, this.missed)
    if gain <= 0:
        return f"its error on held-out recordings is {-gain:.2g} % of travel higher"
    small = (f"within the standard error of that difference, {error:.2g} %" if gain <= error
             else f"less than {100 * MATERIAL:.0f} % of their error")
    return f"its error on held-out recordings is {gain:.2g} % of travel lower, {small}"


def as_good(this: StageResult, best: StageResult) -> str:
    """Return as text in which sense a stage is as good as the best on held-out recordings; '' if it is worse."""
    if this is best:
        return "no other stage has a lower error"
    gap, error = lead(this.missed or {}, best.missed or {})
    which = f"the least of any determined stage, {best.error:.3g} % ({best.stage.title}), is lower by less than"
    if gap <= MATERIAL * best.error:
        return f"{which} {100 * MATERIAL:.0f} % of it"
    return f"{which} the standard error of the difference, {error:.2g} %" if gap <= error else ""


def shown(errors: dict[str, float] | None) -> str:
    """Return the mean of the errors [%] as text with three digits; "-" if there are none."""
    return f"{np.mean(list(errors.values())):.3g}" if errors else "-"
