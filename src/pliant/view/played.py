"""Contents of the live page: a model file, or the folder of a study with its intervals and recordings."""

from __future__ import annotations

from pathlib import Path

from pliant.identification import Experiment
from pliant.model import load_model
from pliant.validation.stored import load_outcome
from pliant.view.live import Played, sliders_of


def played_from(source: Path, log: Path | None = None, touch: float = 0.0) -> Played:
    """The model in a file, or that of a study's first fit with what may be changed of it and its recordings.

    Parameters
    ----------
    source : Path
    log : Path, optional
        Of a control loop of that body, to be watched.
    touch : float
        N m, see `pliant.view.watched.Watched`.

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
    """Return a stored experiment, which is in the axes of its recording, in the base frame, where the model is."""
    return experiment.turned() if experiment.x_sign < 0 else experiment
