"""Uncertainty of gains where inputs leave the range of the training recordings.

An error of the model passes for the effect of an input that moves little in training: if all inputs together move the
body ten times as far as this one does, an error of 5 % of the motion is one of 50 % of its gain. Training recordings
do not show it. Recordings in which the input moves farther do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pliant.identification.chamber_parameters import ALIKE_GAINS
from pliant.identification.drives import pressures_at
from pliant.identification.names import path_of
from pliant.identification.prediction import compared_of
from pliant.identification.sensitivity import sensitivities

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment
    from pliant.identification.result import FitResult
    from pliant.model import Model

Array = np.ndarray
# Error of the model, as a fraction of the motion in training, that may pass for the effect of an input; set with
# benchmarks/strangers.py bands
MISTAKEN = 0.05


class InputRange(NamedTuple):
    """Least and largest value [SI] of an input in the compared frames of training, and the largest distance between
    them among all inputs in the same unit.
    """

    low: float
    high: float
    widest: float

    @property
    def doubt(self) -> float:
        """Return the standard deviation of the input's gain, as a fraction of the size of gains; 1 at most."""
        width = self.high - self.low
        return min(MISTAKEN * self.widest / width, 1.0) if width > 0 else 1.0

    def excess(self, values: Array) -> Array:
        """Return the part of the values (T,) of the input beyond this range, as a fraction of each value. Between the
        range and 0 there is none.
        """
        beyond = values - np.clip(values, min(self.low, 0.0), max(self.high, 0.0))
        return np.divide(beyond, values, out=np.zeros(len(values)), where=beyond != 0)


def beyond_inputs(
    fitted: FitResult, exp: Experiment, values: Mapping[str, float], training: Sequence[Experiment], time_step: float,
) -> Array:
    """Return the variance (T, S, k) [m^2; angles: rad^2] of a prediction at T times and S stations that is due to the
    gains of inputs beyond their range in training. It is 0 for a model with one input.

    Parameters
    ----------
    fitted : FitResult
    exp : Experiment
        The recording that is predicted.
    values : mapping
        All parameters by name, including those of `exp`.
    training : sequence of Experiment
        The training recordings.
    time_step : float
        s.
    """
    ranges = input_ranges(fitted.model, training)
    excess = {n: r.excess(np.asarray(exp.drives[n](exp.time))) for n, r in ranges.items() if n in exp.drives}
    spreads = {n: spread for n, spread in gain_spreads(fitted, ranges).items()
               if np.any(excess.get(path_of(n).owner, 0.0))}  # fmt: skip
    variance = np.zeros((exp.time.size, len(exp.stations), len(exp.axes)))
    if not spreads:
        return variance
    rows, slopes = sensitivities(fitted.model, exp, values, spreads, time_step)
    for slope, (name, spread) in zip(compared_of(exp, slopes, rows), spreads.items(), strict=True):
        variance += (spread * excess[path_of(name).owner][:, None, None] * slope) ** 2
    return variance


def gain_spreads(fitted: FitResult, ranges: Mapping[str, InputRange]) -> dict[str, float]:
    """Return the standard deviation (SI) of the free gains of inputs with some `ranges`, by parameter name: a fraction
    of the largest gain of their kind.
    """
    spreads = dict[str, float]()
    for kind in ALIKE_GAINS:
        free = {p.name: float(p.value or 0.0) for p in fitted.parameters
                if p.free and path_of(p.name).owner in ranges and path_of(p.name).own in kind}  # fmt: skip
        sizes = [np.linalg.norm([v for n, v in free.items() if path_of(n).owner == owner]) for owner in ranges]
        spreads |= {n: float(max(sizes)) * ranges[path_of(n).owner].doubt for n in free}
    return {n: spread for n, spread in spreads.items() if spread > 0}


def input_ranges(model: Model, training: Sequence[Experiment]) -> dict[str, InputRange]:
    """Return the range in training of each input of a model with several, by name; {} if none was recorded."""
    names, units = model.actuation.names, np.array(model.actuation.units)
    driven = [e for e in training if e.drives]
    if len(names) < 2 or not driven:
        return {}
    compared = np.concatenate([np.isfinite(e.compared).any(axis=(1, 2)) for e in driven])
    values = pressures_at(model, driven)[compared]
    low, high = values.min(axis=0), values.max(axis=0)
    widest = {unit: float((high - low)[units == unit].max()) for unit in units}
    return {n: InputRange(float(a), float(b), widest[unit]) for n, unit, a, b in zip(names, units, low, high,
                                                                                     strict=True)}  # fmt: skip
