"""Loading of the live page's content: a model file, or the results of a study with intervals and recordings."""

from __future__ import annotations

from pathlib import Path

from pliant.identification import Experiment
from pliant.model import load_model
from pliant.validation.stored import load_outcome
from pliant.view.live import Played, sliders_of


def played_from(source: Path, log: Path | None = None, touch: float = 0.0) -> Played:
    """Return the content of the live page for a model file or a results folder.

    For a folder it is the model of the first fit, with sliders for its parameters and its recordings.

    Parameters
    ----------
    source : Path
        Model file, or folder written by `pliant run`.
    log : Path, optional
        log.csv of a control loop of the same body, to be watched.
    touch : float
        Unexplained joint torque [N m] above which a touch is shown; see `pliant.view.watched.WatchedLoop`.

    Raises
    ------
    InputError
        When the file or folder cannot be read.
    """
    if not source.is_dir():
        model = load_model(source)
        return Played(model, sliders_of(model), {}, log=log, touch=touch)
    outcome = load_outcome(source)
    first = outcome.fits[0]
    recordings = {r.name: in_base_frame(r.experiment) for r in first.records}
    return Played(outcome.model, sliders_of(outcome.model, first.result.parameters), recordings,
                  first.result.values.get("start", 0.0), log, touch)


def in_base_frame(experiment: Experiment) -> Experiment:
    """Return a stored experiment, which is in the axes of its recording, in the base frame of the model."""
    return experiment.turned() if experiment.x_sign < 0 else experiment
