"""Recordings that hold angles and no places: how many links they support, and what they cannot tell."""

from __future__ import annotations

from collections.abc import Mapping

from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.validation.outcome import StudyOutcome
from pliant.validation.wording import NO_PLACES

NOT_TOLD = (
    "Angles do not tell the mass (it sets the scale of stiffness, damping and torque), how the stiffness is spread "
    "along the body, or where its points are: forces and places that the model gives rest on stated mass and length."
)


def supported_links(experiments: Mapping[str, Experiment]) -> int | None:
    """Links that angles without places support, one for each; None where places were recorded.

    Raises
    ------
    InputError
        When some recordings hold places and others do not.
    """
    kinds = {name: e.without_positions for name, e in experiments.items()}
    if len(set(kinds.values())) > 1:
        bare = [name for name, without_positions in kinds.items() if without_positions]
        raise InputError(f"recording {bare[0]} holds angles and no places, others hold places: a study compares one of "
                         "them")  # fmt: skip
    if not all(kinds.values()):
        return None
    return max(len(e.stations) for e in experiments.values())


def told_of_angles(outcome: StudyOutcome) -> list[str]:
    """Return the verdict's sentences on recordings of angles alone; none where positions were recorded."""
    if not outcome.turns:
        return []
    angles = max(len(r.experiment.stations) for f in outcome.fits for r in f.records)
    links = outcome.model.n
    supports = f"{angles} angles support {angles} links" if angles > 1 else "One angle supports one link"
    has = "as many as the chain has" if links == angles else f"the chain has {links}, as stated"
    if links > angles:
        has += ": what they do between the angles is not seen"
    return [NO_PLACES, f"{supports}, {has}.", NOT_TOLD]
