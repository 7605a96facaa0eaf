"""The verdict of a study: sentences on each fit with their numbers, held-out recordings first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pliant.model.section import PLACEMENT, bending_stiffness, joint_placement
from pliant.study.angles import told_of_angles
from pliant.study.schema import Targets
from pliant.validation.outcome import FitOutcome, Forecast, RecordOutcome, StudyOutcome
from pliant.validation.wording import metric_label, sized

LONGER = 2.0  # % of the body's length: a larger extension is reported
SAME = 0.1  # of the body's extension: a smaller extension of the model counts as none


def verdict(outcome: StudyOutcome, targets: Targets) -> tuple[str, ...]:
    """Return sentences on every fit: held-out recordings against the targets, training recordings, then notes."""
    lines = [f"Model selection chose {outcome.model_selection.reason}"] if outcome.model_selection else []
    lines += [outcome.wirings.sentence] if outcome.wirings else []
    for fit in outcome.fits:
        held = [r for r in fit.records if r.role == "held_out"]
        lines += [record_sentence(fit, r, targets) for r in held or fit.records]
        lines += [n.sentence for n in fit.not_computed]
        followed = [r.metrics["rmse_percent_of_travel"] for r in fit.records if r.role == "train"]
        if held and followed:
            worst = max(followed)
            lines.append(f"{fit.title}: training error at most {worst:.1f} % of the peak displacement (RMS).")
        if not fit.result.converged or "bound" in fit.result.status or "do not show" in fit.result.status:
            lines.append(f"{fit.title}: {fit.result.status}")
        lines += [f"{fit.title}: {note}" for note in fit.result.notes if "correlated" not in note]
    lines += [n.sentence for n in outcome.failed]
    for forecast in outcome.forecasts:
        lines.append(forecast_sentence(forecast))
    return (*lines, *told_of_placement(outcome), *told_of_angles(outcome))


def told_of_placement(outcome: StudyOutcome) -> list[str]:
    """Return a sentence that compares fits with different joint placements or numbers of links; empty if
    all are alike.
    """
    shown: dict[tuple[str, int], str] = {}
    numbers = {fit.result.model.n for fit in outcome.fits}
    for fit in outcome.fits:
        role = "held_out" if any(r.role == "held_out" for r in fit.records) else "train"
        worst = max((r.metrics["rmse_percent_of_travel"] for r in fit.records if r.role == role), default=None)
        where, section = joint_placement(fit.result.model), float(np.mean(bending_stiffness(fit.result.model)))
        how = "prediction error" if role == "held_out" else "training error"
        error = "" if worst is None else f", {how} {worst:.1f} % of the peak displacement"
        links = fit.result.model.n
        count = f"{links} link{'s' * (links > 1)}, " if len(numbers) > 1 else ""
        shown.setdefault((where, links), f"{fit.title}, {count}{PLACEMENT[where]}: EI {section:.3g} N m^2{error}")
    if len(shown) < 2:
        return []
    number = " and their number" if len(numbers) > 1 else ""
    return [f"Stiffness depends on the assumed positions of the joints{number}. {'; '.join(shown.values())}."]


def forecast_sentence(forecast: Forecast) -> str:
    """Return the sentence on a forecast: its numbers, with 95 % intervals from the fit's uncertainty."""
    parts = []
    for key, value in forecast.numbers.items():
        words, unit = metric_label(key)
        half = forecast.interval.get(key)
        about = "" if half is None else f" +- {half:.2g}"
        parts.append(f"{words} {value:.3g}{about} {unit}".rstrip())
    tail = " (95 % intervals from the fit's uncertainty)" if forecast.interval else ""
    return f"Forecast, {forecast.title}: {', '.join(parts)}{tail}."


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
    """Return sentences on missing oscillation and on lengthening of the body, which the error metrics do not show."""
    sentences = ""
    measured, modelled = m["frequency_hz"]["measured"], m["frequency_hz"]["modelled"]
    if measured is None and sized(m, "steady_state")[0]["measured"] is not None:
        rings = "as does the model" if modelled is None else f"while the model oscillates at {modelled:.3g} Hz"
        sentences = f" The body comes to rest without oscillation, {rings}."
    longer = m.get("extension_percent") or 0.0
    if longer > LONGER:
        sentences += f" The body lengthens by {m['extension_mm']:.2g} mm ({longer:.1f} %), {by_the_model(m)}."
    return sentences


def by_the_model(m: dict[str, Any]) -> str:
    """Return the model's lengthening as the end of a sentence on the body's lengthening."""
    longer = m.get("extension_modelled_percent") or 0.0
    if abs(longer) < SAME * m["extension_percent"]:
        return "the model does not"
    return f"the model by {longer:.1f} %"


def ringing(m: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Yield (suffix, frequency, damping ratio) of large and of small swings, or of all swings together.

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
    """Return the targets and whether the metrics meet them, as the end of a sentence; "" without targets."""
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
                parts.append(f"no {what} in the model: missed")
                continue
            off = 100 * (modelled / measured - 1)
            good = abs(off) <= limit
            parts.append(f"{what} {off:+.1f} %, target {limit:g} %: {'met' if good else 'missed'}")
    return f" ({'; '.join(parts)})" if parts else ""
