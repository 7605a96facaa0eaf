"""Sentences on the results of a study: the verdict on every fit, and the headline of the report with its warnings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pliant.failures import NotComputed
from pliant.model.summary import PLACEMENT, bending_stiffness, joint_placement
from pliant.study.schema import Targets
from pliant.validation.baseline import better_sentence, plain_map_sentence
from pliant.validation.outcome import FitOutcome, Forecast, Headline, RecordOutcome, StudyOutcome
from pliant.validation.wording import NO_PLACES, metric_label, sized, span

NOT_DETERMINED = (
    "Angles do not determine the mass (which sets the scale of stiffness, damping and torque), the distribution of the "
    "stiffness along the body, or positions: forces and positions of the model depend on the stated mass and length."
)
LONGER = 2.0  # % of the body's length: a larger extension is reported
STATIONS_LINE = "The line through the stations"
SAME = 0.1  # of the body's extension: a smaller extension of the model counts as none
UNSAID = ("correlated", "Standard errors come from")  # mark notes on standard errors, which stand beside these alone
WEAK = "weakly determined"  # marks notes on weakly determined parameters
OF_ERRORS = (*UNSAID, "integration step")  # mark notes on standard errors, which the summary does not list
NEARLY = 75.0  # % of peak displacement: a model that misses by this much somewhere meets no target
FAR = 10.0  # % of peak displacement: a larger error of any point is a warning
OVERSHOOT = 5.0  # percentage points: a larger error of the overshoot is a warning
OFF = 10.0  # %: a larger error of a frequency is a warning
DAMPED = 25.0  # %: a larger error of a damping ratio is a warning
STEADY = 5.0  # % of peak displacement: a larger error of the steady state is a warning
WORTH_NAMING = 0.5  # fraction of its warning limit from which the largest deviation is named
COVERED = 80.0  # %: a smaller coverage of the 95 % band is a warning


def verdict(outcome: StudyOutcome, targets: Targets) -> tuple[str, ...]:
    """Return the sentences of the verdict: for each fit the errors on held-out recordings compared with the targets,
    the training error and notes; then sentences on failures and forecasts.
    """
    lines = [f"Model selection chose {outcome.model_selection.reason}."] if outcome.model_selection else []
    lines += [outcome.wirings.sentence] if outcome.wirings else []
    lines = [*better_map(outcome.fits[0]), *lines]
    for fit in outcome.fits:
        held_out = [r for r in fit.records if r.role == "held_out"]
        lines += better_map(fit) if fit is not outcome.fits[0] else []
        lines += [record_sentence(fit, r, targets) for r in held_out or fit.records]
        lines += [f"{fit.title}: {s}" for s in [plain_map_sentence(fit)] if s]
        lines += [n.sentence for n in fit.not_computed]
        followed = [r.metrics["rmse_percent_of_travel"] for r in fit.records if r.role == "train"]
        if held_out and followed:
            worst = max(followed)
            lines.append(f"{fit.title}: training error at most {worst:.1f} % of the peak displacement (RMS).")
        if not fit.result.converged or "bound" in fit.result.status or "do not show" in fit.result.status:
            lines.append(f"{fit.title}: {fit.result.status}")
        lines += [f"{fit.title}: {note}" for note in fit.result.notes
                  if not any(mark in note for mark in UNSAID)]
    lines += dict.fromkeys(note for fit in outcome.fits if fit.baseline for note in fit.baseline.notes)
    lines += [*doubts_on_other_fits(outcome), *(n.sentence for n in outcome.failed)]
    for forecast in outcome.forecasts:
        lines.append(forecast_sentence(forecast))
    return (*lines, *placement_sentences(outcome), *angles_sentences(outcome))


def better_map(fit: FitOutcome) -> list[str]:
    """Return two sentences where a plain map predicts held-out recordings better than the model: which recordings, and
    what the model's residual there suggests; empty elsewhere.
    """
    sentence = better_sentence(fit)
    return [f"{fit.title}: {sentence} {fit.baseline.suggestion}"] if fit.baseline and sentence else []


def angles_sentences(outcome: StudyOutcome) -> list[str]:
    """Return the report's sentences on recordings that hold angles alone; empty if positions were recorded."""
    if not outcome.turns:
        return []
    angles = max(len(r.experiment.stations) for f in outcome.fits for r in f.records)
    links = outcome.model.n
    supports = f"{angles} measured angles determine {angles} links" if angles > 1 else "One angle determines one link"
    has = "as many as the chain has" if links == angles else f"the chain has {links}, as stated"
    if links > angles:
        has += ": their motion between the angles is not measured"
    return [NO_PLACES, f"{supports}, {has}.", NOT_DETERMINED]


