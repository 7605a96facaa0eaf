"""`report.html`: the results of a study on one interactive page that needs no other file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pliant.adaptation import Adaptation
from pliant.errors import InputError
from pliant.files import write_text
from pliant.selection import ModelSelection
from pliant.validation.draw import moves_torque
from pliant.validation.metrics import definitions
from pliant.validation.outcome import FitOutcome, Forecast, Headline, RecordOutcome, Shape, StudyOutcome
from pliant.validation.wording import NO_PLACES, ROLE, digits, metric_label
from pliant.view.data import Pack, page_data
from pliant.view.rows import (
    DETAILS,
    PAIRS,
    SINGLE,
    columns,
    correlation_rows,
    detail_row,
    first_records,
    fit_table,
    known_unit,
    link_rows,
    missing_row,
    model_facts,
    not_shown,
    order_rows,
    parameter_row,
    plain_maps,
    points_text,
    record_row,
    selection_rows,
)

ASSETS = Path(__file__).parent / "assets"
SIGNS = {"good": ("✓", "Good"), "beware": ("!", "Caution"), "missed": ("✗", "Missed"), "open": ("?", "Open")}


def write_report(outcome: StudyOutcome, folder: str | Path) -> Path:
    """Write the results of a study as ``report.html`` and return its path.

    Parameters
    ----------
    outcome : StudyOutcome
    folder : str or Path
        Folder for the page, created if it is absent. The page loads nothing from a network.

    Returns
    -------
    Path
        Path of the page. The same outcome gives the same bytes.

    Raises
    ------
    InputError
        When the folder cannot be created or written to.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write into the output folder {folder}: {error.strerror or error}") from None
    return write_text(folder / "report.html", report_page(outcome))


def report_page(outcome: StudyOutcome) -> str:
    """Return the HTML text of the report."""
    pack = Pack()
    data = page_data(outcome, pack)
    filled = content(outcome) | {"every": data["every"]}
    scripts = [asset("uPlot.iife.min.js"), asset("figures.js"), asset("report.js")]
    return template("report.html.j2").render(
        filled, data=script_json(data), block=pack.text(), scripts=scripts,
        styles=[asset("uPlot.min.css"), asset("page.css")],
    )


def template(name: str) -> Any:
    """Return a Jinja template of the page, which escapes user text."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(ASSETS), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(label=metric_label, digits=digits, role=ROLE)
    return environment.get_template(name)


def asset(name: str) -> str:
    """Return the text of a script or style sheet of the page."""
    return (ASSETS / name).read_text(encoding="utf-8")


def script_json(data: Any) -> str:
    """Return `data` as JSON that is safe inside a script element, whatever text it contains."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def content(outcome: StudyOutcome) -> dict[str, Any]:
    """Return everything that the page shows as text and tables."""
    main = sorted(first_records(outcome.fits), key=lambda pair: pair[1].role != "held_out")
    headline = outcome.headline or Headline("open", "There is no verdict; the table of records has the numbers.")
    sign, word = SIGNS[headline.state]
    turns = outcome.turns
    meaning = definitions(turns=turns)
    return {
        "axes": outcome.axes, "in_space": len(outcome.axes) == 3 and not turns, "unit": "°" if turns else "mm",
        "no_places": NO_PLACES if turns else "",
        "worst_record": worst_record(outcome), "outcome": outcome, "headline": headline, "sign": sign, "word": word,
        "records": {
            role: [row for f in outcome.fits for row in (
                *(record_row(f, r) for r in f.records if r.role == role),
                *(missing_row(f, m) for m in f.missing if m.role == role))] for role in ("held_out", "train")
        },
        "details": [detail_row(f, r) for f in outcome.fits for r in f.records], "detail_columns": DETAILS,
        "seen": {r.name: points_text(r) for _, r in main},
        "several": len(outcome.fits) > 1, "plain_maps": plain_maps(outcome.fits),
        "fits": fit_table(outcome.fits, list(outcome.findings)),
        "band_json": script_json({
            f"{k}:{r.name}": band_sentence(f, r) for k, f in enumerate(outcome.fits) for r in f.records
        }),
        "model_selection": selection_block(outcome.model_selection) if outcome.model_selection else None,
        "days": [day_block(a) for a in outcome.adaptations.values()],
        "parameters": [
            (f, [parameter_row(p) for p in f.result.parameters], correlation_rows(f.result)) for f in outcome.fits
        ],
        "unseen": [(f.title, not_shown(f.result)) for f in outcome.fits],
        "shape": shape_block(outcome.shape) if outcome.shape else None,
        "lengthens": bool(outcome.model.extensions),
        "failed": [n.sentence for n in outcome.failed],
        "forecasts": [forecast_block(f) for f in outcome.forecasts],
        "definition": meaning, "definitions": {k: (*metric_label(k), v) for k, v in meaning.items()},
        "pairs": columns(PAIRS, turns=turns), "single": columns(SINGLE, turns=turns), "facts": model_facts(outcome),
        "torque": moves_torque(outcome.fits), "clocks": [clock_title(n, c.delay) for n, c in outcome.clocks.items()],
    }


