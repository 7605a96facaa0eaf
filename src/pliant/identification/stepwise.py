"""Stepwise model selection: each stage frees more parameters, and held-out recordings choose among the stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import FitError, InputError
from pliant.identification.experiment import Experiment
from pliant.identification.fit import FIT_OPTIONS, FitOptions
from pliant.identification.model_selection import DETERMINED, lead, shared_bic
from pliant.identification.result import FitResult
from pliant.identification.stage_fit import StageFitter, Step, entry_name
from pliant.identification.stages import STAGES, Entry, Stage, each_chamber, of_chambers
from pliant.model import Model
from pliant.options import with_defaults

MATERIAL = 0.05  # of the held-out error: a gain below this buys nothing
SELECTION_OPTIONS: FitOptions = {**FIT_OPTIONS, "starts": 1}


@dataclass(frozen=True, repr=False)
class ModelSelection(Shown):
    """All stages, the one that the recordings support, and why."""

    steps: tuple[Step, ...]
    chosen: str
    reason: str

    @property
    def step(self) -> Step:
        """The chosen stage."""
        (step,) = (s for s in self.steps if s.stage.name == self.chosen)
        return step

    @property
    def result(self) -> FitResult:
        """The fit of the chosen stage."""
        assert self.step.result is not None  # a stage without a fit is never chosen
        return self.step.result

    def card(self) -> Card:
        """Error, criterion and cost of every stage."""
        rows = [[
            s.stage.title + " *" * (s.stage.name == self.chosen), str(len(s.freed)), shown(s.train), shown(s.held_out),
            f"{s.bic:.0f}" if s.bic is not None else "-", f"{s.step_ns:.0f}", f"{s.seconds:.2g}",
        ] for s in self.steps]
        head = ("stage", "free", "training %", "held out %", "BIC", "ns/step", "fit s")
        refused = [f"{s.stage.title}: {s.reason}." for s in self.steps if s.reason]
        return Card("Model selection; * chosen", (self.reason, *refused), head, rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        return {
            "chosen": self.chosen, "reason": self.reason,
            "stages": {
                s.stage.name: {
                    "title": s.stage.title, "stands_on": s.stands_on, "free": list(s.freed), "train_percent": s.train,
                    "held_out_percent": s.held_out, "bic": s.bic, "fit_s": s.seconds,
                    "step_ns": s.step_ns if s.result else None, "reason": s.reason, "not_determined": s.open,
                    "as_given": list(s.given),
                } for s in self.steps
            },
        }


def select_model(
    train: Sequence[Experiment], held_out: Sequence[Experiment], model: Model, *, common: Sequence[Entry] = (),
    stages: Sequence[Stage] = STAGES, late: bool = True, progress: Callable[[str], None] | None = None,
    **options: Unpack[FitOptions],
) -> ModelSelection:
    """Fit every stage, each from where a lower one ended, and judge it on records that it has not seen.

    A stage stands on the one below it, unless that one does not pay: has a higher BIC than the stage that it stands on
    itself, or parameters that the recordings do not determine, whose standard error is more than half of their value.
    Such a one that the given model has a value for stays as given, where the stage is determined without it. The
    held-out records have no say in that; they choose at the end, among the stages that are determined.

    Parameters
    ----------
    train, held_out : sequences of Experiment
    model : Model
        As given: the lowest stage moves nothing of it but `common`. Where it has no torque law, torque_1 (of each
        chamber) is free on every stage.
    common : sequence of Parameter or str
        What every stage frees, such as the place of a marker.
    stages : sequence of Stage
    late : bool
        Whether a stage that puts finer numbers in the place of others, as `joints` does, is tried once more at the end,
        as ``NAME_late``, where it was passed over and others have been taken after it.
    step : float, s
        Longest step of the integration; default: 2e-3.
    weighting, loss, starts, rng
        As in `fit`, of each stage; of `starts` the default is 1.
    progress : callable, optional
        Called with one line for each stage.

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
    if not stages or len({r.name for r in stages}) < len(stages):
        raise InputError("a model selection needs stages whose names differ")
    free = {entry_name(e): e for e in common}
    if "torque_1" not in free and any(e.excitation != "release" for e in train):
        laws = zip(each_chamber("*.torque_1", model), model.chambers, strict=True)
        free |= {entry_name(e): e for e, c in laws if not c.torque.any() and entry_name(e) not in free}
    fitter = StageFitter(train, held_out, model, how, tuple(free))
    each = [of_chambers(r, model) for r in stages]
    return chosen(fit_stages(fitter, each, free, late=late, progress=progress or (lambda _line: None)))


