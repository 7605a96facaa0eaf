"""Prediction intervals of motions and of other quantities computed from fitted parameters (delta method)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.failures import FAILED
from pliant.identification.beyond_inputs import beyond_inputs
from pliant.identification.discrepancy import discrepancy, speed
from pliant.identification.experiment import FIRST_FRAMES, Experiment, farthest
from pliant.identification.fit import predict_held_out
from pliant.identification.prediction import compared_of, predict
from pliant.identification.result import FitResult
from pliant.identification.sensitivity import sensitivities
from pliant.identification.uncertainty import FEWEST, HIDDEN
from pliant.shapes import Float

Array = np.ndarray
LEAST_SQUARE = 0.1  # of the mean squared residual: least expected square at any time
REACH = (1.5, 3.0)  # standard deviations, least and most, for 95 % of the residuals
TRIAL_GAIN = 0.02  # standard deviation of a gain from trial to trial, which fewer than three recordings do not show
# rad, standard deviation of the turn of a whole shape about its base from trial to trial, which fewer than three
# recordings do not show either: the rest of the virtual laboratories' fibres varies by .35 % of length at the tip
TRIAL_TURN = 4e-3
OF_MEDIAN = 0.5 * np.pi  # variance of the median of normal values over that of their mean
AT_REST = 3  # independent values in the errors at rest of one recording, by all stations
LEAST_VARIANCE = 1e-6  # of the largest variance of scaled parameters: smaller ones are neglected


@dataclass(frozen=True, repr=False)
class Band(Shown):
    """A predicted motion with the prediction interval ("band") of each of its coordinates.

    Attributes
    ----------
    position, std, lower, upper : array (T, S, 2)
        Predicted coordinates, their standard error, and the limits of the band, m; (T, S, 1), rad, for angles only.
    unit, factor : str, float
        Unit for display, and the factor to it from the SI unit.
    level : float
        Probability that the band contains a coordinate.
    """

    position: Float[Array, "T S k"]
    std: Float[Array, "T S k"]
    lower: Float[Array, "T S k"]
    upper: Float[Array, "T S k"]
    level: float
    unit: str = "mm"
    factor: float = 1e3

    def holds(self, position: Float[Array, "T S k"]) -> float:
        """Return the fraction of the observed values in `position` that lie within the prediction interval."""
        measured = np.isfinite(position)
        return float(((self.lower <= position) & (position <= self.upper))[measured].mean())

    def widened(self, spread: Float[Array, "T S k"]) -> Band:
        """Return the band with an additional standard deviation `spread` [m; rad], independent of the others."""
        half = np.hypot(0.5 * (self.upper - self.lower), NormalDist().inv_cdf(0.5 + 0.5 * self.level) * spread)
        return replace(self, std=np.hypot(self.std, spread), lower=self.position - half, upper=self.position + half)

    def card(self) -> Card:
        """Return a display card: the level of the prediction interval, and its median and largest half-width."""
        half = 0.5 * self.factor * (self.upper - self.lower)
        frames, stations = self.position.shape[:2]
        median, most = (f"{v:.3g} {self.unit}" for v in (np.nanmedian(half), np.nanmax(half)))
        wide = f"half-width {median} (median), {most} at most"
        return Card(f"Band of {100 * self.level:g} % about {frames} frames of {stations} station(s): {wide}")


def prediction_band(
    experiment: Experiment, fitted: FitResult, *, time_step: float | None = None, level: float = 0.95,
    noise: float | Float[Array, "T S k"] = 0.0, own: FitResult | None = None, training: Sequence[Experiment] = (),
    reach: float | None = None,
) -> Band:
    """Predict the motion of an experiment, with a prediction interval from the covariance of the fit.

    `TrainingResiduals.band` has the interval of a new recording, with the errors of the training recordings at rest.

    The interval follows by the delta method. The experiment's own parameters (edge times) are fitted to it, which
    compensates for part of the errors of the shared parameters.

    Parameters
    ----------
    experiment : Experiment
        A recording that was not used in the fit, or a planned one.
    fitted : FitResult
    time_step : float, optional
        Longest time step, s; default: that of the fit.
    level : float
        Probability that the band contains a coordinate.
    noise : float or array (T, S, 2 or 1)
        Standard deviation of the measurement, m, for a band that contains the measured points. 0: a band for the true
        motion. `residual_noise` estimates it from the training recordings.
    own : FitResult, optional
        The fit of the experiment's own parameters from `predict_held_out`, if it exists already.
    training : sequence of Experiment, optional
        The training recordings. If given, the band grows where pressure or speed leave their range; see `discrepancy`.
        The scatter of the parameters from trial to trial counts where it exceeds the noise, which contains that of the
        training recordings: as estimated from three or more recordings; 2 % of the motion for fewer.
    reach : float, optional
        Standard deviations of the noise within which its fraction `level` lies, from `residual_reach`; default: those
        of a normal distribution.

    Returns
    -------
    Band
        Arrays of shape (T, S, 2), m; (T, S, 1), rad, for angles only.

    Raises
    ------
    InputError
        When the fit has no covariance, or the level is not between 0 and 1.
    """
    if fitted.covariance is None:
        raise InputError("a prediction band needs the covariance of a fit: fit with at least one free parameter")
    if not 0 < level < 1:
        raise InputError(f"the level of a band must lie between 0 and 1, got {level}")
    time_step = time_step or fitted.time_step
    own = own or predict_held_out(experiment, fitted, time_step=time_step)[1]
    shared = [k for k, n in enumerate(fitted.covariance.names) if "." not in n or n.partition(".")[0] not in
              {e.partition(".")[0] for e in fitted.rmse}]
    names = [fitted.covariance.names[k] for k in shared] + list(experiment.own_parameters)
    scale = {p.name: p.scale for p in own.parameters}
    sizes = {n: scale[n] or max(abs(own.values[n]), 1e-6) for n in names}
    rows, slopes = sensitivities(own.model, experiment, own.values, sizes, time_step)
    scaled = compared_of(experiment, slopes, rows) * np.array(list(sizes.values()))[:, None, None, None]
    theirs, mine = scaled[: len(shared)], scaled[len(shared) :]
    rows = compared_of(experiment, rows)
    if len(mine):
        measured = np.isfinite(experiment.compared)
        taken = np.linalg.lstsq(mine[:, measured].T, theirs[:, measured].T, rcond=HIDDEN)[0]
        theirs = theirs - np.tensordot(taken.T, mine, axes=1)
    unit = np.array([sizes[n] for n in names[: len(shared)]])

    def spread(matrix: Array) -> Array:
        relative = matrix[np.ix_(shared, shared)] / np.outer(unit, unit)
        return np.maximum(np.einsum("itsc,ij,jtsc->tsc", theirs, relative, theirs), 0.0)

    normal = NormalDist().inv_cdf(0.5 + 0.5 * level)
    variance, near = spread(fitted.covariance.matrix), ((reach or normal) / normal * noise) ** 2
    if training:
        pressure = predict(own.model, experiment, own.values, time_step)["pressure"]
        variance += discrepancy(own.model, experiment, own.values, rows, pressure, training) ** 2
        variance += beyond_inputs(fitted, experiment, own.values, training, time_step)
        between = fitted.covariance.between
        near = np.maximum(near, trial_to_trial(rows, len(training)) if between is None else spread(between))
    half = normal * np.sqrt(variance + near)
    return Band(rows, half / normal, rows - half, rows + half, level, *experiment.shown_in)


def trial_to_trial(rows: Array, recordings: int) -> Array:
    """Return the stated variance (T, S, k) of a motion (T, S, k) from trial to trial: that of a common gain. It is 0
    where three or more training `recordings` show their scatter. Two at different levels do not: a torque law passes
    through both.
    """
    return np.asarray((TRIAL_GAIN * (rows - rows[:1])) ** 2 * (recordings < FEWEST))


def trial_turn(experiment: Experiment, rows: Array, recordings: int) -> Array:
    """Return the stated standard deviation (T, S, k) of a motion `rows` (T, S, k) from trial to trial, beyond that in
    the residuals of one or two training `recordings`: that of a turn about the base, as by a base or a sensor's frame
    that is set anew, or by the bias of a fibre. See `TrainingResiduals.rest_spread`.

    It is 0 where three or more recordings show their scatter, for settled poses, for markers that are placed anew in
    each recording, and for measured values other than positions and angles from the base.
    """
    turn = TRIAL_TURN * np.sqrt(2.0 / recordings) * (recordings < FEWEST)
    if experiment.poses or experiment.own_places:
        return np.zeros_like(rows)
    if experiment.without_positions:
        return np.full_like(rows, turn * (experiment.alone == "angle" and experiment.angle_reference == "base"))
    return np.asarray(turn * np.sqrt(np.sum(rows**2, axis=-1, keepdims=True) - rows**2))


@dataclass(frozen=True, eq=False)
class TrainingResiduals:
    """What is left of N training recordings by their fit, from which noise and reach of predictions are learnt.

    Attributes
    ----------
    train : sequence of Experiment
    motions : sequence of arrays (T, S, k)
        Modelled values of each training recording, m; angles: rad.
    weighting : str
        That of the fit. With "travel", residuals are taken relative to each recording's peak displacement.
    """

    train: Sequence[Experiment]
    motions: Sequence[Array]
    weighting: str = "travel"

    @classmethod
    def of(
        cls, train: Sequence[Experiment], fitted: FitResult, *, time_step: float | None = None,
        weighting: str = "travel",
    ) -> TrainingResiduals:
        """Return the residuals of a fit, whose training recordings are simulated. `time_step` is in s; default: that
        of the fit.
        """
        step = time_step or fitted.time_step
        motions = [predict(fitted.model, exp, fitted.values, step)["compared"] for exp in train]
        return cls(train, motions, weighting)

    @cached_property
    def errors(self) -> Array:
        """Return all absolute training residuals (M,), each over its standard deviation from `noise`."""
        sizes = []
        for exp, rows in zip(self.train, self.motions, strict=True):
            off = np.abs(exp.compared - rows) / self.noise(exp, rows)
            sizes.append(off[np.isfinite(off)])
        return np.concatenate(sizes)

    def reach(self, level: float = 0.95) -> float:
        """Return the number of standard deviations of `noise` within which the fraction `level` of the training
        residuals lies.

        Errors of a model that lacks something are bounded, and reach less far than normal ones of the same size.
        """
        return float(np.clip(np.quantile(self.errors, level), *REACH))

    def band(
        self, experiment: Experiment, fitted: FitResult, modelled: Float[Array, "T S k"], own: FitResult, *,
        time_step: float | None = None, level: float = 0.95,
    ) -> Band:
        """Return the prediction interval of a recording that a fit to the training recordings predicts as `modelled`
        [m; angles: rad]. `own` is the fit of its own parameters, from `predict_held_out`.
        """
        band = prediction_band(experiment, fitted, time_step=time_step, level=level, own=own, training=self.train,
                               noise=self.noise(experiment, modelled), reach=self.reach(level))  # fmt: skip
        turned = trial_turn(experiment, modelled, len(self.train))
        return band.widened(np.maximum(self.rest_spread(experiment.stations, level), turned))

    def rest_spread(self, stations: Sequence[str], level: float = 0.95) -> Float[Array, "S k"]:
        """Return the standard deviation [m; angles: rad] of the rest of a new recording at S stations beyond that in
        `noise`.

        Every recording begins beside the model by an error of its own, such as that of its fibre or of its tracker. A
        fit to K recordings takes the mean of these errors into its parameters. A new recording scatters about it with
        1 + 1 / K times their variance, of which the residuals of the training recordings contain 1 - 1 / K. The
        variance is that of the medians of the first frames, without their noise. Since few recordings show it badly,
        the result is larger by the quotient of the quantiles of Student's t and of the normal distribution at `level`.
        It is 0 for a single recording, which shows no scatter; `band` takes at least `trial_turn`. Settled poses,
        releases and recordings with a warm-up do not begin at rest and are left out.
        """
        from scipy.stats import t

        rests: dict[str, list[Array]] = {}
        noise: dict[str, list[Array]] = {}
        for exp, rows in zip(self.train, self.motions, strict=True):
            if exp.poses or exp.excitation == "release" or exp.warm_up:
                continue
            for name, left in zip(exp.stations, np.moveaxis(rows - exp.compared, 1, 0), strict=True):
                first = left[np.isfinite(left).all(axis=1)][:FIRST_FRAMES]
                if len(first) > 1:
                    rests.setdefault(name, []).append(np.median(first, axis=0))
                    noise.setdefault(name, []).append(OF_MEDIAN * np.var(first, axis=0, ddof=1) / len(first))
        quantile = 0.5 + 0.5 * level
        variances = {
            name: (t.ppf(quantile, AT_REST * (len(r) - 1)) / NormalDist().inv_cdf(quantile)) ** 2
            * 2.0 / len(r) * np.maximum(np.var(r, axis=0, ddof=1) - np.mean(noise[name], axis=0), 0.0)
            for name, r in rests.items() if len(r) > 1
        }  # fmt: skip
        if not variances:
            return np.zeros((len(stations), len(self.train[0].axes)))
        usual: Array = np.mean(list(variances.values()), axis=0)
        return np.sqrt([variances.get(name, usual) for name in stations])

    def noise(self, experiment: Experiment, modelled: Float[Array, "T S k"]) -> Float[Array, "T S k"]:
        """Return the standard deviation of a prediction's residuals at T times and S stations: (T, S, 2 or 3) [m], or
        (T, S, 1) [rad] if only angles were recorded.

        The squared residuals of each coordinate are modelled as a non-negative sum of a constant, a term in the squared
        displacement of the tip, and a term in its squared speed, since a model errs differently at rest, while held,
        and in motion.

        With the weighting "travel", residuals and displacements are taken relative to each recording's peak
        displacement and scaled back by that of the prediction `modelled` (T, S, ...). A prediction with a smaller
        peak displacement than all training recordings errs as much as the smallest of them does. The constant is taken
        relative to the peak displacement, or as a sum of this and one of the same size [m] in all recordings, whichever
        gives the larger residuals. A station without training data gets the mean of all stations.
        """
        share = self.weighting == "travel"
        return noise_like(self.train, self.motions, experiment, modelled, share=share)


def residual_reach(
    train: Sequence[Experiment], fitted: FitResult, *, time_step: float | None = None, weighting: str = "travel",
    level: float = 0.95,
) -> float:
    """Return `TrainingResiduals.reach` of the training recordings of a fit, which are simulated."""
    return TrainingResiduals.of(train, fitted, time_step=time_step, weighting=weighting).reach(level)


def residual_noise(
    train: Sequence[Experiment], fitted: FitResult, experiment: Experiment, modelled: Float[Array, "T S k"], *,
    time_step: float | None = None, weighting: str = "travel",
) -> Float[Array, "T S k"]:
    """Return `TrainingResiduals.noise` of a prediction from the training recordings of a fit, which are simulated."""
    return TrainingResiduals.of(train, fitted, time_step=time_step, weighting=weighting).noise(experiment, modelled)


def noise_like(
    train: Sequence[Experiment], motions: Sequence[Array], experiment: Experiment, modelled: Array, *, share: bool,
) -> Array:
    """Return the standard deviation (T, S, k) of residuals as in `residual_noise`, from the modelled `motions` of the
    training recordings. With `share`, residuals are taken relative to the peak displacements.
    """
    left = dict[str, list[tuple[Array, Array]]]()
    least = min(e.travel for e in train) if share else 0.0
    for exp, rows in zip(train, motions, strict=True):
        unit = exp.travel if share else 1.0
        square = ((rows - exp.compared) / unit) ** 2
        traits = with_constant(motion_traits(exp.time, rows, unit, settled=exp.poses), least / unit)
        for k, name in enumerate(exp.stations):
            if np.isfinite(square[:, k]).any(axis=0).all():
                left.setdefault(name, []).append((traits, square[:, k]))
    path = modelled[:, -1]
    way = farthest(path, poses=True) if experiment.poses else float(np.linalg.norm(path - path[0], axis=1).max())
    unit = max(way, least, 1e-12) if share else 1.0
    own = with_constant(motion_traits(experiment.time, modelled, unit, settled=experiment.poses), least / unit)
    variances = dict[str, Array]()
    for name, parts in left.items():
        traits, square = map(np.concatenate, zip(*parts, strict=True))
        variances[name] = np.maximum(variance_by(own, traits, square), variance_by(own[:, :-1], traits[:, :-1], square))
    usual: Array = np.mean(list(variances.values()), axis=0)
    return np.asarray(unit * np.sqrt(np.stack([variances.get(n, usual) for n in experiment.stations], axis=1)))


def motion_traits(time: Array, rows: Array, unit: float, *, settled: bool = False) -> Array:
    """Return regressors (T, 3) for the variance of the residuals at T times: 1, squared displacement and squared speed
    of the tip.

    `rows` (T, S, ...) holds the motion, m; displacement and speed are divided by `unit`, m. The speed is 0 for settled
    poses.
    """
    path = rows[:, -1] / unit
    fast = speed(time, path, settled=settled)
    return np.stack([np.ones(time.size), np.sum((path - path[0]) ** 2, axis=1), fast**2], axis=1)


def with_constant(traits: Array, ratio: float) -> Array:
    """Return the regressors `traits` (T, 3) with a fourth one: the square of the `ratio` of the smallest peak
    displacement in training to that of the recording. Its coefficient is a variance of one size [m^2] in all
    recordings, such as that of a base beside its true position.
    """
    return np.column_stack([traits, np.full(len(traits), ratio**2)])


def variance_by(own: Array, traits: Array, square: Array) -> Array:
    """Return the expected squared residuals (T, C) of C coordinates at T times with the regressors `own` (T, k). They
    follow from a fit to M samples: squared residuals `square` (M, C) at the regressors `traits` (M, k).
    """
    from scipy.optimize import nnls

    size = np.sqrt(np.mean(traits**2, axis=0)) + 1e-300
    columns = []
    for column in square.T:
        measured = np.isfinite(column)
        parts = nnls(traits[measured] / size, column[measured])[0]
        columns.append(np.maximum(own / size @ parts, LEAST_SQUARE * column[measured].mean()))
    return np.stack(columns, axis=1)


def half_widths(
    fitted: FitResult, measure: Callable[[Mapping[str, float]], Array], *, level: float = 0.95,
    problems: list[str] | None = None,
) -> Array:
    """Return the half-widths of the confidence intervals of quantities that `measure` computes from parameter values.

    The parameters are moved by one standard error to both sides along each principal direction of their covariance,
    within their bounds; half the difference of the results is that direction's contribution. This is exact for
    quantities linear in the parameters, and steadier than a derivative for others. Parameters of the training
    recordings alone, such as their edge times, are held constant.

    Parameters
    ----------
    fitted : FitResult
    measure : callable
        Takes parameter values by name and returns an array, always of the same shape; NaN for a missing value.
    problems : list of str, optional
        Every distinct reason why `measure` failed is appended to this list.

    Returns
    -------
    array
        Of the shape that `measure` returns; 0 where the fit has no covariance, NaN where `measure` fails or returns
        NaN.
    """
    value = np.asarray(measure(fitted.values), dtype=float)
    total = np.zeros_like(value)
    if fitted.covariance is None:
        return total
    of_recordings = tuple(f"{name}." for name in fitted.rmse)
    shared = [k for k, name in enumerate(fitted.covariance.names) if not name.startswith(of_recordings)]
    parameters = {p.name: p for p in fitted.parameters}
    chosen = [parameters[fitted.covariance.names[k]] for k in shared]
    size = np.array([p.scale or 1.0 for p in chosen])
    variance, directions = np.linalg.eigh(fitted.covariance.matrix[np.ix_(shared, shared)] / np.outer(size, size))
    for v, direction in zip(variance, directions.T, strict=True):
        if v <= LEAST_VARIANCE * max(float(variance[-1]), 1e-300):
            continue
        ends = []
        for side in (-1.0, 1.0):
            moved = side * np.sqrt(v) * direction * size
            values = {p.name: float(np.clip(p.value + m, p.lower, p.upper)) for p, m in zip(chosen, moved, strict=True)}
            try:
                ends.append(np.asarray(measure({**fitted.values, **values}), dtype=float))
            except FAILED as error:
                if problems is not None and str(error) not in problems:
                    problems.append(str(error))
                ends.append(np.full_like(value, np.nan))
        total += (0.5 * (ends[1] - ends[0])) ** 2
    return np.asarray(NormalDist().inv_cdf(0.5 + 0.5 * level) * np.sqrt(total))