def worst_record(outcome: StudyOutcome) -> str:
    """Return the words that name the recording with the largest error under the first fit, a held-out one if there
    are any.
    """
    records = outcome.fits[0].records
    candidates = [r for r in records if r.role == "held_out"] or list(records)
    if not candidates:
        return ""
    worst = max(candidates, key=lambda r: r.metrics.get("rmse_percent_of_travel") or 0.0)
    which = "held-out record" if worst.role == "held_out" else "record"
    return f"Look first at {worst.name}, the {which} with the largest error"


def clock_title(name: str, delay: float) -> str:
    """Return the title of a plot: the name of a recording, and by how much its pressure's clock is moved [ms]."""
    return f"{name}: the pressure's clock is moved by {1e3 * delay:+.1f} ms".replace("-", "\N{MINUS SIGN}")


def band_sentence(fit: FitOutcome, record: RecordOutcome) -> str:
    """Return a sentence on the sources of a prediction band and on its coverage; "" if there is no band."""
    covariance = fit.result.covariance
    if record.band is None or covariance is None:
        return ""
    within = digits(record.metrics.get("within_band_percent"), 3, zeros=False)
    return (f"The {100 * record.band.level:g} % band combines the parameters' uncertainty ({covariance.source}) with "
            f"residuals as large as in training; it contains {within} % of the measured coordinates.")


def selection_block(selection: ModelSelection) -> dict[str, Any]:
    """Return the steps of a model selection, and the reason for the choice."""
    return {"reason": selection.reason, "rows": selection_rows(selection)}


def day_block(day: Adaptation) -> dict[str, Any]:
    """Return the verdict on another day, the errors before and after, and what moved, as text."""
    _, factor = day.result.shown_in
    errors = [(e.name, e.role, *(digits(factor * v) for v in (e.before, e.after, e.travel))) for e in day.errors]
    moves = [(m.name, m.belongs, *(digits(v, 4, zeros=False) for v in (m.before, m.after)), digits(m.std, 2),
              digits(m.prior_std, 2), digits(m.moved, 2), m.unit) for m in day.moves]  # fmt: skip
    return {"sentence": day.sentence, "seconds": digits(day.seconds), "errors": errors, "moves": moves}


def shape_block(shape: Shape) -> dict[str, Any]:
    """Return the content of the section on the dense shape: tip, errors of each number of segments, links."""
    notes: Sequence[str] = [shape.tip_status, *shape.order.notes, *shape.links.notes]
    return {
        "name": shape.name, "summary": shape.order.summary(), "notes": [n for n in dict.fromkeys(notes) if n],
        "orders": order_rows(shape), "links": link_rows(shape), "n": shape.links.n,
        "lowest": digits(1e3 * float(np.max(shape.order.max_error[shape.order.orders.index(shape.links.n)])))
        if shape.links.n in shape.order.orders else "",
    }


def forecast_block(forecast: Forecast) -> dict[str, Any]:
    """Return the stated changes and the predicted numbers of a forecast, and what it extrapolates."""
    stated = [(k, digits(v, 5, zeros=False), known_unit(k)) for k, v in forecast.stated.items()]
    half = {k: f" ± {digits(v, 2)}" for k, v in forecast.interval.items()}
    numbers = [(k, *metric_label(k), f"{digits(v, 4)}{half.get(k, '')}") for k, v in forecast.numbers.items()]
    return {"title": forecast.title, "stated": stated, "numbers": numbers, "extrapolates": forecast.extrapolates}