def fit_stages(
    fitter: StageFitter, stages: Sequence[Stage], free: dict[str, Entry], *, late: bool,
    progress: Callable[[str], None],
) -> list[Step]:
    """All stages, fitted; then, if `late`, once more those passed over that refine others.

    Not those that add something of their own: a law of springs tried so late earned it on training records alone.
    """
    below, steps, replaced = Step(Stage("", "")), list[Step](), set[str]()

    def paid(stage: Stage) -> bool:
        nonlocal below, free
        made, taken = fitter.fit_stage(stage, below, free)
        steps.append(made)
        progress(f"stage {stage.title}: {made.reason or f'{made.error:.3g} % of travel'}")
        for failure in made.not_computed:
            progress(f"warning: {failure.sentence}")
        if not made.result or made.open or not pays(made, below):
            return False
        below, free = made, taken
        replaced.update(stage.drops)
        return True

    passed = [(stage, below.stage.name) for stage in stages if not paid(stage)]
    for stage, on in passed if late else ():
        names = {entry_name(e) for choice in stage.frees for e in choice}
        if stage.drops and on != below.stage.name and not replaced & names:
            paid(stage._replace(name=f"{stage.name}_late", title=f"{stage.title}, late"))
    return steps


def pays(step: Step, below: Step) -> bool:
    """Whether a stage has a lower BIC than the one that it stands on."""
    if below.follows is None or step.follows is None:
        return True
    mine, theirs = shared_bic([step.follows, below.follows])
    return mine < theirs


def chosen(steps: Sequence[Step]) -> ModelSelection:
    """The lowest stage that is as good as the best on held-out records, or of the lowest BIC where there are none.

    As good: its error is above the best by less than `MATERIAL` of it, or by less than one standard error of the
    difference. Stages with parameters that the recordings do not determine stand back, where there are others, and so
    do stages that cannot predict a held-out record which another stage predicts.
    """
    fitted = [s for s in steps if s.result and s.follows]
    if not fitted:
        raise FitError(f"no stage of the model selection can be fitted: {steps[0].reason}")
    bic = shared_bic([s.follows for s in fitted if s.follows])
    criteria = {s.stage.name: value for s, value in zip(fitted, bic, strict=True)}
    steps = tuple(replace(s, bic=criteria.get(s.stage.name)) for s in steps)
    able = most_predicted([s for s in fitted if not s.open] or fitted)
    if not able[0].held_out:
        enough = min(able, key=lambda s: criteria[s.stage.name])
        why = "no stage can predict a held-out record" if enough.not_computed else "no record is held out"
        reason = f"{enough.stage.title}: lowest BIC; {why}, so nothing is proved."
    else:
        best = min(able, key=lambda s: s.error)
        enough, why = next((s, why) for s in able if (why := as_good(s, best)))
        below = able[: able.index(enough)]
        said = f"{enough.stage.title}: {enough.error:.3g} % of travel on held-out records"
        said += f", against {below[-1].error:.3g} % one stage lower" if below else ""
        reason = f"{said}; {why}."
    if enough.not_computed and enough.held_out:
        reason += f" No stage can predict {', '.join(n.record for n in enough.not_computed)}."
    if enough.given:
        reason += f" The recordings do not determine {' and '.join(enough.given)}: as given."
    judged = tuple(replace(s, reason=s.reason or refusal(s, enough)) for s in steps)
    return ModelSelection(judged, enough.stage.name, reason)


def most_predicted(steps: Sequence[Step]) -> list[Step]:
    """The stages that predict the most held-out records, the same ones."""
    most = max(steps, key=lambda s: len(s.held_out or ()))
    return [s for s in steps if (s.held_out or {}).keys() == (most.held_out or {}).keys()]


def refusal(step: Step, chosen: Step) -> str:
    """Return why a fitted stage was not chosen; empty for the chosen one."""
    if step.stage.name == chosen.stage.name or not step.result:
        return ""
    if step.open:
        return f"not determined by the recordings (standard error over {100 * DETERMINED:.0f} %): {step.open}"
    if step.not_computed and (step.missed or {}).keys() != (chosen.missed or {}).keys():
        return " ".join(n.sentence for n in step.not_computed)
    if not (step.missed and chosen.missed):
        return "its BIC is higher"
    gain, error = lead(chosen.missed, step.missed)
    if gain <= 0:
        return f"it errs by {-gain:.2g} % of travel more on held-out records"
    small = (f"within that gain's standard error, {error:.2g} %" if gain <= error
             else f"less than {100 * MATERIAL:.0f} % of their error")
    return f"it gains {gain:.2g} % of travel on held-out records, {small}"


def as_good(step: Step, best: Step) -> str:
    """In which sense a stage is as good as the best on held-out records; empty where it is not."""
    if step is best:
        return "no other stage has less"
    gap, error = lead(step.missed or {}, best.missed or {})
    which = f"the least of any determined stage, {best.error:.3g} % ({best.stage.title}), is lower by less than"
    if gap <= MATERIAL * best.error:
        return f"{which} {100 * MATERIAL:.0f} % of it"
    return f"{which} the standard error of the difference, {error:.2g} %" if gap <= error else ""


def shown(errors: dict[str, float] | None) -> str:
    """Mean of some records' errors, as text."""
    return f"{np.mean(list(errors.values())):.3g}" if errors else "-"
