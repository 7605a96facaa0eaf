"""Design of the next recording for a study: fit its model, then rank the recordings that would add most information."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pliant.identification.design import Design, design
from pliant.study.fits import run_fit, run_model_selection, selection_fit
from pliant.study.prepare import without
from pliant.study.run import prepare_all
from pliant.study.schema import Study


def design_study(
    study: Study, *, highest: float | Mapping[str, float] | None = None, criterion: str = "E",
    progress: Callable[[str], None] | None = None,
) -> Design:
    """Fit a study's model and rank candidate recordings by how much each would reduce the uncertainty of the
    parameters.

    Parameters
    ----------
    study : Study
    highest : float or mapping, optional
    criterion : {"E", "D"}
        As in `pliant.identification.design.design`.

    Raises
    ------
    InputError, FitError
        As `run_study`.
    """
    notify = progress or (lambda _line: None)
    ready = prepare_all(study, notify)
    study = without(study, ready.dropped)
    model = ready.model
    selection = run_model_selection(study, ready.experiments, model, notify)
    if selection is not None:
        fitted = selection_fit(study, selection, ready.experiments, notify)
    else:
        name = next(iter(study.fits))
        fitted = run_fit(study, name, ready.experiments, model, notify, {})
    train = [r.experiment for r in fitted.records if r.role == "train"]
    return design(fitted.result, train, highest=highest, criterion=criterion)
