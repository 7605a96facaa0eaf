"""Measured and modelled motion of a study's recordings as plain arrays, for exports."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.validation.outcome import FitOutcome, RecordOutcome, StudyOutcome

Array = np.ndarray


class Side(NamedTuple):
    """The measured and modelled motion of one recording.

    Attributes
    ----------
    name : str
    role : str
        "train" or "held_out".
    time : array (T,)
        s.
    measured, modelled : array (T, S, D)
        Points [m] with D = 2 or 3, or angles [rad] with D = 1. NaN if a point was not measured.
    inputs : array (T, C)
        Recorded inputs, or fitted ones if only the level was known, in the units of the model's inputs.
    body : array (T, n + 2, D) or None
        Base, first joint and link tips of the model [m].
    """

    name: str
    role: str
    time: Array
    measured: Array
    modelled: Array
    inputs: Array
    body: Array | None


class Sides(NamedTuple):
    """Recordings with the same stations and inputs, with the motion that one fit predicts for each.

    Attributes
    ----------
    study, title, fit : str
    stations : tuple of str
    axes : tuple of str
        ("x", "y"), ("x", "y", "z") or ("angle",); for a further variable without positions the names of its kinds of
        rows, see `equations.observation.KINDS`.
    inputs, units : tuple of str
        Names and SI units of the model's inputs.
    sides : tuple of Side
        Training recordings first.
    """

    study: str
    title: str
    fit: str
    stations: tuple[str, ...]
    axes: tuple[str, ...]
    inputs: tuple[str, ...]
    units: tuple[str, ...]
    sides: tuple[Side, ...]

    @property
    def turns(self) -> bool:
        """Return whether the recordings have no positions."""
        return self.axes[0] not in tuple("xyz")


def sides_of(outcome: StudyOutcome, fit: str = "", records: Sequence[str] = ()) -> Sides:
    """Return the recordings of a fit with the motion that it predicts for them, training recordings first.

    Raises
    ------
    InputError
        When the fit or a recording is unknown, or the recordings have different stations.
    """
    chosen = fit_named(outcome.fits, fit)
    known = {r.name: r for r in chosen.records}
    if strange := [r for r in records if r not in known]:
        raise InputError(f"fit {chosen.name!r} has no recording {strange[0]!r}: choose from "
                         f"{', '.join(known) or 'none'}")
    wanted = [known[r] for r in records] if records else list(known.values())
    if not wanted:
        raise InputError(f"fit {chosen.name!r} has no recording whose motion could be computed: choose another fit")
    first = wanted[0].experiment
    for r in wanted:
        if r.experiment.stations != first.stations:
            raise InputError(
                f"{r.name} has the stations {', '.join(r.experiment.stations)}, {first.name} has "
                f"{', '.join(first.stations)}: export recordings of the same stations (records=...)"
            )
    actuation = chosen.result.model.actuation
    ordered = sorted(wanted, key=lambda r: r.role != "train")
    return Sides(outcome.name, outcome.title, chosen.title, first.stations, first.axes, actuation.names,
                 actuation.units, tuple(side_of(r, actuation.names) for r in ordered))


def fit_named(fits: Sequence[FitOutcome], name: str) -> FitOutcome:
    """Return the fit with this name, or the first one for an empty name."""
    for f in fits:
        if name in ("", f.name):
            return f
    raise InputError(f"these results have no fit {name!r}: choose from {', '.join(f.name for f in fits)}")


def side_of(record: RecordOutcome, inputs: Sequence[str]) -> Side:
    """Return the measured and modelled motion of one recording with its recorded inputs. If none were recorded, the
    inputs are those of the fit.
    """
    exp = record.experiment
    values = np.array(record.pressure, dtype=float).reshape(exp.time.size, -1)
    if exp.drives:
        values = np.zeros_like(values)
        for name, trace in exp.drives.items():
            values[:, inputs.index(name)] = trace(exp.time)
    elif exp.pressure is not None:
        values = np.asarray(exp.pressure(exp.time), dtype=float).reshape(exp.time.size, -1)
    return Side(exp.name, record.role, exp.time, exp.compared if exp.without_positions else exp.position,
                record.modelled, values, record.body)
