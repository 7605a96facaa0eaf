"""The headline of a study's report: how well the first fit predicts, and the warnings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from pliant.failures import NotComputed
from pliant.study.schema import Targets
from pliant.study.verdict import LONGER, by_the_model, judged, ringing
from pliant.validation.outcome import FitOutcome, Headline, RecordOutcome, StudyOutcome
from pliant.validation.wording import sized

OF_ERRORS = ("correlated", "integration step")  # mark notes on standard errors, which only the full verdict lists
FAR = 10.0  # % of peak displacement: a larger error of any point is a warning
OVERSHOOT = 5.0  # percentage points: a larger error of the overshoot is a warning
OFF = 10.0  # %: a larger error of a frequency is a warning
DAMPED = 25.0  # %: a larger error of a damping ratio is a warning
STEADY = 5.0  # % of peak displacement: a larger error of the steady state is a warning
WORTH_NAMING = 0.5  # fraction of its warning limit from which the largest deviation is named
COVERED = 80.0  # %: a smaller coverage of the 95 % band is a warning


def headline(outcome: StudyOutcome, targets: Targets) -> Headline:
    """Return the state, sentences and warnings of the first fit, judged by its held-out recordings if it has any."""
    fit = outcome.fits[0]
    held = [r for r in fit.records if r.role == "held_out"]
    lost = [m for m in fit.missing if m.role == "held_out"]
    shown = [] if lost and not held else held or list(fit.records)
    verdicts = [judged(r.metrics, targets) for r in shown]
    own = [*fit_warnings(fit, held=bool(held or lost)), *(w for r in shown for w in record_warnings(r))]
    warnings = tuple(dict.fromkeys([*failure_warnings(outcome), *outcome.doubts, *own]))
    if any("missed" in v for v in verdicts) or (lost and targets != Targets()):
        state = "missed"
    elif warnings:
        state = "beware"
    else:
        state = "good" if any(verdicts) else "open"
    verdicts += ["missed"] * (len(lost) if targets != Targets() else 0)
    said = [sentence(shown, held=bool(held)) + largest_shortfall(shown)] if shown else []
    said += [lost_sentence(lost)] if lost else []
    return Headline(state, " ".join([*said, target_sentence(verdicts)]), warnings)  # type: ignore[arg-type]


def lost_sentence(lost: Sequence[NotComputed]) -> str:
    """Return a sentence that names the held-out recordings which the fit could not predict."""
    names = ", ".join(m.record for m in lost)
    return f"Held-out record{'s' * (len(lost) > 1)} {names} could not be predicted."


def failure_warnings(outcome: StudyOutcome) -> Iterator[str]:
    """Yield warnings on results of the first fit and the study that could not be computed, and a count for
    other fits.
    """
    yield from (n.sentence for n in (*outcome.failed, *outcome.fits[0].not_computed))
    if others := sum(len(f.not_computed) for f in outcome.fits[1:]):
        yield f"{others} prediction(s) or band(s) of the other fits could not be computed; the full verdict lists them."


def sentence(shown: Sequence[RecordOutcome], *, held: bool) -> str:
    """Return a sentence with the RMS error of the recordings, as a range if there are several."""
    share = sorted(r.metrics["rmse_percent_of_travel"] for r in shown)
    error, (_, unit) = sorted(sized(r.metrics, "rmse")[0] for r in shown), sized(shown[0].metrics, "rmse")
    many = len(shown) > 1
    verb, role = ("predicts", "held-out") if held else ("fits", "training")
    which = f"{len(shown)} {role} records" if many else f"the {role} record {shown[0].name}"
    to = f"{share[0]:.1f} to {share[-1]:.1f}" if many else f"{share[0]:.1f}"
    size = f"{error[0]:.2g} to {error[-1]:.2g}" if many else f"{error[0]:.2g}"
    return f"The model {verb} {which} with an RMS error of {to} % of the peak displacement ({size} {unit})."


def target_sentence(verdicts: Sequence[str]) -> str:
    """Return a sentence that says how many of the recordings meet the study's targets."""
    if not any(verdicts):
        return "The study states no target."
    met = sum(bool(v) and "missed" not in v for v in verdicts)
    if met == len(verdicts):
        return "The targets are met." if len(verdicts) > 1 else "The target is met."
    return f"The targets are met by {met} of {len(verdicts)}." if len(verdicts) > 1 else "The target is missed."


def fit_warnings(fit: FitOutcome, *, held: bool) -> Iterator[str]:
    """Yield the warnings about the fit itself, not about single recordings."""
    if not held:
        yield "No record is held out: this shows that the model can fit the recordings, not that it predicts others."
    if not fit.result.converged or "bound" in fit.result.status or "do not show" in fit.result.status:
        yield fit.result.status
    yield from (note for note in fit.result.notes if not any(word in note for word in OF_ERRORS))


def record_warnings(record: RecordOutcome) -> Iterator[str]:
    """Yield a sentence for each deviation of the model from a recording that exceeds its warning limit."""
    yield from (sentence for size, sentence in shortfalls(record) if size > 1.0)


def largest_shortfall(shown: Sequence[RecordOutcome]) -> str:
    """Return a sentence on the largest deviation relative to its warning limit; "" if none exceeds half of
    its limit.
    """
    found = [one for r in shown for one in shortfalls(r) if one[0] > WORTH_NAMING]
    return f" Largest deviation: {max(found)[1]}" if found else ""


def shortfalls(record: RecordOutcome) -> Iterator[tuple[float, str]]:
    """Yield each deviation of the model from the recording as (fraction of its warning limit, sentence)."""
    m, name = record.metrics, record.name
    (travel, unit), (most, _), (steady, _) = (sized(m, k) for k in ("travel", "max", "steady_state_error"))
    far = 100 * most / travel
    yield far / FAR, f"{name}: the largest error is {most:.2g} {unit}, {far:.0f} % of the peak displacement."
    measured, modelled = m["overshoot_percent"]["measured"], m["overshoot_percent"]["modelled"]
    if measured is not None:
        off = (modelled or 0.0) - measured
        yield abs(off) / OVERSHOOT, f"{name}: model overshoot {off:+.0f} points relative to measured {measured:.0f} %."
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
    held = m.get("within_band_percent", 95.0)
    within = f"the 95 % prediction band contains only {held:.0f} % of the measured values"
    yield (95.0 - held) / (95.0 - COVERED), f"{name}: {within}."
    longer = m.get("extension_percent") or 0.0
    if longer > 0:
        shorter = abs(longer - (m.get("extension_modelled_percent") or 0.0))
        yield shorter / LONGER, f"{name}: the body lengthens by {longer:.1f} %, {by_the_model(m)}."


def ringing_shortfalls(m: dict[str, Any], name: str) -> Iterator[tuple[float, str]]:
    """Yield the deviations of frequency and damping ratio as (fraction of warning limit, sentence).

    Large and small swings are compared separately where both are known.
    """
    for which, frequency, ratio in ringing(m):
        for what, pair, limit, unit in (("frequency", frequency, OFF, " Hz"), ("damping ratio", ratio, DAMPED, "")):
            measured, modelled = pair["measured"], pair["modelled"]
            if measured and modelled:
                off = 100 * (modelled / measured - 1)
                digits = f"{measured:.3g}" if unit else f"{measured:.2g}"
                yield abs(off) / limit, f"{name}: model {what}{which} {off:+.0f} % relative to measured {digits}{unit}."