def placement_sentences(outcome: StudyOutcome) -> list[str]:
    """Return a list with one sentence that compares fits with different joint placements or numbers of links. It is
    empty if these do not differ.
    """
    lines: dict[tuple[str, int], str] = {}
    numbers = {fit.result.model.n for fit in outcome.fits}
    for fit in outcome.fits:
        role = "held_out" if any(r.role == "held_out" for r in fit.records) else "train"
        worst = max((r.metrics["rmse_percent_of_travel"] for r in fit.records if r.role == role), default=None)
        where, section = joint_placement(fit.result.model), float(np.mean(bending_stiffness(fit.result.model)))
        how = "prediction error" if role == "held_out" else "training error"
        error = "" if worst is None else f", {how} {worst:.1f} % of the peak displacement"
        links = fit.result.model.n
        count = f"{links} link{'s' * (links > 1)}, " if len(numbers) > 1 else ""
        lines.setdefault((where, links), f"{fit.title}, {count}{PLACEMENT[where]}: EI {section:.3g} N m^2{error}")
    if len(lines) < 2:
        return []
    number = " and their number" if len(numbers) > 1 else ""
    return [f"Stiffness depends on the assumed positions of the joints{number}. {'; '.join(lines.values())}."]


def forecast_sentence(forecast: Forecast) -> str:
    """Return a sentence with the predicted numbers of a forecast and their 95 % intervals, which come from the fit's
    uncertainty, and one on what it extrapolates.
    """
    parts = []
    for key, value in forecast.numbers.items():
        words, unit = metric_label(key)
        half = forecast.interval.get(key)
        about = "" if half is None else f" +- {half:.2g}"
        parts.append(f"{words} {value:.3g}{about} {unit}".rstrip())
    tail = " (95 % intervals from the fit's uncertainty)" if forecast.interval else ""
    beyond = f" It {extrapolated(forecast)}" if forecast.extrapolates else ""
    return f"Forecast, {forecast.title}: {', '.join(parts)}{tail}.{beyond}"


def extrapolated(forecast: Forecast) -> str:
    """Return the end of a sentence on what a forecast extrapolates."""
    return f"extrapolates {'; '.join(forecast.extrapolates)}."


def record_sentence(fit: FitOutcome, record: RecordOutcome, targets: Targets) -> str:
    """Return the sentence on the model's error for one recording, and on the targets that it meets."""
    m = record.metrics
    record_of, how = ("held-out", "predicted") if record.role == "held_out" else ("training", "fitted")
    rmse, unit = sized(m, "rmse")
    sentence = (
        f"{fit.title}: {record_of} record {record.name} is {how} with an RMS error of {rmse:.3g} {unit}, "
        f"{m['rmse_percent_of_travel']:.1f} % of its peak displacement"
    )
    return f"{sentence}{judged(m, targets)}.{unlike(m)}"


def unlike(m: dict[str, Any]) -> str:
    """Return sentences on two properties that the error metrics do not show: a motion without oscillation, and a line
    through the stations that lengthens.
    """
    sentences = ""
    measured, modelled = m["frequency_hz"]["measured"], m["frequency_hz"]["modelled"]
    if measured is None and sized(m, "steady_state")[0]["measured"] is not None:
        rings = "as does the model" if modelled is None else f"while the model oscillates at {modelled:.3g} Hz"
        sentences = f" The body comes to rest without oscillation, {rings}."
    longer = m.get("extension_percent") or 0.0
    if longer > LONGER:
        sentences += f" {STATIONS_LINE} lengthens by {m['extension_mm']:.2g} mm ({longer:.1f} %), {by_the_model(m)}."
    return sentences


