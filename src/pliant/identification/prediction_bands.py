"""From the uncertainty of parameters to that of predictions: bands by the delta method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.identification.discrepancy import discrepancy, speed
from pliant.identification.experiment import Experiment, farthest
from pliant.identification.fit import predict_held_out
from pliant.identification.prediction import compared_of, predict
from pliant.identification.result import FitResult
from pliant.identification.sensitivity import sensitivities
from pliant.identification.uncertainty import HIDDEN

Array = np.ndarray
LEAST = 0.1  # of the mean squared residual: what is left of it anywhere


@dataclass(frozen=True, repr=False)
class Band(Shown):
    """A prediction with its band.

    Attributes
    ----------
    position, std, lower, upper : array (T, S, 2)
        Predicted coordinates, their standard error, and the limits of the band, m; (T, S, 1), rad, of angles alone.
    unit, factor : str, float
        In which a reader reads them, and how many of it make one SI unit.
    level : float
        Share of cases in which the band holds each coordinate.
    """

    position: Array
    std: Array
    lower: Array
    upper: Array
    level: float
    unit: str = "mm"
    factor: float = 1e3

    def holds(self, position: Array) -> float:
        """Share of the numbers of `position`, shaped as the band, that lie within; what was not seen does not count."""
        seen = np.isfinite(position)
        return float(((self.lower <= position) & (position <= self.upper))[seen].mean())

    def card(self) -> Card:
        """Return a summary of the band's width."""
        half = 0.5 * self.factor * (self.upper - self.lower)
        frames, stations = self.position.shape[:2]
        median, most = (f"{v:.3g} {self.unit}" for v in (np.nanmedian(half), np.nanmax(half)))
        wide = f"half its width is {median} (median), {most} at most"
        return Card(f"Band of {100 * self.level:g} % about {frames} frames of {stations} station(s): {wide}")


def prediction_band(
    experiment: Experiment, fitted: FitResult, *, step: float = 2e-3, level: float = 0.95,
    noise: float | Array = 0.0, own: FitResult | None = None, training: Sequence[Experiment] = (),
) -> Band:
    """The prediction of an experiment with the band that the fit's covariance gives it (delta method).

    What is the experiment's own (edge times) is fitted to it, and takes up of the shared parameters' errors what it
    can.

    Parameters
    ----------
    experiment : Experiment
        Recorded or planned, one that the fit has not seen.
    fitted : FitResult
    step : float
        Longest step of the integration, s.
    level : float
        Share of cases in which the band shall hold each coordinate.
    noise : float or array (T, S, 2 or 1)
        Standard deviation of the measurement, m, for a band that holds the measured points; 0: the motion itself.
        `residual_noise` takes it from the training records.
    own : FitResult, optional
        The fit of what is the experiment's own, from `predict_held_out`, where it is there already.
    training : sequence of Experiment, optional
        What the fit learned from: the band then grows where pressure or speed leave what they showed; see
        `discrepancy`.

    Returns
    -------
    Band
        Arrays of shape (T, S, 2), m; (T, S, 1), rad, of angles alone.

    Raises
    ------
    InputError
        When the fit has no covariance, or the level is not between 0 and 1.
    """
    if fitted.covariance is None:
        raise InputError("a prediction band needs a fit with free parameters: this one has no covariance")
    if not 0 < level < 1:
        raise InputError(f"the level of a band lies between 0 and 1, got {level}")
    own = own or predict_held_out(experiment, fitted, step=step)[1]
    shared = [k for k, n in enumerate(fitted.covariance.names) if "." not in n or n.partition(".")[0] not in
              {e.partition(".")[0] for e in fitted.rmse}]
    names = [fitted.covariance.names[k] for k in shared] + list(experiment.own_parameters)
    scale = {p.name: p.scale for p in own.parameters}
    sizes = {n: scale[n] or max(abs(own.values[n]), 1e-6) for n in names}
    rows, slopes = sensitivities(own.model, experiment, own.values, sizes, step)
    rows = compared_of(experiment, rows)
    scaled = compared_of(experiment, slopes) * np.array(list(sizes.values()))[:, None, None, None]
    theirs, mine = scaled[: len(shared)], scaled[len(shared) :]
    if len(mine):
        seen = np.isfinite(experiment.compared)
        taken = np.linalg.lstsq(mine[:, seen].T, theirs[:, seen].T, rcond=HIDDEN)[0]
        theirs = theirs - np.tensordot(taken.T, mine, axes=1)
    unit = np.array([sizes[n] for n in names[: len(shared)]])
    relative = fitted.covariance.matrix[np.ix_(shared, shared)] / np.outer(unit, unit)
    variance = np.einsum("itsc,ij,jtsc->tsc", theirs, relative, theirs)
    variance = np.maximum(variance, 0.0) + noise**2
    if training:
        pressure = predict(own.model, experiment, own.values, step)["pressure"]
        variance += discrepancy(own.model, experiment, own.values, rows, pressure, training) ** 2
    std = np.sqrt(variance)
    half = NormalDist().inv_cdf(0.5 + 0.5 * level) * std
    return Band(rows, std, rows - half, rows + half, level, *experiment.shown_in)


