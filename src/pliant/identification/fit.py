"""Output-error identification: simulate every experiment, compare with the recording, and adjust the parameters."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from pliant.errors import FitError, InputError, PliantError
from pliant.identification.chamber_parameters import held_gains
from pliant.identification.drives import at_rest, hardly_driven
from pliant.identification.edges import edges
from pliant.identification.experiment import Experiment
from pliant.identification.forward_model import held_note
from pliant.identification.identifiability import combinations, examine
from pliant.identification.nested import excess_phrase, inside, warm_start
from pliant.identification.observation import check_direction
from pliant.identification.optimise import solve, solve_all
from pliant.identification.parameters import Parameter, apply, for_record, shared_name, values_of
from pliant.identification.prediction import LONGEST, fit_step, predict
from pliant.identification.problem import JointPrior, Problem, root_mean_square, scattered
from pliant.identification.residuals import WEIGHTINGS, noise_ratio
from pliant.identification.result import FitResult, cautions, far_off, parameter_dict, status_sentence, stopped_at
from pliant.identification.start_search import independent_start, searched
from pliant.identification.uncertainty import Covariance, covariance, information_criterion
from pliant.model import Model
from pliant.options import with_defaults
from pliant.simulation import modes
from pliant.simulation.solve import check_step, longest_allowed_step

if TYPE_CHECKING:  # an optimiser is imported when one runs
    from scipy.optimize import OptimizeResult

__all__ = ["FIT_OPTIONS", "FitOptions", "FitResult", "fit", "parameter_dict", "parameters_from", "predict_held_out"]
Array = np.ndarray
LOSSES = ("linear", "soft_l1", "huber", "cauchy")
STEP_BIAS = 0.5  # standard errors: least bias of a parameter by the integration step for a warning
ABOVE_NOISE = 3.0  # residuals, in standard deviations of the noise, that a second start must confirm
NUMBERS = ("value", "lower", "upper", "scale", "prior", "prior_std", "shrink")


class FitOptions(TypedDict, total=False):
    """Keyword options of `fit`, where they are documented."""

    time_step: float | None
    loss: str
    starts: int
    weighting: str
    rng: np.random.Generator | int | None
    prior: JointPrior | None
    tolerance: float
    least_error: float
    error_time: float


FIT_OPTIONS: FitOptions = {
    "time_step": None, "loss": "linear", "starts": 3, "weighting": "travel", "rng": 0, "prior": None, "tolerance": 1e-9,
    "least_error": 0.0, "error_time": 0.0,
}


def fit(
    experiments: Sequence[Experiment],
    model: Model,
    parameters: Sequence[Parameter | str],
    *,
    regularise: bool = False,
    section_area: float | None = None,
    max_evaluations: int = 200,
    progress: Callable[[str], None] | None = None,
    nested: Mapping[str, FitResult] = MappingProxyType({}),
    **options: Unpack[FitOptions],
) -> FitResult:
    """Fit the parameters of a model to one or several recordings, by least squares on the simulated motion.

    Parameters
    ----------
    experiments : sequence of Experiment
        The training recordings.
    model : Model
        Geometry, and the values of everything that is not fitted.
    parameters : sequence of Parameter or str
        A name alone is a free parameter whose start is estimated; ``stiffness_*`` means one for each joint. The edge
        times of a pulse or release are added.
    time_step : float
        Longest time step, s; default: the longest one, at most 2 ms (10 ms if none rings), that resolves the modes of
        the model at the start values (`pliant.simulation.time_step.resolving_step`).
    loss : {"linear", "soft_l1", "huber", "cauchy"}, default "linear"
        Robust losses limit the weight of outliers beyond 1 % of the peak displacement, or three standard deviations of
        the noise.
    starts : int
        Number of starts: the estimate, the optima of `nested` fits, and others scattered about the estimate; default:
        3. For a chain in space whose stiffness is given, one start is searched for without that value.
    weighting : {"travel", "metre", "noise", "decay"}, default "travel"
        Unit of the residuals. "travel": each experiment's peak displacement, so that all pressure levels count alike.
        "metre": the same unit for all. "noise": standard deviations of each station's noise, as given with the
        experiment, else estimated from the residuals. "decay": the motion still to come in each frame, so that the
        small swings of a free decay count as much as the large ones.
    regularise : bool
        Fit even if the recordings do not determine some combination of parameters, which then stays near its start.
    section_area : float, optional
        Solid cross-section of the body, m^2, against which a fitted mass is checked.
    rng : numpy.random.Generator, int or None
        Random generator or seed of the scattered starts; default: 0.
    prior : JointPrior, optional
        Prior of several parameters together, in place of their own priors; those that are not free are left out.
    tolerance : float
        Relative change of the cost at which a search ends; default: 1e-9.
    least_error : float
        RMS error of the model, known from other recordings, in the unit of the residuals. Priors weigh at least as much
        as this error demands, also where few data are fitted closely; not for the weighting "noise". Default: 0.
    error_time : float
        Correlation time [s] of that error: a recording shows it as often as this time fits into it. Default: 0.
    max_evaluations : int
        Highest number of evaluations for each start.
    progress : callable, optional
        Called with one line of text for each start.
    nested : mapping, optional
        Results, by name, of smaller fits to the same recordings that this fit contains. Each optimum is one more start,
        in place of a scattered one.

    Returns
    -------
    FitResult

    Raises
    ------
    InputError
        When a parameter is unknown or out of bounds, or the step is too long for the model's first mode.
    TypeError
        For an unknown keyword.
    FitError
        When nothing is free, the recordings do not determine all parameters, a start value cannot be estimated, or no
        start can be simulated.
    """
    began = clock.perf_counter()
    how = with_defaults(fit, options, FIT_OPTIONS)
    loss, weighting = how["loss"], how["weighting"]
    check_choices(loss, weighting)
    problem = first_problem(experiments, model, parameters, how["time_step"], weighting, how["prior"])
    problem.expect_error(how["least_error"], how["error_time"])
    longest = how["time_step"] or LONGEST
    second = independent_start(problem, model, parameters, longest, weighting) if how["starts"] > 1 else None
    warm = {name: warm_start(problem, smaller) for name, smaller in nested.items()}
    further = [x if x is second else inside(problem, x) for x in (second, *warm.values()) if x is not None]
    simulable = starts_of(problem, how["starts"], np.random.default_rng(how["rng"]), further)
    if regularise:
        problem.hold_to_start()
    else:
        check_identifiable(problem)
    best = solve_all(problem, simulable, loss, max_evaluations, progress, how["tolerance"])
    agreeing = best.agreeing
    for _ in range(2 if problem.learns else 0):
        problem.learn_sizes(best.x)
        best = solve(problem, best.x, loss, max_evaluations, tolerance=how["tolerance"])
    best, excess = below_nested(problem, best, warm, loss, max_evaluations)
    best.doubt = lone_optimum(problem, best.x, agreeing, len(simulable))
    return finished(problem, best, loss, section_area, clock.perf_counter() - began, excess_phrase(excess))


def first_problem(
    experiments: Sequence[Experiment], model: Model, parameters: Sequence[Parameter | str], time_step: float | None,
    weighting: str, prior: JointPrior | None = None,
) -> Problem:
    """Return the least-squares problem of a fit with the estimated start values of its parameters.

    Raises
    ------
    FitError, InputError
        When nothing is free, a start value cannot be estimated, or the experiments cannot be fitted together.
    """
    if len(alone := {e.alone or "positions" for e in experiments}) > 1:
        raise InputError("a fit compares either positions or angles or inclinations, but some of its experiments hold "
                         f"{' and others '.join(sorted(alone))} alone: fit them separately")  # fmt: skip
    check_inclinations(experiments, model, parameters)
    model, filled = searched(experiments, model, parameters, time_step or LONGEST, weighting)
    if not any(p.free for p in filled):
        raise FitError("nothing to fit: every parameter is fixed; free at least one")
    step = time_step or min(fit_step(model, values_of(filled), experiments), longest_allowed_step(model))
    check_step(model, step, "midpoint")
    return Problem(list(experiments), model, filled, step, weighting, prior)


def check_inclinations(
    experiments: Sequence[Experiment], model: Model, parameters: Sequence[Parameter | str]
) -> None:
    """Raise InputError if experiments with inclinations state another direction of gravity than the model, or it is to
    be estimated.
    """
    inclined = [e for e in experiments if "gravity" in e.further]
    listed = [p for p in parameters if isinstance(p, Parameter)]
    free = [p if isinstance(p, str) else p.name for p in parameters if isinstance(p, str) or p.free]
    if inclined and (turning := [name for name in free if shared_name(name).startswith("gravity_")]):
        raise InputError(f"{turning[0]} cannot be estimated from recordings of inclination such as {inclined[0].name}, "
                         "which state the direction of gravity in the base frame: hold it constant, or leave it out")
    for exp in inclined:
        values = {**for_record({p.name: p.value for p in listed if p.value is not None}, exp.name), **exp.known}
        check_direction(f"recording {exp.name}", exp.further["gravity"].constants, apply(model, {
            name: value for name, value in values.items() if name.startswith("gravity_")}).gravity)  # fmt: skip


def below_nested(
    problem: Problem, best: OptimizeResult, warm: Mapping[str, Array | None], loss: str, max_evaluations: int,
) -> tuple[OptimizeResult, dict[str, float]]:
    """Return the best optimum known, and its excess over the cost of each smaller fit, as a fraction of that cost.

    `warm` holds the start from each smaller fit; None where the model cannot be simulated. The search is repeated from
    a start whose cost is below that of the optimum.
    """
    excess = {}
    for name, x in warm.items():
        if x is None:
            continue
        cost = solve(problem, x, loss, 1).cost
        if best.cost > cost:
            best = min(best, solve(problem, inside(problem, x), loss, max_evaluations), key=lambda end: float(end.cost))
        excess[name] = float(best.cost / max(cost, 1e-300)) - 1.0
    return best, excess


def lone_optimum(problem: Problem, x: Array, agreeing: int, starts: int) -> str:
    """Return a warning if the residuals far exceed the noise and no other start point of the fit led to the optimum x
    (P,) of P parameters; '' otherwise.
    """
    ratio = max(noise_ratio(o, part) for o, part in problem.parted(problem.data_residual(x)))
    if agreeing or ratio <= ABOVE_NOISE:
        return ""
    alone = "only one start was tried" if starts == 1 else f"none of the other {starts - 1} starts led here"
    return (
        f"its residuals are {ratio:.2g} times the noise of the recordings and {alone}: the model may lack something, "
        "or a better optimum may exist; compare with other start values"
    )


def starts_of(
    problem: Problem, starts: int, rng: np.random.Generator, further: Sequence[Array] = (),
) -> list[Array]:
    """Return the start points of a fit from which the model can be simulated: the estimated one, `further` ones, and
    random points around the first, up to the number `starts`.

    Each start (P,) holds scaled parameters. Raises FitError if no start can be simulated.
    """
    points = [problem.start, *further]
    points += [scattered(problem.free, problem.start, problem.bounds, rng) for _ in range(starts - len(points))]
    good = []
    broken = ""
    for x in points:
        if np.isfinite(problem.residual(x)).all() and not problem.broken:
            good.append(x)
        broken = problem.broken or broken
    if not good:
        raise FitError(f"the model cannot be simulated with any of the fit's start values: {broken or 'check them'}")
    return good


def check_identifiable(problem: Problem) -> None:
    """Raise FitError if the recordings do not determine every free parameter of a fit."""
    undetermined = [d for d in examine(problem).directions if d.kind == "null"]
    if undetermined:
        said = "; ".join(f"{d.sentence} ({d.cure})" for d in undetermined)
        raise FitError(f"these parameters cannot be fitted together: {said}; or pass regularise=True")


def predict_held_out(
    experiment: Experiment, fitted: FitResult, *, time_step: float | None = None,
) -> tuple[dict[str, Any], FitResult]:
    """Predict an experiment that was not fitted. The fitted parameters are held constant. Only the experiment's edge
    times, at which its pressure switches or its body is let go, are fitted to it.

    `time_step` is in s; default: that of the fit. Returns the prediction (see `predict`) and the result of fitting the
    edge times; nothing is fitted for an experiment without edge times.
    """
    time_step = time_step or fitted.time_step
    fixed = [p.with_(free=False, prior=None, prior_std=None, shrink=0.0) for p in fitted.parameters]
    if not experiment.own_parameters:
        values = fitted.values
        prediction = predict(fitted.model, experiment, values, time_step)
        rmse = {experiment.name: root_mean_square(prediction["compared"], experiment.compared)}
        note = "nothing was fitted to this recording"
        return prediction, FitResult(
            fitted.model, tuple(fixed), note, rmse, 1, 0.0, True, turns=experiment.without_positions,
            time_step=time_step,
        )
    moments = best_edges(experiment, fitted, time_step)
    span = float(np.ptp(experiment.time))
    low, high = float(experiment.time[0]) - span, float(experiment.time[-1]) + span
    fixed += [Parameter(name, value, lower=low, upper=high) for name, value in moments.items()]
    fixed += carried_over(experiment, fitted)
    own_fit = fit([experiment], fitted.model, fixed, time_step=time_step, starts=1)
    return predict(own_fit.model, experiment, own_fit.values, time_step), own_fit


def carried_over(experiment: Experiment, fitted: FitResult) -> list[Parameter]:
    """Return the release time of a held-out recording as a fixed parameter. Its value is the mean release time of the
    fitted recordings.

    The list is empty if the recording is not a release or the training recordings have no ``release_time``. The turn of
    the base (`base_turn`) differs between recordings and stays 0.
    """
    times = [v for n, v in fitted.values.items() if n.partition(".")[0] in fitted.rmse and n.endswith(".release_time")]
    if experiment.excitation != "release" or not times or "release_time" in fitted.values:
        return []
    source = f"mean of {len(times)} training records, standard deviation {np.std(times):.2g} s"
    name = f"{experiment.name}.release_time"
    return [Parameter(name, float(np.mean(times)), free=False, source=source)]


def best_edges(experiment: Experiment, fitted: FitResult, time_step: float) -> dict[str, float]:
    """Return start values [s] of an experiment's edge times, by parameter name. Each edge is moved by up to two periods
    of the first mode, and the time of least error is taken.

    The motion of a ringing body nearly repeats after a period, so that a fit of edge times has several local minima.
    Each edge is therefore moved in steps of a quarter of the first mode's period, up to two periods either way, and
    the time of least error is taken.
    """
    times = {f"{experiment.name}.{name}": time for name, time in edges(experiment).items()}
    others = values_of(carried_over(experiment, fitted))
    quarter = 0.25 / float(modes(fitted.model)[0][0])
    for name, time in list(times.items()):
        moved = [time + k * quarter for k in sorted(range(-8, 9), key=abs)]
        errors = [error_at(experiment, fitted, others | times | {name: moment}, time_step) for moment in moved]
        times[name] = moved[int(np.argmin(errors))]
    return times


def error_at(experiment: Experiment, fitted: FitResult, times: Mapping[str, float], time_step: float) -> float:
    """Return the RMS error [m; angles: rad] of an experiment with edge `times` [s]; inf if it cannot be simulated."""
    try:
        positions = predict(fitted.model, experiment, {**fitted.values, **times}, time_step)["compared"]
    except PliantError:
        return float("inf")
    error = root_mean_square(positions, experiment.compared)
    return error if np.isfinite(error) else float("inf")


def check_choices(loss: str, weighting: str) -> None:
    """Raise InputError for an unknown `loss` or `weighting` of a fit."""
    for what, value, known in (("loss", loss, LOSSES), ("weighting", weighting, WEIGHTINGS)):
        if value not in known:
            raise InputError(f"unknown {what} {value!r}: use one of {', '.join(known)}")


def finished(
    problem: Problem, best: OptimizeResult, loss: str, section_area: float | None, seconds: float, failure: str,
) -> FitResult:
    """Return the result of a fit at its optimum: covariance, status, warnings, and the error of each recording. A
    `failure` of the search goes into the status.
    """
    values = problem.values(best.x)
    spread = covariance(problem, best.x, robust=loss != "linear")
    named = dict(zip(spread.names, spread.doubt, strict=True))
    parameters = tuple(
        p.with_(value=values[p.name], std=named.get(p.name)) for p in problem.parameters
    )
    record_prefixes = tuple(f"{e.name}." for e in problem.experiments)
    model = apply(problem.model, {k: v for k, v in values.items() if not k.startswith(record_prefixes)})
    rmse = {
        e.name: root_mean_square(predict(problem.model, e, values, problem.time_step)["compared"], e.compared)
        for e in problem.experiments
    }
    notes = cautions(model, parameters, problem.experiments, section_area) + combinations(problem, best.x, spread)
    notes += [spread.note] if spread.note else []
    if spread.correlated:
        notes.append(f"Residuals are correlated over {spread.correlated:.2g} s, which the standard errors count in.")
    notes += [note for e in problem.experiments if (note := at_rest(problem.model, e))]
    notes += [note for e in problem.experiments if (note := held_note(problem.model, e, values))]
    notes += step_notes(problem, best.x, spread)
    notes += hardly_driven([p.name for p in problem.free], problem.model, problem.experiments)
    if held_gains(parameters, problem.model):
        notes.append("The mean of the joints' gains is held constant: the torque law has a scale of its own.")
    mean_square = float(np.mean(problem.data_residual(best.x) ** 2))
    bic = information_criterion(mean_square, spread.effective, best.x.size)
    failure = far_off(problem.experiments, rmse) or failure
    return FitResult(
        model, parameters, status_sentence(best, parameters, failure), rmse, problem.evaluations, seconds,
        best.status > 0 and not failure and not any(map(stopped_at, parameters)),
        spread, tuple(notes), bic, turns=problem.experiments[0].without_positions,
        time_step=problem.time_step,
    )


def step_notes(problem: Problem, x: Array, found: Covariance) -> list[str]:
    """Return a list with one warning if the simulation's time step biases a parameter by at least half of its standard
    error. The warning names the parameter with the largest bias; without one the list is empty.

    The change of the residuals at half the step is turned into a change of the parameters to first order. For a method
    of second order, the whole error of the step is 4/3 of that change.
    """
    shortest = min(float(np.min(np.diff(e.time), initial=np.inf)) for e in problem.experiments)
    finer = problem.with_time_step(0.5 * min(problem.time_step, shortest))
    change = finer.data_residual(x) - problem.data_residual(x)
    if finer.broken or problem.broken:
        return []
    J = problem.jacobian(x)
    shift = np.linalg.lstsq(J, np.append(change, np.zeros(len(J) - len(change))) / 0.75, rcond=None)[0] * problem.scale
    std = np.array([s or np.inf for s in found.std])
    worst = int(np.argmax(np.abs(shift) / std))
    bias = float(abs(shift[worst]) / std[worst])
    if bias < STEP_BIAS:
        return []
    better = 2.0 * finer.time_step * np.sqrt(0.5 * STEP_BIAS / bias)
    text = (f"The integration step of {1e3 * problem.time_step:.3g} ms biases {found.names[worst]} by about {bias:.2g} "
            f"standard errors: use a step of {1e3 * better:.2g} ms or less.")  # fmt: skip
    return [text]


def parameters_from(entries: Mapping[str, Any]) -> list[Parameter]:
    """Return fit parameters from a dict that gives for each name a start value, "free", or a table of `Parameter`
    attributes.
    """
    parsed = []
    for name, entry in entries.items():
        if entry == "free" or entry is None:
            parsed.append(Parameter(name))
        elif isinstance(entry, Mapping):
            parsed.append(Parameter(name, **checked_table(name, entry)))
        else:
            parsed.append(Parameter(name, **checked_table(name, {"value": entry})))
    return parsed


def checked_table(name: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes in a parameter's table converted to their types; raise InputError for a wrong one."""
    kinds: dict[str, type] = dict.fromkeys(NUMBERS, float) | {"free": bool, "source": str}
    checked = {}
    for key, value in table.items():
        kind = kinds.get(key)
        if kind is None:
            raise InputError(f"parameter {name}: {key!r} is not a known entry; use {', '.join(kinds)}")
        if not isinstance(value, kind) and not (kind is float and type(value) is int):
            raise InputError(f"parameter {name}: {key} must be a {kind.__name__}, got {value!r:.60}")
        checked[key] = kind(value)
    return checked