def by_the_model(m: dict[str, Any]) -> str:
    """Return the end of a sentence on the measured lengthening of the line through the stations. It says by how much
    that of the model lengthens. Stations beside the axis lengthen the line of a body that bends and does not lengthen.
    """
    longer = m.get("extension_modelled_percent") or 0.0
    if abs(longer) < SAME * m["extension_percent"]:
        return "in the model it does not: the body lengthens, or stations lie beside its axis"
    return f"in the model by {longer:.1f} %"


def ringing(m: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Yield (suffix, frequency, damping ratio) once for large and once for small swings, or once for all swings
    together. The suffix names the swings, as " of large swings". Frequency and damping ratio are each a measured and a
    modelled value.

    Large and small swings are separate if the recording shows both. One number for both would hide that friction or
    stiffness depends on the amplitude.
    """
    sizes = [s for s in ("large", "small") if m[f"frequency_{s}_hz"]["measured"]]
    if len(sizes) < 2:
        yield "", m["frequency_hz"], m["damping_ratio"]
        return
    for size in sizes:
        yield f" of {size} swings", m[f"frequency_{size}_hz"], m[f"damping_ratio_{size}"]


def judged(m: dict[str, Any], targets: Targets) -> str:
    """Return the end of a sentence that says which targets the metrics of a recording meet and which they miss; ""
    without targets.

    A model at rest is off by the whole peak displacement, however short the motion is. So a recording misses its
    targets where the largest error is at least three quarters of the peak displacement.
    """
    parts = []
    near = nearly_all(m)
    if targets.rmse_percent_of_travel is not None:
        good = m["rmse_percent_of_travel"] <= targets.rmse_percent_of_travel and not near
        parts.append(f"target {targets.rmse_percent_of_travel:g} %: {'met' if good else 'missed'}")
    rows = [(frequency, f"frequency{which}", targets.frequency_percent) for which, frequency, _ in ringing(m)]
    rows += [(ratio, f"damping ratio{which}", targets.damping_percent) for which, _, ratio in ringing(m)]
    rows += [(sized(m, "steady_state")[0], "steady state", targets.steady_state_percent)]
    for pair, what, limit in rows:
        measured, modelled = pair["measured"], pair["modelled"]
        if limit is not None and measured:
            if modelled is None:
                parts.append(f"no {what} in the model: missed")
                continue
            off = 100 * (modelled / measured - 1)
            good = abs(off) <= limit
            parts.append(f"{what} {off:+.1f} %, target {limit:g} %: {'met' if good else 'missed'}")
    if parts and near:
        parts.append(f"{near}: missed")
    return f" ({'; '.join(parts)})" if parts else ""


def nearly_all(m: dict[str, Any]) -> str:
    """Return how large the largest error is, if it is at least `NEARLY` of the peak displacement; else ""."""
    (travel, _), (most, unit) = (sized(m, k) for k in ("travel", "max"))
    if not travel or not most or 100 * most < NEARLY * travel:
        return ""
    return f"the largest error, {most:.3g} {unit}, is {100 * most / travel:.0f} % of the peak displacement"


def headline(outcome: StudyOutcome, targets: Targets) -> Headline:
    """Return the headline of the report: sentences and warnings on the first fit, what forecasts extrapolate, and a
    state. The state is "missed" if
    a target is missed, "beware" if there are warnings, "good" if all targets are met, or "open" if no target is stated.
    """
    fit = outcome.fits[0]
    held_out = [r for r in fit.records if r.role == "held_out"]
    lost = [m for m in fit.missing if m.role == "held_out"]
    records = [] if lost and not held_out else held_out or list(fit.records)
    verdicts = [judged(r.metrics, targets) for r in records]
    plain = better_sentence(fit)
    notes = [*([fit.baseline.suggestion] if plain and fit.baseline else []),
             *fit_warnings(fit, held=bool(held_out or lost), chosen=of_selection(outcome, fit)),
             *(w for r in records for w in record_warnings(r))]
    other = doubts_on_other_fits(outcome)
    doubts = [d for d in outcome.doubts if d not in other]
    warnings = tuple(dict.fromkeys([*failure_warnings(outcome), *doubts, *notes]))
    if any("missed" in v for v in verdicts) or (lost and targets != Targets()):
        state = "missed"
    elif warnings:
        state = "beware"
    else:
        state = "good" if any(verdicts) else "open"
    verdicts += ["missed"] * (len(lost) if targets != Targets() else 0)
    sentences = [plain] if plain else []
    model = f"The model of the fit {fit.title}" if len(outcome.fits) > 1 else "The model"
    sentences += [sentence(model, records, held=bool(held_out)) + largest_shortfall(records)] if records else []
    sentences += [lost_sentence(lost)] if lost else []
    beyond = tuple(f"Forecast, {f.title}: it {extrapolated(f)}" for f in outcome.forecasts if f.extrapolates)
    spoken = " ".join([*sentences, target_sentence(verdicts)])
    return Headline(state, spoken, (*warnings, *beyond))  # type: ignore[arg-type]


def doubts_on_other_fits(outcome: StudyOutcome) -> tuple[str, ...]:
    """Return the warnings that are about a fit other than the first: they do not concern the headline's model."""
    first, *others = (f"{f.title}: " for f in outcome.fits)
    kept = (first, *(f"{r.name}: " for f in outcome.fits for r in f.records))
    return tuple(d for d in outcome.doubts if d.startswith(tuple(others)) and not d.startswith(kept))


def of_selection(outcome: StudyOutcome, fit: FitOutcome) -> bool:
    """Return whether a fit is the result of the model selection."""
    return outcome.model_selection is not None and fit.name == "model_selection"


def lost_sentence(lost: Sequence[NotComputed]) -> str:
    """Return a sentence that names the held-out recordings which the fit could not predict."""
    names = ", ".join(m.record for m in lost)
    return f"Held-out record{'s' * (len(lost) > 1)} {names} could not be predicted."


def failure_warnings(outcome: StudyOutcome) -> Iterator[str]:
    """Yield a warning for each result of the first fit and of the whole study that could not be computed. One more
    warning states how many results of the other fits are missing.
    """
    yield from (n.sentence for n in (*outcome.failed, *outcome.fits[0].not_computed))
    if others := sum(len(f.not_computed) for f in outcome.fits[1:]):
        yield f"{others} prediction(s) or band(s) of the other fits could not be computed; the full verdict lists them."


def sentence(model: str, shown: Sequence[RecordOutcome], *, held: bool) -> str:
    """Return a sentence with the RMS error of the model on the recordings, as a range if there are several. It begins
    with `model`, which names the fit if there are several.
    """
    share = sorted(r.metrics["rmse_percent_of_travel"] for r in shown)
    error, (_, unit) = sorted(sized(r.metrics, "rmse")[0] for r in shown), sized(shown[0].metrics, "rmse")
    verb, role = ("predicts", "held-out") if held else ("fits", "training")
    which = f"{len(shown)} {role} records" if len(shown) > 1 else f"the {role} record {shown[0].name}"
    percent = span(share[0], share[-1], ".1f")
    return (f"{model} {verb} {which} with an RMS error of {percent} % of the peak displacement "
            f"({span(error[0], error[-1])} {unit}).")


def target_sentence(verdicts: Sequence[str]) -> str:
    """Return a sentence that says how many of the recordings meet the study's targets."""
    if not any(verdicts):
        return "The study states no target."
    count = sum(bool(v) and "missed" not in v for v in verdicts)
    if count == len(verdicts):
        return "The targets are met." if len(verdicts) > 1 else "The target is met."
    return f"Targets are met by {count} of {len(verdicts)} records." if len(verdicts) > 1 else "The target is missed."


def fit_warnings(fit: FitOutcome, *, held: bool, chosen: bool = False) -> Iterator[str]:
    """Yield the warnings about a fit as a whole, not about single recordings.

    The terms of a `chosen` model improve its predictions although a parameter may be weakly determined: the full
    verdict alone names it.
    """
    if not held:
        yield "No record is held out: this shows that the model can fit the recordings, not that it predicts others."
    if not fit.result.converged or "bound" in fit.result.status or "do not show" in fit.result.status:
        yield fit.result.status
    unsaid = (*OF_ERRORS, WEAK) if chosen else OF_ERRORS
    yield from (note for note in fit.result.notes if not any(word in note for word in unsaid))


def record_warnings(record: RecordOutcome) -> Iterator[str]:
    """Yield a sentence for each deviation of the model from a recording that exceeds its warning limit."""
    yield from (sentence for size, sentence in shortfalls(record) if size > 1.0)


def largest_shortfall(shown: Sequence[RecordOutcome]) -> str:
    """Return a sentence on the model's largest deviation from the recordings; "" if it is small. Deviations are
    compared relative to their warning limits, and one below half of its limit is small.
    """
    large = [shortfall for r in shown for shortfall in shortfalls(r) if shortfall[0] > WORTH_NAMING]
    return f" Largest deviation: {max(large)[1]}" if large else ""


def shortfalls(record: RecordOutcome) -> Iterator[tuple[float, str]]:
    """Yield (size, sentence) for each deviation of the model from a recording. The size is the deviation divided by the
    limit beyond which the report warns.
    """
    m, name = record.metrics, record.name
    (travel, unit), (most, _), (steady, _) = (sized(m, k) for k in ("travel", "max", "steady_state_error"))
    far = 100 * most / travel
    yield far / FAR, f"{name}: the largest error is {most:.2g} {unit}, {far:.0f} % of the peak displacement."
    measured, modelled = m["overshoot_percent"]["measured"], m["overshoot_percent"]["modelled"]
    if measured is not None:
        off = (modelled or 0.0) - measured
        yield (abs(off) / OVERSHOOT,
               f"{name}: model overshoot {off:+.0f} percentage points relative to measured {measured:.0f} %.")
    measured, modelled = m["frequency_hz"]["measured"], m["frequency_hz"]["modelled"]
    if (measured is None) != (modelled is None):
        rings = (f"the body oscillates at {measured:.3g} Hz, the model does not oscillate." if measured is not None
                 else f"the model oscillates at {modelled:.3g} Hz, the body does not oscillate.")
        yield 2.0, f"{name}: {rings}"
    elif measured:
        yield from ringing_shortfalls(m, name)
    if steady is not None:
        share = 100 * abs(steady) / travel
        off_by = f"{steady:+.2g} {unit}, {share:.0f} % of the peak displacement"
        yield share / STEADY, f"{name}: the steady state of the model is off by {off_by}."
    coverage = m.get("within_band_percent", 95.0)
    within = f"the 95 % prediction band contains only {coverage:.0f} % of the measured values"
    yield (95.0 - coverage) / (95.0 - COVERED), f"{name}: {within}."
    longer = m.get("extension_percent") or 0.0
    if longer > 0:
        shorter = abs(longer - (m.get("extension_modelled_percent") or 0.0))
        line = STATIONS_LINE[0].lower() + STATIONS_LINE[1:]
        yield shorter / LONGER, f"{name}: {line} lengthens by {longer:.1f} %, {by_the_model(m)}."


def ringing_shortfalls(m: dict[str, Any], name: str) -> Iterator[tuple[float, str]]:
    """Yield (size, sentence) for the model's deviations in frequency and damping ratio from a recording. The size is
    the deviation divided by the limit beyond which the report warns.

    Large and small swings are compared separately where both are known.
    """
    for which, frequency, ratio in ringing(m):
        for what, pair, limit, unit in (("frequency", frequency, OFF, " Hz"), ("damping ratio", ratio, DAMPED, "")):
            measured, modelled = pair["measured"], pair["modelled"]
            if measured and modelled:
                off = 100 * (modelled / measured - 1)
                digits = f"{measured:.3g}" if unit else f"{measured:.2g}"
                yield abs(off) / limit, f"{name}: model {what}{which} {off:+.0f} % relative to measured {digits}{unit}."
