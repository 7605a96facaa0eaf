"""The verdict: plain sentences with their numbers, held-out records first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pliant.model.section import PLACEMENT, bending_stiffness, joint_placement
from pliant.study.angles import told_of_angles
from pliant.study.schema import Targets
from pliant.validation.outcome import FitOutcome, Forecast, RecordOutcome, StudyOutcome
from pliant.validation.wording import metric_label, sized

LONGER = 2.0  # % of its length: a body that grows by more is said to
SAME = 0.1  # of what the body grows: a model that grows by less does not


def verdict(outcome: StudyOutcome, targets: Targets) -> tuple[str, ...]:
    """Sentences about every fit: held-out records against the targets, then training, then what the fit said."""
    lines = [f"Model selection chose {outcome.model_selection.reason}"] if outcome.model_selection else []
    lines += [outcome.wirings.sentence] if outcome.wirings else []
    for fit in outcome.fits:
        held = [r for r in fit.records if r.role == "held_out"]
        lines += [record_sentence(fit, r, targets) for r in held or fit.records]
        lines += [n.sentence for n in fit.not_computed]
        followed = [r.metrics["rmse_percent_of_travel"] for r in fit.records if r.role == "train"]
        if held and followed:
            worst = max(followed)
            lines.append(f"{fit.title}: the training records are followed to {worst:.1f} % of travel or better.")
        if not fit.result.converged or "bound" in fit.result.status or "do not show" in fit.result.status:
            lines.append(f"{fit.title}: {fit.result.status}")
        lines += [f"{fit.title}: {note}" for note in fit.result.notes if "correlated" not in note]
    lines += [n.sentence for n in outcome.failed]
    for forecast in outcome.forecasts:
        lines.append(forecast_sentence(forecast))
    return (*lines, *told_of_placement(outcome), *told_of_angles(outcome))


def told_of_placement(outcome: StudyOutcome) -> list[str]:
    """Bending stiffness and error of fits whose joints sit in different places; nothing where all sit alike."""
    shown: dict[tuple[str, int], str] = {}
    numbers = {fit.result.model.n for fit in outcome.fits}
    for fit in outcome.fits:
        role = "held_out" if any(r.role == "held_out" for r in fit.records) else "train"
        worst = max((r.metrics["rmse_percent_of_travel"] for r in fit.records if r.role == role), default=None)
        where, section = joint_placement(fit.result.model), float(np.mean(bending_stiffness(fit.result.model)))
        how = "predicted" if role == "held_out" else "followed"
        error = "" if worst is None else f", {how} to {worst:.1f} % of travel"
        links = fit.result.model.n
        count = f"{links} link{'s' * (links > 1)}, " if len(numbers) > 1 else ""
        shown.setdefault((where, links), f"{fit.title}, {count}{PLACEMENT[where]}: EI {section:.3g} N m^2{error}")
    if len(shown) < 2:
        return []
    number = " and how many there are" if len(numbers) > 1 else ""
    return [f"Stiffness depends on where the joints are assumed to sit{number}. {'; '.join(shown.values())}."]


def forecast_sentence(forecast: Forecast) -> str:
    """Return the sentence on a forecast, with the interval that follows from the fit's uncertainty."""
    parts = []
    for key, value in forecast.numbers.items():
        words, unit = metric_label(key)
        half = forecast.interval.get(key)
        about = "" if half is None else f" +- {half:.2g}"
        parts.append(f"{words} {value:.3g}{about} {unit}".rstrip())
    tail = " (95 % from the fit's uncertainty)" if forecast.interval else ""
    return f"Forecast, {forecast.title}: {', '.join(parts)}{tail}."


def record_sentence(fit: FitOutcome, record: RecordOutcome, targets: Targets) -> str:
    """Return how well one record is followed, and which targets it meets."""
    m = record.metrics
    how = "has not been seen by the fit and is predicted" if record.role == "held_out" else "is followed"
    rmse, unit = sized(m, "rmse")
    sentence = (
        f"{fit.title}: record {record.name} {how} to {rmse:.3g} {unit} RMSE, "
        f"{m['rmse_percent_of_travel']:.1f} % of its travel"
    )
    return f"{sentence}{judged(m, targets)}.{unlike(m)}"


def unlike(m: dict[str, Any]) -> str:
    """Return sentences on motions of the recorded body that a model of links cannot make, or cannot be compared by."""
    said = ""
    measured, modelled = m["frequency_hz"]["measured"], m["frequency_hz"]["modelled"]
    if measured is None and sized(m, "steady_state")[0]["measured"] is not None:
        rings = "and so does the model" if modelled is None else f"while the model rings at {modelled:.3g} Hz"
        said = f" It comes to rest without ringing, over-damped, {rings}."
    longer = m.get("extension_percent") or 0.0
    if longer > LONGER:
        said += f" The body lengthens by {m['extension_mm']:.2g} mm ({longer:.1f} %), {by_the_model(m)}."
    return said


def by_the_model(m: dict[str, Any]) -> str:
    """Return the model's lengthening, as the tail of a sentence on the body."""
    longer = m.get("extension_modelled_percent") or 0.0
    if abs(longer) < SAME * m["extension_percent"]:
        return "the model does not"
    return f"the model by {longer:.1f} %"


def ringing(m: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Frequency and damping ratio, of large and of small swings where the record shows both, else of all together.

    One number over both hides a body whose friction or stiffness depends on the amplitude.
    """
    sizes = [s for s in ("large", "small") if m[f"frequency_{s}_hz"]["measured"]]
    if len(sizes) < 2:
        yield "", m["frequency_hz"], m["damping_ratio"]
        return
    for size in sizes:
        yield f" of {size} swings", m[f"frequency_{size}_hz"], m[f"damping_ratio_{size}"]


def judged(m: dict[str, Any], targets: Targets) -> str:
    """The targets and whether the metrics meet them, as the tail of a sentence."""
    parts = []
    if targets.rmse_percent_of_travel is not None:
        good = m["rmse_percent_of_travel"] <= targets.rmse_percent_of_travel
        parts.append(f"target {targets.rmse_percent_of_travel:g} %: {'met' if good else 'missed'}")
    rows = [(frequency, f"frequency{which}", targets.frequency_percent) for which, frequency, _ in ringing(m)]
    rows += [(ratio, f"damping ratio{which}", targets.damping_percent) for which, _, ratio in ringing(m)]
    rows += [(sized(m, "steady_state")[0], "steady state", targets.steady_state_percent)]
    for pair, what, limit in rows:
        measured, modelled = pair["measured"], pair["modelled"]
        if limit is not None and measured:
            if modelled is None:
                parts.append(f"{what}: the model shows none, missed")
                continue
            off = 100 * (modelled / measured - 1)
            good = abs(off) <= limit
            parts.append(f"{what} {off:+.1f} %, target {limit:g} %: {'met' if good else 'missed'}")
    return f" ({'; '.join(parts)})" if parts else ""
