"""Fit a known arm to a few seconds of another day, and judge what changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, TypedDict, Unpack

import numpy as np

from pliant.adaptation.change import BodyChange, body_change, freed, released_names, spaced
from pliant.adaptation.day import DayParts, check_day, part_like
from pliant.adaptation.mounting import COMMON, COMMON_GAIN, mounting_parameters, of_geometry, of_mounting
from pliant.adaptation.posterior import FROM_DAY_TO_DAY, Posterior, by_joint
from pliant.adaptation.result import FAR, Adaptation, DayError, Move, Verdict
from pliant.failures import FAILED
from pliant.identification.experiment import Experiment
from pliant.identification.fit import FitResult, fit, predict_held_out
from pliant.identification.identifiability import join_words
from pliant.identification.parameters import Parameter
from pliant.identification.problem import root_mean_square
from pliant.identification.uncertainty import Covariance
from pliant.options import with_defaults

Array = np.ndarray
Notify = Callable[[str], None]
MOST_ROUNDS = 3  # of releasing parameters of the body from their prior
EVALUATIONS, TOLERANCE = 60, 1e-4  # of a search; the change of the cost at which it ends is far below its doubt
MOST_FACTOR = 4.0  # by which a positive parameter of the body may change
STRAINED = 2.5  # standard deviations of the wide priors of the mounting
MOST_JOINTS = 6  # of a chain whose joints are judged one by one
PLAIN = 1.15  # error before over error after: a smaller gain is no new mounting, whatever the statistics say
NO_MOUNTING = 8.0  # standard deviations of chi-squared: a mounting does not move farther against its wide priors
TOO_CLOSE = 0.5  # of the earlier error: a smaller one means that the mounting took up errors of the model
WORSE_REST = 1.05  # of the error on the rest of the day: a larger one above the usual refutes a change of the body
SURPRISING = 1.5  # of the error expected of the earlier model in the earlier mounting: a larger one is no chance
TOLD = 0.05  # logarithm of a common factor on the gains, from which the verdict mentions it
LOST = 0.3  # of the peak displacement: a larger error on the fitted seconds means another arm
WORSE = 3.0  # errors of the earlier fit: likewise, if above a tenth of the peak displacement
MOST_EARLIER = 3  # recordings of the earlier day that are fitted as the new one


class AdaptModelOptions(TypedDict, total=False):
    """Keyword options of `adapt_model`, where they are documented."""

    weighting: str
    loss: str
    kind: bool
    usual: float | None
    earlier: Callable[[], Sequence[Experiment]]
    progress: Notify | None


ADAPT_MODEL_OPTIONS: AdaptModelOptions = {
    "weighting": "travel", "loss": "linear", "kind": False, "usual": None, "earlier": list, "progress": None,
}


def adapt_model(
    old: FitResult, posterior: Posterior, day: DayParts, **options: Unpack[AdaptModelOptions],
) -> Adaptation:
    """Fit a known arm to the first seconds of another day, and judge what changed.

    The posterior of the earlier fit is the prior of the body's parameters. Those of the mounting are free with wide
    priors (`MOUNTING`). A few seconds that are followed much more closely than the earlier recordings are overfitted:
    the fit is repeated with priors weighed by the earlier error and the time over which it was correlated. If the
    recordings are followed less closely than the earlier ones, a parameter of the body that moves by more than four of
    its standard deviations is released from its prior, and the fit is repeated. So are all of them if the mounting
    moves farther than its priors allow.

    Whether the body changed is judged by another fit, whose body is free (`body_change`). Parameters that changed are
    released from their prior, unless the rest of the day is then predicted worse.

    Parameters
    ----------
    old : FitResult
        The earlier fit, whose errors are those "before".
    posterior : Posterior
        What earlier fits say about the body.
    day : DayParts
        Recordings of the day, see `parts_of_day`.
    weighting, loss : str
        As in `fit`.
    kind : bool
        Whether the recordings are of another robot of the kind.
    usual : float, optional
        RMS error [m; angles: rad] of the earlier model; default: the median of its training recordings.
    earlier : callable, optional
        Returns recordings of the earlier fit. Fitted as the day is, they show by how much errors of the model's form
        move the mounting and the body; default: none.
    progress : callable, optional
        Called with a line of text after each fit.

    Raises
    ------
    InputError
        When the recordings do not move, or lack inputs or stations of the model.
    FitError
        When the model cannot be simulated.
    """
    how = with_defaults(adapt_model, options, ADAPT_MODEL_OPTIONS)
    notify = how["progress"] or (lambda _line: None)
    check_day(old, day)
    usual = how["usual"] = usual_error(old) if how["usual"] is None else how["usual"]
    settings = partial(settings_of, old, how, usual)
    of_day = settings(day)
    result, released = fitted_in_rounds(old, posterior, day, of_day, usual, notify)
    change = BodyChange()
    if how["kind"]:
        return judged(old, posterior, day, result, change, how)

    def fit_alike(exp: Experiment) -> FitResult:
        part = part_like(exp, old, day)
        return fitted_day(posterior, part, posterior.prior.widened(released), of_day | settings(part))

    how["earlier"] = cache(how["earlier"])
    moves = list[dict[str, float]]()
    try:
        moves = mounting_of_earlier(how["earlier"], fit_alike)
        change, posterior, result = with_change(old, posterior, day, (result, released), how, settings)
    except FAILED as error:  # the fit with a free body; the adapted one stands
        notify(f"warning: whether the body changed is unknown: {error}")
    return judged(old, posterior, day, with_error_of_form(result, moves), change, how)


def with_change(
    old: FitResult, posterior: Posterior, day: DayParts, adapted: tuple[FitResult, dict[str, float]],
    how: AdaptModelOptions, settings: Callable[[DayParts], dict[str, Any]],
) -> tuple[BodyChange, Posterior, FitResult]:
    """Return how the body changed, and what is known about it and the fit with this change, from the `adapted` fit and
    the variances that it released.
    """
    (result, released), notify = adapted, how["progress"] or (lambda _line: None)
    separate = by_joint(posterior, FROM_DAY_TO_DAY, MOST_JOINTS)

    def fit_freed(part: DayParts) -> FitResult:
        return fitted_day(separate, part, separate.prior.widened(freed(separate)), settings(part))

    change = body_change(separate, fit_freed(day), how["earlier"], lambda exp: fit_freed(part_like(exp, old, day)))
    notify(f"adapt: {change.sentence}")
    where = posterior if set(change.names) <= {*posterior.body.names, "stiffness"} else separate
    names = {*released, *released_names(where, change.names)}
    if names == set(released):
        return change, posterior, result
    wide = where.prior.widened({n: v for n, v in (released | freed(where)).items() if n in names})
    other = fitted_day(where, day, wide, settings(day))
    if error_of_rest(other, day) > max(WORSE_REST * error_of_rest(result, day), how["usual"] or 0.0):
        notify("adapt: with this change the rest of the day is predicted worse: it is none")
        return change._replace(names=(), changes=(), refuted=change.names), posterior, result
    return change, where, other


def settings_of(old: FitResult, how: AdaptModelOptions, usual: float, day: DayParts) -> dict[str, Any]:
    """Return the options of a fit to a day, for an earlier model whose RMS error [m; angles: rad] is `usual`."""
    return {
        "weighting": how["weighting"], "loss": how["loss"], "time_step": old.time_step, "tolerance": TOLERANCE,
        "least_error": least_error(usual, day, how["weighting"]),
    }


def fitted_in_rounds(
    old: FitResult, posterior: Posterior, day: DayParts, options: dict[str, Any], usual: float, notify: Notify,
) -> tuple[FitResult, dict[str, float]]:
    """Return the fit to a day, and the variances (SI) of the parameters that it released from their prior, by name."""
    prior, released = posterior.prior, dict[str, float]()
    result = fitted_day(posterior, day, prior, options)
    if old.covariance and max(result.rmse.values()) < TOO_CLOSE * usual:
        options["error_time"] = old.covariance.correlated
        result = fitted_day(posterior, day, prior, options)
    for _ in range(MOST_ROUNDS):
        moves = body_moves(posterior, result)
        far = {n: abs(z) for n, z in moves.items() if abs(z) > FAR}
        if not far and strained(all_moves(posterior, result)):
            far = dict.fromkeys(moves, 1.0)
        far = {n: z for n, z in far.items() if n not in released}
        notify(f"adapt: {result.status}")
        if not far or within_usual(result, usual):
            break
        released |= {n: v for n, v in freed(posterior).items() if far.get(n, 0.0) > 0.5 * max(far.values())}
        notify(f"adapt: released from the earlier fit: {', '.join(released)}")
        result = fitted_day(posterior, day, prior.widened(released), options)
    return result, released


def usual_error(old: FitResult) -> float:
    """Return the median RMS error [m; angles: rad] of the recordings of a fit; 0 if it is unknown."""
    return float(np.median(list(old.rmse.values()))) if old.rmse else 0.0


def within_usual(result: FitResult, usual: float) -> bool:
    """Return whether a fit follows each of its recordings at least as closely as the earlier model did its own, whose
    RMS error [m; angles: rad] is `usual`: then nothing demands another body.
    """
    return max(result.rmse.values(), default=0.0) <= usual


def least_error(usual: float, day: DayParts, weighting: str) -> float:
    """Return the RMS error `usual` [m; angles: rad] of the earlier model in the unit of the residuals.

    A few seconds can be fitted more closely than the model deserves.
    """
    unit = {"metre": 1.0, "noise": np.inf}.get(weighting, float(np.median([e.travel for e in day.fitted])))
    dimensions = len(day.fitted[0].axes)
    return float(usual / unit / np.sqrt(dimensions))


def strained(moves: Sequence[Move]) -> bool:
    """Return whether a parameter of the mounting moved farther than its wide prior makes plausible, as it does to make
    up for a change of the body.
    """
    return any(abs(m.after - m.before) > STRAINED * m.prior_std for m in moves if m.belongs == "mounting")


def fitted_day(posterior: Posterior, day: DayParts, prior: Any, options: dict[str, Any]) -> FitResult:
    """Return the fit of the body and of its mounting to the first seconds of a day."""
    std = prior.std
    body = [bounded(p.with_(prior=p.value, prior_std=std[p.name], std=None)) if p.free else p
            for p in posterior.parameters]  # fmt: skip
    listed: list[Parameter | str] = [*body, *mounting_parameters(posterior.model, day.fitted, posterior.values)]
    result = fit(list(day.fitted), posterior.model, listed, prior=prior, starts=1, max_evaluations=EVALUATIONS,
                 **options)  # fmt: skip
    covariance = result.covariance
    if covariance is None:
        return result
    return replace(result, covariance=covariance._replace(between=posterior.scatter(covariance.names)))


def bounded(p: Parameter) -> Parameter:
    """Return a parameter with bounds a factor of four from its value, if it cannot be negative: a Gaussian prior that
    is wide for its mean says nothing about values near 0.
    """
    if p.value is None or p.lower < 0.0 or p.value <= p.lower:
        return p
    return p.with_(lower=max(p.lower, p.value / MOST_FACTOR), upper=min(p.upper, MOST_FACTOR * p.value))


def common_factor(posterior: Posterior, result: FitResult) -> float:
    """Return the part of the move of all gains that they have in common, as the logarithm of a factor."""
    direction = posterior.gain_direction
    if not direction.any():
        return 0.0
    move = np.array([result.values[n] for n in posterior.body.names]) - posterior.body.mean
    weighed = np.linalg.solve(posterior.body.covariance, direction)
    return float(weighed @ move / (weighed @ direction + COMMON_GAIN**-2))


def body_moves(posterior: Posterior, result: FitResult) -> dict[str, float]:
    """Return by how many of its standard deviations each free parameter of the body moved, by name, apart from the
    factor that all gains have in common.
    """
    factor, std = common_factor(posterior, result), posterior.body.std
    rows = zip(posterior.body.names, posterior.body.mean, factor * posterior.gain_direction, strict=True)
    return {name: float((result.values[name] - mean - common) / std[name]) for name, mean, common in rows}


def all_moves(posterior: Posterior, result: FitResult) -> tuple[Move, ...]:
    """Return the moves of all free parameters from one day to the other, those of the mounting first."""
    moved, std = body_moves(posterior, result), posterior.prior.std
    rows = []
    for p in result.parameters:
        if not p.free or p.value is None or not (p.name in moved or of_mounting(p.name)) or p.prior is None:
            continue
        in_body = p.name in moved
        old = posterior.body.std[p.name] if in_body else posterior.std.get(p.name)
        rows.append(Move(p.name, "body" if in_body else "mounting", p.unit, p.prior, p.value, old,
                         std[p.name] if in_body else float(p.prior_std or 0.0), p.std,
                         moved[p.name] if in_body else None if not old else (p.value - p.prior) / old))  # fmt: skip
    direction = posterior.gain_direction
    if direction.any():
        factor = float(np.exp(common_factor(posterior, result)))
        rows.append(Move(COMMON, "mounting", "1", 1.0, factor, None, COMMON_GAIN, None, None))
    return tuple(sorted(rows, key=lambda m: m.belongs == "body"))


def judged(
    old: FitResult, posterior: Posterior, day: DayParts, result: FitResult, change: BodyChange, how: AdaptModelOptions,
) -> Adaptation:
    """Return moves, errors and verdict of an adapted model."""
    moves = all_moves(posterior, result)
    errors, travel = [], max(e.travel for e in (*day.fitted, *day.judged))  # a part may hold less motion than the day
    for exp in (*day.fitted, *day.judged):
        before = error_of(exp, old)
        after = result.rmse[exp.name] if exp.name in result.rmse else error_of(exp, result)
        errors.append(DayError(exp.name, "fitted" if exp in day.fitted else "judged", before, after, travel))
    change = change._replace(names=released_names(posterior, change.names))
    largest = max(how["usual"] or 0.0, *old.rmse.values())
    mounting = mounting_moved(moves, surprising=surprising(errors, largest))
    if impossible := no_mounting(moves, result):
        change = change._replace(another=f"its mounting would have to move farther than mountings do: {impossible}")
    verdict, sentence = verdict_of(old, moves, errors, mounting, None if how["kind"] else change)
    return Adaptation(verdict, sentence, change.names, moves, tuple(errors), day.seconds, result)


def error_of(exp: Experiment, result: FitResult) -> float:
    """Return the RMS error [m; angles: rad] of a recording under a fitted model, with its own edge times fitted."""
    return root_mean_square(predict_held_out(exp, result)[0]["compared"], exp.compared)


def error_of_rest(result: FitResult, day: DayParts) -> float:
    """Return the mean RMS error [m; angles: rad] of a fit on the recordings that judge it; 0 if there are none."""
    errors = [error_of(e, result) for e in day.judged]
    return float(np.mean(errors)) if errors else 0.0


def surprising(errors: Sequence[DayError], largest: float) -> bool:
    """Return whether the earlier model, in its earlier mounting, predicts a day worse, in the mean of its recordings,
    than its `largest` earlier error [m; angles: rad] and a change of the whole body from day to day explain.
    """
    travel = max(e.travel for e in errors)
    return bool(np.mean([e.before for e in errors]) > SURPRISING * np.hypot(largest, FROM_DAY_TO_DAY * travel))


def mounting_moved(moves: Sequence[Move], *, surprising: bool) -> str:
    """Return a phrase on the parameters of the mounting that moved, '' if none did. That the earlier mounting predicts
    `surprising` errors shows that it moved, whether or not the recordings tell its parameters apart.
    """
    clear = [m.name for m in moves if m.belongs == "mounting" and m.clear]
    if clear:
        return join_words(clear)
    mine = [m for m in moves if m.belongs == "mounting" and m.name != COMMON]
    if not surprising or not mine:
        return ""
    return f"the mounting as a whole, most of all {largest_of(mine)}, which make up for each other,"


def largest_of(moves: Sequence[Move]) -> str:
    """Return the names of the three largest moves for their priors, joined."""
    return join_words([m.name for m in sorted(moves, key=lambda m: -abs(m.after - m.before) / m.prior_std)[:3]])


def no_mounting(moves: Sequence[Move], result: FitResult) -> str:
    """Return what moved most if base, frame, rest shape and markers moved farther than their wide priors and the errors
    of the model's form explain; '' if they did not.
    """
    mine = [m for m in moves if m.belongs == "mounting" and of_geometry(m.name)]
    covariance = result.covariance
    if not mine or covariance is None:
        return ""
    std = np.array([m.prior_std for m in mine])
    spread = np.eye(len(mine))
    if covariance.form is not None:
        index = [covariance.names.index(m.name) for m in mine]
        spread += covariance.form[np.ix_(index, index)] / np.outer(std, std)
    away = np.array([m.after - m.before for m in mine]) / std
    far = away @ np.linalg.solve(spread, away) > len(mine) + NO_MOUNTING * np.sqrt(2.0 * len(mine))
    return largest_of(mine) if far else ""


def verdict_of(
    old: FitResult, moves: Sequence[Move], errors: Sequence[DayError], mounting: str, change: BodyChange | None,
) -> tuple[Verdict, str]:
    """Return the verdict on an arm of another day, and a sentence with the reason. `mounting` is a phrase on the
    parameters of the mounting that moved, '' for none; `change` that of the body, None for another robot of the kind.
    """
    fitted = max(e.after / e.travel for e in errors if e.role == "fitted")
    usual = max(old.rmse.values(), default=0.0) / max(e.travel for e in errors)
    lost = fitted > LOST or (usual > 0 and fitted > max(0.1, WORSE * usual))
    if change is None and not lost:
        return "another of the kind", "Another robot of the kind: its body is fitted within the spread of the kind."
    if change is None or lost or change.another:
        stays = f"its error on the fitted seconds stays at {100 * fitted:.2g} % of the peak displacement"
        reason = change.another if change and not lost else stays
        return "another arm", f"Another arm: {reason}. Identify it anew, from these start values."
    if change.names:
        listed = join_words([c.sentence for c in change.changes])
        return "changed body", f"The body changed: {listed}, in a fit whose body is free.{change.caution}"
    verdict, sentence = same_or_mounted(moves, errors, mounting, change.refuted)
    return verdict, sentence + or_stiffer(moves)


def same_or_mounted(
    moves: Sequence[Move], errors: Sequence[DayError], mounting: str, refuted: Sequence[str],
) -> tuple[Verdict, str]:
    """Return the verdict on an arm whose body is the same, and a sentence with the reason."""
    body = "no parameter of the body did"
    if refuted:
        body = f"that {join_words(refuted)} changed, as a fit whose body is free shows, the rest of the day refutes"
    less = f"{100 * (1 - 1 / PLAIN):.0f} % smaller"
    if mounting and sum(e.before for e in errors) > PLAIN * sum(e.after for e in errors):
        return "re-mounted", f"The same arm, mounted anew: {mounting} moved; {body}."
    if any(m.belongs == "mounting" and m.clear for m in moves):
        reason = f", hardly mounted anew: {mounting} moved, which does not make the errors {less}; {body}"
    elif mounting:
        reason = (f", although its errors are larger than expected: no other mounting makes them {less}, and no other "
                  "body")  # fmt: skip
    else:
        reason = f" in the same mounting: {body if refuted else 'no parameter moved beyond its doubt'}"
    return "same arm", f"The same arm{reason}."


def or_stiffer(moves: Sequence[Move]) -> str:
    """Return a sentence on a common factor of the gains, which a change of all stiffnesses may be; '' where it is near
    1 or unknown.
    """
    factor = next((m.after for m in moves if m.name == COMMON), 1.0)
    if abs(np.log(factor)) < TOLD:
        return ""
    return (f" The factor {factor:.3g} on the gains of all inputs, as of another sensor or supply, may be the inverse "
            "factor on all stiffnesses: motion without a known load shows both alike.")  # fmt: skip


def mounting_of_earlier(
    earlier: Callable[[], Sequence[Experiment]], fit_alike: Callable[[Experiment], FitResult],
) -> list[dict[str, float]]:
    """Return by how much (SI) the same fit moves the mounting in up to three recordings of the earlier day, by name."""
    moves = []
    for exp in spaced(earlier(), MOST_EARLIER):
        try:
            result = fit_alike(exp)
        except FAILED:  # such as a recording whose first seconds hold no motion
            continue
        moves.append({p.name: p.value - p.prior for p in result.parameters
                      if p.free and of_mounting(p.name) and p.value is not None and p.prior is not None})  # fmt: skip
    return moves


def with_error_of_form(result: FitResult, moves: Sequence[Mapping[str, float]]) -> FitResult:
    """Return the fit of a day whose standard errors include the moves (SI) of the mounting in K earlier recordings: the
    mean square of these moves, for another recording (1 + 1 / K) of it. No prior is left with less certainty than it
    states.
    """
    covariance = result.covariance
    if covariance is None or not moves:
        return result
    names = covariance.names
    away = np.array([[m.get(n, 0.0) for n in names] for m in moves])
    form = (1.0 + 1.0 / len(moves)) * away.T @ away / len(moves)
    priors = {p.name: p.prior_std for p in result.parameters if p.prior_std}
    left = np.array([priors.get(n, np.inf) for n in names]) ** 2 - np.diag(covariance.total)
    size = np.diag(form)
    part = np.sqrt(np.minimum(np.divide(np.maximum(left, 0.0), size, out=np.ones_like(size), where=size > 0), 1.0))
    return with_covariance(result, covariance._replace(
        form=(0.0 if covariance.form is None else covariance.form) + np.outer(part, part) * form))  # fmt: skip


def with_covariance(result: FitResult, covariance: Covariance) -> FitResult:
    """Return a fit with another covariance of its parameters, from which their standard errors follow."""
    doubt = dict(zip(covariance.names, covariance.doubt, strict=True))
    parameters = tuple(p.with_(std=doubt[p.name]) if p.name in doubt else p for p in result.parameters)
    before = result.covariance.note if result.covariance else ""
    notes = tuple(covariance.note if before and note == before else note for note in result.notes)
    return replace(result, covariance=covariance, parameters=parameters, notes=notes)
