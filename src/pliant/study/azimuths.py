"""Azimuths of tendons that a study does not state, estimated from the motion of the tip when each tendon is pulled."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.study.schema import ActuatorEntry, Study

Array = np.ndarray
LEAST_DRAWN = 1e-6  # of the inputs' largest singular value: below it, two tendons were always pulled together


def training(study: Study) -> list[str]:
    """Return the names of the study's training recordings, without duplicates, in order."""
    names = [name for entry in study.fits.values() for name in entry.train]
    names += study.model_selection.train if study.model_selection else []
    return list(dict.fromkeys(names))


def with_azimuths(
    study: Study, experiments: Mapping[str, Experiment], tell: Callable[[str], None],
) -> ActuatorEntry:
    """Return the study's actuator with every missing `azimuth_deg` estimated from the training recordings.

    A tendon bends the body towards itself. The motion of the tip across the base tangent is modelled as a sum of one
    motion for each tendon, proportional to its input, by least squares over the training recordings. The direction of
    each motion is the azimuth of the tendon. Fits of gain_x and gain_y start from these azimuths.

    Raises
    ------
    InputError
        When the recordings do not determine the motion of each tendon, since some were always pulled together.
    """
    tendons = study.actuator.tendons
    unknown = [t.name for t in tendons if t.azimuth_deg is None]
    if not unknown:
        return study.actuator
    names = [t.name for t in tendons]
    moves = tip_moves([experiments[n] for n in training(study) if n in experiments], names)
    degrees = dict(zip(names, np.degrees(np.arctan2(moves[:, 1], moves[:, 0])) % 360.0, strict=True))
    tell("estimated azimuths: " + ", ".join(f"{name} {degrees[name]:.0f} deg" for name in unknown))
    stated = [
        t.model_copy(update={"azimuth_deg": float(degrees[t.name])}) if t.name in unknown else t for t in tendons
    ]
    return study.actuator.model_copy(update={"tendons": stated})


def tip_moves(experiments: Sequence[Experiment], names: Sequence[str]) -> Array:
    """Return the motion of the last station across the base tangent for a unit of each input (C, 2) [m], by least
    squares.
    """
    inputs, moves = [], []
    for exp in experiments:
        tip = exp.last_station[:, :2]
        seen = np.isfinite(tip).all(axis=1)
        drawn = np.stack([exp.drives[n](exp.time) if n in exp.drives else 0.0 * exp.time for n in names], axis=1)
        inputs.append(drawn[seen] - drawn[seen].mean(axis=0))
        moves.append(tip[seen] - tip[seen].mean(axis=0))
    drawn = np.concatenate(inputs) if inputs else np.zeros((0, len(names)))
    found, _, rank, _ = np.linalg.lstsq(drawn, np.concatenate(moves or [np.zeros((0, 2))]), rcond=LEAST_DRAWN)
    if rank < len(names):
        raise InputError(
            f"the azimuths of the tendons {', '.join(names)} cannot be estimated, since no training recordings pull "
            "each of them separately: state azimuth_deg of each"
        )
    return np.asarray(found)