def residual_noise(
    train: Sequence[Experiment], fitted: FitResult, experiment: Experiment, modelled: Array, *, step: float = 2e-3,
    weighting: str = "travel",
) -> Array:
    """Standard deviation (T, S, 2 or 1) of what the model leaves of a record, m, as the training records have it.

    Squared residuals of each coordinate are a constant, a part with the square of the tip's way from where it began and
    one with the square of its speed, none negative: a model errs otherwise where a body rests, is held, and moves.

    With the weighting by travel, residuals and ways are taken in shares of each record's travel, and come back as
    shares of the `modelled` (T, S, ...) travel of the experiment. A station that no training record sees gets the mean
    of all.
    """
    shares, left = weighting == "travel", dict[str, list[tuple[Array, Array]]]()
    for exp in train:
        rows, unit = predict(fitted.model, exp, fitted.values, step)["compared"], exp.travel if shares else 1.0
        square = ((rows - exp.compared) / unit) ** 2
        traits = motion_traits(exp.time, rows, unit, settled=exp.poses)
        for k, name in enumerate(exp.stations):
            if np.isfinite(square[:, k]).any(axis=0).all():
                left.setdefault(name, []).append((traits, square[:, k]))
    path = modelled[:, -1]
    way = farthest(path, poses=True) if experiment.poses else float(np.linalg.norm(path - path[0], axis=1).max())
    unit = max(way, 1e-12) if shares else 1.0
    own = motion_traits(experiment.time, modelled, unit, settled=experiment.poses)
    made = {name: variance_by(own, *map(np.concatenate, zip(*parts, strict=True))) for name, parts in left.items()}
    usual: Array = np.mean(list(made.values()), axis=0)
    return np.asarray(unit * np.sqrt(np.stack([made.get(n, usual) for n in experiment.stations], axis=1)))


def motion_traits(time: Array, rows: Array, unit: float, *, settled: bool = False) -> Array:
    """Columns (T, 3) of a motion `rows` (T, S, ...): 1, the tip's way from its start and its speed, both squared.

    Rows that are settled poses have no speed.
    """
    path = rows[:, -1] / unit
    fast = speed(time, path, settled=settled)
    return np.stack([np.ones(time.size), np.sum((path - path[0]) ** 2, axis=1), fast**2], axis=1)


def variance_by(own: Array, traits: Array, square: Array) -> Array:
    """Expected squares (T, C) of a motion of traits `own` (T, 3), after those (M, C) of motions of `traits` (M, 3)."""
    from scipy.optimize import nnls

    size = np.sqrt(np.mean(traits**2, axis=0)) + 1e-300
    columns = []
    for column in square.T:
        seen = np.isfinite(column)
        parts = nnls(traits[seen] / size, column[seen])[0]
        columns.append(np.maximum(own / size @ parts, LEAST * column[seen].mean()))
    return np.stack(columns, axis=1)
