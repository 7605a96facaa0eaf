"""Studies of recordings that hold angles and no positions: how many links they support, and what they leave unknown."""

from __future__ import annotations

from collections.abc import Mapping

from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.validation.outcome import StudyOutcome
from pliant.validation.wording import NO_PLACES

NOT_TOLD = (
    "Angles do not determine the mass (which sets the scale of stiffness, damping and torque), the distribution of the "
    "stiffness along the body, or positions: forces and positions of the model depend on the stated mass and length."
)


def supported_links(experiments: Mapping[str, Experiment]) -> int | None:
    """Return the number of links that angles support, one for each angle; None if positions were recorded.

    Raises
    ------
    InputError
        When some recordings hold positions and others do not.
    """
    kinds = {name: e.without_positions for name, e in experiments.items()}
    if len(set(kinds.values())) > 1:
        bare = [name for name, without_positions in kinds.items() if without_positions]
        raise InputError(f"recording {bare[0]} holds angles and no positions, but others hold positions: use "
                         "recordings of one kind in a study")  # fmt: skip
    if not all(kinds.values()):
        return None
    return max(len(e.stations) for e in experiments.values())


def told_of_angles(outcome: StudyOutcome) -> list[str]:
    """Return the report's sentences on recordings that hold angles alone; empty if positions were recorded."""
    if not outcome.turns:
        return []
    angles = max(len(r.experiment.stations) for f in outcome.fits for r in f.records)
    links = outcome.model.n
    supports = f"{angles} angles support {angles} links" if angles > 1 else "One angle supports one link"
    has = "as many as the chain has" if links == angles else f"the chain has {links}, as stated"
    if links > angles:
        has += ": their motion between the angles is not measured"
    return [NO_PLACES, f"{supports}, {has}.", NOT_TOLD]
